"""The scene in a tube: the helix of a wire without weight under thrust, without friction (row F16).

Its pitch is 2π√(2 E I/F), and it presses on the wall by r F²/(4 E I) per length, r being what the wire's axis may be
off the tube's. The wire's base may not move along the tube, all else is free. All solvers start from a helix whose
pitch is `OFF` times theory's, and let it settle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from magwire_env.validation.free.tubes import AREA, BENDING, DENSITY, MODULUS, RADIUS

__all__ = ["Found", "Helix"]


OFF = 1.1


@dataclass(frozen=True)
class Found:
    """pitch : m; load : N/m, on the wall per length of wire"""

    pitch: float
    load: float


@dataclass(frozen=True)
class Helix:
    """Numbers of the scene, in SI units: a nitinol wire of 0.4 mm.

    segments : equal ones; gap : m, from the tube's axis to the wire's where they touch; thrust : N; length : m
    axial : N; mass : kg/m; seconds : in which it settles, the last fifth being measured
    rate : 1/s, at which motion across and along the tube is damped
    """

    segments: int = 50
    gap: float = 0.3e-3
    thrust: float = 0.5
    length: float = 0.6
    axial: float = 0.1 * MODULUS * AREA
    mass: float = DENSITY * AREA
    bending: float = BENDING
    radius: float = RADIUS
    seconds: float = 0.1
    rate: float = 100.0

    name = "in a tube, helix under thrust"

    @cached_property
    def expected(self) -> Found:
        """Of theory."""
        load = self.gap * self.thrust**2 / (4 * self.bending)
        return Found(2 * math.pi * math.sqrt(2 * self.bending / self.thrust), load)

    @cached_property
    def rest(self) -> np.ndarray:
        """(N,) m, the segments."""
        return np.full(self.segments, self.length / self.segments)

    @cached_property
    def start(self) -> np.ndarray:
        """(N + 1, 3) m: a helix of `OFF` times the pitch of theory, from the base at x = 0 on; chords as long as the
        segments."""
        turn = 2 * math.pi / (OFF * self.expected.pitch) * self.length / self.segments
        along = math.sqrt(self.rest[0] ** 2 - (2 * self.gap * math.sin(0.5 * turn)) ** 2)
        k = np.arange(self.segments + 1)
        return np.stack([along * k, self.gap * np.cos(turn * k), self.gap * np.sin(turn * k)], axis=-1)

    @property
    def middle(self) -> slice:
        """Nodes that are measured, far from both ends."""
        return slice(self.segments // 4, 3 * self.segments // 4 + 1)

    def measured(self, positions: np.ndarray, forces: np.ndarray) -> Found:
        """From positions (N + 1, 3) m and the wall's force on each node (N + 1,) N, means over time."""
        x = positions[self.middle]
        phase = np.unwrap(np.arctan2(x[:, 2], x[:, 1]))
        slope = abs(float(np.polyfit(x[:, 0], phase, 1)[0]))
        return Found(2 * math.pi / slope, float(forces[self.middle].mean()) / float(self.rest[0]))
