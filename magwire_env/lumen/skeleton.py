"""From a closed surface to its tree of centrelines: minimal paths through the balls that fit into it.

As in Antiga et al. 2003 (the way of VMTK): the centres of the Delaunay tetrahedra of points on the surface approximate
the medial axis; a path that is cheap where the balls are large runs along the middle. Ends are the openings, and those
extremities that stick out of the tree's balls by more than a radius.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay, KDTree

from .junctions import Line, joined
from .mending import Opening
from .surface import Surface

__all__ = ["Line", "centrelines"]

_SPACING = 0.45
"""Distance between the surface's sample points, in radii of the ball that touches there."""

_COARSE = 6_000
"""Points by area, and as many by face, at which the lumen's width is looked at first."""

_MOST_SAMPLES = 50_000

_SPUR = 1.0
"""A branch that sticks out of its parent's ball by less than this many of its radii is a spur."""

_COVER = 1.25
"""A ball whose centre lies within this many radii of a centre of the tree belongs to it."""

_POINTED = 0.65
"""A branch ends where its radius falls below this share of what it was just before."""

_MOST_BRANCHES = 400

Progress = Callable[[float, str], None]


@dataclass
class _Graph:
    """The balls that fit in: centres (n, 3), radii (n,), and which of them overlap, (n, n) by length and cost."""

    centres: np.ndarray
    radii: np.ndarray
    lengths: csr_matrix
    costs: csr_matrix


def centrelines(
    surface: Surface, openings: list[Opening], inlet: np.ndarray | None, notes: list[str], progress: Progress
) -> list[Line]:
    """The tree's lines, each after its parent, in the surface's own unit; the first begins at the inlet.

    inlet : a point at the end where the wire comes in; default the widest opening, or the widest extremity
    Raises `ValueError` if the inlet is nowhere near the surface, or if an opening cannot be reached from it.
    """
    progress(0.1, "samples")
    points, _normals = _samples(surface)
    progress(0.2, "balls that fit")
    graph = _medial(surface, points)
    progress(0.6, "paths")
    goals = [_beneath(graph, o) for o in openings]
    root, at = _root(surface, graph, openings, goals, inlet, notes)
    found = _tree(graph, root, [g for i, g in enumerate(goals) if i != at], openings, notes)
    progress(0.8, "centring")
    ends = {g: openings[i] for i, g in enumerate(goals)}
    lines = [_line(surface, graph, path, parent, ends, k == 0) for k, (path, parent) in enumerate(found)]
    return joined(surface, lines)


# --- the medial axis --------------------------------------------------------------------------------------------------


