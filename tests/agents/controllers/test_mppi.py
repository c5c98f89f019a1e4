"""MPPI is as fast as the best command, tracks and reaches, and is the same single, batched and twice."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.benchmark.certificates import ride
from agents.controllers import MPPI, MPPISettings, NetForce
from agents.evaluation.evaluator import evaluate
from magwire_env import Scenario
from magwire_env.quasistatic.pool import scenario_pool

SMALL = MPPISettings(samples=64, horizon=6)


def run(task, policy, episodes, seed=1_000_000, **settings):
    """Successes and the summaries' RMS errors (m) of one episode each."""
    envs = gym.make_vec(task, num_envs=episodes, **settings)
    controller = policy(envs)
    observation, _ = envs.reset(seed=seed)
    success, rms, running = np.zeros(episodes, dtype=bool), np.full(episodes, np.nan), np.ones(episodes, dtype=bool)
    state, starts = None, np.ones(episodes, dtype=bool)
    while running.any():
        action, state = controller.predict(observation, state, starts)
        observation, _, terminated, truncated, infos = envs.step(action)
        starts = terminated | truncated
        ended = running & starts
        if ended.any():
            success[ended] = infos["is_success"][ended]
            rms[ended] = infos["summary"].get("rms_error", rms)[ended]
            running &= ~ended
    return success, rms


def test_it_steers_faster_than_the_greatest_net_force():
    mppi, net = (evaluate(c.from_env, "MagWire/Steer-v0", 16) for c in (MPPI, NetForce))
    assert mppi.success.all()
    assert 0.98 < np.median(mppi.time / net.time) < 1.0


def test_it_finishes_a_long_wire_with_more_friction():
    hard = Scenario.paper().replace(wire__length=0.2, wire__segments=32, contact__friction=0.1)
    mppi, net = (ride(c.from_env, "Steer", [hard] * 6) for c in (MPPI, NetForce))
    assert mppi.success.all()
    assert np.median(mppi.time / net.time) < 1.005


@pytest.mark.parametrize(("kind", "ratio"), [("SteerAny", 1.0), ("Chase", 0.95), ("Dual", 1.0)])
def test_it_finishes_generated_tracts_faster_than_the_greatest_net_force(kind, ratio):
    some = list(scenario_pool(kind, "test", 4))
    mppi, net = (evaluate(c.from_env, f"MagWire/{kind}-v0", len(some), scenario=some) for c in (MPPI, NetForce))
    assert mppi.success.all()
    assert np.median(mppi.time / net.time) < ratio


def test_it_reaches_targets_either_way():
    assert run("MagWire/Reach-v0", MPPI.from_env, 24)[0].all()


def test_it_tracks_within_two_millimetres():
    success, rms = run("MagWire/Track-v0", MPPI.from_env, 16)
    assert success.mean() > 0.9
    assert np.median(rms) < 2e-3


@pytest.mark.parametrize("task", ["MagWire/Steer-v0", "MagWire/Track-v0"])
def test_single_and_batched_agree(task):
    env, envs = gym.make(task), gym.make_vec(task, num_envs=3)
    one, many = MPPI.from_env(env, settings=SMALL), MPPI.from_env(envs, settings=SMALL)
    observation, _ = env.reset(seed=5)
    observations, _ = envs.reset(seed=5)
    state = states = None
    for _ in range(10):
        action, state = one.predict(observation, state)
        actions, states = many.predict(observations, states)
        assert action == pytest.approx(actions[0], abs=1e-6)
        observation = env.step(action)[0]
        observations = envs.step(actions)[0]


def test_the_same_seed_gives_the_same_and_another_does_not():
    times = [
        evaluate(lambda env, seed=seed: MPPI.from_env(env, samples=32, seed=seed), "MagWire/Steer-v0", 3).time
        for seed in (0, 0, 1)
    ]
    assert np.array_equal(times[0], times[1])
    assert not np.array_equal(times[0], times[2])


def test_memory_starts_afresh_with_an_episode():
    envs = gym.make_vec("MagWire/Steer-v0", num_envs=2)
    controller = MPPI.from_env(envs, settings=SMALL)
    observation, _ = envs.reset(seed=0)
    first, (plan,) = controller.predict(observation, episode_start=np.ones(2, dtype=bool))
    again, _ = controller.predict(observation, (plan + 0.3,), np.array([True, False]))
    assert again[0] == first[0]
    assert again[1] != first[1]


def test_it_follows_the_scenarios_that_episodes_draw():
    envs = gym.make_vec("MagWire/SteerAny-v0", num_envs=2, pool_size=4)
    controller = MPPI.from_env(envs, settings=SMALL)
    for seed in (0, 1):
        observation, _ = envs.reset(seed=seed)
        action, _ = controller.predict(observation)
        fresh, _ = MPPI.from_env(envs, settings=SMALL).predict(observation)
        assert np.array_equal(action, fresh)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("samples", 8, "at least 32"),
        ("horizon", 1, "at least 2"),
        ("iterations", 0, "at least 1"),
        ("knots", 2.5, "at least 2"),
        ("seed", -1, "at least 0"),
        ("temperature", 0.0, "greater than 0"),
        ("noise", float("nan"), "finite"),
        ("finest", 1.5, r"in \[0, 1\]"),
        ("fade", 0.0, "greater than 0"),
        ("spacing", -1.0, "greater than 0"),
    ],
)
def test_bad_settings_are_refused(name, value, allowed):
    with pytest.raises(ValueError, match=rf"MPPISettings\.{name} must .*{allowed}"):
        MPPISettings(**{name: value})


def test_settings_and_single_ones_do_not_mix():
    with pytest.raises(ValueError, match="settings must not come with single ones, got samples"):
        MPPI.from_env(gym.make("MagWire/Steer-v0"), settings=SMALL, samples=64)
    with pytest.raises(TypeError, match="colour"):
        MPPI.from_env(gym.make("MagWire/Steer-v0"), colour=3)
