"""From a path of balls to a smooth line in the middle of a surface, which ends where its lumen does."""

from __future__ import annotations

from typing import Any

import numpy as np

from .junctions import Line
from .medial import Balls
from .mending import Opening
from .surface import Surface

__all__ = ["line_of"]


def line_of(
    surface: Surface, graph: Balls, path: list[int], parent: int, ends: dict[int, Opening], first: bool
) -> Line:
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
        for share, most in ((0.97, 1.5), (0.93, np.inf)):
            for i in range(len(radii) - 3):
                behind, farther = np.interp(steps[i] + radii[i] * np.array([1.0, 2.0]), steps, radii)
                if steps[i] > most * behind:
                    break
                if radii[i] >= share * min(behind, 2.0 * behind - farther):  # a tube that tapers goes on as it does
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