def _samples(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Points on the surface, dense where it is narrow, and normals out of it, (n, 3) each."""
    rng = np.random.default_rng(0)
    areas = surface.areas
    by_area = rng.choice(len(areas), _COARSE, p=areas / areas.sum())
    faces = np.concatenate([by_area, rng.integers(0, len(areas), _COARSE)])  # small faces tell of narrow branches
    rng.shuffle(faces)
    at = _within(surface, faces, rng)
    radius = _touching(at, surface.normals[faces])
    local = _smallest_near(at, radius)
    # as many samples on each face as its area holds squares of the spacing there
    near = KDTree(at)
    corners = surface.vertices[surface.faces]
    spacing = _SPACING * local[near.query(corners.mean(axis=1))[1]]
    expected = areas / spacing**2
    if expected.sum() > _MOST_SAMPLES:
        expected *= _MOST_SAMPLES / expected.sum()
    count = np.floor(expected + rng.random(len(expected))).astype(np.int64)
    faces = np.repeat(np.arange(len(areas)), count)
    return _even(_within(surface, faces, rng), surface.normals[faces], np.repeat(spacing, count))


def _within(surface: Surface, faces: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random point on each of the faces."""
    u, v = rng.random(len(faces)), rng.random(len(faces))
    over = u + v > 1
    u[over], v[over] = 1 - u[over], 1 - v[over]
    a, b, c = (surface.vertices[surface.faces[faces, i]] for i in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a)


def _even(points: np.ndarray, normals: np.ndarray, spacing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Without those that crowd a point before them, nearer than half the spacing."""
    pairs = KDTree(points).query_pairs(float(np.quantile(spacing, 0.9)) * 0.5, output_type="ndarray")
    close = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) < 0.4 * spacing[pairs].min(axis=1)
    drop = np.zeros(len(points), dtype=bool)
    drop[pairs[close].max(axis=1)] = True
    return points[~drop], normals[~drop]


def _touching(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Radius of the largest ball inside that touches the surface at each point: shrinking balls (Ma et al. 2012)."""
    tree = KDTree(points)
    few = min(1000, len(points))
    radius = np.full(few, float(np.ptp(points, axis=0).max()))
    radius = _shrunk(tree, points, normals, radius)
    if few < len(points):  # the others begin with what their neighbours found: a far centre makes a slow search
        near = KDTree(points[:few]).query(points, k=4)[1]
        radius = _shrunk(tree, points, normals, 1.5 * radius[near].max(axis=1))
    return radius


def _shrunk(tree: KDTree, points: np.ndarray, normals: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """The balls at the first points of all, shrunk until they hold no other point."""
    points, normals = points[: len(radius)], normals[: len(radius)]
    for _ in range(12):
        centre = points - radius[:, None] * normals
        gap, at = tree.query(centre)
        other = tree.data[at] - points
        chord, along = np.linalg.norm(other, axis=1), -(other * normals).sum(axis=1)
        steep = along > 0.15 * chord
        fit = np.where(steep, chord**2 / np.maximum(2 * along, 1e-12 * chord + 1e-300), 3.0 * chord)
        smaller = (gap < radius) & (chord > 0) & (fit < 0.98 * radius)
        if not smaller.any():
            break
        radius = np.where(smaller, fit, radius)
    return radius


def _smallest_near(points: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """The lower quartile of the radius among a few neighbours: one bad ball does not count."""
    _, near = KDTree(points).query(points, k=min(9, len(points)))
    return np.quantile(radius[near], 0.4, axis=1)


def _medial(surface: Surface, points: np.ndarray) -> _Graph:
    """The graph of the balls about the tetrahedra's centres inside; neighbours share a face and overlap."""
    size = float(np.ptp(points, axis=0).max())
    jitter = (
        np.random.default_rng(1).normal(size=points.shape) * 1e-7 * size
    )  # points on one circle have no unique tetrahedra
    cells = Delaunay(points + jitter)
    centres, radii = _circumcentres(points[cells.simplices])
    low, high = surface.bounds
    ok = ((centres > low) & (centres < high)).all(axis=1)
    number = np.full(len(centres), -1)
    candidates = np.flatnonzero(ok)
    inside = candidates[surface.inside(centres[candidates])]
    gaps = surface.closest(centres[inside])[0]
    keep = gaps > 0.3 * radii[inside]  # else the ball sticks out between the samples
    inside, gaps = inside[keep], gaps[keep]
    number[inside] = np.arange(len(inside))
    a = np.repeat(inside, 4)
    b = cells.neighbors[inside].ravel()
    ok = (b > a) & (b >= 0)
    a, b = number[a[ok]], number[b[ok]]
    a, b = a[b >= 0], b[b >= 0]
    where = centres[inside]
    apart = np.linalg.norm(where[a] - where[b], axis=1)
    overlap = apart < gaps[a] + gaps[b]  # two balls that fit and overlap: no wall stands between
    a, b, apart = a[overlap], b[overlap], np.maximum(apart[overlap], 1e-9 * size)
    mean = (gaps[a] + gaps[b]) / 2
    shape = (len(inside), len(inside))
    lengths = coo_matrix((apart, (a, b)), shape=shape).tocsr()
    costs = coo_matrix((apart / mean**2, (a, b)), shape=shape).tocsr()
    return _Graph(where, gaps, lengths, costs)


def _circumcentres(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 3) and radii (n,) of the spheres through four points each, (n, 4, 3); flat ones lie at infinity."""
    base = corners[:, 0]
    edges = corners[:, 1:] - base[:, None]
    square = (edges**2).sum(axis=2)
    cross = np.stack(
        [np.cross(edges[:, 1], edges[:, 2]), np.cross(edges[:, 2], edges[:, 0]), np.cross(edges[:, 0], edges[:, 1])],
        axis=1,
    )
    volume = (edges[:, 0] * cross[:, 0]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = (square[:, :, None] * cross).sum(axis=1) / (2 * volume[:, None])
    offset[~np.isfinite(offset).all(axis=1)] = np.inf
    return base + offset, np.linalg.norm(offset, axis=1)


# --- paths ------------------------------------------------------------------------------------------------------------


def _beneath(graph: _Graph, opening: Opening) -> int:
    """The ball beneath an opening: a large one near its middle."""
    gap = np.linalg.norm(graph.centres - opening.centre, axis=1)
    near = np.flatnonzero(gap < 2.0 * opening.radius)
    if not near.size:
        return int(gap.argmin())
    return int(near[(graph.radii[near] - 0.5 * gap[near]).argmax()])


def _root(
    surface: Surface,
    graph: _Graph,
    openings: list[Opening],
    goals: list[int],
    inlet: np.ndarray | None,
    notes: list[str],
) -> tuple[int, int]:
    """The ball at the inlet, and the number of the opening it is, or −1."""
    shown = "({:.6g}, {:.6g}, {:.6g})".format
    if inlet is not None:
        ends = np.array([o.centre for o in openings]).reshape(-1, 3)
        gaps = np.linalg.norm(ends - inlet, axis=1)
        if len(gaps) and gaps.min() < 3 * openings[int(gaps.argmin())].radius:
            return goals[int(gaps.argmin())], int(gaps.argmin())
        gap = float(surface.closest(inlet[None])[0][0])
        near = np.linalg.norm(graph.centres - inlet, axis=1)
        ball = int((near - graph.radii).argmin())
        if not surface.inside(inlet[None])[0] and gap > 2 * graph.radii[ball]:
            raise ValueError(
                f"inlet must be a point at an end of the lumen, in the file's coordinates, got {shown(*inlet)}, "
                f"{gap:.4g} outside it"
            )
        return _tip(graph, ball, inlet), -1
    if openings:
        at = int(np.argmax([o.radius for o in openings]))
        notes.append(
            f"the inlet is taken to be the widest open end, at {shown(*openings[at].centre)}; inlet=(x, y, z) "
            "chooses another"
        )
        return goals[at], at
    start = int(graph.radii.argmax())
    gaps = _from(graph, start)
    one = int(np.where(np.isfinite(gaps), gaps, -1).argmax())
    gaps = _from(graph, one)
    other = int(np.where(np.isfinite(gaps), gaps, -1).argmax())
    before = dijkstra(graph.costs, directed=False, indices=start, return_predecessors=True)[1]
    nobody = np.full(len(gaps), -1)
    ways = [_way_in(before, tip, nobody, start) for tip in (one, other)]
    far = [way[_end_of(graph, way[: max(3, len(way) // 4)])] for way in ways]
    at = far[int(np.argmax(graph.radii[far]))]
    notes.append(
        f"the inlet is taken to be the wider of the two farthest ends, at {shown(*graph.centres[at])}; inlet=(x, y, "
        "z) chooses another"
    )
    return at, -1


def _tip(graph: _Graph, ball: int, inlet: np.ndarray) -> int:
    """A large ball about an inlet's point."""
    near = np.flatnonzero(np.linalg.norm(graph.centres - graph.centres[ball], axis=1) < 1.5 * graph.radii[ball])
    gap = np.linalg.norm(graph.centres[near] - inlet, axis=1)
    return int(near[(graph.radii[near] - 0.7 * gap).argmax()])


def _from(graph: _Graph, source: int) -> np.ndarray:
    """Length of the shortest way from a ball to each; infinite if there is none."""
    return dijkstra(graph.lengths, directed=False, indices=source)


def _tree(
    graph: _Graph, root: int, goals: list[int], openings: list[Opening], notes: list[str]
) -> list[tuple[list[int], int]]:
    """Paths of balls from the tree outwards, with the number of the path each leaves."""
    cost, before = dijkstra(graph.costs, directed=False, indices=root, return_predecessors=True)
    far = _from(graph, root)
    lost = [g for g in goals if not np.isfinite(cost[g])]
    if lost:
        where = graph.centres[lost[0]]
        raise ValueError(
            f"the open end at ({where[0]:.6g}, {where[1]:.6g}, {where[2]:.6g}) cannot be reached from the inlet: the "
            "lumen is "
            "closed between them, or narrower than its triangles"
        )
    owner = np.full(len(graph.centres), -1)
    paths: list[tuple[list[int], int]] = []

    def add(tip: int) -> None:
        path = _way_in(before, tip, owner, root)
        parent = int(owner[path[-1]])
        fresh = path if parent < 0 else path[:-1]
        owner[fresh] = len(paths)
        paths.append((path[::-1], parent))

    for goal in sorted(goals, key=lambda g: -far[g]):
        if owner[goal] < 0:
            add(goal)
    left = _Uncovered(graph, np.isfinite(far))
    if not paths:
        whole = _way_in(before, left.farthest(far), owner, root)
        add(whole[_end_of(graph, whole[: max(3, len(whole) // 4)])])
    for path, _ in paths:
        left.cover(path)
    for o in openings:
        left.close_rim(o.centre, o.radius)
    left.close_rim(graph.centres[root], float(graph.radii[root]))
    dropped = 0
    while left.open.any() and len(paths) < _MOST_BRANCHES:
        tip = left.farthest(far)
        path = _way_in(before, tip, owner, root)
        out = path[: int(np.argmin(left.open[path]))] if not left.open[path].all() else path[:-1]
        joint = float(left.by[path[len(out)]])
        stick = far[tip] - far[out[-1]] + (_COVER - 1.0) * joint
        settled = out[_end_of(graph, out)]
        left_over = far[settled] - far[out[-1]] + (_COVER - 1.0) * joint
        pointed = graph.radii[settled] < 0.6 * np.median(graph.radii[out[-max(3, len(out) // 3) :]])
        if stick >= _SPUR * joint and left_over >= 0.7 * _SPUR * joint and not (pointed and stick < 6 * joint):
            add(settled)
            left.cover(paths[-1][0])
            left.close_beyond(settled, tip, far)
        else:
            dropped += int(0.5 * _SPUR * joint < stick)
        left.cover(out)
        left.open[out] = False
    if dropped:
        notes.append(f"{dropped} short or pointed spurs of less than their parent's radius are dropped")
    return _wider_goes_on(graph, [path for path, _ in paths])


def _wider_goes_on(graph: _Graph, paths: list[list[int]]) -> list[tuple[list[int], int]]:
    """The same tree cut into lines anew: where paths part, the wider one goes on, of two alike the straighter.

    paths : from the tree's balls outwards, the first from the root; the others begin with a ball of one before them
    """
    ahead: dict[int, list[int]] = {}
    path_of: dict[tuple[int, int], tuple[int, int]] = {}
    for k, path in enumerate(paths):
        for i, (a, b) in enumerate(pairwise(path)):
            ahead.setdefault(a, []).append(b)
            path_of[a, b] = (k, i)
    lines: list[tuple[list[int], int]] = []
    waiting = [([paths[0][0]], -1)]
    while waiting:
        line, parent = waiting.pop(0)
        while following := ahead.get(line[-1]):
            if len(following) > 1:
                looks = [_just_ahead(graph, paths[k][i:]) for k, i in (path_of[line[-1], b] for b in following)]
                back = _direction(graph, line[::-1], graph.radii[line[-1]])
                widest = max(width for width, _ in looks)
                alike = [n for n, (width, _) in enumerate(looks) if width > 0.85 * widest]
                best = min(alike, key=lambda n: float(looks[n][1] @ back))
                waiting += [([line[-1], b], len(lines)) for n, b in enumerate(following) if n != best]
                line.append(following[best])
            else:
                line.append(following[0])
        lines.append((line, parent))
    return lines


def _just_ahead(graph: _Graph, path: list[int]) -> tuple[float, np.ndarray]:
    """The width of a path behind the junction it begins in, and its direction there."""
    reach = graph.radii[path[0]]
    steps = np.r_[0.0, np.linalg.norm(np.diff(graph.centres[path], axis=0), axis=1).cumsum()]
    behind = (steps > 1.3 * reach) & (steps < 4.0 * reach)
    if not behind.any():
        behind = steps >= 0.6 * steps[-1]
    return float(np.median(graph.radii[path][behind])), _direction(graph, path, 2.0 * reach)


def _direction(graph: _Graph, path: list[int], reach: float) -> np.ndarray:
    """Unit vector from a path's first ball to the one `reach` along it."""
    steps = np.r_[0.0, np.linalg.norm(np.diff(graph.centres[path], axis=0), axis=1).cumsum()]
    way = graph.centres[path[int(np.searchsorted(steps, reach).clip(max=len(path) - 1))]] - graph.centres[path[0]]
    return way / max(float(np.linalg.norm(way)), 1e-300)


class _Uncovered:
    """The balls that belong to no path yet, and the radius of the tree's ball that covers each of the others."""

    def __init__(self, graph: _Graph, reached: np.ndarray) -> None:
        self.graph, self.open, self.by = graph, reached.copy(), np.zeros(len(reached))
        self.tree = KDTree(graph.centres)

    def farthest(self, far: np.ndarray) -> int:
        left = np.flatnonzero(self.open)
        return int(left[far[left].argmax()])

    def close_beyond(self, end: int, tip: int, far: np.ndarray) -> None:
        """Take out the small balls in the point or the corners of an end, out to its tip."""
        centres, radii = self.graph.centres, self.graph.radii
        reach = float(np.linalg.norm(centres[tip] - centres[end])) + 2.0 * radii[end]
        near = np.array(self.tree.query_ball_point(centres[end], reach), dtype=np.int64)
        self.open[near[(radii[near] <= radii[end]) & (far[near] > far[end])]] = False

    def close_rim(self, centre: np.ndarray, radius: float) -> None:
        """Take out the small balls about an end: those in the corner between its flat cap and the wall."""
        near = np.array(self.tree.query_ball_point(centre, 2.0 * radius), dtype=np.int64)
        near = near[self.graph.radii[near] < 0.7 * radius]
        self.open[near] = False
        self.by[near] = np.maximum(self.by[near], radius)

    def cover(self, path: list[int]) -> None:
        """Take the balls about a path's centres out of those still open."""
        centres, radii = self.graph.centres[path], self.graph.radii[path]
        steps = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1) / (0.2 * radii[1:]))]
        some = np.unique(np.searchsorted(steps, np.arange(0.0, steps[-1] + 1.0)).clip(max=len(path) - 1))
        for k in some:
            near = np.array(self.tree.query_ball_point(centres[k], _COVER * radii[k]), dtype=np.int64)
            self.open[near] = False
            self.by[near] = np.maximum(self.by[near], radii[k])


def _way_in(before: np.ndarray, tip: int, owner: np.ndarray, root: int) -> list[int]:
    """The path from a ball back to the tree."""
    path = [tip]
    while path[-1] != root and owner[path[-1]] < 0:
        path.append(int(before[path[-1]]))
    return path


def _end_of(graph: _Graph, path: list[int]) -> int:
    """Number of the ball, on a path from an extremity inwards, where its line should end: before the balls shrink.

    Towards a corner or a point of the wall the balls that fit get small. A ball is too small if it has less than
    `_POINTED` of the radius of one behind it, nearer than three radii of that one, or 0.4 of one nearer than twelve;
    those wider than the branch (its mouth in the parent) do not count.
    """
    radii = graph.radii[path]
    steps = np.r_[0.0, np.linalg.norm(np.diff(graph.centres[path], axis=0), axis=1).cumsum()]
    own = radii <= 1.5 * np.median(np.interp(np.linspace(0.0, steps[-1], 64), steps, radii))
    for i in range(len(path)):
        near = own & (steps > steps[i]) & (steps - steps[i] < 3.0 * radii)
        about = own & (steps > steps[i]) & (steps - steps[i] < 12.0 * radii)
        if radii[i] >= _POINTED * radii[near].max(initial=0.0) and radii[i] >= 0.4 * radii[about].max(initial=0.0):
            return i
    return len(path) - 1


# --- lines ------------------------------------------------------------------------------------------------------------


def _line(surface: Surface, graph: _Graph, path: list[int], parent: int, ends: dict[int, Opening], first: bool) -> Line:
    """A path as a smooth line in the middle of the lumen."""
    points, radii = graph.centres[path], graph.radii[path]
    points, radii = _resampled(points, radii)
    for _ in range(2):
        points = _centred(surface, _smooth(points, radii))
        radii = surface.closest(points)[0]
    points = _smooth(points, radii, 1)
    blind_start, blind_end = first and path[0] not in ends, path[-1] not in ends
    points = _blunt(points, surface.closest(points)[0], blind_start, blind_end)
    head: list[Any] = []
    tail: list[Any] = []
    if first and path[0] in ends:
        points, head = _without_cap(points, radii, ends[path[0]], False)
    if path[-1] in ends:
        points, tail = _without_cap(points, radii, ends[path[-1]], True)
    radii = surface.closest(points)[0]
    if blind_start:  # the wire comes in through the wall
        head = _to_wall(surface, points[::-1], radii[0], 0.0)
    if blind_end:
        tail = _to_wall(surface, points, radii[-1], radii[-1])
    points = np.concatenate([*head, points, *tail])
    radii = np.concatenate([radii[:1] if head else radii[:0], radii, radii[-1:] if tail else radii[:0]])
    return Line(points, radii, parent)


def _to_wall(surface: Surface, points: np.ndarray, radius: float, left: float) -> list[np.ndarray]:
    """The point straight on from a line's last one, `left` before the wall, (1, 3); none if it is hardly farther."""
    back = points[max(0, len(points) - 5)]
    ahead = (points[-1] - back) / max(float(np.linalg.norm(points[-1] - back)), 1e-300)
    way, end = 0.0, points[-1]
    for _ in range(20):  # each step goes as far as no wall can stand
        gap = float(surface.distance(end[None])[0][0])
        if gap < 0.01 * radius or way > 2.0 * radius:
            break
        way += gap
        end = points[-1] + way * ahead
    return [(points[-1] + (way - left) * ahead)[None]] if way - left > 0.05 * radius else []


def _blunt(points: np.ndarray, radii: np.ndarray, at_start: bool, at_end: bool) -> np.ndarray:
    """Without the last points in a blind end, where the balls shrink."""

    def kept(radii: np.ndarray, steps: np.ndarray) -> int:
        """How many points at the end to drop."""
        for i in range(len(radii) - 3):
            behind = np.interp(steps[i] + radii[i], steps, radii)
            if radii[i] >= 0.93 * behind:
                return i
        return 0

    steps = np.r_[0.0, np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()]
    head = kept(radii, steps) if at_start else 0
    tail = kept(radii[::-1], steps[-1] - steps[::-1]) if at_end else 0
    return points[head : len(points) - tail] if head + tail < len(points) - 2 else points


def _without_cap(
    points: np.ndarray, radii: np.ndarray, end: Opening, last: bool
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Without the points whose ball a flat cap cuts; the line goes on to the cap's middle."""
    depth = (end.centre - points) @ end.out
    near = np.linalg.norm(points - end.centre, axis=1) < 3 * end.radius
    keep = ~(near & (depth < 1.02 * end.radius))
    if keep.sum() < 2:
        keep[:] = True
        keep[-1 if last else 0] = len(points) <= 2
    return points[keep], [end.centre[None]]


def _resampled(points: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points about 0.4 radii apart along the line."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.r_[True, step > 0]
    points, radii = points[keep], radii[keep]
    if len(points) < 2:
        return points, radii
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    local = np.maximum((radii[1:] + radii[:-1]) / 2, 0.05 * radii.max())
    along = np.r_[0.0, np.cumsum(step / (0.4 * local))]
    at = np.linspace(0.0, along[-1], max(3, int(np.ceil(along[-1])) + 1))
    return np.stack([np.interp(at, along, p) for p in points.T], axis=1), np.interp(at, along, radii)


def _smooth(points: np.ndarray, radii: np.ndarray, rounds: int = 2) -> np.ndarray:
    """Each inner point moved towards the middle of its neighbours, the ends kept."""
    points = points.copy()
    for _ in range(rounds):
        if len(points) > 2:
            points[1:-1] += 0.5 * ((points[:-2] + points[2:]) / 2 - points[1:-1])
    return points


def _centred(surface: Surface, points: np.ndarray) -> np.ndarray:
    """Each point moved across the line to where the largest ball fits, within half a radius: pattern search."""
    if len(points) < 3:
        return points
    t = np.gradient(points, axis=0)
    t /= np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-300)
    some = np.eye(3)[np.abs(t).argmin(axis=1)]
    n1 = np.cross(t, some)
    n1 /= np.linalg.norm(n1, axis=1, keepdims=True)
    n2 = np.cross(t, n1)
    turn = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ways = np.cos(turn)[:, None, None] * n1 + np.sin(turn)[:, None, None] * n2
    best = surface.closest(points)[0]
    limit, start, step = 0.5 * best, points, 0.2 * best
    row = np.arange(len(points))
    for _ in range(7):
        tries = points + step[None, :, None] * ways
        gap = surface.closest(tries.reshape(-1, 3))[0].reshape(len(turn), -1)
        gap[np.linalg.norm(tries - start, axis=2) > limit] = -1.0
        way = gap.argmax(axis=0)
        better = gap[way, row] > best
        points = np.where(better[:, None], tries[way, row], points)
        best = np.where(better, gap[way, row], best)
        step = np.where(better, step, step / 2)
    return points
