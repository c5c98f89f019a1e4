"""How the magnets stand to the tract ahead of the tip: geometry alone, no magnetic force."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined, kernel
from ..simulation import Simulator
from ..simulation.magnetics import SLOT
from .preview import CENTRE, FIRST, MOMENT, REST, SECOND, stand

__all__ = ["SightPreview"]

_LEAST = 1e-6
"""m, between a magnet and the tract."""


class SightPreview:
    """The distance of every magnet from places ahead of the tips, and the angles between it and the tract there.

    offsets : (k,) m along the centreline
    scale : m, what distances are divided by

    With r from magnet to tract, r̂ its direction, t the tract's tangent, b its curvature vector p'' · `scale`, and M̂ the
    direction of the magnet's moment, a magnet and a place give r̂·t, |r|/`scale`, r̂·b, and M̂·t, M̂·r̂, M̂·b; then every
    degree of freedom of that magnet gives three numbers: for a turn, what a radian of it adds to M̂·t, M̂·r̂ and M̂·b; for
    a slide, how far along t, r̂ and b its axis points.
    """

    def __init__(self, sim: Simulator, offsets: np.ndarray, scale: float) -> None:
        self._sim, self._offsets, self._scale = sim, np.asarray(offsets, dtype=np.float64), scale
        count = sim.library.magnet_count
        self._slots = np.ascontiguousarray(sim.library.rigs.slots[:count])
        self.size = len(self._offsets) * sum(6 + 3 * len(own_dofs(slots)) for slots in self._slots)

    def read(self) -> np.ndarray:
        """(n, size), place by place, magnet by magnet."""
        sim, library = self._sim, self._sim.library
        seen = np.empty((sim.num_envs, self.size))
        sight_ahead(
            sim.model.ahead(self._offsets), sim.rig.entry, self._slots,
            library.rigs.magnets[:, : library.magnet_count], sim.rig.q, self._scale, seen,
        )  # fmt: skip
        return seen


def own_dofs(slots: np.ndarray) -> list[int]:
    """The degrees of freedom of a magnet, in the order in which they are seen: its turns, then its slides."""
    places = (SLOT.turn_1, SLOT.turn_2, SLOT.slide_x, SLOT.slide_x + 1, SLOT.slide_x + 2)
    return [int(slots[place]) for place in places if slots[place] >= 0]


@inlined
def seen_along(v, at, line, scale, seen, column):
    """A vector (3,) along the tangent, the line from the magnet and the curvature vector; the next free column."""
    along, across, bent = 0.0, 0.0, 0.0
    for axis in range(3):
        along += v[axis] * at[3 + axis]
        across += v[axis] * line[axis]
        bent += v[axis] * at[6 + axis]
    seen[column], seen[column + 1], seen[column + 2] = along, across, bent * scale
    return column + 3


@kernel
def sight_ahead(found, entries, slots, magnets, q, scale, seen):
    """How the magnets stand to the places `found` (n, k, 9), see `SightPreview`."""
    stands, line, slide = np.zeros((slots.shape[0], 6, 3)), np.zeros(3), np.eye(3)
    stands[:, REST, 2] = 1.0
    for lane in range(seen.shape[0]):
        here, column = seen[lane], 0
        for m in range(slots.shape[0]):
            stand(slots, m, magnets[entries[lane], m], q, lane, stands[m])
        for k in range(found.shape[1]):
            at = found[lane, k]
            for m in range(slots.shape[0]):
                work = stands[m]
                distance = 0.0
                for axis in range(3):
                    line[axis] = at[axis] - work[CENTRE, axis]
                    distance += line[axis] * line[axis]
                distance = max(math.sqrt(distance), _LEAST)
                for axis in range(3):
                    line[axis] /= distance
                column = seen_along(line, at, line, scale, here, column)
                here[column - 2] = distance / scale  # in place of the line along itself
                column = seen_along(work[MOMENT], at, line, scale, here, column)
                if slots[m, SLOT.turn_1] >= 0:
                    column = seen_along(work[FIRST], at, line, scale, here, column)
                if slots[m, SLOT.turn_2] >= 0:
                    column = seen_along(work[SECOND], at, line, scale, here, column)
                for axis in range(3):
                    if slots[m, SLOT.slide_x + axis] >= 0:
                        column = seen_along(slide[axis], at, line, scale, here, column)
