"""How the lines of a surface meet: each branch is led to its parent's axis, and the parent's axis past the mouth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from .surface import Surface

__all__ = ["Line", "joined"]

_PROBE = 0.8
"""The wall is looked for this share of the radius away from the axis."""

_FIT = (0.4, 1.8)
"""A branch's direction is fitted between these lengths behind its mouth, in its radii."""


_FLARE = 1.5
"""A branch's mouth is at most this many times as wide as the branch behind it."""


_SHARP = 0.8
"""rad: a course does not turn by more from one of its points to the next."""


@dataclass
class Line:
    """A centreline: its points (n, 3) and radii (n,), from its parent's line outwards.

    parent : number of the line it leaves; −1 for the first, which begins at the inlet
    """

    points: np.ndarray
    radii: np.ndarray
    parent: int


def joined(surface: Surface, lines: list[Line]) -> list[Line]:
    """Each branch led straight to its parent's axis from where it leaves the parent's balls.

    In a mouth the balls that fit in are drawn towards it. So the parent's axis is first moved, there, to one radius
    from the wall that faces the mouth: that wall is whole. Lines stand after their parents, and stay so.
    """
    beyond = [_beyond(lines[line.parent], line) if line.parent >= 0 else None for line in lines]
    made: list[Line] = []
    for k, line in enumerate(lines):
        made.append(_past_mouths(surface, line, [b for b in beyond if b is not None and b.parent == k]))
    for k, line in enumerate(made):
        if line.parent >= 0:
            made[k] = _led(surface, made[line.parent], line)
    return [_straightened(line) for line in made]


def _straightened(line: Line) -> Line:
    """The line without inner points at which its course turns back."""
    points, radii = line.points, line.radii
    while len(points) > 2:
        step = np.diff(points, axis=0)
        step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-300)
        turn = np.arccos(np.clip((step[1:] * step[:-1]).sum(axis=1), -1, 1))
        if turn.max() < 1.5 * _SHARP:
            break
        points, radii = np.delete(points, turn.argmax() + 1, axis=0), np.delete(radii, turn.argmax() + 1)
    return Line(points, radii, line.parent)


def _beyond(parent: Line, line: Line) -> Line:
    """A branch from where it lies outside its parent's balls."""
    first = _mouth(parent, line)
    return Line(line.points[first:], line.radii[first:], line.parent)


def _mouth(parent: Line, line: Line) -> int:
    """The number of a branch's first point outside its parent's balls; one point at least is left behind it."""
    gap, at = KDTree(parent.points).query(line.points)
    out = gap > 0.95 * parent.radii[at]
    first = int(out.argmax()) if out.any() else max(len(line.points) - 2, 1)
    return min(first, len(line.points) - 2)


def _past_mouths(surface: Surface, line: Line, mouths: list[Line]) -> Line:
    """The line moved away from its mouths: to one radius from the wall opposite.

    Its radius there is half its width across the plane of both branches, within those before and behind the mouth.
    """
    if not mouths or len(line.points) < 4:
        return line
    points, radii = _finer(line, mouths)
    toward, near = _mouths_within(points, radii, mouths)
    size = np.linalg.norm(toward, axis=1)
    inner = (near > 0) & (size > 0.5 * near)  # mouths on both sides leave no whole wall
    inner[[0, -1]] = False
    if not inner.any() or inner[1:-1].all():
        return line
    toward = toward[inner] / size[inner, None]
    low, high = _on_both_sides(radii, inner)
    own = (low + high) / 2
    for _ in range(4):
        p, t = points[inner], _tangents(points)[inner]
        away = -toward + (toward * t).sum(axis=1, keepdims=True) * t
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        side = np.cross(t, away)
        width = (_as_far(surface, p, side, own) + _as_far(surface, p, -side, own)) / 2
        own = np.clip(width, low, high)
        move = np.clip(_as_far(surface, p, away, own) - own, -0.3 * own, 0.3 * own)
        points[inner] = p + move[:, None] * away
    points = _without_kinks(_finer(line, mouths)[0], points, inner)
    radii[inner] = surface.closest(points[inner])[0]
    return Line(points, radii, line.parent)


def _without_kinks(before: np.ndarray, points: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """The moved points; a stretch whose course now turns sharply is moved more evenly, or not at all."""
    numbers = np.flatnonzero(inner)
    points = points.copy()
    for piece in np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1):
        around = slice(max(piece[0] - 2, 0), piece[-1] + 3)
        move = points[piece] - before[piece]
        for _ in range(4):
            if _sharpest_turn(points[around]) < _SHARP:
                break
            wider = np.vstack([np.zeros(3), move, np.zeros(3)])
            move = (wider[:-2] + 2 * wider[1:-1] + wider[2:]) / 4
            points[piece] = before[piece] + move
        else:
            points[piece] = before[piece]
    return points


def _sharpest_turn(points: np.ndarray) -> float:
    """The largest turn from one step to the next, rad."""
    step = np.diff(points, axis=0)
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-300)
    return float(np.arccos(np.clip((step[1:] * step[:-1]).sum(axis=1), -1, 1)).max(initial=0.0))


