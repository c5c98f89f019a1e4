"""Extremum seeking: turn the magnet towards more force, in the direction that a small dither shows."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.envs.observation import FORCE_SCALE
from magwire_env.physics.checks import positive
from magwire_env.scenario.rig import wrapped

from .base import Controller, Memory
from .seen import magnet_seen, way_seen

__all__ = ["ExtremumSeeking"]

_LEAST_SWING = 1e-3
"""Lower bound of the mean square of a magnet's swing, in squares of the servo's travel in a control period.

It keeps the slope of the force from growing without limit when the magnet hardly moves.
"""

_LEAST_FORCE = 1e-6
"""Lower bound of the force that slopes are divided by, N."""

_LEVEL = 0.02
"""Slope below which the direction uphill stays as it was: a share of the force for each servo travel of a period."""

_LEASH = 3.0
"""Number of control periods of servo travel by which the estimate may lead the magnet."""


class ExtremumSeeking(Controller):
    """Perturbation-based extremum seeking (Ariyur and Krstić, "Real-time optimization by extremum-seeking control").

    Knows: the force along the tract and across it, where the magnets are, and in a task that comes back whether the tip
    is on its way back. It has no model and knows no place.

    The command of every degree of freedom is an estimate of the best one plus a sinusoidal dither with a period of its
    own. The measured force and magnet setting pass a high-pass filter. The low-passed product of the two over the
    low-passed square of the setting is the slope of the force. The estimate moves uphill in proportion to the slope
    over the size of the force. Where the force pulls backwards, it moves uphill as fast as the servo.

    amplitude : of the dither, in the servo's travel in a control period
    period : of the dither, control periods; each further degree of freedom has a period that is a fifth shorter
    gain : step of the estimate for a slope as large as the force, both for the servo's travel in a control period
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

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        sim = self.core.sim
        speed, low, high = self.limits
        reach, turns = speed * sim.control_period, sim.library.is_turn
        way = way_seen(self, observation)[:, None]
        drive = self.seen(observation, "drive_force").astype(np.float64) * FORCE_SCALE * way
        size = np.hypot(drive, self.seen(observation, "lateral_force").astype(np.float64) * FORCE_SCALE)
        magnet = magnet_seen(self, observation)
        none = np.zeros_like(magnet)
        memory: tuple[np.ndarray, ...] = (
            none, magnet, none + 1.0, magnet, drive + none, size + none, none, none
        )  # fmt: skip
        if state is not None:
            memory = tuple(np.where(starts[:, None], new, old) for new, old in zip(memory, state, strict=True))
        steps, guess, uphill, middle, mean, scale, product, square = memory
        magnet = np.where(turns, guess + wrapped(magnet - guess), magnet)
        # High-pass and low-pass filters; from here on a swing is in units of the servo's travel in a period.
        swing, rise = (magnet - middle) / reach, drive - mean
        middle, mean = middle + self._slow * (magnet - middle), mean + self._slow * rise
        scale = scale + self._fast * (size - scale)
        product = product + self._fast * (swing * rise - product)
        square = square + self._fast * (swing**2 - square)
        slope = product / np.maximum(square, _LEAST_SWING) / np.maximum(scale, _LEAST_FORCE)
        uphill = np.where(np.abs(slope) > _LEVEL, np.sign(slope), uphill)
        move = np.where(drive < 0.0, uphill, np.clip(self.gain * slope, -1.0, 1.0))
        # The estimate must not run away from a magnet that cannot follow.
        guess = magnet + np.clip(guess + move * reach - magnet, -_LEASH * reach, _LEASH * reach)
        guess = np.where(turns, guess, np.clip(guess, low, high))
        command = guess + self.amplitude * reach * np.sin(self._pace * (steps + 1.0))
        return self.core.actuation.action(command), (
            steps + 1.0, guess, uphill, middle, mean, scale, product, square
        )  # fmt: skip
