"""The par as a controller: what it plans is what the env measures, and nobody is faster."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce, NetForce
from agents.evaluation.episodes import EVALUATION_SEED
from agents.evaluation.evaluator import evaluate
from agents.par.optimal import Optimal
from agents.par.refinement import Refinement
from magwire_env.envs.kernels import EPISODE
from magwire_env.quasistatic.pool import scenario_pool

STEER, REACH, TRACK = "MagWire/Steer-v0", "MagWire/Reach-v0", "MagWire/Track-v0"
QUICK = Refinement(samples=8, rounds=6)


def episode(env, controller):
    """Drive every lane of a batch through its first episode → summaries' times and RMS errors, and successes."""
    observation, _ = env.reset(seed=EVALUATION_SEED)
    n = env.num_envs
    time, rms, success = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, dtype=bool)
    running, starts, state = np.ones(n, dtype=bool), np.ones(n, dtype=bool), None
    while running.any():
        action, state = controller.predict(observation, state, starts)
        observation, _, terminated, truncated, infos = env.step(action)
        starts = terminated | truncated
        ended = running & starts
        if ended.any():
            success[ended] = infos["is_success"][ended]
            time[ended] = infos["summary"]["time"][ended]
            rms[ended] = infos["summary"].get("rms_error", rms)[ended]
            running &= ~ended
    return time, rms, success


def test_the_replay_takes_the_planned_time_and_no_controller_is_faster_on_the_same_starts():
    env = gym.make_vec(STEER, num_envs=12)
    par = Optimal.from_env(env, settings=QUICK, cache=False)
    found = evaluate(par, STEER, 12, env=env)
    assert found.success.all()
    assert np.array_equal(found.time, par.time)
    for other in (MaxForce, NetForce):
        assert (found.time <= evaluate(other.from_env, STEER, 12).time).all()


@pytest.mark.parametrize("kind", ["SteerAny", "Chase", "Orient", "Dual"])
def test_it_arrives_on_unseen_tracts_no_later_than_net_force(kind):
    task, scenarios = f"MagWire/{kind}-v0", list(scenario_pool(kind, "test", 3))
    env = gym.make_vec(task, num_envs=3, scenario=scenarios)
    par = Optimal.from_env(env, settings=QUICK, cache=False)
    found = evaluate(par, task, 3, env=env)
    assert found.success.all()
    assert np.array_equal(found.time, par.time)
    assert (found.time <= evaluate(NetForce.from_env, task, 3, scenario=scenarios).time).all()


def test_targets_are_reached_and_held_when_planned():
    env = gym.make_vec(REACH, num_envs=4)
    par = Optimal.from_env(env, settings=QUICK, cache=False)
    time, _, success = episode(env, par)
    assert success.all()
    assert time == pytest.approx(par.time, abs=1e-12)


def test_a_reference_is_followed_with_the_planned_error():
    env = gym.make_vec(TRACK, num_envs=4, time_limit=10.0)
    par = Optimal.from_env(env, settings=Refinement(rounds=0), cache=False)
    _, rms, _ = episode(env, par)
    assert rms == pytest.approx(par.time, abs=1e-12)
    assert np.median(rms) < 2.5e-3


@pytest.mark.parametrize("mode", ["rate", "direction"])
def test_other_action_modes_replay_the_plan(mode):
    env = gym.make_vec(STEER, num_envs=2, action_mode=mode)
    par = Optimal.from_env(env, settings=QUICK, cache=False)
    time, _, success = episode(env, par)
    assert success.all()
    assert time == pytest.approx(par.time, abs=1e-4)


def test_every_reset_is_planned_but_not_what_a_batch_goes_on_with_by_itself():
    env = gym.make_vec(STEER, num_envs=2, time_limit=0.3)
    par = Optimal.from_env(env, settings=Refinement(rounds=0), cache=False)
    observation, _ = env.reset(seed=0)
    first = par.predict(observation, None, np.ones(2, dtype=bool))[0]
    assert par.predict(observation, None, np.ones(2, dtype=bool))[0] == pytest.approx(first)
    plan = par._actions.copy()
    starts = np.ones(2, dtype=bool)
    for _ in range(3):
        observation, _, terminated, truncated, _ = env.step(par.predict(observation, None, starts)[0])
        starts = terminated | truncated
    assert starts.all()
    core = env.unwrapped.core
    env.step(par.predict(observation, None, starts)[0])  # the batch begins anew by itself
    core.episodes.lanes[EPISODE.steps, 1] = 1.0  # one lane is elsewhere, so it is no reset of all
    rest = par.predict(core.observe(), None, np.zeros(2, dtype=bool))[0]
    assert np.array_equal(par._actions, plan)
    assert rest[0] == pytest.approx(core.actuation.action(core.sim.magnet)[0])
    observation, _ = env.reset(seed=7)
    par.predict(observation, None, np.ones(2, dtype=bool))
    assert not np.array_equal(par._actions, plan)


def test_bad_settings_are_named():
    env = gym.make_vec(STEER, num_envs=2)
    for bad, name in (({"settings": 3}, "settings"), ({"cache": True}, "cache"), ({"cache": 4}, "cache")):
        with pytest.raises(ValueError, match=name):
            Optimal.from_env(env, **bad)
    for field, value in (("samples", 2), ("rounds", -1), ("patience", 0), ("least", float("nan"))):
        with pytest.raises(ValueError, match=field):
            Refinement(**{field: value})


def test_a_par_is_played_in_angles_whatever_its_task_takes():
    """Track-v1 takes rates; replayed as rates, 28 of 100 plans lost the tip on the way."""
    modes = []

    class Probe(Optimal):
        @classmethod
        def from_env(cls, env, **settings):
            modes.append(env.unwrapped.core.actuation.mode)
            return MaxForce.from_env(env)

    for settings in ({}, {"action_mode": "rate"}):
        evaluate(Probe.from_env, "MagWire/Track-v1", 2, time_limit=0.5, **settings)
    assert modes == ["angle", "rate"]  # unless it is asked for something else
