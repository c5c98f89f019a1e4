"""Random lumens: seeded trees like vessels and bronchi, and tubes like bowel, split for training and testing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from ..physics.checks import non_negative, one_of, positive, vector, whole
from .curve import Tract
from .generator import SPLITS, Bounds, generate
from .lumen import Lumen

__all__ = ["KINDS", "TreeBounds", "grow", "within_bounds"]

KINDS = ("vessels", "bronchi", "bowel")
"""The order is part of each kind's random stream, so it must never change."""

_TREES = 400
"""Trees begun before the bounds are called too tight."""

_TRIES = 12
"""Ways tried for each branch, or pair of branches, before its tree is given up."""

_NEAR = 3.0
"""Branches that meet are not compared nearer to their junction than this many radii of the parent."""


@dataclass(frozen=True)
class TreeBounds:
    """What every generated lumen keeps to.

    leaves : (least, most) dead ends; bowel has one
    radius : (least, most) m, of the inlet's lumen
    bend : least bend radius of a centreline, in radii of its lumen (half of it out of distribution)
    margin : m, from wall to wall of branches that do not meet, at least
    box : m along x, y, z; the centrelines stay inside a box of this size
    narrowest : m, least radius at a stenosis
    length : (least, most) of a tree's branches, in radii of their own; None: what the kind has, 9 to 22 of "vessels",
        5.2 to 7 of "bronchi"
    """

    leaves: tuple[int, int] = (3, 15)
    radius: tuple[float, float] = (3e-3, 5e-3)
    bend: float = 5.0
    margin: float = 1e-3
    box: tuple[float, float, float] = (0.3, 0.3, 0.2)
    narrowest: float = 0.6e-3
    length: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        low, high = (whole(f"TreeBounds.leaves[{i}]", v, 1) for i, v in enumerate(self.leaves))
        object.__setattr__(self, "leaves", (low, high))
        for name, size in (("radius", 2), ("box", 3)):
            values = vector(f"TreeBounds.{name}", getattr(self, name), size, "m")
            checked = tuple(positive(f"TreeBounds.{name}[{i}]", v, "m") for i, v in enumerate(values))
            object.__setattr__(self, name, checked)
        for name in ("bend", "narrowest"):
            object.__setattr__(self, name, positive(f"TreeBounds.{name}", getattr(self, name)))
        object.__setattr__(self, "margin", non_negative("TreeBounds.margin", self.margin, "m"))
        if high < low or self.radius[1] < self.radius[0]:
            raise ValueError(
                f"TreeBounds.leaves and radius must be (least, most), got {self.leaves} and {self.radius} m"
            )
        if self.length is not None:
            least, most = (positive(f"TreeBounds.length[{i}]", v, "radii") for i, v in enumerate(self.length))
            object.__setattr__(self, "length", (least, most))
            if not 3.0 <= least <= most:
                raise ValueError(f"TreeBounds.length must be (least, most) of at least 3 radii, got {self.length}")
        if self.bend < 1.5:
            raise ValueError(f"TreeBounds.bend must be at least 1.5 radii, got {self.bend:g}")


@dataclass(frozen=True)
class _Style:
    """How a family of trees grows; pairs are ranges that each tree or branch draws from.

    length : of a branch, in radii of its own
    tortuosity : how much of the sharpest bend allowed is used
    spatial : how far the plane of a fork is turned from the one before, degrees
    uneven : radius of the smaller branch over that of the larger
    taper : share of its radius that a branch loses along itself
    angles : the angles of a fork over Murray's
    stenosis : share of branches with one, and how much of the radius it takes
    thirds : share of forks that part in three
    """

    length: tuple[float, float]
    tortuosity: tuple[float, float]
    spatial: tuple[float, float]
    uneven: tuple[float, float]
    taper: tuple[float, float]
    angles: tuple[float, float] = (0.95, 1.1)
    stenosis: tuple[float, tuple[float, float]] = (0.0, (0.0, 0.0))
    thirds: float = 0.0
    bend: float = 1.0


_STYLES = {
    "vessels": _Style((9, 22), (0.2, 0.9), (0, 90), (0.6, 1.0), (0.0, 0.2), stenosis=(0.25, (0.2, 0.5))),
    "bronchi": _Style((5.2, 7.0), (0.0, 0.15), (75, 105), (0.75, 1.0), (0.0, 0.08)),
}
"""Bronchi: a length of three diameters, and successive forks at right angles (Weibel 1963; Kitaoka et al. 1999)."""

