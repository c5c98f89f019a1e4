"""The search for the load that makes a shape: least squares over the rod's equilibria, from several starts.

From a start (`starts`) SciPy's least squares follows the equilibrium, with the exact derivative of the shape by the
load. What it makes least is the distance from the target, and beside it how far a magnet stands in the rod and how near
the rod is to a snap, where that derivative is without bound and nothing could be held.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares

from ..checks import whole
from ..rod_energy import Chart, Shape
from .means import Means
from .points import Point, Problem
from .routes import detour, route
from .solution import ShapeSolution
from .starts import aside, balances, sketch
from .targets import Aim, Target
from .verdict import told

if TYPE_CHECKING:
    from ..rod import FreeRod

__all__ = ["solve"]

_EVALUATIONS = 60
"""Equilibria that one start may solve for."""

_AGREE = 4
"""Starts that end in the same shape, short of the target, before it is taken for the nearest."""

_GOOD = 0.02
"""A search ends this near, of the tolerance."""

_STRIDE = 0.5
"""Largest turn of a segment, rad, that is foreseen from the derivative."""

_Start = tuple[np.ndarray, Shape]
"""Parameters z, and the shape from which the rod relaxes."""


@dataclass(frozen=True)
class _End:
    """Where one start led.

    route, loads : of `routes.route`
    touched : the last step of the search was lost in contact with a magnet
    """

    point: Point
    route: str
    loads: list[dict[str, Any]]
    touched: bool

    @property
    def fits(self) -> bool:
        """The shape is as wanted, whether or not a rod from rest comes to it."""
        return self.point.fit.error <= 1 and self.point.clear

    @property
    def reached(self) -> bool:
        return self.fits and self.route != ""

    @property
    def rank(self) -> tuple[bool, float]:
        return not self.reached, self.point.fit.error + float(self.point.off.sum())


class _Near(Exception):
    """The search is near enough."""

    def __init__(self, point: Point) -> None:
        self.point = point


def solve(rod: FreeRod, target: Target, means: Means, starts: int) -> ShapeSolution:
    """The load among `means` that brings `rod` nearest to `target`, of at most `starts` starts.

    Raises `ValueError` if no start has an equilibrium to begin with.
    """
    starts = whole("starts", starts, 1)
    problem = Problem(rod, Aim(target, rod.wire), means)
    ends = _ends(problem, starts)
    if not ends:
        raise ValueError("target must leave the rod an equilibrium to start from, got none: it touches the magnets")
    best = min(ends, key=lambda end: end.rank)
    if best.fits and not best.reached:
        way, loads = detour(problem, best.point)
        best = replace(best, route=way, loads=loads)
    return told(problem, best.point, best.route, best.loads, best.touched, len(ends))


def _ends(problem: Problem, starts: int) -> list[_End]:
    """Where at most `starts` starts led: until one reaches the target, or enough agree on the nearest shape."""
    shape = sketch(problem)
    balanced = ((z, shape) for z in balances(problem, shape))
    rest = [(problem.means.seeds()[0], problem.rod._rest)]
    source = itertools.chain(itertools.islice(balanced, 1), rest, balanced)
    beside: list[_Start] = []
    ends: list[_End] = []
    for start in _in_turn(source, beside):
        end = _descend(problem, *start)
        if end is None:
            continue
        if end.fits and not end.reached and not any(e.fits for e in ends):
            beside += [(z, end.point.shape) for z in aside(problem, end.point)]
        ends.append(end)
        best = min(ends, key=lambda end: end.rank)
        agreed = not best.fits and sum(_alike(problem, e, best) for e in ends) == _AGREE
        if best.reached or agreed or len(ends) == starts:
            break
    return ends


def _in_turn(source: Iterator[_Start], beside: list[_Start]) -> Iterator[_Start]:
    """Starts from `source` and from `beside`, which may grow meanwhile, in turn."""
    for start in source:
        yield start
        if beside:
            yield beside.pop(0)
    while beside:
        yield beside.pop(0)


def _alike(problem: Problem, one: _End, other: _End) -> bool:
    """Whether two starts ended in the same shape."""
    return bool(np.abs(one.point.positions - other.point.positions).max() < 1e-3 * problem.rod.wire.length)


def _descend(problem: Problem, z: np.ndarray, shape: Shape) -> _End | None:
    """Least squares from `z`, the rod relaxing from `shape`; None if it has no equilibrium there."""
    first = problem.at(z, shape)
    if first is None:
        return None
    anchor, known, response = first, {z.tobytes(): first}, problem.response(first)

    def residual(z: np.ndarray) -> np.ndarray:
        point = known.get(z.tobytes())
        if point is None:
            step = response.coordinates @ (z - anchor.z)
            step *= min(1.0, _STRIDE / max(float(np.abs(step).max()), 1e-300))
            point = problem.at(z, Chart(problem.chain, anchor.load, anchor.shape).shape(step))
        if point is None:
            return np.full_like(first.residual, math.inf)  # least_squares takes a shorter step
        known[z.tobytes()] = point
        if point.fit.error < _GOOD and point.clear:
            raise _Near(point)
        return point.residual

    def slopes(z: np.ndarray) -> np.ndarray:
        nonlocal anchor, response
        anchor = known[z.tobytes()]
        known.clear()
        known[z.tobytes()] = anchor
        response = problem.response(anchor)
        return problem.slopes(anchor, response)

    bounds = problem.means.low, problem.means.high
    try:
        found = least_squares(residual, z, slopes, bounds=bounds, max_nfev=_EVALUATIONS, xtol=1e-10, ftol=1e-7)
    except _Near as near:
        return _end(problem, near.point, False)
    return _end(problem, known[found.x.tobytes()], problem.touched)


def _end(problem: Problem, point: Point, touched: bool) -> _End:
    return _End(point, *route(problem, point), touched)
