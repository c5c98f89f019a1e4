"""From a closed surface to its tree of centrelines: minimal paths through the balls that fit into it.

As in Antiga et al. 2003 (the way of VMTK): the centres of the Delaunay tetrahedra of points on the surface approximate
the medial axis; a path that is cheap where the balls are large runs along the middle. Ends are the openings, and those
extremities that stick out of the tree's balls by more than a radius.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from .junctions import Line, joined
from .medial import Balls, balls_in, samples_of
from .mending import Opening
from .middle import line_of
from .surface import Surface

__all__ = ["Line", "centrelines"]

_SPUR = 1.0
"""A branch that sticks out of its parent's ball by less than this many of its radii is a spur."""

_COVER = 1.25
"""A ball whose centre lies within this many radii of a centre of the tree belongs to it."""

_POINTED = 0.65
"""A branch ends where its radius falls below this share of what it was just before."""

_LEVEL = 4.0
"""A tube is level for so many of its radii at least: it widens by less than half there."""

_MOST_BRANCHES = 400

Progress = Callable[[float, str], None]


def centrelines(
    surface: Surface, openings: list[Opening], inlet: np.ndarray | None, notes: list[str], progress: Progress
) -> list[Line]:
    """The tree's lines, each after its parent, in the surface's own unit; the first begins at the inlet.

    inlet : a point at the end where the wire comes in; default the widest opening, or the widest extremity
    Raises `ValueError` if the inlet is nowhere near the surface, or if an opening cannot be reached from it.
    """
    progress(0.1, "samples")
    points = samples_of(surface)
    progress(0.2, "balls that fit")
    graph = balls_in(surface, points)
    progress(0.6, "paths")
    goals = [_beneath(graph, o) for o in openings]
    root, at = _root(surface, graph, openings, goals, inlet, notes)
    found = _tree(graph, root, [g for i, g in enumerate(goals) if i != at], openings, notes)
    progress(0.8, "centring")
    ends = {g: openings[i] for i, g in enumerate(goals)}
    lines = [line_of(surface, graph, path, parent, ends, k == 0) for k, (path, parent) in enumerate(found)]
    return joined(surface, lines)


def _beneath(graph: Balls, opening: Opening) -> int:
    """The ball beneath an opening: a large one near its middle."""
    gap = np.linalg.norm(graph.centres - opening.centre, axis=1)
    near = np.flatnonzero(gap < 2.0 * opening.radius)
    if not near.size:
        return int(gap.argmin())
    return int(near[(graph.radii[near] - 0.5 * gap[near]).argmax()])


def _root(
    surface: Surface,
    graph: Balls,
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


def _tip(graph: Balls, ball: int, inlet: np.ndarray) -> int:
    """A large ball about an inlet's point."""
    near = np.flatnonzero(np.linalg.norm(graph.centres - graph.centres[ball], axis=1) < 1.5 * graph.radii[ball])
    gap = np.linalg.norm(graph.centres[near] - inlet, axis=1)
    return int(near[(graph.radii[near] - 0.7 * gap).argmax()])


def _from(graph: Balls, source: int) -> np.ndarray:
    """Length of the shortest way from a ball to each; infinite if there is none."""
    return dijkstra(graph.lengths, directed=False, indices=source)


def _tree(
    graph: Balls, root: int, goals: list[int], openings: list[Opening], notes: list[str]
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
        end = _end_of(graph, out)
        settled = out[end]
        left_over = far[settled] - far[out[-1]] + (_COVER - 1.0) * joint
        pointed = _pointed(graph, out[end:])
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


def _pointed(graph: Balls, path: list[int]) -> bool:
    """A path from its end inwards narrows towards the end all the way, as in a corner of the wall: it is no tube."""
    radii = graph.radii[path]
    if radii[0] >= 0.6 * np.median(radii[-max(3, len(radii) // 3) :]):
        return False
    steps = np.r_[0.0, np.linalg.norm(np.diff(graph.centres[path], axis=0), axis=1).cumsum()]
    return float(steps[int((radii > 1.5 * radii[0]).argmax())]) < _LEVEL * float(radii[0])


def _wider_goes_on(graph: Balls, paths: list[list[int]]) -> list[tuple[list[int], int]]:
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


def _just_ahead(graph: Balls, path: list[int]) -> tuple[float, np.ndarray]:
    """The width of a path behind the junction it begins in, and its direction there."""
    reach = graph.radii[path[0]]
    steps = np.r_[0.0, np.linalg.norm(np.diff(graph.centres[path], axis=0), axis=1).cumsum()]
    behind = (steps > 1.3 * reach) & (steps < 4.0 * reach)
    if not behind.any():
        behind = steps >= 0.6 * steps[-1]
    return float(np.median(graph.radii[path][behind])), _direction(graph, path, 2.0 * reach)


def _direction(graph: Balls, path: list[int], reach: float) -> np.ndarray:
    """Unit vector from a path's first ball to the one `reach` along it."""
    steps = np.r_[0.0, np.linalg.norm(np.diff(graph.centres[path], axis=0), axis=1).cumsum()]
    way = graph.centres[path[int(np.searchsorted(steps, reach).clip(max=len(path) - 1))]] - graph.centres[path[0]]
    return way / max(float(np.linalg.norm(way)), 1e-300)


class _Uncovered:
    """The balls that belong to no path yet, and the radius of the tree's ball that covers each of the others."""

    def __init__(self, graph: Balls, reached: np.ndarray) -> None:
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


def _end_of(graph: Balls, path: list[int]) -> int:
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