_ODD = {
    "vessels": {
        "tortuosity": (0.7, 1.0),
        "thirds": 0.35,
        "angles": (1.2, 1.45),
        "stenosis": (0.6, (0.4, 0.65)),
        "bend": 0.5,
    },
    "bronchi": {"tortuosity": (0.4, 0.9), "thirds": 0.3, "angles": (1.2, 1.4), "spatial": (0, 40), "bend": 0.7},
}


def grow(seed: int, split: str = "train", kind: str = "vessels", bounds: TreeBounds = TreeBounds()) -> Lumen:
    """The random lumen of a seed: a value that depends on its arguments alone, on any machine.

    seed : whole number of at least 0
    split : "train" and "test" are of one family; "ood" bends and forks more sharply, parts in three now and then, and
        is narrowed more often and more tightly
    kind : "vessels": forks by Murray's law (the cubes of the radii add up, and the angles follow from the radii),
        between planar and spatial, with bends, tapering and stenoses; "bronchi": short straight branches whose forks
        turn by a right angle; "bowel": one long tube, wound as `anatomy.generator` winds it, with folds and narrows
    bounds : what the lumen keeps to

    Branches are called "b0" (the trunk), "b1" … Each split and kind has random streams of its own, as
    `magwire_env.anatomy.generator` has. Raises `ValueError` for an unknown split or kind, a bad seed, and bounds that
    no tree met.
    """
    one_of("split", split, SPLITS)
    one_of("kind", kind, KINDS)
    whole("seed", seed, 0)
    draw = _uniforms(int(seed), SPLITS.index(split), KINDS.index(kind))
    name = f"{kind} {split} {seed}"
    if kind == "bowel":
        return _bowel(draw, int(seed), split, name)
    style = replace(_STYLES[kind], **(_ODD[kind] if split == "ood" else {}))  # type: ignore[arg-type]
    if bounds.length is not None:
        style = replace(style, length=bounds.length)
    for _ in range(_TREES):
        tree = _Tree(draw, style, bounds)
        if tree.grown() and (lumen := tree.lumen(name)) is not None:
            return lumen
    raise ValueError(f"bounds must leave room for a tree; none of {_TREES} kept to {bounds}")


def within_bounds(lumen: Lumen, bounds: TreeBounds, odd: bool = False) -> None:
    """Raise `ValueError` naming the bound that a generated tree breaks, its value and where; else return.

    odd : the tree is out of distribution, where bends may be twice as sharp
    """
    if not bounds.leaves[0] <= len(lumen.leaves) <= bounds.leaves[1]:
        raise ValueError(f"leaves must lie in {bounds.leaves}, got {len(lumen.leaves)}")
    points = np.concatenate([b.curve.table[1:, 0:3] for b in lumen.branches])
    size = np.ptp(points, axis=0)
    if (size > np.array(bounds.box)).any():
        raise ValueError(f"the centrelines must fit a box of {bounds.box} m, got {size.round(4).tolist()}")
    least, place = lumen.narrowest
    if least < 0.999 * bounds.narrowest:
        raise ValueError(f"radius must be at least {bounds.narrowest:g} m, got {least:.4g} at {place}")
    for b in lumen.branches:
        s = b.curve.row_spacing * np.arange(len(b.curve.table) - 1)
        tight = 1.0 / (np.maximum(b.curve.curvature(s), 1e-9) * b.widest)
        if tight.min() < (0.5 if odd else 1.0) * bounds.bend * 0.9:
            raise ValueError(
                f"bend radius must be at least {bounds.bend:g} radii, got {tight.min():.2f} on branch {b.name!r} "
                f"at {s[tight.argmin()]:.4f} m"
            )


# --- trees ------------------------------------------------------------------------------------------------------------

_Draw = Callable[..., Any]


@dataclass
class _Bud:
    """Where a branch is to grow: its parent's name, its place, heading, the normal of its fork, radius and leaves."""

    parent: str | None
    at: np.ndarray
    heading: np.ndarray
    normal: np.ndarray
    radius: float
    before: float
    leaves: int


