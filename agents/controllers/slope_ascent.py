"""Gradient ascent on the drive just ahead of the tip: a controller that is smooth where others switch."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from magwire_env.envs.observation import PREVIEW_OFFSETS
from magwire_env.physics.checks import one_of, positive

from .base import Controller, Memory

__all__ = ["SlopeAscent"]


_LEAST = 0.05
"""10 mN; much weaker drives are not followed at full speed."""


class SlopeAscent(Controller):
    """Moves every degree of freedom up the slope of the drive, both taken in the mean from the tip to `ahead`.

    Knows: a force model, the channel ``drive_preview``. It turns the magnets from where they are and looks for no best
    angle, so its action is a continuous function of that channel: a teacher whose actions a network can learn.

    The slopes count relative to the length of the vector of the drive and all of them. A single turning magnet has a
    drive of A cos(φ − φ₀), so this is the sine of the angle that it still has to turn.

    gain : share of the servo's speed for a slope as large as that length
    ahead : m; slopes of the places up to it count

    Raises `ValueError` in a task without a goal to pass, in one that comes back, and under an action mode but "rate".
    """

    env_kwargs: ClassVar[dict[str, Any]] = {"observe": ["drive_preview"], "action_mode": "rate"}

    def __init__(
        self,
        env: gym.Env | gym.vector.VectorEnv,
        gain: float = 3.0,
        ahead: float = 0.01,
        **settings: Any,
    ) -> None:
        super().__init__(env, **settings)
        kind = self.core.task.kind
        if not kind.passes or kind.returns:
            raise ValueError(f"SlopeAscent needs a goal ahead that is to be passed, which {self.core.task.id} has not")
        one_of("action_mode", self.core.actuation.mode, ("rate",))
        self.gain = positive("gain", gain)
        self._places = np.array(PREVIEW_OFFSETS) <= positive("ahead", ahead, "m")

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        seen = self.seen(observation, "drive_preview").reshape(len(observation), len(PREVIEW_OFFSETS), -1)
        mean = seen[:, self._places].mean(axis=1)  # the drive, then its slopes
        length = np.sqrt(np.sum(mean**2, axis=1, keepdims=True))
        return np.clip(self.gain * mean[:, 1:] / (length + _LEAST), -1.0, 1.0).astype(np.float32), state
