"""The scene round a cylinder: a stiff rod drawn over it, which it touches at one point (row F13).

The rod is pulled by 1 N at its near end and drawn at constant speed at its far one; both arms are long enough to end
straight. At the point of contact the bending moment is the same for both arms, M² = 4 E I T sin²(θ/2), so that

    T1 sin²(θ1/2) = T2 sin²(θ2/2),   T2 cos θ2 − T1 cos θ1 = μ (T1 sin θ1 + T2 sin θ2),   θ1 + θ2 = wrap.

Inextensible, without mass, drag or thickness. All solvers have the same numbers, the same mesh, and the same start: the
rod at rest without friction, as the free wire finds it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from magwire_env.validation.free.contact import draped, graded

__all__ = ["Cylinder"]


@dataclass(frozen=True)
class Cylinder:
    """Numbers of the scene, in SI units.

    wrap : rad, from arm to arm; friction : Coulomb's coefficient
    bending : N·m²; axial : N; mass : kg/m; radius : m, from the cylinder's axis to the rod's centreline
    pull : N, at the near end; speed : m/s, of the far end; travel : m, in which the pull comes to a constant
    arm : m, of each arm; middle : m, between them, where segments are `fine` m long; coarse : m, the longest segment
    """

    wrap: float = math.pi
    friction: float = 0.3
    bending: float = 1.0
    axial: float = 2.5e3
    mass: float = 3e-3
    radius: float = 0.3
    pull: float = 1.0
    speed: float = 0.3
    travel: float = 1.0
    arm: float = 5.0
    middle: float = 2.4
    fine: float = 0.1
    coarse: float = 0.3

    @property
    def name(self) -> str:
        return f"round a cylinder, {math.degrees(self.wrap):.0f}°, μ {self.friction:g}"

    @cached_property
    def expected(self) -> float:
        """T2/T1."""

        def ratio(near: float) -> float:
            return (math.sin(0.5 * near) / math.sin(0.5 * (self.wrap - near))) ** 2

        def unbalance(near: float) -> float:
            far, pull = self.wrap - near, ratio(near)
            rubbed = self.friction * (math.sin(near) + pull * math.sin(far))
            return pull * math.cos(far) - math.cos(near) - rubbed

        return ratio(brentq(unbalance, 0.5 * self.wrap, self.wrap - 1e-3))

    @cached_property
    def rest(self) -> np.ndarray:
        """(N,) m, segments from the near end to the far one: fine ones where the rod passes the cylinder."""
        return graded(self.fine, self.middle, self.arm, self.coarse)

    @cached_property
    def directions(self) -> np.ndarray:
        """(2, 3), of the pulls at the near and the far end; the far arm lies along −y."""
        lean = 0.5 * (self.wrap - math.pi)
        angles = np.array([lean + 0.5 * self.wrap + math.pi, lean - 0.5 * self.wrap])
        return np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)

    @cached_property
    def start(self) -> np.ndarray:
        """(N + 1, 3) m, the rod at rest without friction, its axis the cylinder's."""
        lean = np.array([0.5 * (self.wrap - math.pi)])
        wires, _ = draped(np.array([self.wrap]), self.rest, self.bending, self.radius, 4, lean)
        for _k in range(3):
            wires.step()
        if wires.lane("FAILED").any():
            raise RuntimeError("round a cylinder: the rod has not come to rest")
        return wires.positions[0].copy()
