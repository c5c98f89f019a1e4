"""The walls of a batch's lumens as the kernels read them: tubes as rows of cubics, trees and other walls as bricks."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np

from ...lumen.lumen import Lumen
from ...lumen.surface import Surface
from ...scenario import Scenario
from ..lanes import LANES
from . import layout as at
from .bricks import CELLS, Bricks, smooth_union
from .kept_walls import digest_of, kept
from .tubes import Tube

__all__ = ["Walls"]

ROUNDED = 0.1
"""Creases at junctions are rounded where two tubes' depths differ by less than this share of the narrowest radius."""

_CELLS_A_RADIUS = 5.0
_FINEST_CELL, _COARSEST_CELL = 0.1e-3, 1e-3  # m
_MOST_BRICKS = 20_000
"""Bricks that a wall may take: a large tree with narrow ends has coarser cells than its narrowest place asks for."""

_OUTSIDE = 2.5e-3
"""m behind the wall up to which a wire may be pressed; no step goes beyond."""


class Walls:
    """Every different lumen's wall once, and what a lane's parameters say of it.

    table : flat, rows of all tubes; grid : all bricks
    fields : (entries, parameters), the columns of `layout` that find a lane's wall, and NaN elsewhere
    first_row, last_row, spacing, loop : (entries,) of a tube: the row at the inlet, the number of the last one from
        there, m a row, and whether it closes; of bricks 0, 0, 1, False
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self.fields = np.full((len(scenarios), at.PAR_SIZE // LANES), np.nan)
        n = len(scenarios)
        self.first_row, self.last_row, self.spacing = np.zeros(n), np.zeros(n), np.ones(n)
        self.loop = np.array([is_tube(sc.tree) and sc.tract.closed for sc in scenarios])
        tables: list[np.ndarray] = []
        grids: list[np.ndarray] = []
        rows = numbers = 0
        made: dict[tuple, tuple[Tube | Bricks, int]] = {}
        for i, sc in enumerate(scenarios):
            key = _key(sc)
            if key not in made:
                wall = _wall_of(sc)
                made[key] = (wall, rows if isinstance(wall, Tube) else numbers)
                if isinstance(wall, Tube):
                    tables.append(wall.table)
                    rows += len(wall.table)
                else:
                    grids.append(wall.data)
                    numbers += len(wall.data)
            wall, first = made[key]
            if isinstance(wall, Tube):
                self.first_row[i], self.spacing[i] = first + wall.first_row, wall.spacing
                self.last_row[i] = round(wall.length / wall.spacing) - 1
                found = {"SPACING": wall.spacing, "INLET_ROW": first + wall.first_row, "GRID_NX": 0.0}
            else:
                inlet = float(sc.tree.trunk.radius(0.0))
                found = {"SPACING": 1.0, "INLET_ROW": 0.0, "GRID_INLET": inlet, **wall.fields(first)}
            for name, value in found.items():
                self.fields[i, getattr(at, name) // LANES] = value
        if not tables:
            tables.append(_NOTHING)
        self.table = np.ascontiguousarray(np.vstack(tables)).reshape(-1)
        self.grid = np.concatenate(grids) if grids else np.zeros(0, dtype=np.float32)


_NOTHING = np.zeros((1, at.TABLE_STRIDE))
_NOTHING[0, 1], _NOTHING[0, 12], _NOTHING[0, 16:18] = 1.0, 1e9, (-1e9, 1e9)


def is_tube(lumen: Lumen) -> bool:
    """Whether the wall is that of one tube, which needs no bricks."""
    return len(lumen.branches) == 1 and lumen.wall is None


def _key(sc: Scenario) -> tuple:
    lumen = sc.tree
    return (lumen,) if is_tube(lumen) else (lumen, _thickest(sc), 0.0 if sc.rig.feed else sc.wire.length)


def _thickest(sc: Scenario) -> float:
    return sc.wire.radius if sc.wire.outer_radius is None else sc.wire.outer_radius.most


def _affordable(lumen: Lumen, thickest: float) -> float:
    """The cell, m, at which the layer about the wall takes about `_MOST_BRICKS`."""
    area = 0.0
    for b in lumen.branches:
        area += 2.0 * math.pi * float(b.radius(np.linspace(0.0, b.length, 200)).mean()) * b.length
    cell = _FINEST_CELL
    while cell < _COARSEST_CELL:
        edge = CELLS * cell
        if area * (thickest + _OUTSIDE + 4.0 * cell + edge) < _MOST_BRICKS * edge**3:
            break
        cell *= 1.05
    return min(cell, _COARSEST_CELL)


def _cell_of(lumen: Lumen, thickest: float) -> float:
    """Edge of a cell, m: by the narrowest place, or what is affordable; a warning says if that is rough somewhere."""
    fine = float(np.clip(lumen.narrowest[0] / _CELLS_A_RADIUS, _FINEST_CELL, _COARSEST_CELL))
    cell = max(fine, _affordable(lumen, thickest))
    rough = (cell**3 / (10.0 * 0.05)) ** (1.0 / 3.0)  # the radius R whose twentieth is the error, cell³/(10 R²)
    if cell > fine and lumen.narrowest[0] < rough:
        warnings.warn(
            f"the wall of {lumen.name!r} is kept in cells of {1e3 * cell:.2g} mm, since it is large: a free wire feels "
            f"places of less than {1e3 * rough:.2g} mm radius only roughly",
            stacklevel=2,
        )
    return cell


def _wall_of(sc: Scenario) -> Tube | Bricks:
    lumen = sc.tree
    if is_tube(lumen):
        branch = lumen.trunk
        loop = branch.curve.closed
        return Tube(branch.curve, branch.radius, "loop" if loop else "open", "loop" if loop else "closed")
    narrowest, thickest = lumen.narrowest[0], _thickest(sc)
    cell = _cell_of(lumen, thickest)
    low, high = lumen.bounds
    inlet, along = lumen.trunk.curve.position(0.0), lumen.trunk.curve.tangent(0.0)
    radius = float(lumen.trunk.radius(0.0))
    behind = inlet - along * (5e-3 if sc.rig.feed else sc.wire.length)  # a wire with a free base lies there at first
    low, high = np.minimum(low, behind - radius), np.maximum(high, behind + radius)

    def depth(xyz: np.ndarray) -> np.ndarray:
        if lumen.wall is not None:
            return lumen.wall_distance(xyz)
        found = lumen.tubes.depths(xyz).depth
        found = np.where(np.isfinite(found), found, -1e3)
        return smooth_union(list(found.T), ROUNDED * narrowest)

    def make() -> Bricks:
        return Bricks(depth, low.tolist(), high.tolist(), cell, thickest + 2 * cell, _OUTSIDE + 2 * cell)

    if lumen.wall is not None and not isinstance(lumen.wall, Surface):
        return make()
    return kept(digest_of(lumen, *low, *high, cell, thickest, _OUTSIDE, ROUNDED), make)
