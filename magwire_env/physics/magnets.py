"""Permanent magnets and the rules that turn them into dipole clouds (paper Sections III-A, III-C, IV).

A magnet is uniformly magnetised along its own z axis, so its moment is m = Br·V/μ0. `dipoles(rule, n)` gives
the cloud in the magnet's own frame:

``("grid", (nx, ny, nz))``
    equal dipoles at the centres of equal cells; the paper's 2000 are ``(10, 10, 20)``.
``("gauss", n)``
    n points a direction, Gauss–Legendre weighted: far fewer dipoles for the same field.
``("fitted", n)``
    n = 9 or 21 dipoles fitted to a cuboid's field outside it, see `fitted_cloud`: fewer still.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .checks import one_of, whole
from .dipoles import MU0, DipoleCloud
from .fitted_cloud import SIZES, fitted_points
from .ranges import ranged, ranged_vector

__all__ = ["RULES", "BlockMagnet", "CylinderMagnet", "Magnet", "PointDipole"]

RULES = ("grid", "gauss", "fitted")

MOST_DIPOLES = 200_000
"""Of one cloud; the paper's has 2000."""


@dataclass(frozen=True)
class BlockMagnet:
    """A cuboid magnet.

    size : edge lengths along its own x, y, z, m
    remanence : residual flux density Br, T

    >>> round(BlockMagnet(size=(.0508,) * 3, remanence=1.3).moment, 3)   # the paper's external magnet, A·m²
    135.62
    """

    size: tuple[float, float, float]
    remanence: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", ranged_vector("BlockMagnet.size", self.size))
        object.__setattr__(self, "remanence", ranged("BlockMagnet.remanence", self.remanence))

    @property
    def volume(self) -> float:
        """m³."""
        return math.prod(self.size)

    @property
    def moment(self) -> float:
        """Br·V/μ0, A·m²."""
        return self.remanence * self.volume / MU0

    @property
    def reach(self) -> float:
        """Largest distance of a point of the body from its centre, m."""
        return 0.5 * math.hypot(*self.size)

    def dipoles(self, rule: str = "gauss", n: Any = 4) -> DipoleCloud:
        """The magnet as a cloud; see the module's text for `rule` and `n`."""
        if rule == "fitted":
            if n not in SIZES:
                raise ValueError(f"n must be one of {', '.join(map(str, SIZES))} for a fitted cloud, got {n!r}")
            positions, share = fitted_points(self.size, n)
            return _along_z(positions * np.asarray(self.size) / 2, share * self.moment)
        rule, counts = _rule(rule, n)
        axes, weights = zip(*(_nodes(rule, c) for c in counts), strict=True)
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        share = np.einsum("i,j,k->ijk", *weights).ravel() / 8
        return _along_z(grid * np.asarray(self.size) / 2, share * self.moment)


@dataclass(frozen=True)
class CylinderMagnet:
    """A cylinder magnetised along its axis.

    diameter, height : m
    remanence : Br, T
    mass : kg; by default that of neodymium at 7500 kg/m³

    >>> round(CylinderMagnet(2e-3, 3e-3, 1.37, mass=7.2e-5).moment, 6)   # the paper's tip magnet, A·m²
    0.010275
    """

    diameter: float
    height: float
    remanence: float
    mass: float | None = None

    def __post_init__(self) -> None:
        for name in ("diameter", "height", "remanence"):
            object.__setattr__(self, name, ranged(f"CylinderMagnet.{name}", getattr(self, name)))
        mass = 7500.0 * self.volume if self.mass is None else ranged("CylinderMagnet.mass", self.mass)
        object.__setattr__(self, "mass", mass)

    @property
    def volume(self) -> float:
        """m³."""
        return math.pi / 4 * self.diameter**2 * self.height

    @property
    def moment(self) -> float:
        """Br·V/μ0, A·m²."""
        return self.remanence * self.volume / MU0

    @property
    def reach(self) -> float:
        """Largest distance of a point of the body from its centre, m."""
        return 0.5 * math.hypot(self.diameter, self.height)

    def dipoles(self, rule: str = "gauss", n: Any = 4) -> DipoleCloud:
        """The magnet as a cloud.

        `gauss` takes n × n points over the disk (Gauss in r², equal angles twice as many) and n along the axis.
        `grid` takes the centres of equal cells of the bounding box that lie inside, scaled to the full moment.
        """
        rule, counts = _rule(rule, n)
        radius, half = self.diameter / 2, self.height / 2
        if rule == "grid":
            axes = [_nodes(rule, c)[0] for c in counts]
            grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            grid = grid[np.hypot(grid[:, 0], grid[:, 1]) <= 1.0]
            share = np.full(len(grid), 1 / len(grid))
        else:
            q, wq = _nodes(rule, counts[0])
            z, wz = _nodes(rule, counts[2])
            r = np.sqrt((q + 1) / 2)
            angle = (np.arange(2 * counts[1]) + 0.5) * np.pi / counts[1]
            rr, aa, zz = np.meshgrid(r, angle, z, indexing="ij")
            grid = np.stack([rr * np.cos(aa), rr * np.sin(aa), zz], axis=-1).reshape(-1, 3)
            share = np.einsum("i,j,k->ijk", wq / 2, np.full(len(angle), 1 / len(angle)), wz / 2).ravel()
        return _along_z(grid * np.array([radius, radius, half]), share * self.moment)


@dataclass(frozen=True)
class PointDipole:
    """A single dipole along z, for checks and for magnets far away.

    strength : A·m²
    """

    strength: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "strength", ranged("PointDipole.strength", self.strength))

    @property
    def moment(self) -> float:
        """A·m²."""
        return self.strength

    @property
    def reach(self) -> float:
        """0 m: it has no body."""
        return 0.0

    def dipoles(self, rule: str = "gauss", n: Any = 1) -> DipoleCloud:
        """One dipole, whatever the rule."""
        _rule(rule, n)
        return _along_z(np.zeros((1, 3)), np.array([self.strength]))


Magnet = BlockMagnet | CylinderMagnet | PointDipole


def _rule(rule: str, n: Any) -> tuple[str, tuple[int, int, int]]:
    one_of("rule", rule, RULES)
    if rule == "fitted":
        raise ValueError("rule must be 'grid' or 'gauss' for a magnet that is no cuboid, got 'fitted'")
    if not isinstance(n, (tuple, list)):
        n = (whole("n", n, 1),) * 3
    if len(n) != 3:
        raise ValueError(f"n must be a whole number of at least 1, or three of them, got {n!r}")
    counts = (whole("n[0]", n[0], 1), whole("n[1]", n[1], 1), whole("n[2]", n[2], 1))
    if math.prod(counts) > MOST_DIPOLES:
        raise ValueError(f"n must make at most {MOST_DIPOLES} dipoles, got {counts}")
    return rule, counts


def _nodes(rule: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points in [-1, 1] and weights that sum to 2."""
    if rule == "gauss":
        return np.polynomial.legendre.leggauss(n)
    return (2 * np.arange(n) + 1) / n - 1, np.full(n, 2 / n)


def _along_z(positions: np.ndarray, strengths: np.ndarray) -> DipoleCloud:
    moments = np.zeros_like(positions)
    moments[:, 2] = strengths
    return DipoleCloud(positions, moments)
