"""The wall of a tree of tubes: the exact signed distance of their union, with its gradient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from .branch import Branch
from .tube_kernels import CHUNK, KEPT, deepest

__all__ = ["Depths", "Tubes"]

_ROUND = 48
"""Directions about the centreline in which the wall is sampled to find the creases of junctions."""

_STEP = 0.1
"""Distance along the centreline between those samples, in radii."""

_PARTS = 3
"""Parts that each piece of a crease is cut into, each end of which is then moved onto both walls."""

_HIDDEN = 2e-3
"""A wall point counts as inside another tube if it lies deeper in it than this share of the radius."""

_RING = 16
"""Directions about the centreline in which a wall is looked for where no crease is near."""

_ON_AXIS = 1e-8
"""Nearer than this to a centreline, m, no direction leads away from it: the arc length is known to no better."""

_BLOCK = 1 << 16
"""Points worked on at a time: it bounds the memory."""


@dataclass(frozen=True, eq=False)
class Depths:
    """The tubes about each of n points, the deepest first; empty places have branch −1.

    depth : (n, k) m, radius minus distance from the centreline, at the point of it where this is largest
    branch : (n, k) number of the branch
    arc : (n, k) m, where on its centreline
    """

    depth: np.ndarray
    branch: np.ndarray
    arc: np.ndarray


class Tubes:
    """The union of the balls along every branch; the trunk goes on straight before its start, all other ends are round.

    A tube alone has depth r − ρ, which is the distance from its wall. In a junction the wall of one tube ends inside
    the other, so there the distance is that of the *crease* where the two walls meet. So nothing of a tube's wall or
    cap is felt inside another, the distance is exact, and its level sets about a crease are round: a wire of radius a
    touches it as it would touch an edge, with a force that turns smoothly.
    """

    def __init__(self, branches: Sequence[Branch], open_start: bool = True) -> None:
        self.branches = tuple(branches)
        heights = [len(b.radius_table) for b in branches]
        first = np.concatenate([[0], np.cumsum(heights)[:-1]]).astype(np.int64)
        self._curve = np.ascontiguousarray(np.concatenate([b.curve.table[1:-1] for b in branches]))
        self._radius = np.ascontiguousarray(np.concatenate([b.radius_table for b in branches]))
        self._spacing = np.array([b.curve.row_spacing for b in branches])
        balls: list[Any] = []
        chunks: list[Any] = []
        rows: list[Any] = []
        for i, (b, height) in enumerate(zip(branches, heights, strict=True)):
            starts = np.arange(0, height, CHUNK)
            is_open = open_start and i == 0 and not b.curve.closed
            rows.append((first[i], height, len(chunks), len(starts), is_open, b.curve.closed))
            for start in starts:
                count: int = min(CHUNK, int(height - start))
                s = (start + np.linspace(0, count, 2 * CHUNK + 1)) * self._spacing[i]
                points = b.curve.position(s)
                centre = points.mean(axis=0)
                reach = np.linalg.norm(points - centre, axis=1).max() + 0.05 * self._spacing[i]
                balls.append((*centre, reach, 1.01 * b.radius(s).max()))
                chunks.append((first[i] + start, count))
        self._balls, self._chunks = np.array(balls), np.array(chunks, dtype=np.int64)
        self._rows = np.array(rows, dtype=np.int64)

    @property
    def tables(self) -> tuple[np.ndarray, ...]:
        """What `tube_kernels.deepest` reads: curve, radius, branches, spacings, balls, chunks."""
        return self._curve, self._radius, self._rows, self._spacing, self._balls, self._chunks

    def depths(self, xyz: np.ndarray) -> Depths:
        """The tubes about each point: xyz (n, 3) m."""
        n = len(xyz)
        depth, arc, branch = np.empty((n, KEPT)), np.empty((n, KEPT)), np.empty((n, KEPT), dtype=np.int64)
        deepest(np.ascontiguousarray(xyz, dtype=np.float64), self._curve, self._radius, self._rows, self._spacing,
                self._balls, self._chunks, depth, branch, arc)  # fmt: skip
        return Depths(depth, branch, arc)

    def distance(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance from the wall, positive inside, and its gradient: xyz (n, 3) m → (n,) m, (n, 3)."""
        distance, gradient = np.empty(len(xyz)), np.empty((len(xyz), 3))
        for i in range(0, len(xyz), _BLOCK):
            distance[i : i + _BLOCK], gradient[i : i + _BLOCK] = self._distance(xyz[i : i + _BLOCK])
        return distance, gradient

    def _distance(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = self.depths(xyz)
        distance = found.depth[:, 0].copy()
        outward, _ = self._outward(xyz, found.branch[:, 0], found.arc[:, 0])
        gradient = -outward
        unsure = np.flatnonzero((distance > 0.0) & (found.depth[:, 1] > -distance))
        hidden = unsure[self._foot_hidden(xyz, found, unsure, 0)[0]]
        if not hidden.size:
            return distance, gradient
        nearest, at = np.full(len(hidden), np.inf), np.zeros((len(hidden), 3))
        for k in range(1, KEPT):
            other = np.flatnonzero(found.depth[hidden, k] > 0.0)
            covered, feet = self._foot_hidden(xyz, found, hidden[other], k)
            seen = other[~covered]
            closer = found.depth[hidden[seen], k] < nearest[seen]
            nearest[seen[closer]] = found.depth[hidden[seen[closer]], k]
            at[seen[closer]] = feet[~covered][closer]
        crease, on_crease = self._from_creases(xyz[hidden])
        closer = crease < nearest
        nearest[closer], at[closer] = crease[closer], on_crease[closer]
        self._round_about(xyz, found, hidden, nearest, at)
        known = np.isfinite(nearest)
        hidden, nearest, at = hidden[known], nearest[known], at[known]
        distance[hidden] = nearest
        away = xyz[hidden] - at
        size = np.linalg.norm(away, axis=1)
        sure = size > 1e-12
        gradient[hidden[sure]] = away[sure] / size[sure, None]
        return distance, gradient

    def _outward(self, xyz: np.ndarray, branch: np.ndarray, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors away from the centreline point, (n, 3), 0 upon it; and that point, (n, 3) m."""
        centre = np.empty((len(xyz), 3))
        for b in np.unique(branch):
            mine = branch == b
            centre[mine] = self.branches[b].curve.position(arc[mine])
        out = xyz - centre
        size = np.linalg.norm(out, axis=1, keepdims=True)
        return np.divide(out, size, out=np.zeros_like(out), where=size > _ON_AXIS), centre

    def _radii(self, branch: np.ndarray, arc: np.ndarray) -> np.ndarray:
        r = np.empty(len(branch))
        for b in np.unique(branch):
            mine = branch == b
            r[mine] = self.branches[b].radius(arc[mine])
        return r

    def _ring(self, branch: np.ndarray, arc: np.ndarray, angle: float) -> np.ndarray:
        """Unit vectors from centreline points to their balls' wall points, at an angle about the centreline, (n, 3)."""
        out = np.zeros((len(branch), 3))
        for b in np.unique(branch):
            mine = branch == b
            t = self.branches[b].curve.tangent(arc[mine])
            lean = np.clip(self.branches[b].radius_slope(arc[mine]), -0.999, 0.999)[:, None]
            n1 = np.cross(t, np.eye(3)[np.abs(t).argmin(axis=1)])
            n1 /= np.linalg.norm(n1, axis=1, keepdims=True)
            ring = np.cos(angle) * n1 + np.sin(angle) * np.cross(t, n1)
            out[mine] = np.sqrt(1 - lean**2) * ring - lean * t
        return out

    def _foot_hidden(self, xyz: np.ndarray, found: Depths, which: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Whether the wall point nearest to each of the points `which` on their k-th tube lies inside some tube; it."""
        branch, arc = found.branch[which, k], found.arc[which, k]
        if not len(which):
            return np.zeros(0, dtype=bool), np.zeros((0, 3))
        outward, centre = self._outward(xyz[which], branch, arc)
        lost = np.linalg.norm(outward, axis=1) == 0.0
        outward[lost] = self._ring(branch[lost], arc[lost], 0.0)
        r = self._radii(branch, arc)
        feet = centre + r[:, None] * outward
        return self.depths(feet).depth[:, 0] > _HIDDEN * r, feet

    def _round_about(
        self, xyz: np.ndarray, found: Depths, hidden: np.ndarray, nearest: np.ndarray, at: np.ndarray
    ) -> None:
        """Where walls nearly coincide, a crease may be missed: look at the deepest tube's wall in other directions.

        Changes `nearest` and `at` for points with a visible wall point beside them that is nearer.
        """
        branch, arc = found.branch[hidden, 0], found.arc[hidden, 0]
        doubtful = np.flatnonzero(nearest > 1.01 * found.depth[hidden, 0])
        if not doubtful.size:
            return
        points, branch, arc = xyz[hidden[doubtful]], branch[doubtful], arc[doubtful]
        r, centre = self._radii(branch, arc), self._outward(points, branch, arc)[1]
        for angle in 2 * np.pi * np.arange(_RING) / _RING:
            feet = centre + r[:, None] * self._ring(branch, arc, angle)
            gap = np.linalg.norm(feet - points, axis=1)
            closer = np.flatnonzero(gap < nearest[doubtful])
            closer = closer[self.depths(feet[closer]).depth[:, 0] <= _HIDDEN * r[closer]]
            nearest[doubtful[closer]], at[doubtful[closer]] = gap[closer], feet[closer]

    # --- creases ------------------------------------------------------------------------------------------------------

    @cached_property
    def _creases(self) -> tuple[np.ndarray, np.ndarray]:
        """The creases as short pieces: their ends, (m, 3) m each."""
        pieces = [self._creases_of(i) for i in range(len(self.branches))] if len(self.branches) > 1 else []
        both = np.concatenate(pieces) if pieces else np.zeros((0, 2, 3))
        return both[:, 0], both[:, 1]

    @cached_property
    def _crease_tree(self) -> KDTree:
        a, b = self._creases
        return KDTree((a + b) / 2)

    def _from_creases(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance from the nearest crease, and the point on it: xyz (n, 3) m → (n,) m, (n, 3) m."""
        a, b = self._creases
        if not len(a):
            return np.full(len(xyz), np.inf), np.zeros((len(xyz), 3))
        _, near = self._crease_tree.query(xyz, k=min(6, len(a)))
        near = near.reshape(len(xyz), -1)
        along = b[near] - a[near]
        size = np.maximum((along**2).sum(axis=-1), 1e-30)
        part = np.clip(((xyz[:, None] - a[near]) * along).sum(axis=-1) / size, 0.0, 1.0)
        points = a[near] + part[..., None] * along
        distance = np.linalg.norm(points - xyz[:, None], axis=-1)
        best, row = distance.argmin(axis=1), np.arange(len(xyz))
        return distance[row, best], points[row, best]

    def _creases_of(self, i: int) -> np.ndarray:
        """Where the wall of branch i enters another tube, as pieces (m, 2, 3) m: marching triangles on the wall."""
        branch = self.branches[i]
        others = Tubes([b for j, b in enumerate(self.branches) if j != i], open_start=i != 0)
        stations = _stations(branch)
        near = np.zeros(len(stations), dtype=bool)
        probe = others.depths(branch.curve.position(stations)).depth[:, 0]
        near |= probe > -2.0 * branch.radius(stations)
        near = np.convolve(near, np.ones(3), mode="same") > 0
        wall = _wall_grid(branch, stations[near], np.flatnonzero(near))
        pieces = np.concatenate([_zero_pieces(grid, others) for grid in wall]) if wall else np.zeros((0, 2, 3))
        parts = np.linspace(0.0, 1.0, _PARTS + 1)[:, None]
        points = pieces[:, :1] + parts * (pieces[:, 1:] - pieces[:, :1])
        points = self._sharpened(points.reshape(-1, 3), i, others).reshape(-1, _PARTS + 1, 3)
        return np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3)

    def _sharpened(self, xyz: np.ndarray, i: int, others: Tubes) -> np.ndarray:
        """Points near a crease of branch i moved onto it: onto both walls, by Newton's least step."""
        mine = Tubes(self.branches[i : i + 1], open_start=i == 0)
        for _ in range(3):
            values, slopes = [], []
            for tubes in (mine, others):
                found = tubes.depths(xyz)
                values.append(found.depth[:, 0])
                slopes.append(-tubes._outward(xyz, found.branch[:, 0], found.arc[:, 0])[0])
            a, b = np.stack(values, axis=1), np.stack(slopes, axis=1)
            cosine = (b[:, 0] * b[:, 1]).sum(axis=1)
            crossing = np.abs(cosine) < 0.995  # walls that nearly touch have no crease to be found better
            square = np.maximum(1 - cosine**2, 1e-3)
            first, second = a[:, 0] - cosine * a[:, 1], a[:, 1] - cosine * a[:, 0]
            step = -(first[:, None] * b[:, 0] + second[:, None] * b[:, 1]) / square[:, None]
            far = np.linalg.norm(step, axis=1) > 0.2 * self.branches[i].widest
            step[far | ~crossing] = 0.0
            xyz = xyz + step
        return xyz


def _stations(branch: Branch) -> np.ndarray:
    """Arc lengths about `_STEP` radii apart, m."""
    s = np.linspace(0.0, branch.length, 8 * len(branch.radius_table) + 1)
    steps = np.concatenate(
        [[0.0], np.cumsum(np.diff(s) / (_STEP * np.minimum(branch.radius(s[1:]), branch.radius(s[:-1]))))]
    )
    count = max(4, int(np.ceil(steps[-1])))
    return np.interp(np.linspace(0.0, steps[-1], count + 1), steps, s)


def _normals(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across each of the unit tangents t, (n, 3), that turn little from one to the next."""
    n1 = np.empty_like(t)
    last = np.eye(3)[np.abs(t[0]).argmin()]
    for i, tangent in enumerate(t):
        last = last - (last @ tangent) * tangent
        size = np.linalg.norm(last)
        if size < 1e-6:
            last = np.eye(3)[np.abs(tangent).argmin()]
            last = last - (last @ tangent) * tangent
            size = np.linalg.norm(last)
        last = last / size
        n1[i] = last
    return n1, np.cross(t, n1)


def _wall_grid(branch: Branch, s: np.ndarray, numbers: np.ndarray) -> list[np.ndarray]:
    """The branch's wall at the stations s, cut where stations are missing: grids (stations, `_ROUND`, 3) m.

    The envelope touches the ball at s along a circle whose direction has component −dr/ds along the tangent. Where
    dr/ds exceeds 1 a ball is swallowed by its neighbours and has no such circle; there the wall is cut too.
    """
    if not len(s):
        return []
    t, slope, r = branch.curve.tangent(s), branch.radius_slope(s), branch.radius(s)
    n1, n2 = _normals(t)
    angle = 2 * np.pi * np.arange(_ROUND) / _ROUND
    ring = n1[:, None] * np.cos(angle)[:, None] + n2[:, None] * np.sin(angle)[:, None]
    whole = np.abs(slope) < 0.999
    lean = np.where(whole, slope, 0.0)
    out = -lean[:, None, None] * t[:, None] + np.sqrt(1 - lean**2)[:, None, None] * ring
    wall = branch.curve.position(s)[:, None] + r[:, None, None] * out
    cuts = np.flatnonzero((np.diff(numbers) > 1) | ~whole[1:] | ~whole[:-1]) + 1
    pieces = np.split(np.arange(len(s)), cuts)
    grids = [wall[p] for p in pieces if len(p) > 1]
    for end, sign in ((0, -1.0), (len(s) - 1, 1.0)):  # the round caps
        at_end = numbers[end] == 0 if sign < 0 else abs(s[end] - branch.length) < 1e-12
        if at_end and not branch.curve.closed:
            lift = np.linspace(np.arcsin(np.clip(-sign * lean[end], -1, 1)), np.pi / 2, 14)[:, None, None]
            cap = np.sin(lift) * sign * t[end] + np.cos(lift) * ring[end]
            grids.append(branch.curve.position(s[end]) + r[end] * cap)
    return grids


def _zero_pieces(grid: np.ndarray, others: Tubes) -> np.ndarray:
    """The pieces of the line on a wall grid along which the depth in the other tubes is 0, (m, 2, 3) m."""
    depth = others.depths(grid.reshape(-1, 3)).depth[:, 0].reshape(grid.shape[:2])
    if not ((depth > 0).any() and (depth < 0).any()):
        return np.zeros((0, 2, 3))
    grid, depth = np.concatenate([grid, grid[:, :1]], axis=1), np.concatenate([depth, depth[:, :1]], axis=1)
    corners = [(slice(None, -1), slice(None, -1)), (slice(1, None), slice(None, -1)),
               (slice(1, None), slice(1, None)), (slice(None, -1), slice(1, None))]  # fmt: skip
    pieces = []
    for three in ((0, 1, 2), (0, 2, 3)):
        p = np.stack([grid[corners[c]].reshape(-1, 3) for c in three], axis=1)
        d = np.stack([depth[corners[c]].ravel() for c in three], axis=1)
        cut = (d > 0).any(axis=1) & (d <= 0).any(axis=1)
        p, d = p[cut], d[cut]
        lone = np.where((d > 0).sum(axis=1) == 1, (d > 0).argmax(axis=1), (d <= 0).argmax(axis=1))
        row = np.arange(len(p))
        ends = []
        for step in (1, 2):
            other = (lone + step) % 3
            a, b = d[row, lone], d[row, other]
            share = (a / np.where(a == b, 1.0, a - b))[:, None]
            ends.append(p[row, lone] + share * (p[row, other] - p[row, lone]))
        pieces.append(np.stack(ends, axis=1))
    return np.concatenate(pieces)
