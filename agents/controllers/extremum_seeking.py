"""Extremum seeking: turn the magnet uphill in force, which way being felt by a small dither."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.envs.observation import FORCE_SCALE
from magwire_env.physics.checks import positive

from .base import Controller
from .seen import magnet_seen

__all__ = ["ExtremumSeeking"]

_LEAST_SWING = 1e-3
"""Mean square of a magnet's swing, in squares of what a servo covers in a period, below which no slope is felt."""

_LEAST_FORCE = 1e-6
"""N, below which no force is felt."""

_LEVEL = 0.02
"""Slope, as a share of the force, in what a servo covers in a period, below which the way uphill stays what it was."""

_LEASH = 3.0
"""Control periods by which the estimate may lead the magnet."""


class ExtremumSeeking(Controller):
    """Perturbation-based extremum seeking (Ariyur and Krstić, "Real-time optimization by extremum-seeking control").

    Knows: the force along the tract and across it, and where the magnets are. No model, no place.

    Every degree of freedom's command is an estimate of the best one plus a sinusoidal dither, each with a period of
    its own. Force and magnet, as measured, pass a high-pass filter; their product, low-passed, over the low-passed
    square of the magnet's part is the slope of the force. The estimate moves uphill in proportion to the slope over
    the force's size; where the force pulls backwards it goes on uphill as fast as the servo does.

    amplitude : of the dither, in what a servo covers in a control period
    period : of the dither, control periods; each further degree of freedom's is a fifth shorter
    gain : the estimate's step for a slope of the force's own size, both by what a servo covers in a control period
    high_pass, low_pass : time constants, control periods
    """

    def __init__(
        self,
        env: gym.Env | gym.vector.VectorEnv,
        amplitude: float = 1.0,
        period: float = 5.0,
        gain: float = 3.0,
        high_pass: float = 2.0,
        low_pass: float = 4.0,
        **settings: Any,
    ) -> None:
        super().__init__(env, **settings)
        self.amplitude, self.gain = positive("amplitude", amplitude), positive("gain", gain)
        period = positive("period", period)
        self._slow, self._fast = (
            1.0 - np.exp(-1.0 / positive(name, time))
            for name, time in (("high_pass", high_pass), ("low_pass", low_pass))
        )
        self._pace = 2 * np.pi / (period * 0.8 ** np.arange(self.core.sim.dof))

    def act(self, observation, state, starts, deterministic):
        sim = self.core.sim
        speed, low, high = sim.library.dofs[sim.lane_scenario].transpose(2, 0, 1)
        reach, turns = speed * sim.control_period, sim.library.is_turn
        drive = self.seen(observation, "drive_force").astype(np.float64) * FORCE_SCALE
        size = np.hypot(drive, self.seen(observation, "lateral_force").astype(np.float64) * FORCE_SCALE)
        magnet = magnet_seen(self, observation)
        none = np.zeros_like(magnet)
        fresh = (none, magnet, none + 1.0, magnet, drive + none, size + none, none, none)
        if state is not None:
            fresh = tuple(np.where(starts[:, None], new, old) for new, old in zip(fresh, state, strict=True))
        steps, guess, uphill, middle, mean, scale, product, square = fresh
        magnet = np.where(turns, guess + _wrapped(magnet - guess), magnet)
        # Band by high-pass and low-pass; the swing in what a servo covers in a period, as everything that follows.
        swing, rise = (magnet - middle) / reach, drive - mean
        middle, mean = middle + self._slow * (magnet - middle), mean + self._slow * rise
        scale = scale + self._fast * (size - scale)
        product = product + self._fast * (swing * rise - product)
        square = square + self._fast * (swing**2 - square)
        slope = product / np.maximum(square, _LEAST_SWING) / np.maximum(scale, _LEAST_FORCE)
        uphill = np.where(np.abs(slope) > _LEVEL, np.sign(slope), uphill)
        move = np.where(drive < 0.0, uphill, np.clip(self.gain * slope, -1.0, 1.0))
        # It must not run away from a magnet that cannot follow.
        guess = magnet + np.clip(guess + move * reach - magnet, -_LEASH * reach, _LEASH * reach)
        guess = np.where(turns, guess, np.clip(guess, low, high))
        command = guess + self.amplitude * reach * np.sin(self._pace * (steps + 1.0))
        return self.core.actuation.action(command), (
            steps + 1.0, guess, uphill, middle, mean, scale, product, square
        )  # fmt: skip


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """In [−π, π]."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
