"""The adapter to SB3."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from agents.learning.hyperparameters import hyperparameters
from agents.learning.sb3 import NativeVecEnv, make_vec_env

ID = "MagWire/Steer-v0"


def test_the_adapter_gives_sb3_what_it_wants():
    venv = make_vec_env(ID, 4, seed=3, time_limit=0.3)
    observation = venv.reset()
    assert np.array_equal(observation[1], gym.make(ID).reset(seed=4)[0])
    for _ in range(3):
        observation, _, done, infos = venv.step(np.zeros((4, 1), dtype=np.float32))
    assert done.all()
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"]
        assert info["episode"]["l"] == 3
        assert not np.array_equal(info["terminal_observation"], observation[i])
    with pytest.raises(ValueError, match="autoreset_mode must be SAME_STEP"):
        NativeVecEnv(gym.make_vec(ID, num_envs=2).unwrapped)


def test_hyperparameters_of_an_unknown_algorithm():
    with pytest.raises(ValueError, match=r"algorithm must be one of 'ppo', 'sac', .*got 'dqn'"):
        hyperparameters("dqn", ID)
