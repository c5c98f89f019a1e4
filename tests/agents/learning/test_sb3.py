"""The adapter to SB3, and models on disk."""

from __future__ import annotations

import json
import shutil

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecFrameStack

from agents.learning.sb3 import NativeVecEnv, frozen, hyperparameters, load, make_model, make_vec_env

ID = "MagWire/Steer-v0"


def test_a_loaded_model_brings_its_normalisation(run):
    policy = load(run[0])
    observation, _ = gym.make(ID).reset(seed=0)
    action, _ = policy.predict(observation)
    raw, _ = policy.model.predict(observation, deterministic=True)
    assert not np.allclose(action, raw)
    assert np.allclose(
        action, policy.model.predict(policy.normalization.normalize_obs(observation), deterministic=True)[0]
    )
    assert np.array_equal(load(run[0]).predict(observation)[0], action)


@pytest.mark.parametrize("name", ["model.zip", "normalization.pkl", "model.json"])
def test_a_truncated_model_file_is_named(run, tmp_path, name):
    folder = tmp_path / "copy"
    shutil.copytree(run[0] / "best", folder)
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=f"{name} is (truncated|damaged)"):
        load(folder)
    (folder / name).unlink()
    with pytest.raises(FileNotFoundError, match=f"holds no {name}"):
        load(folder)


def test_a_model_of_an_env_that_is_no_more_says_so(run, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(run[0] / "best", folder)
    meta = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps(meta | {"env": {"observe": ["no_such_channel"]}}))
    with pytest.raises(ValueError, match="asks for an env that cannot be made: observe must name"):
        load(folder)


def test_a_policy_of_stacked_frames_sees_what_sb3_showed_it():
    venv = make_vec_env(ID, 3, seed=0, frame_stack=4, time_limit=0.3)
    model = make_model("stacked_ppo", venv, 0, {"normalize": {}})
    policy = frozen(model, {"frame_stack": 4})
    assert isinstance(venv, VecFrameStack)
    raw = NativeVecEnv(gym.make_vec(ID, num_envs=3, autoreset_mode="SameStep", time_limit=0.3).unwrapped, seed=0)
    stacked, newest, state, starts = venv.reset(), raw.reset(), None, np.ones(3, dtype=bool)
    for _ in range(7):  # two ends of episodes among them
        actions, state = policy.predict(newest, state=state, episode_start=starts)
        assert np.array_equal(state, stacked)
        stacked, _, starts, _ = venv.step(actions)
        newest = raw.step(actions)[0]
    one, _ = policy.predict(newest[0])
    assert one.shape == (1,)


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
