"""NetForce: its memory, and its speed both ways."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.benchmark.certificates import ride
from agents.controllers import MaxForce, NetForce
from magwire_env import Scenario
from magwire_env.quasistatic import certificate

STEER = "MagWire/Steer-v0"


def test_single_and_batched_agree():
    env, envs = gym.make(STEER), gym.make_vec(STEER, num_envs=3)
    one, many = NetForce.from_env(env), NetForce.from_env(envs)
    observation, _ = env.reset(seed=5)
    observations, _ = envs.reset(seed=5)
    state = states = None
    for _ in range(30):
        action, state = one.predict(observation, state)
        actions, states = many.predict(observations, states)
        assert action == pytest.approx(actions[0], abs=1e-6)
        observation = env.step(action)[0]
        observations = envs.step(actions)[0]


def test_memory_starts_afresh_with_an_episode():
    envs = gym.make_vec(STEER, num_envs=2)
    controller = NetForce.from_env(envs)
    observations, _ = envs.reset(seed=0)
    first, _ = controller.predict(observations, episode_start=np.ones(2, dtype=bool))
    far = (np.array([300.0, 300.0]), np.array([True, True]))
    again, _ = controller.predict(observations, far, np.array([True, False]))
    assert again[0] == pytest.approx(first[0])
    assert abs(again[1, 0] - first[1, 0]) > 0.05


def test_it_crosses_the_papers_tract_as_fast_as_the_papers_policy_and_backwards_too():
    paper = Scenario.paper()
    net, most = (ride(c.from_env, "Steer", [paper] * 8) for c in (NetForce, MaxForce))
    assert net.success.all()
    assert np.median(net.time) < 1.03 * np.median(most.time)
    env = gym.make_vec(STEER, num_envs=2, scenario=paper)
    back = NetForce.from_env(env, direction=-1)
    observation, _ = env.reset(seed=0, options={"tip_arclength": 0.75, "magnet_angle": 3.0})
    state, sim = None, env.unwrapped.core.sim
    needed = certificate(paper, -1, start=0.75, goal=0.3).traverse_time
    for _ in range(int(1.5 * needed / sim.control_period)):
        action, state = back.predict(observation, state)
        observation = env.step(action)[0]
    assert (sim.tip_arclength < 0.3).all()
