"""Reach, Track, the goal env, imperfect readings, varied scenarios, the safety mode."""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env import Scenario
from magwire_env.envs.task import TASKS, Task
from magwire_env.scenario import Reading
from magwire_env.simulation import Library, best_command

LIBRARY = Library([Scenario.paper()])
REACH, TRACK = TASKS["MagWire/Reach-v0"], TASKS["MagWire/Track-v0"]


def test_reach_draws_targets_either_way_never_too_near():
    drawn = np.random.default_rng(0).random((4000, REACH.kind.draws))
    start, goal = (places.s for places in REACH.kind.begin(REACH, LIBRARY, np.zeros(4000, dtype=int), drawn))
    for arclength in (start, goal):
        assert arclength.min() >= 0.1 - 1e-12
        assert arclength.max() <= 0.79 + 1e-12
    assert np.abs(goal - start).min() >= 0.05 - 1e-12
    assert 0.4 < (goal < start).mean() < 0.6


def test_track_references_are_slow_smooth_and_inside():
    drawn = np.random.default_rng(0).random((500, TRACK.kind.draws))
    times = np.arange(0, 32, 0.1)
    path = TRACK.kind.reference(TRACK, LIBRARY, np.zeros(500, dtype=int), drawn, times)
    assert path.min() >= 0.1
    assert path.max() <= 0.78 + 1e-12
    speed = np.diff(path, axis=1) / 0.1
    assert np.abs(speed).max() <= 0.03
    assert np.abs(speed).max(axis=1).mean() > 0.015  # not idle either
    assert (speed.max(axis=1) > 0).all()
    assert (speed.min(axis=1) < 0).all()


def hold(env, target, steps=80):
    """Steer by the sign of the error with the best forward or backward angle."""
    sim = env.unwrapped.core.sim
    grid = np.linspace(0, 0.8, 81)
    ways = [best_command(sim.scenarios[0], grid, direction)[0][:, 0] for direction in (-1, 1)]
    for step in range(1, steps + 1):
        tip, speed = sim.tip_arclength[0], sim.tip_velocity[0]
        error = target - tip - 0.15 * speed
        back, forth = (np.interp(tip, grid, way) for way in ways)
        middle = 0.5 * (back + forth)  # where the drive vanishes, between the two
        angle = middle + np.clip(error / 0.01, -1, 1) * 0.5 * (forth - back)
        yield step, env.step(env.unwrapped.core.actuation.action(np.array([[angle]]))[0])


def test_reach_succeeds_once_the_target_was_held_for_a_second():
    env = gym.make("MagWire/Reach-v0")
    env.reset(seed=0, options={"tip_arclength": 0.35, "target": 0.30, "magnet_angle": 3.0})
    inside = 0
    for step, (_, reward, terminated, _, info) in hold(env, 0.30, 200):  # noqa: B007  (read after the loop)
        near = np.abs(env.unwrapped.simulator.remaining_trace[0][1:]).max() <= 5e-3
        inside = inside + 1 if near else 0
        assert terminated == (inside == 10)
        if terminated:
            break
    assert info["is_success"]
    assert info["reward/success"] == 10
    assert info["summary"]["time"] == pytest.approx(0.1 * step)
    assert info["distance"] == pytest.approx(abs(env.unwrapped.simulator.tip_arclength[0] - 0.30))


def test_track_follows_its_own_reference_and_scores_the_error():
    env = gym.make("MagWire/Track-v0", time_limit=3.0)
    env.reset(seed=1)
    core = env.unwrapped.core
    squares = []
    for k in range(1, 31):
        observation, _, terminated, truncated, info = env.step(np.zeros(1, dtype=np.float32))
        error = abs(core.episodes.reference[0, k] - core.sim.tip_arclength[0])
        assert info["distance"] == pytest.approx(error)
        squares.append(error**2)
        ahead = observation[core.observer.part("reference_preview")] * 0.1 + core.sim.tip_arclength[0]
        assert ahead == pytest.approx(core.episodes.reference[0, [k, k + 5, k + 10, k + 20]], abs=1e-6)
    assert truncated
    assert not terminated
    assert info["summary"]["rms_error"] == pytest.approx(np.sqrt(np.mean(squares)))
    assert info["is_success"] == (info["summary"]["rms_error"] <= 5e-3)


