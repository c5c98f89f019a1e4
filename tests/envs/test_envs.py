"""Both faces of every registered id: the checkers, parity, determinism, autoreset."""

from __future__ import annotations

import pickle
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import magwire_env
from magwire_env import Scenario
from magwire_env.envs.task import TASKS
from magwire_env.physics import PointDipole
from magwire_env.scenario import ActuatedMagnet, Rig, Slide, Turn
from magwire_env.simulation import drive_at

IDS = magwire_env.TASK_IDS
SMALL = {f"MagWire/{name}-v0": {"pool_size": 2} for name in ("NavigateAny", "Recover", "Gentle", "Uniform")}
"""A tree's wall takes a second or two to make, and tests begin with none."""


@pytest.mark.parametrize("env_id", IDS)
def test_gymnasium_and_sb3_checkers_pass(env_id):
    env = gym.make(env_id, **SMALL.get(env_id, {}))
    check_env(env.unwrapped, skip_render_check=True)
    sb3_check_env(env.unwrapped)


@pytest.mark.parametrize("env_id", IDS)
def test_spec_survives_pickling_and_making_again(env_id):
    spec = pickle.loads(pickle.dumps(gym.make(env_id, **SMALL.get(env_id, {})).spec))
    assert gym.make(spec).spec.id == env_id


def rollout(env, seed, steps=60):
    env.action_space.seed(seed)
    observation, _ = env.reset(seed=seed)
    rows = [observation]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        rows.append(np.append(observation, [reward, terminated, truncated, info["wall_force"]]))
    return np.concatenate(rows)