@dataclass
class _Tree:
    """A tree while it grows."""

    draw: _Draw
    style: _Style
    bounds: TreeBounds
    lines: list[tuple] = field(default_factory=list)
    occupied: list[tuple[str, str | None, np.ndarray, np.ndarray]] = field(default_factory=list)

    def grown(self) -> bool:
        """Grow a whole tree; False if some branch found no room."""
        low, high = self.bounds.leaves
        leaves = low + int((high - low + 1) * self.draw())
        radius = _between(self.draw, self.bounds.radius)
        if self.style.tortuosity[1] > 0.2:  # a tree is tortuous, or planar, as a whole
            middle = _between(self.draw, self.style.tortuosity)
            self.style = replace(self.style, tortuosity=(0.7 * middle, min(1.0, 1.3 * middle)))
            turn = _between(self.draw, self.style.spatial)
            self.style = replace(self.style, spatial=(max(0.0, turn - 15), turn + 15))
        x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        buds = [[_Bud(None, np.zeros(3), x, z, radius, radius, leaves)]]
        while buds:
            pair = buds.pop(0)
            for _ in range(_TRIES):
                if (sprouts := self._branches(pair)) is not None:
                    break
            else:
                return False
            buds += sprouts
        return True

    def lumen(self, name: str) -> Lumen | None:
        """The tree as a lumen, moved so that its box is centred; None if it does not fit the bounds."""
        points = np.concatenate([line[1] for line in self.lines])
        centre = np.round((points.max(axis=0) + points.min(axis=0)) / 2, 6)
        lines = [(n, np.round(xyz - centre, 6), np.round(r, 6), parent) for n, xyz, r, parent in self.lines]
        try:
            lumen = Lumen.from_lines(lines, name)
            within_bounds(lumen, self.bounds, odd=self.style.bend < 1.0)
        except ValueError:
            return None
        return lumen

    def _branches(self, pair: list[_Bud]) -> list[list[_Bud]] | None:
        """Grow the branches of one fork together; the forks at their ends, or None if there is no room."""
        grown: list[Any] = []
        sprouts: list[Any] = []
        for k, bud in enumerate(pair):
            name = f"b{len(self.lines) + k}"
            xyz, heading = self._course(bud)
            radii = self._radii(bud, xyz)
            if not self._has_room(name, bud, xyz, radii, grown):
                return None
            grown.append((name, bud.parent, xyz, radii))
            if bud.leaves > 1:
                sprouts.append(self._fork(name, bud, xyz[-1], heading, radii[-1]))
        for name, parent, xyz, radii in grown:
            self.lines.append((name, xyz, radii, parent))
            self.occupied.append((name, parent, xyz, radii))
        return sprouts

    def _course(self, bud: _Bud) -> tuple[np.ndarray, np.ndarray]:
        """Points of a branch, (n, 3) m, and its heading at the end: smooth random bends in two directions."""
        draw, style = self.draw, self.style
        length = bud.radius * _between(draw, style.length)
        count = max(8, round(length / 2.5e-3))
        u = (np.arange(count) + 0.5) / count
        sharpest = _between(draw, style.tortuosity) / (1.15 * style.bend * self.bounds.bend * bud.before)
        waves = [np.sin(np.pi * ((1 + draw()) * u + 2 * draw())) for _ in range(2)]
        share = draw()
        ease = np.minimum(1.0, np.minimum(u, 1 - u) * length / (2 * bud.before))  # straight into and out of a fork
        ways = [w * ease * sharpest * np.sqrt(q) for w, q in zip(waves, (share, 1 - share), strict=True)]
        step = length / count
        at, heading, normal = bud.at, bud.heading, bud.normal
        points = [at]
        for bend, rise in zip(*ways, strict=True):
            across = np.cross(normal, heading)
            turned = heading + step * (bend * across + rise * normal)
            turned /= np.linalg.norm(turned)
            at = at + step * (heading + turned) / np.linalg.norm(heading + turned)
            heading = turned
            normal = normal - (normal @ heading) * heading
            normal /= np.linalg.norm(normal)
            points.append(at)
        bud.normal = normal
        return np.array(points), heading

    def _radii(self, bud: _Bud, xyz: np.ndarray) -> np.ndarray:
        """Radii: a funnel from the parent's to the branch's own, tapering, and perhaps a stenosis."""
        draw, style = self.draw, self.style
        s = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
        funnel = np.clip(s / (2.5 * bud.before), 0.0, 1.0)
        radii = bud.radius + (0.98 * bud.before - bud.radius) * (1 - funnel) ** 2
        radii = radii * (1 - _between(draw, style.taper) * s / s[-1])
        chance, depth = style.stenosis
        if draw() < chance:
            middle, width = s[-1] * (0.45 + 0.3 * draw()), bud.radius * (1.5 + 1.5 * draw())
            radii = radii * (1 - _between(draw, depth) * np.exp(-(((s - middle) / width) ** 2)))
        return np.maximum(radii, self.bounds.narrowest)

    def _has_room(self, name: str, bud: _Bud, xyz: np.ndarray, radii: np.ndarray, grown: list[tuple]) -> bool:
        box = np.array(self.bounds.box)
        everything = np.concatenate([xyz, *(o[2] for o in self.occupied), *(g[2] for g in grown)])
        if (np.ptp(everything, axis=0) > 0.99 * box).any():
            return False
        away = np.linalg.norm(xyz - xyz[0], axis=1)
        for other, _, points, thick in [*self.occupied, *grown]:
            meets = other == bud.parent or any(g[0] == other for g in grown)
            mine = away > _NEAR * bud.before if meets else np.ones(len(xyz), dtype=bool)
            if not mine.any():
                continue
            apart, at = KDTree(points).query(xyz[mine])
            if (apart - radii[mine] - thick[at] < self.bounds.margin + 0.5e-3).any():
                return False
        return True

    def _fork(self, name: str, bud: _Bud, at: np.ndarray, heading: np.ndarray, radius: float) -> list[_Bud]:
        """The branches that go on from a branch's end, by Murray's law."""
        draw, style = self.draw, self.style
        turn = np.deg2rad(_between(draw, style.spatial)) * (1 if draw() < 0.5 else -1)
        normal = bud.normal * np.cos(turn) + np.cross(heading, bud.normal) * np.sin(turn)
        ratio = _between(draw, style.uneven)
        big = radius / (1 + ratio**3) ** (1 / 3)
        sizes = [big, ratio * big]
        cubes = np.array([1.0, ratio**3])
        cosines = [(radius**4 + a**4 - b**4) / (2 * radius**2 * a**2) for a, b in (sizes, sizes[::-1])]
        angles = np.arccos(np.clip(cosines, -1.0, 1.0)) * _between(draw, style.angles) * [1, -1]
        if bud.leaves > 2 and draw() < style.thirds:
            sizes = [0.87 * s for s in sizes] + [0.7 * radius]
            angles, cubes = np.append(1.35 * angles, 0.0), np.append(cubes, 1.0)
        side = 1.0 if draw() < 0.5 else -1.0
        across = np.cross(normal, heading)
        buds = []
        for size, angle, leaves in zip(sizes, side * angles, _shared(bud.leaves, cubes, draw), strict=True):
            ahead = np.cos(angle) * heading + np.sin(angle) * across
            buds.append(_Bud(name, at, ahead, normal, max(size, 1.3 * self.bounds.narrowest), radius, leaves))
        return buds


