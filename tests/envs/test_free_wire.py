"""The tasks with the free wire: single env and batch, its readings in info, pictures of it."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.quasistatic.pool import candidates
from magwire_env.render.snapshot import SLEEVE, blend, snapshots
from tests.support.free import fed_fork, paper_free


@pytest.mark.parametrize("task", ["Steer", "Reach", "Track", "Chase", "Orient", "Dual"])
def test_every_task_runs_with_the_free_wire(task):
    """The single env is lane 0 of the batch of the same seed, bit for bit; observations stay inside their space."""
    settings = {"model": "free"}
    if task in ("Chase", "Orient", "Dual"):
        settings = {"scenario": candidates(task, "train", 1)[0].replace(model="free")}
    env = gym.make(f"MagWire/{task}-v0", **settings)
    envs = gym.make_vec(f"MagWire/{task}-v0", num_envs=2, **settings)
    seen, many = env.reset(seed=4)[0], envs.reset(seed=4)[0]
    assert np.array_equal(seen, many[0])
    rng = np.random.default_rng(0)
    for _ in range(4):
        action = rng.uniform(-1, 1, (2, *env.action_space.shape)).astype(np.float32)
        seen, reward, *_, info = env.step(action[0])
        many, rewards, *_, infos = envs.step(action)
        assert env.observation_space.contains(seen)
        assert np.array_equal(seen, many[0])
        assert reward == rewards[0]
        assert info["wall_force"] == infos["wall_force"][0]
        assert info["unconverged"] == 0


def test_a_pool_s_scenarios_take_the_model_that_is_asked_for():
    env = gym.make("MagWire/Orient-v0", model="free", pool_size=1)
    env.reset(seed=0)
    assert {sc.model for sc in env.unwrapped.core.sim.library.scenarios} == {"free"}
    with pytest.raises(ValueError, match="model must be one of 'locked', 'free', got 'liquid'"):
        gym.make("MagWire/Steer-v0", model="liquid")


def test_a_fed_wire_says_what_its_drive_feels():
    env = gym.make("MagWire/Steer-v0", scenario=fed_fork())
    env.reset(seed=0)
    for _ in range(3):
        *_, info = env.step(np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32))
    sim = env.unwrapped.simulator
    assert info["inserted_length"] == sim.inserted_length[0]
    assert info["base_force"] == pytest.approx(np.linalg.norm(sim.base_force[0]))
    assert info["base_torque"] == pytest.approx(np.linalg.norm(sim.base_torque[0]))
    assert info["base_force"] > 0


def test_a_picture_shows_contact_branches_and_the_sleeve():
    env = gym.make("MagWire/Steer-v0", scenario=fed_fork(), render_mode="rgb_array")
    env.reset(seed=0)
    core, shown = env.unwrapped.core, []
    for _ in range(6):
        env.step(np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32))
        shown.append(snapshots(core)[0])
    now = shown[-1]
    assert now.nodes.shape == (25, 3)
    assert np.isfinite(now.nodes).all()
    assert now.nodes[:, 0].min() == pytest.approx(-SLEEVE)
    assert now.load == pytest.approx(np.linalg.norm(now.contact, axis=1))
    assert now.load.max() > 0
    between = blend(shown[-2], now, 0.5)  # though a node may have come out of the sleeve between
    assert np.isfinite(between.nodes).all()
    frame = env.render()
    assert frame.shape == (480, 640, 3)
    assert frame.std() > 5


def test_varied_friction_and_stiffness_reach_the_free_wire():
    scenario = paper_free(variation__friction=0.3, variation__stiffness=0.3)
    envs = gym.make_vec("MagWire/Steer-v0", num_envs=2, scenario=scenario)
    _, info = envs.reset(seed=1)
    assert len(set(info["variation/stiffness"].tolist())) == 2
    envs.step(np.zeros((2, 1), dtype=np.float32))
    tips = envs.unwrapped.simulator.tip_position
    assert np.abs(tips[0] - tips[1]).max() > 1e-9
