"""A magnet that turns all the time."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.catalogue import CONTROLLERS

ID = "MagWire/Steer-v0"


def test_constant_rotation_starts_afresh_with_each_episode():
    envs = gym.make_vec(ID, num_envs=2)
    observations, _ = envs.reset(seed=0)
    controller = CONTROLLERS["ConstantRotation"].from_env(envs)
    first, state = controller.predict(observations)
    _, state = controller.predict(observations, state)
    again, _ = controller.predict(observations, state, episode_start=np.array([True, False]))
    assert again[0] == pytest.approx(first[0])
    assert again[1, 0] > first[1, 0]
