"""A tube about a centreline as the rows of cubics that `contact.tube` reads."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from .layout import TABLE_STRIDE

__all__ = ["Centreline", "Tube"]

_FAR = 1e9


class Centreline(Protocol):
    """What a tube needs of a curve."""

    @property
    def length(self) -> float: ...

    def position(self, s: np.ndarray) -> np.ndarray: ...


class Tube:
    """Rows of a tube's table.

    curve : the centreline
    radius : m, or a function of arc length; negative for an obstacle, met from outside
    start, end : "open" (it goes on straight), or "closed" by a half sphere; "loop" for both if the curve closes
    spacing : m at most between rows

    The rows run from `first_row`, that of s = 0, on; an open start has its straight row before.
    """

    def __init__(
        self,
        curve: Centreline,
        radius: float | Callable[[np.ndarray], np.ndarray],
        start: str = "open",
        end: str = "closed",
        spacing: float = 2e-3,
    ) -> None:
        count = max(4, math.ceil(curve.length / spacing))
        self.spacing, self.length, self.curve = curve.length / count, curve.length, curve
        s = np.linspace(0.0, curve.length, count + 1)
        points = np.asarray(curve.position(s))
        radii = np.full(s.shape, radius, dtype=np.float64) if np.isscalar(radius) else np.asarray(radius(s))  # type: ignore[operator]
        loop = start == "loop"
        kind = "periodic" if loop else "not-a-knot"
        if loop:
            points[-1], radii[-1] = points[0], radii[0]
        rows = np.zeros((count, TABLE_STRIDE))
        for k in range(3):
            spline = CubicSpline(s, points[:, k], bc_type=kind)
            rows[:, 4 * k : 4 * k + 4] = spline.c[::-1].T
        rows[:, 12:16] = CubicSpline(s, radii, bc_type=kind).c[::-1].T
        rows[:, 16], rows[:, 17] = -_FAR, _FAR
        rows[:, 18], rows[:, 19] = -1.0, 1.0
        rows[0, 18], rows[-1, 19] = (count - 1.0, 1.0 - count) if loop else (0.0, 0.0)
        before, after = [], []
        if start == "open":
            before = [self._straight(points[0], rows[0, 1:12:4], radii[0], -1.0)]
            rows[0, 18] = -1.0
        elif start == "closed":
            rows[0, 16] = 0.0
        if end == "open":
            c = rows[-1, :12].reshape(3, 4)
            h = self.spacing
            after = [self._straight(points[-1], c[:, 1] + h * (2 * c[:, 2] + 3 * h * c[:, 3]), radii[-1], 1.0)]
            rows[-1, 19] = 1.0
        elif end == "closed":
            rows[-1, 17] = self.spacing
        self.first_row = len(before)
        self.table = np.vstack([*before, rows, *after])
        self._s = s

    def _straight(self, point: np.ndarray, direction: np.ndarray, radius: float, side: float) -> np.ndarray:
        row = np.zeros(TABLE_STRIDE)
        t = direction / np.linalg.norm(direction)
        at = point - self.spacing * t if side < 0 else point
        row[0:12:4], row[1:12:4], row[12] = at, t, radius
        row[16], row[17] = -_FAR, _FAR
        row[18], row[19] = (0.0, 1.0) if side < 0 else (-1.0, 0.0)
        return row

    def feet(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Row and way along it, (...) each, of the centreline's points nearest to `points` (..., 3) m."""
        flat = points.reshape(-1, 3)
        centres = self.table[:, 0:12:4] + 0.5 * self.spacing * self.table[:, 1:12:4]
        row = np.empty(len(flat), dtype=np.int64)
        for i in range(0, len(flat), 4096):
            part = flat[i : i + 4096]
            row[i : i + 4096] = ((part[:, None] - centres[None]) ** 2).sum(axis=-1).argmin(axis=1)
        along = np.full(len(flat), 0.5 * self.spacing)
        for _ in range(6):
            c = self.table[row]
            p, d = c[:, :12].reshape(-1, 3, 4), along[:, None]
            x = p[..., 0] + d * (p[..., 1] + d * (p[..., 2] + d * p[..., 3]))
            t = p[..., 1] + d * (2 * p[..., 2] + 3 * d * p[..., 3])
            k = 2 * p[..., 2] + 6 * d * p[..., 3]
            r = flat - x
            ahead = (r * t).sum(axis=1) / np.maximum((t * t).sum(axis=1) - (r * k).sum(axis=1), 0.2)
            along = np.clip(along + ahead, c[:, 16], c[:, 17])
            moved = np.clip(np.floor(along / self.spacing), -1, 1)
            step = np.where(moved < 0, c[:, 18], np.where(moved > 0, c[:, 19], 0.0))
            along = np.where(step != 0, along - moved * self.spacing, along)
            row = row + step.astype(np.int64)
        return row.reshape(points.shape[:-1]), along.reshape(points.shape[:-1])
