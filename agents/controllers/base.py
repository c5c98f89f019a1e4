"""What every controller is: built from an env, asked like an SB3 policy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.envs.core import SteeringCore

__all__ = ["Controller"]


class Controller(ABC):
    """A policy for one env (or batch), which it takes its model, its action mode and its observation's layout from."""

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, **settings: Any) -> None:
        core = getattr(env.unwrapped, "core", None)
        if not isinstance(core, SteeringCore):
            raise ValueError(f"env must be a MagWire env or batch, got {env!r}")
        self.core = core

    @classmethod
    def from_env(cls, env: gym.Env | gym.vector.VectorEnv, **settings: Any) -> Controller:
        """The controller for `env`; settings as its own arguments."""
        return cls(env, **settings)

    def predict(
        self,
        observation: np.ndarray,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """SB3's form: observation (size,) or (n, size) → action (k,) or (n, k) and the controller's memory.

        episode_start : (n,) true where an episode has just begun; memory starts afresh there
        """
        batch = np.atleast_2d(observation)
        starts = np.zeros(len(batch), dtype=np.bool_) if episode_start is None else np.atleast_1d(episode_start)
        action, state = self.act(batch, state, starts, deterministic)
        return (action if np.ndim(observation) == 2 else action[0]), state

    @abstractmethod
    def act(
        self, observation: np.ndarray, state: tuple[np.ndarray, ...] | None, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """`predict` for a batch (n, size), with `starts` (n,)."""

    def seen(self, observation: np.ndarray, channel: str) -> np.ndarray:
        """One channel of the observation, (n, its size), as scaled by the env; `ValueError` if it is not observed."""
        return observation[:, self.core.observer.part(channel)]
