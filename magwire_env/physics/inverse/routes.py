"""How a rod from rest comes to a shape: a rod under a load may have several, and which one depends on the way there."""

from __future__ import annotations

from typing import Any

import numpy as np

from .points import Point, Problem

__all__ = ["ROUTES", "detour", "grown", "route"]

ROUTES = ("at once", "growing", "by way of another")

_STEPS = 24
"""Loads along a way."""

_LIKELY = 5
"""Other loads that are tried as a first stop, of those whose own shape is nearest."""

_BESIDE = (0.5, -0.5, 1.0, -1.0, 2.0, -2.0)
"""How far from the parameters, along each, a first stop is looked for, besides the seeds."""

_SAME = 1e-3
"""Shapes no farther apart than this, in the wire's length, are the same."""

_Loads = list[dict[str, Any]]


def route(problem: Problem, point: Point) -> tuple[str, _Loads]:
    """The way of a rod from rest to `point`, one of the first two `ROUTES`, and its loads for `FreeRod.path`; "" if
    neither leads there. Only a point that is near enough to the target is worth more than the load at once.
    """
    last = problem.means.load(point.z)
    if _comes(problem, [last], point):
        return ROUTES[0], [last]
    if point.fit.error > 1 or not point.clear:
        return "", []
    loads = grown(problem, point.z)
    if _comes(problem, loads, point):
        return ROUTES[1], loads
    return "", []


def detour(problem: Problem, point: Point) -> tuple[str, _Loads]:
    """The same by way of another load, the last of `ROUTES`."""
    for first in _first_stops(problem, point):
        loads = [problem.means.load(first + share * (point.z - first)) for share in np.linspace(0.0, 1.0, _STEPS)]
        if _comes(problem, loads, point):
            return ROUTES[2], loads
    return "", []


def grown(problem: Problem, z: np.ndarray) -> _Loads:
    """The load of `z` growing from nothing in proportion."""
    return [problem.means.load(z, share) for share in np.arange(1, _STEPS + 1) / _STEPS]


def _comes(problem: Problem, loads: _Loads, point: Point) -> bool:
    path = problem.rod.path(loads)
    return path.snap is None and bool(_apart(problem, path.positions[-1], point) < _SAME)


def _apart(problem: Problem, positions: np.ndarray, point: Point) -> float:
    """In the wire's length; infinite where `positions` are not a number."""
    far = float(np.abs(positions - point.positions).max()) / problem.rod.wire.length
    return far if np.isfinite(far) else np.inf


def _first_stops(problem: Problem, point: Point) -> list[np.ndarray]:
    """Other parameters under which a rod from rest has a shape like that of `point`, the likest first."""
    low, high = problem.means.low, problem.means.high
    beside = [np.clip(point.z + step * row, low, high) for step in _BESIDE for row in np.eye(len(point.z))]
    found = []
    for z in [*beside, *problem.means.seeds()]:
        path = problem.rod.path([problem.means.load(z)])
        found.append((_apart(problem, path.positions[0], point), z))
    found.sort(key=lambda entry: entry[0])
    return [z for far, z in found[:_LIKELY] if np.isfinite(far)]
