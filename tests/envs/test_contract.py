"""Gymnasium's contract: time limits in `spec`, goal envs through `gym.make`, messages that name the right shape."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TimeAwareObservation, TimeLimit
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import magwire_env
from agents.cli.main import main as magwire
from magwire_env import Scenario
from magwire_env.envs.task import TASKS

IDS = (*magwire_env.TASK_IDS, "MagWire/ReachGoal-v0")
STEER = "MagWire/Steer-v0"
HELD = np.array([-0.5], dtype=np.float32)
"""Turns the magnet to where it holds the tip fast."""


def layers(env: gym.Env) -> list[type]:
    found = [type(env)]
    while isinstance(env, gym.Wrapper):
        env = env.env
        found.append(type(env))
    return found


def length(env: gym.Env, action: np.ndarray = HELD) -> tuple[int, bool, bool]:
    """Steps, terminated and truncated of an episode that holds one action."""
    env.reset(seed=0)
    for step in range(1, 10_000):
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            return step, terminated, truncated
    raise AssertionError("the episode does not end")


# --- spec.max_episode_steps -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", IDS)
def test_the_spec_has_the_env_s_own_limit_and_no_wrapper_counts_beside_it(env_id):
    limit = round(TASKS.get(env_id, TASKS["MagWire/Reach-v0"]).time_limit / 0.1)
    small = {"pool_size": 1} if env_id in TASKS and TASKS[env_id].pool else {}
    env = gym.make(env_id, **small)
    assert env.spec.max_episode_steps == env.unwrapped.spec.max_episode_steps == limit
    assert TimeLimit not in layers(env)
    if env_id in TASKS:
        assert gym.make_vec(env_id, num_envs=2, **small).spec.max_episode_steps == limit


@pytest.mark.parametrize(
    ("settings", "limit"),
    [
        ({"time_limit": 45.0}, 450),
        ({"time_limit": 0.5}, 5),
        ({"scenario": Scenario.paper().replace(timing__control_period=0.05)}, 600),
    ],
)
def test_the_limit_follows_time_limit_and_control_period(settings, limit):
    """A wrapper with the registered number of steps would cut the longer ones short."""
    env = gym.make(STEER, **settings)
    assert env.spec.max_episode_steps == limit
    assert length(env) == (limit, False, True)
    again = gym.make(env.spec)
    assert again.spec.max_episode_steps == limit
    assert length(again) == (limit, False, True)


def test_a_limit_given_to_gym_make_comes_on_top():
    env = gym.make(STEER, max_episode_steps=50)
    assert layers(env).count(TimeLimit) == 1
    assert env.spec.max_episode_steps == 50
    assert length(env) == (50, False, True)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_a_limit_given_to_the_native_batch_acts_as_it_does_on_single_envs(mode):
    batch = gym.make_vec(STEER, num_envs=3, max_episode_steps=50, autoreset_mode=mode)
    assert batch.spec.max_episode_steps == 50
    singles = [gym.make(STEER, max_episode_steps=50) for _ in range(3)]
    actions = np.array([[-0.8], [-0.5], [-0.2]], dtype=np.float32)
    batch.reset(seed=7)
    for i, env in enumerate(singles):
        env.reset(seed=7 + i)
    for step in range(1, 51):
        _, reward, terminated, truncated, info = batch.step(actions)
        for i, env in enumerate(singles):
            _, one, *ends, _ = env.step(actions[i])
            assert (reward[i], terminated[i], truncated[i]) == (pytest.approx(one, rel=1e-9), *ends)
        assert truncated.all() == (step == 50)
    ended = info["final_info"] if mode == "SameStep" else info
    assert ended["summary"]["steps"].tolist() == [50, 50, 50]


def test_the_batch_s_limit_is_checked_and_minus_one_means_none():
    assert gym.make_vec(STEER, num_envs=2, max_episode_steps=-1).spec.max_episode_steps == 300
    assert gym.make_vec(STEER, num_envs=2, max_episode_steps=900).spec.max_episode_steps == 300
    for wrong in (0, 2.5, "9"):
        with pytest.raises(ValueError, match="max_episode_steps must be a whole number of at least 1"):
            gym.make_vec(STEER, num_envs=2, max_episode_steps=wrong)
    sync = gym.make_vec(STEER, num_envs=2, max_episode_steps=50, vectorization_mode="sync")
    sync.reset(seed=0)
    ends = [sync.step(np.full((2, 1), -0.5, dtype=np.float32))[3].all() for _ in range(50)]
    assert ends == [False] * 49 + [True]


def test_time_can_be_observed():
    env = TimeAwareObservation(gym.make(STEER, time_limit=2.0), normalize_time=True)
    assert env.observation_space.shape == (8,)
    env.reset(seed=0)
    seen = [env.step(HELD)[0] for _ in range(20)]
    assert [round(float(x[-1]), 3) for x in seen[:2]] == [0.05, 0.1]
    assert seen[-1][-1] == 1.0
    assert all(env.observation_space.contains(x) for x in seen)


# --- the goal env -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [{}, {"max_episode_steps": 50}])
def test_the_goal_env_passes_sb3_s_check_as_gym_make_gives_it(settings):
    env = gym.make("MagWire/ReachGoal-v0", **settings)
    sb3_check_env(env)
    rewards = env.compute_reward(np.array([[0.5], [0.5]]), np.array([[0.5], [0.9]]), [{}, {}])
    assert rewards.tolist() == [0.0, -1.0]
    assert type(gym.make(env.spec)) is type(env)


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("MagWire/ReachGoal-v0", "a goal env with dicts for observations, which only gym.make takes"),
        ("Pendulum-v1", "task must be one of MagWire/Steer-v0, "),
        ("MagWire/Stear-v0", "did you mean 'MagWire/Steer-v0'?"),
        ("no_such_module:MagWire/Steer-v0", "No module named 'no_such_module'"),
    ],
)
@pytest.mark.parametrize("command", ["train", "evaluate MaxForce --episodes 1", "plot MaxForce", "play"])
def test_commands_say_which_tasks_there_are(command, task, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        magwire([*command.split(), "--task", task])
    assert words in str(stopped.value)
    assert repr(task) in str(stopped.value)
    assert not any(tmp_path.iterdir())


# --- messages ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("action", "got"),
    [
        (0.2, r"got a number by itself, 0\.2"),
        (np.zeros((1, 1), dtype=np.float32), r"got \(1, 1\)"),
        (np.zeros(2, dtype=np.float32), r"got \(2,\)"),
        ([], r"got \(0,\)"),
    ],
)
def test_a_single_env_names_the_shape_of_an_action(action, got):
    env = gym.make(STEER)
    env.reset(seed=0)
    before = env.unwrapped.simulator.tip_arclength.copy()
    with pytest.raises(ValueError, match=rf"^action must have shape \(1,\), {got}$"):
        env.step(action)
    with pytest.raises(ValueError, match=r"^action must be an array of shape \(1,\), got 'left'$"):
        env.step("left")
    assert env.unwrapped.simulator.tip_arclength == before


@pytest.mark.parametrize(
    ("action", "got"), [(0.2, "a number by itself, 0.2"), (np.zeros(3), "(3,)"), (np.zeros((2, 1)), "(2, 1)")]
)
def test_a_batch_names_the_shape_of_its_actions(action, got):
    envs = gym.make_vec(STEER, num_envs=3)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action must have shape \(3, 1\)") as error:
        envs.step(action)
    assert str(error.value).endswith(f"got {got}")


def test_the_same_lanes_can_be_shown_by_other_channels():
    """To a teacher, for example: as an env with these channels shows them, and not to the policy itself."""
    channels = ("drive_preview", "tip_speed", "magnet_speed")
    plain, rich = (gym.make_vec(STEER, num_envs=3, **k) for k in ({}, {"observe": channels}))
    before = plain.reset(seed=4)[0].shape
    other = plain.unwrapped.core.beside(channels)
    seen = rich.reset(seed=4)[0]
    for _ in range(5):
        assert np.array_equal(other.observe(), seen)
        action = plain.action_space.sample()
        assert plain.step(action)[0].shape == before
        seen = rich.step(action)[0]
    with pytest.raises(ValueError, match="observe"):
        plain.unwrapped.core.beside(("magnet_sped",))