@pytest.mark.parametrize("env_id", IDS)
def test_same_seed_same_trajectory(env_id):
    small = SMALL.get(env_id, {})
    first, again, other = (rollout(gym.make(env_id, **small), seed, 20 if small else 60) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


SCRIPT = """
import hashlib
import gymnasium as gym, magwire_env
from tests.envs.test_envs import rollout
print(hashlib.sha256(rollout(gym.make({env_id!r}), 3).tobytes()).hexdigest())
"""


def test_same_trajectory_in_another_process():
    import hashlib
    from pathlib import Path

    command = [sys.executable, "-c", SCRIPT.format(env_id=IDS[0])]
    root = Path(__file__).parents[2]
    there = subprocess.run(command, capture_output=True, text=True, check=True, cwd=root).stdout.strip()
    assert there == hashlib.sha256(rollout(gym.make(IDS[0]), 3).tobytes()).hexdigest()


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_lane_i_of_a_batch_is_a_single_env_seeded_s_plus_i(env_id, mode):
    """Bit for bit, over episode ends, in every autoreset mode (short episodes, so that all lanes end twice)."""
    n, seed, settings = 5, 11, {"time_limit": 1.2, **SMALL.get(env_id, {})}
    envs = gym.make_vec(env_id, num_envs=n, autoreset_mode=mode, **settings)
    singles = [gym.make(env_id, **settings) for _ in range(n)]
    batch, _ = envs.reset(seed=seed)
    for i, env in enumerate(singles):
        assert np.array_equal(batch[i], env.reset(seed=seed + i)[0])
    rng = np.random.default_rng(0)
    ended = np.zeros(n, dtype=bool)
    ends = 0
    for _ in range(32):
        if mode == AutoresetMode.DISABLED and ended.any():
            batch, _ = envs.reset(options={"reset_mask": ended.copy()})
            for i in np.flatnonzero(ended):
                assert np.array_equal(batch[i], singles[i].reset()[0])
        actions = rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        batch, reward, terminated, truncated, infos = envs.step(actions)
        for i, env in enumerate(singles):
            if mode == AutoresetMode.NEXT_STEP and ended[i]:
                assert np.array_equal(batch[i], env.reset()[0])
                assert (reward[i], terminated[i], truncated[i]) == (0.0, False, False)
                assert not infos["_is_success"][i]
                continue
            one = env.step(actions[i])
            assert (reward[i], terminated[i], truncated[i]) == one[1:4]
            done = one[2] or one[3]
            ends += done
            last = infos["final_info"] if done and mode == AutoresetMode.SAME_STEP else infos
            assert last["_cost"][i]
            assert last["cost"][i] == one[4]["cost"]
            if done:
                assert last["summary"]["time"][i] == one[4]["summary"]["time"]
            if done and mode == AutoresetMode.SAME_STEP:
                assert np.array_equal(infos["final_obs"][i], one[0])
                assert np.array_equal(envs.unwrapped.final_observation[i], one[0])
                assert np.array_equal(batch[i], env.reset()[0])
            else:
                assert np.array_equal(batch[i], one[0])
        ended = terminated | truncated
    assert ends >= 2 * n


def test_a_lane_does_not_depend_on_its_neighbours_or_threads():
    actions = np.random.default_rng(1).uniform(-1, 1, (20, 100, 1)).astype(np.float32)

    def run(n, threads):
        envs = gym.make_vec(IDS[0], num_envs=n, threads=threads)
        envs.reset(seed=0)
        return [envs.step(a[:n])[0] for a in actions]

    full = run(100, 2)
    assert np.array_equal(np.array(run(100, 1)), np.array(full))
    assert np.array_equal(np.array(run(7, 1)), np.array(full)[:, :7])


def test_async_vector_env_works_with_its_defaults():
    """It forks; the child must not wait for the parent's threads."""
    gym.make_vec(IDS[0], num_envs=256, threads=2).reset(seed=0)  # wakes this process's threads first
    envs = gym.vector.AsyncVectorEnv([lambda: gym.make(IDS[0])] * 2)
    try:
        observation, _ = envs.reset(seed=5)
        for _ in range(3):
            observation, *_ = envs.step(np.zeros((2, 1), dtype=np.float32))
        assert np.isfinite(observation).all()
    finally:
        envs.close()


def test_success_ends_the_episode_with_time_interpolated_inside_the_step():
    env = gym.make(IDS[0])
    env.reset(seed=0, options={"tip_arclength": 0.4, "target": 0.42, "magnet_angle": 4.0})
    sim, goal = env.unwrapped.simulator, 0.42
    step, terminated = 0, False
    while not terminated and step < 100:
        step += 1
        before = sim.tip_arclength[0]
        action = env.unwrapped.core.actuation.action(np.array([[4.0]]))[0]
        _, reward, terminated, _, info = env.step(action)
    assert info["is_success"]
    assert info["path_ratio"] == 1.0
    assert before < goal <= sim.tip_arclength[0]
    assert 0.1 * (step - 1) < info["summary"]["time"] <= 0.1 * step
    assert info["reward/success"] == 10.0
    terms = [v for k, v in info.items() if k.startswith("reward/")]
    assert reward == pytest.approx(sum(terms))
    assert info["summary"]["steps"] == step


def test_leaving_backwards_ends_without_success():
    env = gym.make(IDS[0])
    env.reset(seed=0, options={"tip_arclength": 0.002, "magnet_angle": 0.0})
    times, terminated, truncated = [], False, False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = env.step(env.unwrapped.core.actuation.action(np.array([[5.7]]))[0])
        times.append(info["reward/time"])
    assert terminated
    assert not info["is_success"]
    assert times[:-1] == [-0.1] * (len(times) - 1)
    assert sum(times) == pytest.approx(-0.1 * 300)  # giving up does not save time
    assert env.unwrapped.simulator.tip_arclength[0] < 0


def test_time_limit_truncates_at_the_same_step_in_both_faces():
    env = gym.make(IDS[0], time_limit=0.5)
    env.reset(seed=0)
    flags = [env.step(np.zeros(1, dtype=np.float32))[3] for _ in range(5)]
    assert flags == [False] * 4 + [True]
    envs = gym.make_vec(IDS[0], num_envs=2, time_limit=0.5)
    envs.reset(seed=0)
    flags = [envs.step(np.zeros((2, 1), dtype=np.float32))[3].all() for _ in range(5)]
    assert flags == [False] * 4 + [True]


@pytest.mark.parametrize("mode", ["angle", "rate", "direction"])
def test_action_modes_reach_the_commanded_angle(mode):
    env = gym.make(IDS[0], action_mode=mode)
    env.reset(seed=0, options={"magnet_angle": 3.0})
    core = env.unwrapped.core
    for _ in range(12):
        env.step(core.actuation.action(np.array([[4.0]]))[0])
    assert core.sim.magnet[0, 0] == pytest.approx(4.0, abs=1e-6)


def test_sparse_reward_and_own_weights():
    from magwire_env.envs.task import RewardWeights

    for reward, expected in (("sparse", 0.0), (RewardWeights(0, 0, 0.25, 0), -0.25)):
        env = gym.make(IDS[0], reward=reward)
        env.reset(seed=0)
        assert env.step(np.zeros(1, dtype=np.float32))[1] == expected


def test_channels_by_name_and_their_layout():
    names = ("tip_force", "tip_position", "tip_tangent", "tract_preview", "tip_torque", "wall_force")
    env = gym.make(IDS[0], observe=names)
    observation, _ = env.reset(seed=0)
    sim = env.unwrapped.simulator
    assert observation.shape == (3 + 3 + 3 + 36 + 1 + 1,)
    assert observation[3:6] == pytest.approx(sim.tip_position[0] / 0.1, rel=1e-6)
    preview = observation[9:27].reshape(6, 3) * 0.1 + sim.magnet_positions[0, 0]
    ahead = sim.scenarios[0].tract.position(sim.tip_arclength[0] + np.array([0, 0.01, 0.02, 0.04, 0.06, 0.08]))
    assert preview == pytest.approx(ahead, abs=1e-7)


def test_the_magnets_speed_is_what_the_servo_did_and_starts_at_rest():
    env = gym.make("MagWire/Chase-v0", observe=("magnet_speed",), pool_size=1)
    observation, _ = env.reset(seed=0)
    assert (observation == 0.0).all()
    sim = env.unwrapped.simulator
    speed = sim.library.limits.speed[0]
    for _ in range(5):
        before = sim.magnet[0]
        observation, *_ = env.step(env.action_space.sample())
        moved = sim.magnet[0] - before
        moved[sim.library.is_turn] = (moved[sim.library.is_turn] + np.pi) % (2 * np.pi) - np.pi
        assert observation == pytest.approx(moved / (speed * 0.1), abs=1e-6)
    assert (env.reset(seed=1)[0] == 0.0).all()


@pytest.mark.parametrize("coupling", ["force", "wrench"])
def test_the_drive_preview_is_what_point_magnets_do_there(coupling):
    """The drive itself at the tip and ahead of it, and its slopes by every turn and slide by finite differences."""
    turns = (Turn("y", home=1.0), Slide("x", -0.05, 0.05), Turn("z", home=0.5))
    rig = Rig((
        ActuatedMagnet(PointDipole(135.6), (0.02, -0.01, 0.12), turns),
        ActuatedMagnet(PointDipole(80.0), (0.0, 0.05, -0.12), (Turn("x", home=2.0), Slide("z", -0.02, 0.0))),
    ))  # fmt: skip
    scenario = Scenario.paper().replace(rig=rig, coupling=coupling)
    env = gym.make(IDS[0], scenario=scenario, observe=("drive_force", "drive_preview"))
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        sim = env.unwrapped.simulator
        q, tip = sim.magnet[0], sim.tip_arclength[0]
        ahead = observation[1:].reshape(6, 6)
        assert ahead[0, 0] == pytest.approx(observation[0], rel=1e-4, abs=1e-5)
        for row, offset in zip(ahead, (0.0, 0.01, 0.02, 0.04, 0.06, 0.08), strict=True):
            places = np.full(6, tip + offset)
            steps = np.vstack([np.zeros(5), 1e-6 * np.eye(5)])
            drive = drive_at(scenario, q + steps, places) / 10e-3
            slopes = (drive[1:] - drive[0]) / 1e-6 * [1.0, 0.1, 1.0, 1.0, 0.1]
            assert row == pytest.approx(np.clip(np.r_[drive[0], slopes], -10, 10), rel=2e-3, abs=2e-4)


def test_coupling_and_scenario_override_the_task(tmp_path):
    env = gym.make(IDS[0], coupling="wrench")
    assert env.unwrapped.simulator.scenarios[0].coupling == "wrench"
    path = tmp_path / "mine.toml"
    Scenario.paper().replace(contact__friction=0.0).save(path)
    for given in (path, str(path)):
        assert gym.make(IDS[0], scenario=given).unwrapped.simulator.scenarios[0].contact.friction == 0.0
    assert gym.make(IDS[0], scenario="paper").unwrapped.simulator.scenarios[0] == Scenario.paper()


@pytest.mark.parametrize("env_id", IDS)
def test_random_steps_stay_finite(env_id):
    """10 000 steps; 2 000 where a wire is fed, since one that buckles takes the solver long."""
    envs = gym.make_vec(env_id, num_envs=10 if TASKS[env_id].kind.navigates else 50)
    envs.action_space.seed(0)
    envs.reset(seed=0)
    for _ in range(200):
        observation, reward, *_ = envs.step(envs.action_space.sample())
        assert np.isfinite(observation).all()
        assert np.isfinite(reward).all()
        assert envs.observation_space.contains(observation)
