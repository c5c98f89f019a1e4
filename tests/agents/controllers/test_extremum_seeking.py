"""Extremum seeking finds its way by the force alone."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import ExtremumSeeking
from agents.evaluation.evaluator import evaluate
from magwire_env import Scenario
from magwire_env.quasistatic.pool import scenario_pool
from magwire_env.simulation import best_command

STEER = "MagWire/Steer-v0"
FELT = ("drive_force", "lateral_force", "magnet")


def test_it_finishes_nine_in_ten_and_needs_no_more_than_force_and_magnet():
    seeing, feeling = (evaluate(ExtremumSeeking.from_env, STEER, 200, **k) for k in ({}, {"observe": FELT}))
    assert feeling.success.mean() >= 0.97
    assert np.median(feeling.time[feeling.success]) < 11.0
    assert np.array_equal(seeing.success, feeling.success)


@pytest.mark.parametrize(("kind", "count", "share"), [("SteerAny", 60, 0.9), ("Orient", 10, 0.7), ("Dual", 10, 0.7)])
def test_it_finishes_tracts_and_rigs_it_knows_nothing_of(kind, count, share):
    some = list(scenario_pool(kind, "test", count))
    assert evaluate(ExtremumSeeking.from_env, f"MagWire/{kind}-v0", count, scenario=some).success.mean() >= share


@pytest.mark.parametrize("start", [1.0, 3.0, 5.0])
def test_the_magnet_ends_at_the_angle_of_greatest_drive_of_a_stuck_tip(start):
    stuck = Scenario.paper().replace(contact__friction=50.0)
    env = gym.make(STEER, scenario=stuck)
    controller, sim = ExtremumSeeking.from_env(env), env.unwrapped.core.sim
    observation, _ = env.reset(seed=0, options={"magnet_angle": start, "tip_arclength": 0.3})
    state, angles = None, []
    for _ in range(80):
        action, state = controller.predict(observation, state)
        observation = env.step(action)[0]
        angles.append(sim.magnet[0, 0])
    best = best_command(stuck, sim.tip_arclength)[0][0, 0]
    off = np.array(angles[-20:]) - best
    assert abs(np.mean(off - 2 * np.pi * np.round(off / (2 * np.pi)))) < 0.15


def test_single_and_batched_agree():
    env, envs = gym.make(STEER), gym.make_vec(STEER, num_envs=3)
    one, many = ExtremumSeeking.from_env(env), ExtremumSeeking.from_env(envs)
    observation, _ = env.reset(seed=5)
    observations, _ = envs.reset(seed=5)
    state = states = None
    for _ in range(20):
        action, state = one.predict(observation, state)
        actions, states = many.predict(observations, states)
        assert action == pytest.approx(actions[0], abs=1e-6)
        observation, observations = env.step(action)[0], envs.step(actions)[0]


def test_memory_starts_afresh_with_an_episode():
    envs = gym.make_vec(STEER, num_envs=2)
    controller = ExtremumSeeking.from_env(envs)
    observation, _ = envs.reset(seed=0)
    first, state = controller.predict(observation)
    for _ in range(3):
        _, state = controller.predict(observation, state)
    again, _ = controller.predict(observation, state, np.array([True, False]))
    assert again[0] == first[0]
    assert again[1] != first[1]


@pytest.mark.parametrize("name", ["amplitude", "period", "gain", "high_pass", "low_pass"])
def test_bad_settings_are_refused(name):
    with pytest.raises(ValueError, match=f"{name} must be greater than 0, got 0"):
        ExtremumSeeking.from_env(gym.make(STEER), **{name: 0})


def test_it_says_which_channel_it_misses():
    env = gym.make(STEER, observe=("magnet",))
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match="observe must include 'drive_force'"):
        ExtremumSeeking.from_env(env).predict(observation)
