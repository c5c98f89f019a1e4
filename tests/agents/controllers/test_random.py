"""Random actions."""

from __future__ import annotations

import gymnasium as gym
import numpy as np

from agents.controllers import Random


def test_they_are_uniform_in_the_action_space_and_repeat_with_the_seed():
    envs = gym.make_vec("MagWire/Steer-v0", num_envs=1000)
    observation, _ = envs.reset(seed=0)
    first, again, other = (Random.from_env(envs, seed=s).predict(observation)[0] for s in (0, 0, 1))
    assert envs.action_space.contains(first)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert abs(first.mean()) < 0.1
    assert abs(first.std() - 3**-0.5) < 0.05
