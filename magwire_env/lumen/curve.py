"""The tract: a C² centreline parametrised by arc length (paper Algorithm 1, initialisation)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from ..physics.checks import points_array
from ..physics.ranges import RANGES, ranged

__all__ = ["Tract"]

_ROW_SPACING = 2e-3
"""Largest arc length of one table row, m: at 37 mm bend radius the cubic is then within 40 nm of the curve."""

LONGEST = 100.0
"""Longest centreline, m: its table has a row every 2 mm."""

_SHARPEST_CORNER = math.radians(75)
"""Largest turn between successive control chords; a spline through a sharper corner would overshoot."""


@dataclass(frozen=True)
class Tract:
    """A lumen about a smooth centreline; build one with `Tract.from_points` or `Tract.load`.

    points : control points the centreline runs through, m
    radius : lumen radius, m, one for the whole tract or one a control point (see `radius_at`); it does not enter the
        locked motion (the wire rides on the centreline)
    closed : the centreline is a loop; arc length then wraps round

    Beyond both ends of an open tract the centreline goes on straight along the end tangents, so that a wire can
    stand partly outside the entrance. Arc length runs from 0 to `length`.
    """

    points: tuple[tuple[float, float, float], ...]
    radius: float | tuple[float, ...] = 7.5e-3
    closed: bool = False

    def __post_init__(self) -> None:
        xyz = points_array("Tract.points", self.points, "m")
        low, high, _ = RANGES["Tract.points"]
        if len(xyz) and not (low <= xyz.min() and xyz.max() <= high):
            raise ValueError(f"Tract.points must lie in [{low:g}, {high:g}] (in m), got {xyz.min():g} to {xyz.max():g}")
        object.__setattr__(self, "points", tuple(map(tuple, xyz.tolist())))
        object.__setattr__(self, "radius", _checked_radius(self.radius, len(xyz)))
        object.__setattr__(self, "closed", bool(self.closed))
        _check_course(xyz, self.closed)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.points, self.radius, self.closed))

    @classmethod
    def from_points(cls, xyz: Iterable, radius: float | Iterable[float] = 7.5e-3, closed: bool = False) -> Tract:
        """A tract through `xyz`, (n, 3) m in order along it; a loop's first point is not repeated at its end.

        `radius` in m: a number, or n of them, one a point. Raises `ValueError` naming the point that is not finite,
        doubled, or at a corner too sharp for a spline, and the radius that is not positive.
        """
        return cls(points_array("xyz", xyz, "m"), radius, closed)  # type: ignore[arg-type]

    @classmethod
    def load(
        cls,
        path: str | Path,
        unit: str | None = None,
        *,
        line: int | None = None,
        smooth: float = 0.0,
        spacing: float = 5e-3,
        radius: float | None = None,
    ) -> Tract:
        """A tract from a centreline file: CSV, VMTK ``.vtp`` or 3D Slicer ``.mrk.json``.

        unit : of the file's numbers, "m", "cm", "mm" or "um", where the file declares none itself
        line : which line of the file, from 0; needed when it holds several
        smooth : m, root-mean-square deviation allowed from the file's points; 0 runs through them
        spacing : m; a line with closer points is thinned (or, smoothed, resampled) to about this distance
        radius : m, of the lumen; default the file's own radii, else 7.5 mm

        `magwire_env.lumen.files` says what each format must hold. Raises `ValueError` naming the file,
        the place in it and what is allowed.
        """
        from .files import read_centreline

        found = read_centreline(path, unit, line=line, smooth=smooth, spacing=spacing, radius=radius)
        same = bool((found.radius == found.radius[0]).all())
        return cls.from_points(found.points, found.radius[0] if same else found.radius, found.closed)

    def position(self, s: np.ndarray | float) -> np.ndarray:
        """Points of the centreline: s (...) m → (..., 3) m."""
        u, c = self._local(s)
        return c[..., 0:3] + u * (c[..., 3:6] + u * (c[..., 6:9] + u * c[..., 9:12]))

    def tangent(self, s: np.ndarray | float) -> np.ndarray:
        """Unit tangents: s (...) m → (..., 3)."""
        u, c = self._local(s)
        t = c[..., 3:6] + u * (2 * c[..., 6:9] + 3 * u * c[..., 9:12])
        return t / np.linalg.norm(t, axis=-1, keepdims=True)

    def curvature_vector(self, s: np.ndarray | float) -> np.ndarray:
        """κ n = dt/ds, pointing to the centre of the bend: s (...) m → (..., 3) 1/m."""
        u, c = self._local(s)
        rate = c[..., 3:6] + u * (2 * c[..., 6:9] + 3 * u * c[..., 9:12])
        second = 2 * c[..., 6:9] + 6 * u * c[..., 9:12]
        size = np.linalg.norm(rate, axis=-1, keepdims=True)  # 1 to 1e-5, but not its derivative
        t = rate / size
        return (second - (second * t).sum(axis=-1, keepdims=True) * t) / size

    def curvature(self, s: np.ndarray | float) -> np.ndarray:
        """κ, the inverse of the bend radius: s (...) m → (...) 1/m."""
        return np.linalg.norm(self.curvature_vector(s), axis=-1)

    def radius_at(self, s: np.ndarray | float) -> np.ndarray:
        """Lumen radius, linear in arc length between control points: s (...) m → (...) m.

        Beyond the ends of an open tract the last radius goes on.
        """
        s = np.asarray(s, dtype=np.float64)
        if not isinstance(self.radius, tuple):
            return np.full(s.shape, self.radius)
        radii = (*self.radius, self.radius[0]) if self.closed else self.radius
        return np.interp(s % self.length if self.closed else s, self._fit[2], radii)

    @property
    def widest(self) -> float:
        """The largest lumen radius, m."""
        return max(self.radius) if isinstance(self.radius, tuple) else self.radius

    def project(self, xyz: np.ndarray) -> np.ndarray:
        """Arc length of the centreline's closest point, 0 to `length`: xyz (..., 3) m → (...) m."""
        xyz = np.asarray(xyz, dtype=np.float64)
        flat = xyz.reshape(-1, 3)
        samples = np.linspace(0.0, self.length, 4 * (len(self.table) - 2) + 1)
        curve = self.position(samples)
        nearest = [int(((curve - p) ** 2).sum(axis=1).argmin()) for p in flat]
        s = samples[nearest]
        for _ in range(8):  # Newton on (p(s) − x)·t(s) = 0, kept within one sample of the nearest
            gap = self.position(s) - flat
            t, k = self.tangent(s), self.curvature_vector(s)
            slope = np.maximum(1.0 + (gap * k).sum(axis=-1), 0.2)
            s = s - np.clip((gap * t).sum(axis=-1) / slope, -samples[1], samples[1])
            s = s % self.length if self.closed else np.clip(s, 0.0, self.length)
        return s.reshape(xyz.shape[:-1])

    @property
    def length(self) -> float:
        """Arc length of the centreline, m."""
        return self._fit[1]

    @property
    def row_spacing(self) -> float:
        """Arc length of one row of `table`, m."""
        return self.length / (len(self.table) - 2)

    @property
    def table(self) -> np.ndarray:
        """Cubic pieces, (rows + 2, 12): row i + 1 covers s in [i, i + 1]·`row_spacing`.

        Each row holds c0, c1, c2, c3 (three numbers each) of p = c0 + u (c1 + u (c2 + u c3)), u = s − i·spacing.
        The first and the last row are the straight extensions; their u has no bound.
        """
        return self._fit[0]

    @cached_property
    def _fit(self) -> tuple[np.ndarray, float, np.ndarray]:
        """The table, the length (m) and the control points' arc lengths (m; a loop's first point again at its end)."""
        xyz = np.asarray(self.points)
        if self.closed:
            xyz = np.vstack([xyz, xyz[:1]])
        chord = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
        curve = CubicSpline(chord, xyz, bc_type="periodic" if self.closed else "natural")
        s_of_u, u = _arc_length(curve, chord)
        length = float(s_of_u[-1])
        rows = max(4, math.ceil(length / _ROW_SPACING))
        s = np.linspace(0.0, length, rows + 1)
        points = curve(_invert(curve, s_of_u, u, s))
        if self.closed:
            points[-1] = points[0]
        pieces = CubicSpline(s, points, bc_type="periodic" if self.closed else "natural")
        table = np.zeros((rows + 2, 12))
        table[1:-1] = pieces.c[::-1].transpose(1, 0, 2).reshape(rows, 12)
        start, end = pieces(0.0, 1), pieces(length, 1)
        start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
        table[0, 0:3], table[0, 3:6] = pieces(0.0) - start * length / rows, start
        table[-1, 0:3], table[-1, 3:6] = pieces(length), end
        table.flags.writeable = False
        return table, length, s_of_u[::_CELLS]

    def _local(self, s: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        s = np.asarray(s, dtype=np.float64)
        if self.closed:
            s = s % self.length
        spacing = self.row_spacing
        row = np.clip(np.floor(s / spacing).astype(np.int64) + 1, 0, len(self.table) - 1)
        return (s - (row - 1) * spacing)[..., None], self.table[row]


def _check_course(xyz: np.ndarray, closed: bool) -> None:
    fewest = 4 if closed else 2
    if len(xyz) < fewest:
        raise ValueError(f"Tract.points must hold at least {fewest} points, got {len(xyz)}")
    steps = np.diff(np.vstack([xyz, xyz[:1]]) if closed else xyz, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    doubled = np.flatnonzero(lengths <= 1e-9 * max(1.0, lengths.sum()))
    if doubled.size:
        i = int(doubled[0])
        raise ValueError(
            f"Tract.points[{(i + 1) % len(xyz)}] must differ from the point before it, got {xyz[i].tolist()} twice"
        )
    if lengths.sum() > LONGEST:
        raise ValueError(f"Tract.points must make a course of at most {LONGEST:g} m, got {lengths.sum():.4g} m")
    unit = steps / lengths[:, None]
    following = np.roll(unit, -1, axis=0) if closed else unit[1:]
    turn = np.arccos(np.clip((unit[: len(following)] * following).sum(axis=1), -1.0, 1.0))
    if turn.size and turn.max() > _SHARPEST_CORNER:
        i = (int(turn.argmax()) + 1) % len(xyz)
        raise ValueError(
            f"Tract.points[{i}] must not turn the course by more than {math.degrees(_SHARPEST_CORNER):.0f}°, "
            f"got {math.degrees(turn.max()):.0f}° at {xyz[i].tolist()} (more points round the bend, or no kink)"
        )


def _checked_radius(radius: Any, count: int) -> float | tuple[float, ...]:
    if radius is None or np.isscalar(radius) or getattr(radius, "ndim", 1) == 0:
        return ranged("Tract.radius", radius)
    radii = tuple(ranged("Tract.radius", r, f"Tract.radius[{i}]") for i, r in enumerate(radius))
    if len(radii) != count:
        raise ValueError(
            f"Tract.radius must be one number or one for each of the {count} points (in m), got {len(radii)}"
        )
    return radii


_CELLS = 8
"""Cells of the arc-length quadrature between two control points."""

_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(6)


def _arc(curve: CubicSpline, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    half = (b - a) / 2
    at = (a + b)[:, None] / 2 + half[:, None] * _GAUSS_X
    return half * (_speed(curve, at) @ _GAUSS_W)


def _speed(curve: CubicSpline, at: np.ndarray) -> np.ndarray:
    rate = curve(at, 1)
    return np.sqrt(np.einsum("...i,...i->...", rate, rate))  # several times faster than a norm over three numbers


def _arc_length(curve: CubicSpline, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Arc length at a fine grid of the chord parameter, `_CELLS` cells from each knot to the next."""
    inner = knots[:-1, None] + np.diff(knots)[:, None] * (np.arange(_CELLS) / _CELLS)
    u = np.r_[inner.ravel(), knots[-1]]
    return np.r_[0.0, _arc(curve, u[:-1], u[1:]).cumsum()], u


def _invert(curve: CubicSpline, s_of_u: np.ndarray, u: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Chord parameter at arc lengths `s`, by Newton from the grid's linear interpolation to rounding error."""
    at = np.interp(s, s_of_u, u)
    cell = np.clip(np.searchsorted(s_of_u, s, side="right") - 1, 0, len(u) - 2)
    for _ in range(6):  # one step does for points a few millimetres apart
        excess = s_of_u[cell] + _arc(curve, u[cell], at) - s
        if np.abs(excess).max() <= 1e-14 * s[-1]:
            break
        at = np.clip(at - excess / _speed(curve, at), u[0], u[-1])
    return at
