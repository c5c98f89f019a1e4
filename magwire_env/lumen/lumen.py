"""A lumen: a tree of branches with its wall, its routes, and the way from a point in space to a place in the tree."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..physics.checks import finite, points_array, positive
from .branch import Branch
from .curve import Tract
from .joints import attached, check_tree
from .route import Place, Route

__all__ = ["Lumen", "Wall"]


class Wall(Protocol):
    """A wall that is not that of the tubes: a closed room, a surface."""

    def distance(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance, positive inside, and its gradient: (n, 3) m → (n,) m, (n, 3)."""

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest corner of the space inside, (3,) m each."""


@dataclass(frozen=True)
class Lumen:
    """The space a wire moves in: a tree of branches and the wall about it.

    branches : each branch after its parent; the first is the trunk, and the inlet is its start
    wall : the wall, where it is known better than by the branches' radii (a surface); default that of the tubes
    name : what to call it
    axes : of the coordinates, as its file declared them ("LPS", "RAS" …), "" if unknown; nothing is turned
    notes : what was guessed, turned, capped or dropped when it was made, one sentence each

    The inlet is open: the trunk's tube goes on straight before it. Every other end is closed. Frozen and equal by
    value. `Lumen.load` reads other tools' files; `from_tract` and `from_lines` build one by hand.
    """

    branches: tuple[Branch, ...]
    wall: Wall | None = None
    name: str = ""
    axes: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "branches", tuple(self.branches))
        object.__setattr__(self, "notes", tuple(map(str, self.notes)))
        check_tree(self.branches)

    # --- making -------------------------------------------------------------------------------------------------------

    @classmethod
    def from_tract(cls, tract: Tract, name: str = "") -> Lumen:
        """The lumen of one branch, called "trunk"; a closed tract makes a ring, without dead ends."""
        return cls((Branch("trunk", tract),), name=name)

    @classmethod
    def from_lines(cls, lines: Iterable[Sequence[Any]], name: str = "") -> Lumen:
        """A tree from its centrelines: lines (name, points (n, 3) m, radius m or (n,) m, parent or None) in any order.

        The trunk's parent is None; another line leaves its parent at the parent's point nearest to its own first one,
        and is led there if it begins beside the axis. Raises `ValueError` naming a line that begins outside its
        parent, a parent that does not exist, and a circle of parents.
        """
        waiting = [tuple(line) for line in lines]
        for line in waiting:
            if len(line) != 4:
                raise ValueError(f"lines must be (name, points, radius, parent), got {len(line)} parts")
        made: dict[str | None, Branch] = {}
        while waiting:
            ready = [line for line in waiting if line[3] is None or line[3] in made]
            if not ready:
                raise ValueError(
                    f"the parent of line {waiting[0][0]!r} must be another line's name, got {waiting[0][3]!r}"
                )
            for line in ready:
                made[line[0]] = attached(line[0], line[1], line[2], made.get(line[3]))
                waiting.remove(line)
        return cls(tuple(made.values()), name=name)

    @classmethod
    def load(
        cls,
        path: str | Path,
        unit: str | None = None,
        inlet: Iterable[float] | str | None = None,
        invert: bool = False,
        radius: float | None = None,
        holes: str = "refuse",
        progress: bool | None = None,
        cache: bool = True,
    ) -> Lumen:
        """The lumen in another tool's file, or in a ``.lumen`` file: in m, in the axes of the file.

        path : a surface (.stl, .obj, .ply, .vtp, .vtk), a voxel mask or level set (.nii, .nii.gz, .mha, .mhd, .nrrd),
            centrelines and trees (.csv, .vtp, .vtk, .mrk.json, .swc, .json, SimVascular's .pth and .ctgr), or a folder
            of curve files. Surfaces and masks need the extra `anatomy`
        unit : of the coordinates, "m", "cm", "mm" or "um", where the file declares none; default guessed, and said
        inlet : where the wire comes in: a point near an end in the file's own coordinates, or a line's name
        invert : the surface is that of the material about the lumen (a plate with channels)
        radius : m, for lines without radii
        holes : "close" closes holes in the wall of a surface that are no ends, "refuse" names the first
        progress : show a bar; default on a terminal
        cache : keep the result by the file's content, under the user's cache folder

        What was guessed, turned, capped or dropped stands in `notes` and is warned of (`LumenNote`). Raises
        `ValueError` naming the file, the fault and its place in the file's own coordinates; `FileNotFoundError`.
        """
        from .loading import load

        return load(path, unit, inlet, invert, radius, holes, progress, cache)

    def save(self, path: str | Path) -> None:
        """Write the lumen to a ``.lumen`` file that stands alone; `Lumen.load` reads it."""
        from .lumen_file import save_lumen

        save_lumen(self, path)

    # --- the tree -----------------------------------------------------------------------------------------------------

    @property
    def trunk(self) -> Branch:
        """The branch that begins at the inlet."""
        return self.branches[0]

    @property
    def inlet(self) -> Place:
        """Where a wire comes in: the start of the trunk."""
        return Place(self.trunk.name, 0.0)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """The number of each branch's parent; −1 for the trunk's."""
        numbers = {b.name: i for i, b in enumerate(self.branches)}
        return tuple(-1 if b.parent is None else numbers[b.parent] for b in self.branches)

    @cached_property
    def leaves(self) -> tuple[str, ...]:
        """Names of the branches that end in a dead end: those at whose far end no other begins."""
        return tuple(b.name for i, b in enumerate(self.branches) if not b.curve.closed and not self._goes_on(i))

    def _goes_on(self, i: int) -> bool:
        branch = self.branches[i]
        reach = branch.length - float(branch.radius(branch.length))
        return any(self.parents[j] == i and b.start >= reach for j, b in enumerate(self.branches))

    def index(self, name: str) -> int:
        """The number of the branch called `name`."""
        for i, b in enumerate(self.branches):
            if b.name == name:
                return i
        raise ValueError(f"branch must be one of {', '.join(repr(b.name) for b in self.branches)}, got {name!r}")

    def branch(self, name: str) -> Branch:
        """The branch called `name`."""
        return self.branches[self.index(name)]

    def place(self, at: str | tuple[str, float]) -> Place:
        """A place by what people call it: "inlet", a branch's name for its far end, or (name, arc length in m)."""
        if isinstance(at, str):
            return self.inlet if at == "inlet" else Place(at, self.branch(at).length)
        try:
            name, s = at
        except (TypeError, ValueError):
            raise ValueError(
                f"place must be 'inlet', a branch's name, or (name, arc length in m), got {at!r}"
            ) from None
        length, s = self.branch(name).length, finite(f"arc length of place {at!r}", s, "m")
        if not 0.0 <= s <= length:
            raise ValueError(f"arc length on branch {name!r} must lie in [0, {length:.6g}] m, got {s:g}")
        return Place(name, s)

    def position(self, at: str | tuple[str, float]) -> np.ndarray:
        """The centreline point of a place, (3,) m."""
        place = self.place(at)
        return self.branch(place.branch).curve.position(place.s)

    def tangent(self, at: str | tuple[str, float]) -> np.ndarray:
        """The unit tangent at a place, away from the inlet, (3,)."""
        place = self.place(at)
        return self.branch(place.branch).curve.tangent(place.s)

    def route(self, start: str | tuple[str, float] = "inlet", goal: str | tuple[str, float] | None = None) -> Route:
        """The way from one place to another; without a goal, to the far end of the trunk."""
        return Route(self, self.place(start), self.place(self.trunk.name if goal is None else goal))

    def length_of(self, route: Route | str | tuple[str, float]) -> float:
        """Length of a route, or of the way from the inlet to a place, m."""
        return (route if isinstance(route, Route) else self.route("inlet", route)).length

    @property
    def total_length(self) -> float:
        """Length of all branches together, m."""
        return sum(b.length for b in self.branches)

    def _to_trunk(self, place: Place) -> list[tuple[int, float]]:
        """The branches from a place back to the inlet, each with the arc length at which it is entered or left."""
        i, s = self.index(place.branch), place.s
        way = [(i, s)]
        while self.parents[i] >= 0:
            i, s = self.parents[i], self.branches[i].start
            way.append((i, s))
        return way

    # --- space --------------------------------------------------------------------------------------------------------

    @cached_property
    def tubes(self) -> Any:
        """The wall that the branches' radii make; `magwire_env.lumen.tubes.Tubes`."""
        from .tubes import Tubes  # compiled: loaded when first used

        return Tubes(self.branches)

    def wall_distance(self, xyz: np.ndarray) -> np.ndarray:
        """Distance from the wall, positive inside and negative outside: xyz (..., 3) m → (...) m."""
        return self.wall_distance_and_gradient(xyz)[0]

    def wall_distance_and_gradient(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance from the wall, positive inside, and its gradient, pointing inwards: (..., 3) m → (...) m, (..., 3).

        The gradient has length 1, and is 0 upon a centreline, where no wall is nearest. Outside, the distance is that
        from the nearest wall too. Raises `ValueError` naming a point that is not finite.
        """
        xyz = np.asarray(xyz, dtype=np.float64)
        flat = points_array("xyz", xyz.reshape(-1, 3) if xyz.size else np.zeros((0, 3)), "m")
        distance, gradient = self.tubes.distance(flat) if self.wall is None else self._at_wall(flat)
        return distance.reshape(xyz.shape[:-1]), gradient.reshape(xyz.shape)

    def contains(self, xyz: np.ndarray) -> np.ndarray:
        """Whether points lie inside: xyz (..., 3) m → (...)."""
        return self.wall_distance(xyz) > 0.0

    def project(self, xyz: np.ndarray, prefer: Iterable[int] = ()) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The nearest place of the tree: xyz (..., 3) m → branch's number, arc length m, distance from it m, (...).

        Nearest counts in radii, so that a small branch beside a large one is found. prefer : numbers of branches
        (a route's) that win wherever the point is inside their tube. Behind the inlet the arc length is negative.
        """
        xyz = np.asarray(xyz, dtype=np.float64)
        flat = points_array("xyz", xyz.reshape(-1, 3) if xyz.size else np.zeros((0, 3)), "m")
        found = self.tubes.depths(flat)
        rows = np.arange(len(flat))
        used = found.branch >= 0
        radius = np.array([b.widest for b in self.branches])[found.branch]
        for b in np.unique(found.branch[used]):
            mine = found.branch == b
            radius[mine] = self.branches[b].radius(found.arc[mine])
        share = np.where(used, found.depth, -np.inf) / radius
        wanted = np.isin(found.branch, list(prefer)) & (found.depth > 0.0)
        best = (share + 10.0 * wanted).argmax(axis=1)
        branch, s = found.branch[rows, best], found.arc[rows, best]
        gap = np.empty(len(flat))
        for b in np.unique(branch):
            mine = branch == b
            s[mine], gap[mine] = _foot(self.branches[b].curve, flat[mine], s[mine], bool(b == 0))
        shape = xyz.shape[:-1]
        return branch.reshape(shape), s.reshape(shape), gap.reshape(shape)

    def _at_wall(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The surface's distance, joined with the straight way in, which opens the wall at the inlet."""
        assert self.wall is not None
        distance, gradient = self.wall.distance(xyz)
        if self._entry is None:
            return distance, gradient
        near = np.flatnonzero(self._most_of_entry(xyz) > distance)
        through, along = self._entry.distance(xyz[near])
        better = near[through > distance[near]]
        distance[better], gradient[better] = through[through > distance[near]], along[through > distance[near]]
        return distance, gradient

    def _most_of_entry(self, xyz: np.ndarray) -> np.ndarray:
        """More than the distance that the way in gives, (n, 3) m → (n,) m: from the ray out of the ball about it."""
        way = self._entry.branches[0]
        out = xyz - way.curve.position(way.length)
        behind = np.minimum(out @ way.curve.tangent(0.0), 0.0)
        ray = out - behind[:, None] * way.curve.tangent(0.0)
        return 2.0 * way.length + way.widest - np.linalg.norm(ray, axis=1)

    @cached_property
    def _entry(self) -> Any:
        from .tubes import Tubes

        if self.trunk.curve.closed:
            return None
        r = float(self.trunk.radius(0.0))
        within = min(r, 0.5 * self.trunk.length)
        points = self.trunk.curve.position(np.linspace(0.0, within, 4))
        return Tubes((Branch("way in", Tract.from_points(points, r)),))

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest corner of the space inside, without what lies before the inlet, (3,) m each."""
        if self.wall is not None:
            return self.wall.bounds
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for b in self.branches:
            s = np.linspace(0.0, b.length, len(b.radius_table) + 1)
            points, r = b.curve.position(s), b.radius(s)[:, None]
            low, high = np.minimum(low, (points - r).min(axis=0)), np.maximum(high, (points + r).max(axis=0))
        return low, high

    @cached_property
    def sharpest_bend(self) -> tuple[float, Place]:
        """The smallest bend radius of any centreline, m, and where; corners of the routes at forks do not count."""
        found = []
        for b in self.branches:
            s = b.curve.row_spacing * np.arange(len(b.curve.table) - 1)
            curvature = b.curve.curvature(s)
            i = int(curvature.argmax())
            found.append((1.0 / max(float(curvature[i]), 1e-12), Place(b.name, float(s[i]))))
        return min(found)

    @property
    def narrowest(self) -> tuple[float, Place]:
        """The smallest radius, m, and where it is."""
        return min((b.narrowest[0], Place(b.name, b.narrowest[1])) for b in self.branches)

    def too_narrow_for(self, radius: float) -> list[tuple[Place, float]]:
        """The narrowest place of each branch that a wire of this radius does not pass, and the radius there, m."""
        radius = positive("radius", radius, "m")
        return [(Place(b.name, s), r) for b in self.branches for r, s in (b.narrowest,) if r <= radius]

    @property
    def widest(self) -> float:
        """The largest radius, m."""
        return max(b.widest for b in self.branches)

    def replace(self, **changes: Any) -> Lumen:
        """A copy with other fields."""
        return replace(self, **changes)

    def __getstate__(self) -> dict[str, Any]:
        return {k: self.__dict__[k] for k in self.__dataclass_fields__}


def _foot(curve: Tract, xyz: np.ndarray, s: np.ndarray, open_start: bool) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths of the centreline points nearest to `xyz`, from the guess s, by Newton; and the distances, m."""
    for _ in range(6):
        gap = curve.position(s) - xyz
        t, k = curve.tangent(s), curve.curvature_vector(s)
        slope = np.maximum(1.0 + (gap * k).sum(axis=-1), 0.2)
        s = s - np.clip((gap * t).sum(axis=-1) / slope, -curve.row_spacing, curve.row_spacing)
        if curve.closed:
            s = s % curve.length
        else:
            s = np.clip(s, -np.inf if open_start else 0.0, curve.length)
    return s, np.linalg.norm(curve.position(s) - xyz, axis=-1)
