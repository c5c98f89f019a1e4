"""The naive open-loop policy: keep the magnet turning."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from .base import Controller

__all__ = ["ConstantRotation"]


class ConstantRotation(Controller):
    """Turns every magnet at a constant speed from home; slides stay in the middle of their range.

    Knows: nothing but the time.

    speed : rad/s
    """

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, speed: float = 1.0, **settings: Any) -> None:
        super().__init__(env, **settings)
        self.speed = speed

    def act(self, observation, state, starts, deterministic):
        sim = self.core.sim
        elapsed = np.zeros(len(observation)) if state is None else np.where(starts, 0.0, state[0])
        angle = self.speed * (elapsed + sim.control_period)
        command = sim.library.dofs[sim.lane_scenario, :, 1:].mean(axis=2) + sim.library.is_turn * angle[:, None]
        return self.core.actuation.action(command), (elapsed + sim.control_period,)
