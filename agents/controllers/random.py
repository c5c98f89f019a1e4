"""A floor to compare with: random actions."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from .base import Controller, Memory

__all__ = ["Random"]


class Random(Controller):
    """Uniform actions from a seeded generator of its own. Knows: nothing."""

    sees_nothing = True

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, seed: int = 0, **settings: Any) -> None:
        super().__init__(env, **settings)
        self._rng = np.random.default_rng(seed)

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        size = self.core.actuation.space.shape[0]
        return self._rng.uniform(-1.0, 1.0, (len(observation), size)).astype(np.float32), state
