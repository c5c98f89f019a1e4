"""The bracket: nothing beats the bound, the recursion solves cases with a closed form, plans are kept on disk."""

import dataclasses
import math

import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce, NetForce
from agents.evaluation.evaluator import evaluate
from agents.par import dynamic_programming as dp
from agents.par.bound import Fastest, least_time
from agents.par.bracket import Bracket, bracket, least_times, main, nominal
from agents.par.cache import Cache, default_folder
from agents.par.planner import best_plans
from agents.par.refinement import Refinement, refine
from agents.par.seeds import by_controller
from agents.par.starts import FAILED, Starts, Trials, actions_of, commands_of, judged
from magwire_env import Scenario
from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.quasistatic.pool import scenario_pool

STEER = "MagWire/Steer-v0"
QUICK = Refinement(samples=8, rounds=4)


def begun(task=STEER, n=8, seed=1_000_000, **settings):
    env = MagWireVectorEnv(n, task, **settings)
    env.reset(seed=seed, options=settings.pop("options", None))
    return Starts.of(env.core, np.arange(n))


# --- the lower bound --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", ["paper", "soft", "any"])
def test_the_bound_is_below_every_policy_random_and_good(scenario):
    made = {
        "paper": [Scenario.paper()] * 12,
        "soft": [Scenario.paper().replace(wire__bending_modulus=55e3, contact__friction=0.0)] * 12,
        "any": list(scenario_pool("SteerAny", "test", 12)),
    }[scenario]
    starts = begun(n=12, scenario=made)
    least = least_times(starts)
    assert (least > 0.5).all()
    rng, trials, rows = np.random.default_rng(0), Trials(starts), np.arange(12)
    plans = best_plans(starts, QUICK).actions
    for size in (0.0, 0.01, 0.02, 0.04, 0.06, 0.1, 0.2, 0.3):
        noise = np.repeat(rng.normal(size=(12, starts.step_limit // 10, 1)), 10, axis=1)
        tried = plans.copy()
        tried[:, : noise.shape[1]] += (size * noise).astype(np.float32)
        assert (trials.run(rows, np.clip(tried, -1.0, 1.0)).value > least).all()


def test_on_the_way_the_tip_is_never_ahead_of_the_bound():
    """Every place passed is a goal of its own, from random angles under random commands and good ones."""
    scenario = Scenario.paper()
    starts = begun(n=12, scenario=scenario)
    fastest, trials, rows = Fastest(scenario), Trials(starts), np.arange(12)
    hold = np.random.default_rng(1).uniform(-1, 1, (12, 8, 1)).astype(np.float32).repeat(10, axis=1)
    for actions in (hold, best_plans(starts, QUICK).actions[:, :80]):
        tip = np.column_stack([trials.run(rows, actions[:, : k + 1]).tip[:, -1] for k in range(0, 80, 8)])
        for i in rows:
            ahead = np.maximum.accumulate(tip[i])
            for k in np.flatnonzero((np.diff(ahead) > 1e-3) & (ahead[1:] < 0.79)) + 1:
                time = 8 * k * starts.period
                assert fastest.least(float(starts.tip[i]), float(ahead[k]), float(starts.magnet[i, 0])) < time


def test_the_bound_grows_with_the_way_and_knows_the_magnets_angle():
    fastest = Fastest(Scenario.paper())
    times = [fastest.least(0.1, goal) for goal in (0.2, 0.4, 0.6, 0.79)]
    assert (np.diff(times) > 0.5).all()
    best = float(fastest.commands[100, 0])
    assert fastest.least(0.1, 0.79, best) == pytest.approx(times[-1], abs=0.02)
    assert fastest.least(0.1, 0.79, best + math.pi) > times[-1] + 0.3
    assert least_time(Scenario.paper(), 0.7, 0.3, direction=-1) > 1.0


def test_bad_ways_are_named():
    for arguments, name in (
        ((0.1, 0.05), "goal"),
        ((-0.1, 0.5), "start"),
        ((0.1, 5.0), "goal"),
        ((0.1, 0.7, 2), "direc"),
    ):
        with pytest.raises(ValueError, match=name):
            least_time(Scenario.paper(), *arguments)


# --- the recursion ----------------------------------------------------------------------------------------------------


def test_at_a_constant_speed_time_is_the_way_over_it():
    speed = np.full((101, 40), 0.1)
    values = dp.to_the_end(dp.moves(speed, 0.005, 2.0, 0.1), 0.005, 0.5, 2.0, 0.1, 100, 1e-9)
    place = 0.005 * np.arange(len(values))
    assert values == pytest.approx(np.broadcast_to(((0.5 - place) / 0.1)[:, None], values.shape), abs=1e-9)


def test_a_magnet_that_must_first_turn_takes_its_servos_time():
    """The wire moves, at 0.1 m/s, in a quarter of the angles; from opposite the servo needs 3/8 of a turn to there."""
    columns = 80
    speed = np.zeros((101, columns))
    speed[:, columns // 2 - 10 : columns // 2 + 11] = 0.1
    values = dp.to_the_end(dp.moves(speed, 0.005, 4.0, 0.1), 0.005, 0.5, 4.0, 0.1, 200, 1e-9)
    turning = 0.1 * 30 / 4.0
    assert values[0, columns // 2] == pytest.approx(5.0, abs=1e-6)
    assert values[0, 0] == pytest.approx(5.0 + turning, abs=0.1)
    assert (np.diff(values[:, columns // 2]) < 1e-12).all()


def test_a_target_takes_the_way_and_the_hold():
    """Forward under half of the angles, backward under the other half, at rest between; hold 5 periods within 5 mm."""
    angle = 2 * np.pi * np.arange(80) / 80
    speed = np.broadcast_to(0.1 * np.sin(angle), (101, 80)).copy()
    way = dp.moves(speed, 0.005, 8.0, 0.1)
    values, held = dp.to_a_target(way, 0.005, 0.3, 0.005, 5, 1e-3, 0, 100, 8.0, 0.1, 300, 1e-9)
    assert held[0].max() == 0.0
    assert held[4, len(held[0]) // 2, 0] == pytest.approx(0.4)
    assert values[60, 0] == pytest.approx(0.5)
    assert 1.5 < values[40, 20] < 2.2
    assert values[40, 20] == pytest.approx(values[80, 60], abs=0.02)


def test_a_reference_at_the_wires_own_speed_costs_nothing():
    speed = np.full((101, 40), 0.05)
    reference = 0.1 + 0.05 * 0.1 * np.arange(21)
    values = dp.along_a_reference(dp.moves(speed, 0.005, 2.0, 0.1), 0.005, reference, 1e-3, 31, 2.0, 0.1)
    assert values[0, 15] == pytest.approx(0.0, abs=1e-12)
    assert values[0, 17] == pytest.approx(20 * (2e-3) ** 2, rel=1e-3)


# --- plans ------------------------------------------------------------------------------------------------------------


def test_actions_and_commands_undo_each_other_exactly():
    starts = begun("MagWire/Chase-v0", 2, scenario=list(scenario_pool("Chase", "test", 2)))
    actions = np.random.default_rng(0).uniform(-1, 1, (2, 500, 3)).astype(np.float32)
    again = actions_of(starts.library, starts.entries, commands_of(starts.library, starts.entries, actions))
    assert np.array_equal(again, actions)


def test_a_followed_plan_is_the_plan_itself_when_nothing_is_changed():
    starts = begun(n=4)
    trials, rows = Trials(starts), np.arange(4)
    plan = best_plans(starts, Refinement(rounds=0)).actions
    clocked = trials.run(rows, plan)
    followed = trials.run(rows, plan, clocked.tip)
    used = int(clocked.steps.min())
    assert np.array_equal(followed.actions[:, :used], plan[:, :used])
    assert np.array_equal(followed.value, clocked.value)


def test_a_target_held_too_short_or_beyond_the_time_does_not_count():
    starts = begun("MagWire/Reach-v0", 1)
    goal, width = float(starts.goal[0]), starts.task.tolerance
    trace = np.full((60, 3, 1), goal + 4 * width)
    trace[20:29] = goal
    value, time, _ = judged(starts, trace)
    assert value[0] >= FAILED
    assert np.isnan(time[0])
    trace[29] = goal
    value, time, steps = judged(starts, trace)
    assert (time[0], steps[0]) == (pytest.approx(3.0), 30)
    assert 2.9 <= value[0] <= 3.0
    short = dataclasses.replace(starts, step_limit=29)
    assert judged(short, trace)[0][0] >= FAILED


def test_refinement_never_worsens_and_repeats_itself():
    starts = begun("MagWire/Chase-v0", 3, scenario=list(scenario_pool("Chase", "test", 3)))
    plans, trials = by_controller(starts, NetForce.from_env), Trials(starts)
    plain = trials.run(np.arange(3), plans).value
    (better, value), again = (refine(trials, plans, Refinement(samples=8, rounds=12)) for _ in range(2))
    assert (value <= plain).all()
    assert value.mean() < 0.95 * plain.mean()
    assert np.array_equal(better, again[0])
    assert np.array_equal(trials.run(np.arange(3), better).value, value)


# --- the cache --------------------------------------------------------------------------------------------------------


def test_a_kept_plan_is_the_same_and_a_damaged_file_is_survived(tmp_path):
    starts, cache = begun(n=3), Cache(tmp_path)
    made = best_plans(starts, QUICK, cache)
    files = sorted(tmp_path.rglob("*.npz"))
    assert len(files) == 3
    assert not list(tmp_path.rglob("*.part"))
    before = [f.stat().st_mtime_ns for f in files]
    kept = best_plans(starts, QUICK, cache)
    assert [f.stat().st_mtime_ns for f in files] == before
    assert np.array_equal(kept.actions[:, :60], made.actions[:, :60])
    assert np.array_equal(kept.time, made.time)
    files[0].write_bytes(files[0].read_bytes()[:100])
    with pytest.warns(UserWarning, match=files[0].name):
        again = best_plans(starts, QUICK, cache)
    assert again.time == pytest.approx(made.time, abs=1e-4)  # planned alone now, and not beside the others
    assert np.array_equal(best_plans(starts, QUICK, cache).time, again.time)


def test_a_plan_of_another_simulator_is_made_again(tmp_path):
    starts, cache = begun(n=1), Cache(tmp_path)
    made = best_plans(starts, QUICK, cache)
    (key,) = cache.keys(starts, QUICK)
    cache.store(key, made.actions[0], float(made.time[0]) - 0.5)
    with pytest.warns(UserWarning, match="another simulator"):
        assert best_plans(starts, QUICK, cache).time == pytest.approx(made.time)


def test_keys_tell_starts_scenarios_and_settings_apart_but_not_names(monkeypatch, tmp_path):
    cache = Cache(tmp_path)
    one = begun(n=2)
    keys = set(cache.keys(one, QUICK))
    assert len(keys) == 2
    assert keys.isdisjoint(cache.keys(one, Refinement()))
    assert keys.isdisjoint(cache.keys(begun(n=2, scenario=Scenario.paper().replace(contact__friction=0.04)), QUICK))
    assert keys == set(cache.keys(begun(n=2, scenario=Scenario.paper().replace(name="another")), QUICK))
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path))
    assert default_folder() == tmp_path / "par"


# --- the bracket ------------------------------------------------------------------------------------------------------


def test_the_papers_bracket_is_narrow_and_holds_every_policy():
    paper = nominal(Scenario.paper(), settings=QUICK)
    assert (paper.lower < paper.upper).all()
    assert paper.gap[0] < 0.02
    found = bracket(episodes=12, settings=QUICK)
    assert isinstance(found, Bracket)
    assert (found.lower < found.upper).all()
    assert found.gap.mean() < 0.03
    for policy in (MaxForce, NetForce):
        time = evaluate(policy.from_env, STEER, 12).time
        assert (time > found.lower).all()
        assert (found.upper <= time).all()


def test_a_targets_bracket():
    found = bracket(task="MagWire/Reach-v0", episodes=4, settings=QUICK)
    assert (found.lower >= 1.0).all()
    assert (found.lower <= found.upper).all()


def test_tasks_without_a_nominal_start_and_no_episodes_are_named():
    with pytest.raises(ValueError, match="task"):
        nominal(Scenario.paper(), "MagWire/Track-v0")
    with pytest.raises(ValueError, match="episodes"):
        bracket(episodes=0)


def test_the_command_prints_the_bracket(capsys, tmp_path):
    main(["--episodes", "2", "--rounds", "2", "--cache", str(tmp_path)])
    printed = capsys.readouterr().out
    assert "magnets at their best" in printed
    assert "mean of 2 evaluation starts, 100.0% reached" in printed