def _shared(leaves: int, weights: np.ndarray, draw: _Draw) -> list[int]:
    """`leaves` given out by the weights, with some chance, at least one each."""
    counts = [1] * len(weights)
    for _ in range(leaves - len(weights)):
        counts[int(np.searchsorted(np.cumsum(weights) / np.sum(weights), draw()))] += 1
    return counts


def _between(draw: _Draw, ends: tuple[float, float]) -> float:
    return ends[0] + (ends[1] - ends[0]) * draw()


def _uniforms(seed: int, split: int, kind: int) -> _Draw:
    """A function that draws the next uniform in [0, 1), from the bit generator's own lasting stream."""
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(split, 1, kind)))
    return lambda: float(int(bits.random_raw()) >> 11) * 2.0**-53


# --- bowel ------------------------------------------------------------------------------------------------------------


def _bowel(draw: _Draw, seed: int, split: str, name: str) -> Lumen:
    """A wound tube with folds half as deep as they are long, wide and narrow stretches, and one or two sphincters."""
    wound = generate(seed, split, Bounds(lumen=(8e-3, 11e-3), bend_radius=0.035, box=(0.3, 0.3, 0.06)))
    count = round(wound.length / 2.5e-3)
    s = np.linspace(0.0, wound.length, count + 1)
    base = 9.0e-3 + 1.5e-3 * np.sin(2 * np.pi * ((1.5 + 2 * draw()) * s / wound.length + draw()))
    depth, every = (0.1 + 0.15 * draw()) * (1.4 if split == "ood" else 1.0), 0.02 + 0.012 * draw()
    folds = depth * (0.5 + 0.5 * np.cos(2 * np.pi * (s / every + draw()))) ** 2
    radii = base * (1 - folds)
    for _ in range(1 + int(2 * draw())):
        middle, width = wound.length * (0.2 + 0.6 * draw()), 0.008 + 0.008 * draw()
        radii = radii * (1 - (0.2 + 0.2 * draw()) * np.exp(-(((s - middle) / width) ** 2)))
    xyz = np.round(wound.position(s), 6)
    return Lumen.from_tract(Tract.from_points(xyz, np.round(radii, 6)), name)
