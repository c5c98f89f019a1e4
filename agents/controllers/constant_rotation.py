"""The naive open-loop policy: the magnet turns all the time."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from .base import Controller, Memory

__all__ = ["ConstantRotation"]


class ConstantRotation(Controller):
    """Turns every magnet at a constant speed from home; slides stay in the middle of their range.

    Knows: the time since the episode's start.

    speed : rad/s
    """

    sees_nothing = True

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, speed: float = 1.0, **settings: Any) -> None:
        super().__init__(env, **settings)
        self.speed = speed

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        sim = self.core.sim
        elapsed = np.zeros(len(observation)) if state is None else np.where(starts, 0.0, state[0])
        angle = self.speed * (elapsed + sim.control_period)
        _, low, high = self.limits
        command = (low + high) / 2 + sim.library.is_turn * angle[:, None]
        return self.core.actuation.action(command), (elapsed + sim.control_period,)
