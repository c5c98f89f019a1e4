"""What controllers read from an observation is what the simulator knows."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from agents.controllers import Random
from agents.controllers.seen import aim_seen, magnet_seen, tip_seen


@pytest.mark.parametrize("task", ["Steer", "Reach", "Chase", "Dual"])
def test_tip_magnet_and_goal_are_read_back(task):
    envs = gym.make_vec(f"MagWire/{task}-v0", num_envs=4, **({"pool_size": 2} if task in ("Chase", "Dual") else {}))
    controller, core = Random.from_env(envs), envs.unwrapped.core
    observation, _ = envs.reset(seed=3)
    for _ in range(5):
        observation = envs.step(controller.predict(observation)[0])[0]
    tip, speed = tip_seen(controller, observation)
    assert tip == pytest.approx(core.sim.tip_arclength, abs=1e-6)
    assert speed == pytest.approx(core.sim.tip_velocity, abs=1e-6)
    gap = magnet_seen(controller, observation) - core.sim.magnet
    turns = core.sim.library.is_turn
    assert np.where(turns, np.angle(np.exp(1j * gap)), gap) == pytest.approx(0.0, abs=1e-5)
    aims = aim_seen(controller, observation, np.array([0.1, 0.2]))
    assert aims == pytest.approx(np.repeat(core.goal[:, None], 2, axis=1), abs=1e-6)


def test_a_reference_is_read_back_between_its_points():
    envs = gym.make_vec("MagWire/Track-v0", num_envs=4)
    controller, core = Random.from_env(envs), envs.unwrapped.core
    observation, _ = envs.reset(seed=3)
    period = core.sim.control_period
    aims = aim_seen(controller, observation, period * np.arange(1, 12))
    assert aims == pytest.approx(core.episodes.reference[:, 1:12], abs=5e-4)
