"""The quasi-static balance of a whole wire that slides along its tract: the force that the tip must supply.

The wire moves as one along the tract. T is the tension of its springs, E I its bending rigidity, κ the tract's
curvature, and N = T + ½ E I κ². The bending energy is ½ E I κ² a metre. Its derivative by arc length says that the
joints push with ½ E I (κ²)′ a metre along the wire; its derivative by stretch, that they pull with E I κ² at both ends.
So the balance along the wire, and its conditions at the two ends, are

    N′ = ± μ |T κ n + w⊥| − w·t ± c v,      N(tail) = −½ E I κ²,      force at the tip = N + ½ E I κ²

with weight w and drag c a metre; the upper sign holds for forward motion. As in the kernel, the lateral load is that of
T and not of N: the bending reaction is left out. With E I = 0 and w = 0 this is the capstan equation. The condition at
the tail is known, so one integration from the tail to the tip gives the force at the tip, whatever the magnet does.
When the wire moves backwards, the tip pushes it: T < 0, and its size grows towards the tip by the same formula.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..compiled import kernel
from ..scenario import Scenario
from ..simulation.centreline import COURSE, curve_at, tables
from ..simulation.vectors import dot

__all__ = ["Tails"]

_STEP = 2e-3
"""Largest step of the integration along the wire by Heun's method, m."""

LENGTH, RIGIDITY, WX, WY, WZ, MU, DRAG = range(len(COURSE), len(COURSE) + 7)
"""Columns of a scenario's row; its `Course` comes first."""


@kernel
def _curve_and_weight(s: float, par: np.ndarray, table: np.ndarray) -> tuple[float, float, float, float]:
    """Curvature squared, weight along the tangent, weight along κ n, and the weight across the tract squared."""
    _, t, k = curve_at(s, par, table)
    w = par[WX], par[WY], par[WZ]
    along = dot(w, t)
    return dot(k, k), along, dot(w, k), max(dot(w, w) - along * along, 0.0)


@kernel
def _slope(
    force: float, per_speed: float, course: tuple[float, float, float, float], par: np.ndarray, direction: float
) -> tuple[float, float]:
    """d/ds of N, and d/ds of N's derivative by speed. `course` is of `_curve_and_weight`."""
    k2, along, bent, across = course
    tension = force - 0.5 * par[RIGIDITY] * k2
    load2 = tension * tension * k2 + 2.0 * tension * bent + across
    load = np.sqrt(max(load2, 0.0))
    rub = direction * par[MU]
    grows = (tension * k2 + bent) / load if load > 0.0 else 0.0
    return rub * load - along, rub * grows * per_speed + par[DRAG]


@kernel
def _integrate(
    tips: np.ndarray,
    entries: np.ndarray,
    par: np.ndarray,
    table: np.ndarray,
    direction: float,
    force: np.ndarray,
    per_speed: np.ndarray,
) -> None:
    """Write, for every tip, the force there (N) and its growth with speed (N·s/m), both signed along the tract."""
    for i in range(len(tips)):
        p = par[entries[i]]
        steps = max(1, int(np.ceil(p[LENGTH] / _STEP)))
        h = p[LENGTH] / steps
        s = tips[i] - p[LENGTH]
        here = _curve_and_weight(s, p, table)
        n, x = -0.5 * p[RIGIDITY] * here[0], 0.0
        for k in range(1, steps + 1):
            there = _curve_and_weight(s + k * h, p, table)
            dn, dx = _slope(n, x, here, p, direction)
            en, ex = _slope(n + h * dn, x + h * dx, there, p, direction)
            n, x = n + 0.5 * h * (dn + en), x + 0.5 * h * (dx + ex)
            here = there
        force[i], per_speed[i] = n + 0.5 * p[RIGIDITY] * here[0], x


class Tails:
    """The wires and tracts of scenarios, ready for `resistance`."""

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self._table, courses = tables([sc.tract for sc in scenarios])
        self._par = np.hstack([courses, [_row(sc) for sc in scenarios]])

    def resistance(self, entries: np.ndarray, tips: np.ndarray, direction: float) -> tuple[np.ndarray, np.ndarray]:
        """The force that the tip must supply to move the wire behind it.

        entries : (n,) number of the scenario
        tips : (n,) m, arc length of the tip
        direction : +1 forward, −1 backward

        Returns the force (n,) N along the direction of motion at a standstill, with the whole friction against the
        motion, and its growth with speed (n,) N·s/m.
        """
        tips = np.ascontiguousarray(tips, dtype=np.float64)
        force, per_speed = np.empty_like(tips), np.empty_like(tips)
        entries = np.ascontiguousarray(entries, dtype=np.int64)
        _integrate(tips, entries, self._par, self._table, direction, force, per_speed)
        return direction * force, per_speed


def _row(sc: Scenario) -> list[float]:
    wire = sc.wire
    weight = wire.mass / wire.length * np.asarray(sc.gravity)
    return [wire.length, wire.bending_rigidity, *weight, sc.contact.friction, sc.contact.drag]