def test_reach_shows_finely_how_close_the_goal_is():
    env = gym.make("MagWire/Reach-v1")
    observation, _ = env.reset(seed=3)
    core = env.unwrapped.core
    for _ in range(5):
        shown = observation[core.observer.part("goal_close")]
        way = core.goal[0] - core.sim.tip_arclength[0]
        assert shown == pytest.approx(np.tanh(way / np.array([5e-3, 20e-3, 100e-3])), abs=1e-6)
        observation, *_ = env.step(env.action_space.sample())


def test_the_goal_env_rewards_any_goals_alike():
    env = gym.make("MagWire/ReachGoal-v0")
    check_env(env.unwrapped, skip_render_check=True)
    observation, _ = env.reset(seed=0)
    assert observation["desired_goal"][0] == pytest.approx(env.unwrapped.core.goal[0] / 0.8)
    observation, reward, *_, info = env.step(env.action_space.sample())
    assert reward == env.unwrapped.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
    achieved = np.array([[0.5], [0.5], [0.5]])
    desired = np.array([[0.5], [0.506], [0.507]])
    assert env.unwrapped.compute_reward(achieved, desired, {}).tolist() == [0.0, 0.0, -1.0]


def test_hindsight_replay_takes_the_goal_env():
    from stable_baselines3 import SAC, HerReplayBuffer

    env = gym.make("MagWire/ReachGoal-v0", time_limit=1.0)
    model = SAC("MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=30, seed=0)
    model.learn(40)
    assert model.replay_buffer.size() == 40


def sensed(**sensing):
    return Scenario.paper().replace(**{f"sensing__{k}": v for k, v in sensing.items()})


def run(env, seed=3, steps=12):
    observation, _ = env.reset(seed=seed)
    rows = [observation]
    for k in range(steps):
        rows.append(env.step(np.array([0.3 * np.sin(k)], dtype=np.float32))[0])
    return np.array(rows)


def test_noise_has_its_size_and_is_seeded():
    truth = run(gym.make("MagWire/Steer-v0"), steps=250)
    env = gym.make("MagWire/Steer-v0", scenario=sensed(force=Reading(noise=2e-3), length=Reading(noise=1e-3)))
    noisy, again = run(env, steps=250), run(env, steps=250)
    assert np.array_equal(noisy, again)
    error = (noisy - truth).std(axis=0)
    assert error[2] == pytest.approx(0.2, rel=0.15)  # drive: 2 mN over 10 mN
    assert error[0] == pytest.approx(1e-3 / 0.8, rel=0.15)
    assert error[1] == 0  # speed was not given any
    assert np.abs(np.corrcoef((noisy - truth)[1:, 2], (noisy - truth)[:-1, 2])[0, 1]) < 0.2


def test_bias_lasts_an_episode_and_changes_with_the_next():
    truth = run(gym.make("MagWire/Steer-v0"))
    env = gym.make("MagWire/Steer-v0", scenario=sensed(speed=Reading(bias=0.02)))
    offset = (run(env) - truth)[:, 1]
    assert offset == pytest.approx(np.full(13, offset[0]), abs=1e-6)
    assert offset[0] != 0
    assert (run(env, seed=4) - run(gym.make("MagWire/Steer-v0"), seed=4))[0, 1] != pytest.approx(offset[0], abs=1e-3)


def test_resolution_rounds_to_its_step():
    rows = run(gym.make("MagWire/Steer-v0", scenario=sensed(length=Reading(step=0.01))))
    steps = rows[:, 0] * 0.8 / 0.01
    assert steps == pytest.approx(np.round(steps), abs=1e-4)


def test_delay_shows_the_past():
    truth = run(gym.make("MagWire/Steer-v0"))
    late = run(gym.make("MagWire/Steer-v0", scenario=sensed(delay=3)))
    assert np.array_equal(late[3:], truth[:-3])
    assert np.array_equal(late[:3], np.repeat(truth[:1], 3, axis=0))


def test_a_batch_reads_as_its_single_envs_do_over_resets():
    scenario = sensed(force=Reading(noise=1e-3, bias=1e-3, step=5e-4), delay=2)
    envs = gym.make_vec("MagWire/Steer-v0", num_envs=3, scenario=scenario, time_limit=0.6, autoreset_mode="SameStep")
    singles = [gym.make("MagWire/Steer-v0", scenario=scenario, time_limit=0.6) for _ in range(3)]
    batch, _ = envs.reset(seed=5)
    assert np.array_equal(batch, [env.reset(seed=5 + i)[0] for i, env in enumerate(singles)])
    for k in range(14):
        action = np.full((3, 1), 0.1 * k - 0.5, dtype=np.float32)
        batch, _, terminated, truncated, _ = envs.step(action)
        rows = [env.step(action[i])[0] for i, env in enumerate(singles)]
        ended = terminated | truncated
        rows = [env.reset()[0] if ended[i] else rows[i] for i, env in enumerate(singles)]
        assert np.array_equal(batch, rows)


def test_variation_is_drawn_applied_and_told():
    scenario = Scenario.paper().replace(
        variation__friction=0.5, variation__remanence=0.1, variation__stiffness=0.2, variation__placement=3e-3
    )
    env = gym.make("MagWire/Steer-v0", scenario=scenario)
    plain = gym.make("MagWire/Steer-v0")
    forces = []
    for seed in range(12):
        _, info = env.reset(seed=seed, options={"tip_arclength": 0.3, "magnet_angle": 3.9})
        plain.reset(seed=seed, options={"tip_arclength": 0.3, "magnet_angle": 3.9})
        assert 0.5 <= info["variation/friction"] <= 1.5
        assert 0.8 <= info["variation/stiffness"] <= 1.2
        assert 0.9 <= info["variation/remanence"] <= 1.1
        forces.append(env.unwrapped.simulator.drive_force[0] / plain.unwrapped.simulator.drive_force[0])
        step_info = env.step(np.zeros(1, dtype=np.float32))[4]
        assert step_info["variation/friction"] == info["variation/friction"]
    assert np.std(forces) > 0.02
    _, first = env.reset(seed=3)
    _, again = env.reset(seed=3)
    assert first == again


def test_remanence_alone_scales_the_force_and_the_next_episode_starts_from_the_scenario():
    scenario = Scenario.paper().replace(variation__remanence=0.3)
    env, plain = gym.make("MagWire/Steer-v0", scenario=scenario), gym.make("MagWire/Steer-v0")
    for seed in range(5):
        _, info = env.reset(seed=seed)
        plain.reset(seed=seed)
        ratio = env.unwrapped.simulator.drive_force[0] / plain.unwrapped.simulator.drive_force[0]
        assert ratio == pytest.approx(info["variation/remanence"], rel=1e-9)


def test_the_safety_mode_ends_an_episode_over_the_limit():
    scenario = Scenario.paper().replace(contact__wall_force_limit=0.05)
    for safety in (False, True):
        env = gym.make("MagWire/Steer-v0", scenario=scenario, safety=safety)
        env.reset(seed=0, options={"tip_arclength": 0.7, "magnet_angle": 3.0})
        for _ in range(20):
            _, _, terminated, _, info = env.step(np.array([0.5], dtype=np.float32))
            if info["cost"] > 0:
                break
        assert info["cost"] > 0
        assert terminated == safety
        assert not info["is_success"]


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Reading(noise=-1), "Reading.noise must be at least 0, got -1"),
        (lambda: sensed(delay=1.5), "Sensing.delay must be a whole number of at least 0, got 1.5"),
        (
            lambda: Scenario.paper().replace(variation__remanence=1.0),
            r"Variation.remanence must lie in \[0, 0.999\], got 1.0",
        ),
        (lambda: Task("x"), "Task must have either a scenario or a pool"),
        (
            lambda: Task("x", "wander", Scenario.paper),
            "Task.kind must be a Kind or one of 'steer', 'in and out', 'reach', 'track', .* got 'wander'",
        ),
        (lambda: gym.make("MagWire/ReachGoal-v0", task="MagWire/Steer-v0"), "task must be one whose target is held"),
    ],
)
def test_refusals(build, words):
    with pytest.raises(ValueError, match=words):
        build()


def test_a_scenario_without_a_certificate_warns_once():
    scenario = Scenario.paper().replace(name="stiff", wire__bending_modulus=5e6)
    with pytest.warns(UserWarning, match="scenario 'stiff' has no certificate for MagWire/Steer-v1: blocked at"):
        gym.make("MagWire/Steer-v1", scenario=scenario, disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gym.make("MagWire/Steer-v1", scenario=scenario, disable_env_checker=True)
        gym.make("MagWire/Steer-v1", scenario=Scenario.paper().replace(contact__friction=0.0))
