"""What the magnets could do ahead of the tip: the drive there and its slopes, with the magnets as point dipoles."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel
from ..simulation import Simulator
from ..simulation.magnetics import MAGNET, SLOT
from ..simulation.model import require

__all__ = ["DrivePreview"]

_SMALL = 1e-5
"""m, for the slope along a slide."""


class DrivePreview:
    """The drive ahead of the tips of a simulator's wires.

    offsets : (k,) m along the centreline
    reach : (dof,) rad and m; a slope is what so much more gives

    Raises `ValueError` for a wire model without a quasi-static theory.
    """

    def __init__(self, sim: Simulator, offsets: np.ndarray, reach: np.ndarray) -> None:
        scenarios = sim.library.scenarios
        require(scenarios[0], "quasistatic", "the drive ahead of the tip")
        self._sim, self._offsets, self._reach = sim, np.asarray(offsets, dtype=np.float64), reach
        self._moment = np.array([sc.tip.moment for sc in scenarios])
        self._wrench = np.array([float(sc.coupling == "wrench") for sc in scenarios])

    def read(self) -> np.ndarray:
        """(n, k (1 + dof)) N, place by place: the drive, then its slope by every degree of freedom.

        The magnets stand where the scenario places them, plus their slides; coils are left out.
        """
        sim, library = self._sim, self._sim.library
        seen = np.empty((sim.num_envs, len(self._offsets) * (1 + sim.dof)))
        count = library.magnet_count
        drive_ahead(
            sim.model.ahead(self._offsets), sim.rig.entry, self._moment, self._wrench, library.rigs.slots[:count],
            library.rigs.magnets[:, :count], sim.rig.q, self._reach, seen,
        )  # fmt: skip
        return seen


@inlined
def point_drive(at, centre, moment, wrench):
    """Drive of a point dipole along the unit vector `moment` at `centre`, over μ0 m m_tip/4π (N → 1/m⁴).

    at : (9,) point, tangent and curvature vector of the centreline
    With r from magnet to tract, c = t·r/r and κ n the curvature vector it is M̂·g: g = 3 [(1 − 5 c²) r/r + 2 c t]/r⁴,
    plus under `wrench` [3 (κ n·r) r/r² − κ n]/r³.
    """
    r2, along, turned, to_tip, to_tangent, to_bend = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        r = at[axis] - centre[axis]
        r2 += r * r
        along += at[3 + axis] * r
        turned += at[6 + axis] * r
        to_tip += moment[axis] * r
        to_tangent += moment[axis] * at[3 + axis]
        to_bend += moment[axis] * at[6 + axis]
    drive = 3.0 * ((1.0 - 5.0 * along * along / r2) * to_tip + 2.0 * along * to_tangent) / r2
    return (drive + wrench * (3.0 * turned * to_tip / r2 - to_bend)) / (r2 * math.sqrt(r2))


@inlined
def turned_about(axis, angle, vector, out):
    """`vector` (3,) turned about a world axis into `out`."""
    c, s = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    x, y = vector[i], vector[j]
    out[axis], out[i], out[j] = vector[axis], c * x - s * y, s * x + c * y


@inlined
def across(axis, vector, out):
    """How `vector` moves, a radian of turn about a world axis: the axis across it, into `out`."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    x, y = vector[i], vector[j]
    out[axis], out[i], out[j] = 0.0, -y, x


REST, ONCE, MOMENT, FIRST, SECOND, CENTRE = range(6)
"""Rows of `stand`'s work: the moment at rest, after the first turn, as it is; how each turn moves it; the centre."""


@kernel
def stand(slots, m, magnet, q, lane, work):
    """Where magnet `m` of a lane stands, and how its turns move its moment, into `work` (6, 3).

    The row `REST` is given, a unit vector; a turn that is not there leaves its row as it is.
    """
    first, second = slots[m, SLOT.turn_1], slots[m, SLOT.turn_2]
    for axis in range(3):
        d = slots[m, SLOT.slide_x + axis]
        work[CENTRE, axis] = magnet[MAGNET.centre_x + axis] + (q[d, lane] if d >= 0 else 0.0)
        work[ONCE, axis] = work[REST, axis]
    if first >= 0:
        turned_about(slots[m, SLOT.axis_1], q[first, lane], work[REST], work[ONCE])
        across(slots[m, SLOT.axis_1], work[ONCE], work[FIRST])
    for axis in range(3):
        work[MOMENT, axis] = work[ONCE, axis]
    if second >= 0:  # the second turn carries the first one's slope along
        turned_about(slots[m, SLOT.axis_2], q[second, lane], work[ONCE], work[MOMENT])
        across(slots[m, SLOT.axis_2], work[MOMENT], work[SECOND])
        if first >= 0:
            for axis in range(3):
                work[ONCE, axis] = work[FIRST, axis]
            turned_about(slots[m, SLOT.axis_2], q[second, lane], work[ONCE], work[FIRST])


@kernel
def drive_of_magnet(at, slots, m, magnet, q, lane, tip, reach, work, seen):
    """Add one magnet's drive at one place, and its slopes, to `seen` (1 + dof,).

    tip : the tip's moment, A·m², and 1 under `wrench`
    work : as `stand`'s
    """
    strength, wrench = magnet[MAGNET.strength] * tip[0], tip[1]
    stand(slots, m, magnet, q, lane, work)
    centre, moment = work[CENTRE], work[MOMENT]
    here = point_drive(at, centre, moment, wrench)
    seen[0] += strength * here
    first, second = slots[m, SLOT.turn_1], slots[m, SLOT.turn_2]
    if first >= 0:
        seen[1 + first] = strength * point_drive(at, centre, work[FIRST], wrench) * reach[first]
    if second >= 0:
        seen[1 + second] = strength * point_drive(at, centre, work[SECOND], wrench) * reach[second]
    for axis in range(3):
        d = slots[m, SLOT.slide_x + axis]
        if d >= 0:
            centre[axis] += _SMALL
            slope = (point_drive(at, centre, moment, wrench) - here) / _SMALL
            centre[axis] -= _SMALL
            seen[1 + d] = strength * slope * reach[d]


@kernel
def drive_ahead(found, entries, moments, wrench, slots, magnets, q, reach, seen):
    """The drive at the places `found` (n, k, 9), see `DrivePreview.read`."""
    places, size = found.shape[1], 1 + reach.shape[0]
    work = np.zeros((6, 3))
    work[REST, 2] = 1.0
    for lane in range(seen.shape[0]):
        entry = entries[lane]
        tip = moments[entry], wrench[entry]
        for k in range(places):
            here = seen[lane, k * size : (k + 1) * size]
            here[:] = 0.0
            for m in range(slots.shape[0]):
                drive_of_magnet(found[lane, k], slots, m, magnets[entry, m], q, lane, tip, reach, work, here)
