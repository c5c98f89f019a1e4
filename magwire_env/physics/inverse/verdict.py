"""The end of a search as a `ShapeSolution`: what was reached, or what stands in the way."""

from __future__ import annotations

from typing import Any

import numpy as np

from .points import SOFT, Point, Problem
from .routes import ROUTES, grown
from .solution import ShapeSolution
from .targets import TipPose

__all__ = ["told"]

_RANK = 1e-3
"""Singular values below this share of the greatest count as zero."""

_LEFT = 0.3
"""Share of the residual that a search may leave within reach, to first order, and still count as settled."""


def told(
    problem: Problem, point: Point, route: str, loads: list[dict[str, Any]], touched: bool, tried: int
) -> ShapeSolution:
    """The solution at `point`, to which a rod from rest comes by `route` and its `loads`.

    touched : the last step of the search was lost in contact with a magnet
    """
    means, fit, within = problem.means, point.fit, problem.aim.within
    slopes = problem.slopes(point, problem.response(point))
    j = slopes[: len(fit.residual)] * within
    _, values, rows = np.linalg.svd(j, full_matrices=False)
    rank = int((values > _RANK * values[0]).sum()) if values[0] > 0 else 0
    reached = fit.error <= 1 and point.clear and route != ""
    load = means.load(point.z)
    snap = None if route else _snap(problem, point.z)
    limit, because = "", ""
    if not reached:
        limit, because = _limit(problem, point, touched, slopes, rank, snap)
    turn = problem.aim.target.turn if isinstance(problem.aim.target, TipPose) and fit.turn else 0.0
    off = f"{_size(fit.distance, fit.turn)} off where {_size(within, turn)} may be"
    way = "" if route == ROUTES[0] else f" ({route})"
    why = f"reached{way}, {off}" if reached else f"not reached, {off}: {because}"
    return ShapeSolution(
        reached, why, limit, load, means.parameters(point.z), means.names, point.positions, fit.distance, fit.turn,
        fit.error, route, tuple(loads), snap, values, rows @ means.parameters_by(point.z), rank, point.stiffness, tried,
    )  # fmt: skip


def _limit(
    problem: Problem, point: Point, touched: bool, slopes: np.ndarray, rank: int, snap: float | None
) -> tuple[str, str]:  # fmt: skip
    """What keeps the rod from its target: the word and the sentence of a `ShapeSolution`."""
    if not point.clear:
        return "contact", "a magnet would have to stand in the rod"
    if point.fit.error <= 1:
        at = f"; with the load growing it snaps at {100 * snap:.0f} %" if snap is not None else ""
        return (
            "branch",
            f"the shape is an equilibrium under this load, but no way of a rod from rest to it was found{at}",
        )
    if limits := problem.means.at_limits(point.z):
        return "range", ", ".join(limits)
    if point.stiffness < SOFT:
        soft = 100 * max(point.stiffness, 0.0)
        return "snap", f"nearer to it the rod snaps, its softest mode here at {soft:.2g} % of the straight rod's"
    if touched:
        return "contact", "nearer to it the rod is drawn into a magnet"
    if _share(slopes, point.residual) < _LEFT:
        ways = f"{rank} independent way{'s' if rank != 1 else ''}"
        return "directions", f"here the load moves the rod in {ways}, and what is left lies outside them"
    return "search", "the search got no farther, short of a limit that it can name"


def _share(slopes: np.ndarray, residual: np.ndarray) -> float:
    """The part of `residual` that the parameters can take away to first order, those that hardly move it left out."""
    columns, values, _ = np.linalg.svd(slopes, full_matrices=False)
    kept = columns[:, values > _RANK * values[0]]
    return float(np.linalg.norm(kept.T @ residual) / np.linalg.norm(residual))


def _snap(problem: Problem, z: np.ndarray) -> float | None:
    """Share of the growing load at which a rod from rest leaves its branch; None if it does not."""
    loads = grown(problem, z)
    snap = problem.rod.path(loads).snap
    return None if snap is None else (snap + 1) / len(loads)


def _size(distance: float, turn: float) -> str:
    return f"{1e3 * distance:.3g} mm" + (f" and {np.degrees(turn):.2g}°" if turn else "")
