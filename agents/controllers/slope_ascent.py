"""Gradient ascent on the drive at the tip: a controller that is smooth where others switch."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from magwire_env.envs.observation import PREVIEW_OFFSETS, SPEED_SCALE
from magwire_env.physics.checks import non_negative, one_of, positive

from .base import Controller, Memory

__all__ = ["SlopeAscent"]


_LEAST = 0.05
"""10 mN; much weaker drives are not followed at full speed."""


class SlopeAscent(Controller):
    """Moves every degree of freedom up the slope of the drive, where the tip will be in `lead` at its present speed.

    Knows: a force model, the channel ``drive_preview``, and the tip's speed. It turns the magnets from where they are
    and looks for no best angle, so its action is a continuous function of what it sees, which a network can learn.

    The slopes count relative to the length of the vector of the drive and all of them. A single turning magnet has a
    drive of A cos(φ − φ₀), so this is the sine of the angle that it still has to turn.

    gain : share of the servo's speed for a slope as large as that length
    lead : s

    Raises `ValueError` in a task without a goal to pass, in one that comes back, and under an action mode but "rate".
    """

    env_kwargs: ClassVar[dict[str, Any]] = {"observe": ["drive_preview", "tip_speed"], "action_mode": "rate"}

    def __init__(
        self,
        env: gym.Env | gym.vector.VectorEnv,
        gain: float = 2.5,
        lead: float = 0.25,
        **settings: Any,
    ) -> None:
        super().__init__(env, **settings)
        kind = self.core.task.kind
        if not kind.passes or kind.returns:
            raise ValueError(f"SlopeAscent needs a goal ahead that is to be passed, which {self.core.task.id} has not")
        one_of("action_mode", self.core.actuation.mode, ("rate",))
        self.gain, self.lead = positive("gain", gain), non_negative("lead", lead, "s")

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        seen = self.seen(observation, "drive_preview").reshape(len(observation), len(PREVIEW_OFFSETS), -1)
        speed = self.seen(observation, "tip_speed") * SPEED_SCALE
        shares = _shares(np.maximum(speed, 0.0) * self.lead)
        there = np.sum(shares[:, :, None] * seen, axis=1)  # the drive, then its slopes
        length = np.linalg.norm(there, axis=1, keepdims=True)
        return np.clip(self.gain * there[:, 1:] / (length + _LEAST), -1.0, 1.0).astype(np.float32), state


def _shares(ahead: np.ndarray) -> np.ndarray:
    """The shares (n, k) that the places of the preview have in one `ahead` (n, 1) m of the tip, linear between two."""
    places = np.array(PREVIEW_OFFSETS)
    at = np.interp(ahead, places, np.arange(len(places)))
    return np.maximum(1.0 - np.abs(at - np.arange(len(places))), 0.0)
