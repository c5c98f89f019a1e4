"""The way from one place of a lumen to another: unique in a tree, so that progress along it is one number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .curve import Tract

if TYPE_CHECKING:
    from .branch import Branch
    from .lumen import Lumen

__all__ = ["Leg", "Place", "Route"]

_CORNER = 1.0
"""Centreline points nearer than this many radii to a corner are left out of `Route.tract`, which rounds it."""


class Place(NamedTuple):
    """A point of a centreline: the branch's name, and the arc length on it, m."""

    branch: str
    s: float


class Leg(NamedTuple):
    """A part of a route: the number of a branch, and the arc lengths on it from which and to which it is run, m."""

    branch: int
    begin: float
    end: float


@dataclass(frozen=True)
class Route:
    """The way between two places of a lumen, as one curve; build it with `Lumen.route`.

    lumen : the tree it runs through
    start, goal : where it begins and ends

    Its parameter x is the way run, 0 at the start and `length` at the goal, m. It follows the centrelines: position is
    continuous, and the tangent turns where a branch leaves its parent. `tract()` is a smooth curve beside it.
    """

    lumen: Lumen
    start: Place
    goal: Place

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """The parts of the route, in order."""
        up, down = self.lumen._to_trunk(self.start), self.lumen._to_trunk(self.goal)
        shared = {b for b, _ in up} & {b for b, _ in down}
        out, back = dict(up), dict(down)
        common = next(b for b, _ in up if b in shared)
        legs = []
        for b, s in up:
            if b == common:
                break
            legs.append(Leg(b, s, 0.0))
        legs.append(Leg(common, out[common], back[common]))
        legs += [Leg(b, 0.0, s) for b, s in reversed(down[: [b for b, _ in down].index(common)])]
        whole = tuple(leg for leg in legs if leg.begin != leg.end)
        return whole or (legs[-1],)

    @property
    def length(self) -> float:
        """Length of the way, m."""
        return float(self._ends[-1])

    def leg_at(self, x: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """The number of the branch, and the arc length on it, after a way of x (...) m → (...), (...) m.

        Before the start and beyond the goal the first and the last branch go on.
        """
        x = np.asarray(x, dtype=np.float64)
        i = np.clip(np.searchsorted(self._ends, x, side="right") - 1, 0, len(self.legs) - 1)
        branch, begin, end = (np.array(column)[i] for column in zip(*self.legs, strict=True))
        return branch, begin + np.where(end < begin, -1.0, 1.0) * (x - self._ends[i])

    def place(self, x: float) -> Place:
        """The place after a way of x m."""
        branch, s = self.leg_at(x)
        return Place(self.lumen.branches[int(branch)].name, float(s))

    def position(self, x: np.ndarray | float) -> np.ndarray:
        """Points of the route: x (...) m → (..., 3) m."""
        return self._along(x, lambda b, s: b.curve.position(s), (3,))

    def tangent(self, x: np.ndarray | float) -> np.ndarray:
        """Unit tangents, in the direction of the route: x (...) m → (..., 3)."""
        x = np.asarray(x, dtype=np.float64)
        i = np.clip(np.searchsorted(self._ends, x, side="right") - 1, 0, len(self.legs) - 1)
        way = np.array([-1.0 if leg.end < leg.begin else 1.0 for leg in self.legs])[i]
        return way[..., None] * self._along(x, lambda b, s: b.curve.tangent(s), (3,))

    def radius(self, x: np.ndarray | float) -> np.ndarray:
        """Lumen radius along the route: x (...) m → (...) m."""
        return self._along(x, lambda b, s: b.radius(s), ())

    def remaining(self, branch: np.ndarray | int | str, s: np.ndarray | float) -> np.ndarray:
        """The way left to the goal from places of the tree: numbers of branches, arc lengths (m) → m.

        In a wrong branch it counts the way back out of it. Beyond the goal it is negative: minus the way back.
        """
        if isinstance(branch, str):
            branch = self.lumen.index(branch)
        base, pivot, below, above = self.table.T
        branch, s = np.broadcast_arrays(np.asarray(branch, dtype=np.int64), np.asarray(s, dtype=np.float64))
        gap = s - pivot[branch]
        return base[branch] + np.where(gap < 0.0, -below[branch], above[branch]) * gap

    def travelled(self, branch: np.ndarray | int | str, s: np.ndarray | float) -> np.ndarray:
        """`length` − `remaining`, m: the way run, less what a wrong branch has to give back."""
        return self.length - self.remaining(branch, s)

    def passed(self, branch: np.ndarray | int | str, s: np.ndarray | float) -> np.ndarray:
        """Whether places are at the goal or beyond it."""
        return self.remaining(branch, s) <= 0.0

    @cached_property
    def table(self) -> np.ndarray:
        """What `remaining` needs of each branch, (branches, 4): base (m), pivot (m), and two slopes, ±1.

        remaining = base + below·(pivot − s) for s < pivot, base + above·(s − pivot) else.
        """
        branches, parents = self.lumen.branches, self.lumen.parents
        table = np.full((len(branches), 4), np.nan)
        left = 0.0
        for leg in reversed(self.legs):
            ahead = -1.0 if leg is self.legs[-1] else 1.0  # beyond the goal it is negative
            table[leg.branch] = (left, leg.end, *((1.0, ahead) if leg.end >= leg.begin else (ahead, 1.0)))
            left += abs(leg.end - leg.begin)
        top = next(b for b in range(len(branches)) if not np.isnan(table[b, 0]))  # parents stand before their children
        while parents[top] >= 0:  # from where the route is nearest to the trunk, back to the inlet
            there = float(_rule(table[top], 0.0))
            sign = 1.0 if there > 0.0 else -1.0
            table[parents[top]] = (there, branches[top].start, sign, sign)
            top = parents[top]
        for b in range(len(branches)):
            if np.isnan(table[b, 0]):
                there = float(_rule(table[parents[b]], branches[b].start))
                sign = 1.0 if there > 0.0 else -1.0
                table[b] = (there, 0.0, sign, sign)
        table.flags.writeable = False
        return table

    def tract(self, spacing: float = 5e-3) -> Tract:
        """A smooth (C²) curve along the route with its radius: points about `spacing` m apart, corners rounded.

        Its arc length differs a little from the route's own, since it cuts the corners.
        """
        count = max(8, round(self.length / spacing))
        x = np.linspace(0.0, self.length, count + 1)
        for corner in self._ends[1:-1]:
            keep = np.abs(x - corner) > _CORNER * float(self.radius(corner))
            keep[[0, -1]] = True
            x = x[keep]
        if len(x) == 2:
            x = np.linspace(0.0, self.length, 3)
        return Tract.from_points(self.position(x), self.radius(x))

    @cached_property
    def _ends(self) -> np.ndarray:
        """The way at the start of each leg, and at the goal, m."""
        return np.concatenate([[0.0], np.cumsum([abs(leg.end - leg.begin) for leg in self.legs])])

    def _along(
        self, x: np.ndarray | float, of: Callable[[Branch, np.ndarray], np.ndarray], shape: tuple[int, ...]
    ) -> np.ndarray:
        x = np.asarray(x, dtype=np.float64)
        branch, s = self.leg_at(x)
        out = np.empty((*x.shape, *shape))
        for b in np.unique(branch):
            mine = branch == b
            out[mine] = of(self.lumen.branches[b], s[mine])
        return out


def _rule(row: np.ndarray, s: float) -> float:
    base, pivot, below, above = row
    return base + (below * (pivot - s) if s < pivot else above * (s - pivot))
