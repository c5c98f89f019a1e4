"""One tube of a lumen: a centreline, a radius along it, and where it leaves its parent."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..physics.checks import finite
from .curve import Tract

__all__ = ["Branch"]


@dataclass(frozen=True)
class Branch:
    """A centreline with a radius along it, as a part of a `Lumen`.

    name : how routes and targets call it
    curve : the centreline, C²; its radius is that of the largest ball about a point of it that fits into the lumen, m
        (VMTK's MaximumInscribedSphereRadius). The wall is the envelope of these balls. For a cone of half angle α that
        is the radius across the axis times cos α: 0.5 % less at 6°
    parent : name of the branch it leaves, None for the trunk
    start : arc length on the parent, m, at which it leaves; its first point lies on the parent's axis there
    """

    name: str
    curve: Tract
    parent: str | None = None
    start: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise ValueError(f"Branch.name must be a text that is not empty, got {self.name!r}")
        if not isinstance(self.curve, Tract):
            raise ValueError(f"Branch.curve must be a Tract, got {type(self.curve).__name__} in branch {self.name!r}")
        object.__setattr__(self, "start", finite(f"Branch.start of {self.name!r}", self.start, "m"))

    @property
    def length(self) -> float:
        """Arc length of the centreline, m."""
        return self.curve.length

    def radius(self, s: np.ndarray | float) -> np.ndarray:
        """Radius along the branch, C¹ in arc length and constant beyond its ends: s (...) m → (...) m."""
        u, c = self._local(s)
        return c[..., 0] + u * (c[..., 1] + u * (c[..., 2] + u * c[..., 3]))

    def radius_slope(self, s: np.ndarray | float) -> np.ndarray:
        """dr/ds along the branch, 0 beyond its ends: s (...) m → (...)."""
        u, c = self._local(s)
        slope = c[..., 1] + u * (2 * c[..., 2] + 3 * u * c[..., 3])
        outside = (np.asarray(s) < 0.0) | (np.asarray(s) > self.length)
        return np.where(outside & (not self.curve.closed), 0.0, slope)

    @cached_property
    def radius_table(self) -> np.ndarray:
        """Cubic pieces of the radius, (rows, 4): row i covers s in [i, i + 1]·`curve.row_spacing`, as `curve.table`.

        r = c0 + u (c1 + u (c2 + u c3)) with u = s − i·spacing: a monotone interpolation (Fritsch and Carlson 1980) of
        the control points' radii, so that it has no swings of its own. Row i belongs to row i + 1 of `curve.table`.
        """
        curve, rows = self.curve, len(self.curve.table) - 2
        table = np.zeros((rows, 4))
        if not isinstance(curve.radius, tuple):
            table[:, 0] = curve.radius
        else:
            arcs = curve._fit[2]
            radii = np.array((*curve.radius, curve.radius[0]) if curve.closed else curve.radius)
            fit, h = PchipInterpolator(arcs, radii), curve.row_spacing
            knots = np.linspace(0.0, curve.length, rows + 1)
            r, slope = fit(knots), fit(knots, 1)
            rise = np.diff(r) / h
            table[:, 0], table[:, 1] = r[:-1], slope[:-1]
            table[:, 2] = (3 * rise - 2 * slope[:-1] - slope[1:]) / h
            table[:, 3] = (slope[:-1] + slope[1:] - 2 * rise) / h**2
        table.flags.writeable = False
        return table

    @property
    def widest(self) -> float:
        """The largest radius, m."""
        return self.curve.widest

    @property
    def narrowest(self) -> tuple[float, float]:
        """The smallest radius and its arc length, m."""
        s = np.linspace(0.0, self.length, len(self.radius_table) + 1)
        r = self.radius(s)
        return float(r.min()), float(s[r.argmin()])

    def _local(self, s: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        s = np.asarray(s, dtype=np.float64)
        s = s % self.length if self.curve.closed else np.clip(s, 0.0, self.length)
        spacing = self.curve.row_spacing
        row = np.clip(np.floor(s / spacing).astype(np.int64), 0, len(self.radius_table) - 1)
        return s - row * spacing, self.radius_table[row]

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "radius_table"}