def _as_far(surface: Surface, points: np.ndarray, way: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """How far the wall is from each point in a direction across the line, about a radius away."""
    reach = _PROBE * radius
    return reach + surface.distance(points + reach[:, None] * way)[0]


def _mouths_within(points: np.ndarray, radii: np.ndarray, mouths: list[Line]) -> tuple[np.ndarray, np.ndarray]:
    """The sum of the unit vectors from each point, across the line, towards the mouths in reach; and their number."""
    toward, near, t = np.zeros_like(points), np.zeros(len(points), dtype=int), _tangents(points)
    for mouth in mouths:
        gap, at = KDTree(mouth.points).query(points)
        reach = gap < radii + 0.9 * mouth.radii[at]  # its ball and one of the branch overlap
        way = mouth.points[at] - points
        way -= (way * t).sum(axis=1, keepdims=True) * t
        size = np.linalg.norm(way, axis=1)
        reach &= size > 0.3 * radii
        toward[reach] += way[reach] / size[reach, None]
        near[reach] += 1
    return toward, near


def _on_both_sides(radii: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smaller and the larger of the line's radii before and behind each stretch of `inner`, for its points."""
    numbers = np.flatnonzero(inner)
    low, high = [], []
    for piece in np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1):
        ends = radii[piece[0] - 1], radii[piece[-1] + 1]
        low.append(np.full(len(piece), min(ends)))
        high.append(np.full(len(piece), max(ends)))
    return np.concatenate(low), np.concatenate(high)


def _finer(line: Line, mouths: list[Line]) -> tuple[np.ndarray, np.ndarray]:
    """The line's points and radii, with one more between any two before a mouth: it may turn there."""
    near = np.zeros(len(line.points), dtype=bool)
    for mouth in mouths:
        gap, at = KDTree(mouth.points).query(line.points)
        near |= gap < line.radii + 0.9 * mouth.radii[at]
    numbers = np.arange(len(line.points))
    wanted = np.sort(np.concatenate([numbers, 0.5 + numbers[:-1][near[1:] & near[:-1]]]))
    points = np.stack([np.interp(wanted, numbers, p) for p in line.points.T], axis=1)
    return points, np.interp(wanted, numbers, line.radii)


def _course(parent: Line, line: Line) -> tuple[int, np.ndarray]:
    """The number of a branch's point just behind its mouth, and its direction there, (3,)."""
    first = _mouth(parent, line)
    arc = np.concatenate([[0.0], np.linalg.norm(np.diff(line.points[first:], axis=0), axis=1).cumsum()])
    own = float(np.median(line.radii[first:][arc < 4 * line.radii[first]]))
    begin = min(first + int(np.searchsorted(arc, _FIT[0] * own)), len(line.points) - 2)
    end = min(len(line.points), max(first + int(np.searchsorted(arc, _FIT[1] * own)), begin + 2))
    piece = line.points[begin:end]
    ahead = np.linalg.svd(piece - piece.mean(axis=0))[2][0]
    return begin, ahead if ahead @ (piece[-1] - piece[0]) > 0 else -ahead


def _led(surface: Surface, parent: Line, line: Line) -> Line:
    """A branch with a straight first piece from its parent's axis, in the direction it has just behind its mouth.

    Its radius there is that of the balls that fit in, and at most `_FLARE` of that behind the mouth.
    """
    begin, ahead = _course(parent, line)
    start, radius = _meeting(parent, line.points[begin], ahead)
    way = line.points[begin] - start
    count = max(2, round(float(np.linalg.norm(way)) / (0.4 * line.radii[begin])))
    lead = start + np.arange(count)[:, None] / count * way
    wide = surface.closest(lead)[0]
    wide[0] = min(wide[0], radius)
    wide = np.minimum(wide, _FLARE * line.radii[begin])
    return Line(np.concatenate([lead, line.points[begin:]]), np.concatenate([wide, line.radii[begin:]]), line.parent)


def _meeting(parent: Line, point: np.ndarray, ahead: np.ndarray) -> tuple[np.ndarray, float]:
    """The place of the parent's axis that the branch, drawn on backwards, passes most nearly; the radius there."""
    a, b = parent.points[:-1], parent.points[1:]
    share = np.linspace(0.0, 1.0, 9)[:-1, None, None]
    fine = np.concatenate([((1 - share) * a + share * b).transpose(1, 0, 2).reshape(-1, 3), parent.points[-1:]])
    radii = np.interp(np.arange(len(fine)) / 8, np.arange(len(parent.points)), parent.radii)
    apart = np.linalg.norm(fine - point, axis=1)
    close = np.flatnonzero(apart < 3.0 * radii + apart.min())
    back = fine[close] - point
    along = np.minimum((back * ahead).sum(axis=1), 0.0)
    miss = np.linalg.norm(back - along[:, None] * ahead, axis=1) + 0.05 * np.linalg.norm(back, axis=1)
    number = int(close[miss.argmin()])
    return fine[number], float(radii[number])


def _tangents(points: np.ndarray) -> np.ndarray:
    t = np.gradient(points, axis=0)
    return t / np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-300)
