"""The quasi-static balance of a whole wire that slides along its tract: what its tail holds against the tip.

In a wire that moves as one along the tract, let T be the tension of its springs and N = T + ½ E I κ². The joints of a
wire of bending energy ½ E I κ² a metre push with ½ E I (κ²)′ a metre along it and pull with E I κ² at its two ends
(from the energy, by arc length and by stretch), so both ends are free where N + ½ E I κ² balances the outer force, and

    N′ = ± μ |T κ n + w⊥| − w·t ± c v,      N(tail) = −½ E I κ²,      force at the tip = N + ½ E I κ²

with weight w and drag c a metre, the upper sign moving forward. The lateral load is that of the kernel: T and not N, so
the bending reaction is left out, and the capstan is the case E I = w = 0. The tail's condition is known, hence one
integration from the tail to the tip gives the force the tip must supply, whatever the magnet does. Moving backwards it
is the tip that pushes: T < 0 and grows in size from the tail to the tip, by the same formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit

from ..scenario import Scenario

__all__ = ["Tails"]

_STEP = 2e-3
"""Largest step of the integration along the wire, m (Heun)."""

_JIT: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
}

FIRST_ROW, LAST_ROW, SPACING, PERIOD, LENGTH, STIFFNESS, WX, WY, WZ, MU, DRAG = range(11)


@njit(**_JIT)
def _row_at(s, par, table):
    """The table's row at arc length `s`, and the distance from its start."""
    if par[PERIOD] > 0.0:
        s = s - par[PERIOD] * np.floor(s / par[PERIOD])
    row = min(max(np.floor(s / par[SPACING]) + 1.0, 0.0), par[LAST_ROW])
    return table[np.int64(par[FIRST_ROW] + row)], s - (row - 1.0) * par[SPACING]


@njit(**_JIT)
def _course(s, par, table):
    """Curvature squared, weight along the tangent, weight along κ n, and the weight across the tract squared."""
    c, u = _row_at(s, par, table)
    kx, ky, kz = 2.0 * c[6] + 6.0 * u * c[9], 2.0 * c[7] + 6.0 * u * c[10], 2.0 * c[8] + 6.0 * u * c[11]
    tx = c[3] + u * (2.0 * c[6] + 3.0 * u * c[9])
    ty = c[4] + u * (2.0 * c[7] + 3.0 * u * c[10])
    tz = c[5] + u * (2.0 * c[8] + 3.0 * u * c[11])
    wx, wy, wz = par[WX], par[WY], par[WZ]
    along = wx * tx + wy * ty + wz * tz
    across = max(wx * wx + wy * wy + wz * wz - along * along, 0.0)
    return kx * kx + ky * ky + kz * kz, along, wx * kx + wy * ky + wz * kz, across


@njit(**_JIT)
def _slope(force, per_speed, course, par, direction):
    """d/ds of N and of its derivative by speed."""
    k2, along, bent, across = course
    tension = force - 0.5 * par[STIFFNESS] * k2
    load2 = tension * tension * k2 + 2.0 * tension * bent + across
    load = np.sqrt(max(load2, 0.0))
    rub = direction * par[MU]
    grows = (tension * k2 + bent) / load if load > 0.0 else 0.0
    return rub * load - along, rub * grows * per_speed + par[DRAG]


@njit(**_JIT)
def _integrate(tips, entries, par, table, direction, force, per_speed):
    """For every lane the force at the tip (N) and its growth with speed (N·s/m), both signed along the tract."""
    for i in range(len(tips)):
        p = par[entries[i]]
        steps = max(1, int(np.ceil(p[LENGTH] / _STEP)))
        h = p[LENGTH] / steps
        s = tips[i] - p[LENGTH]
        here = _course(s, p, table)
        n, x = -0.5 * p[STIFFNESS] * here[0], 0.0
        for k in range(1, steps + 1):
            there = _course(s + k * h, p, table)
            dn, dx = _slope(n, x, here, p, direction)
            en, ex = _slope(n + h * dn, x + h * dx, there, p, direction)
            n, x = n + 0.5 * h * (dn + en), x + 0.5 * h * (dx + ex)
            here = there
        force[i], per_speed[i] = n + 0.5 * p[STIFFNESS] * here[0], x


class Tails:
    """The wires and tracts of scenarios, as numbers; see `pull`."""

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        first: dict = {}
        tables, rows = [], 0
        for sc in scenarios:
            if sc.tract not in first:
                first[sc.tract] = rows
                tables.append(sc.tract.table)
                rows += len(sc.tract.table)
        self._table = np.ascontiguousarray(np.vstack(tables))
        self._par = np.array([_row(sc, first[sc.tract]) for sc in scenarios])

    def pull(self, entries: np.ndarray, tips: np.ndarray, direction: float) -> tuple[np.ndarray, np.ndarray]:
        """What the tip must supply to move the wire behind it.

        entries : (n,) number of the scenario
        tips : (n,) m, arc length of the tip
        direction : +1 forward, −1 backward

        Returns the force along the direction of motion at a standstill (n,) N, friction fully against the motion, and
        its growth with speed (n,) N·s/m.
        """
        tips = np.ascontiguousarray(tips, dtype=np.float64)
        force, per_speed = np.empty_like(tips), np.empty_like(tips)
        entries = np.ascontiguousarray(entries, dtype=np.int64)
        _integrate(tips, entries, self._par, self._table, direction, force, per_speed)
        return direction * force, per_speed


def _row(sc: Scenario, first_row: int) -> list[float]:
    tract, wire = sc.tract, sc.wire
    weight = wire.mass / wire.length * np.asarray(sc.gravity)
    period = tract.length if tract.closed else 0.0
    return [
        first_row, len(tract.table) - 1, tract.row_spacing, period, wire.length, wire.bending_rigidity, *weight,
        sc.contact.friction, sc.contact.drag,
    ]  # fmt: skip
