"""Meshes and lines for the browser page: tubes, magnets, field lines. Pure NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..physics.magnets import Magnet
from .snapshot import body_halves

__all__ = ["field_lines", "prism", "quaternion", "rotation_to", "seeds", "tube", "within"]


def tube(points: np.ndarray, radius: np.ndarray | float, sides: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """A tube along `points` (n, 3) m, open at both ends: vertices (n·sides, 3) m and faces (m, 3).

    The rings' frames are carried along without twist. Points that coincide, as those of a wire that is not drawn as far
    as it reaches behind the inlet, have the direction of the next ones that do not.
    """
    points = np.asarray(points, dtype=np.float64)
    ways = np.gradient(points, axis=0)
    size = np.linalg.norm(ways, axis=1)
    known = np.flatnonzero(size > 0.0)
    following = known[np.minimum(np.searchsorted(known, np.arange(len(points))), len(known) - 1)]
    ways = ways[following] / size[following, None]
    first = np.eye(3)[np.abs(ways[0]).argmin()]
    normals = np.empty_like(points)
    for i, way in enumerate(ways):
        first = first - way * (way @ first)
        first = first / np.linalg.norm(first)
        normals[i] = first
    binormals = np.cross(ways, normals)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.cos(angle)[:, None] * normals[:, None] + np.sin(angle)[:, None] * binormals[:, None]
    across = np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(points),))
    vertices = points[:, None] + across[:, None, None] * ring
    return vertices.reshape(-1, 3), tube_faces(len(points), sides)


def tube_faces(rings: int, sides: int) -> np.ndarray:
    """Faces between `rings` of `sides` vertices each, outwards, (2·(rings − 1)·sides, 3)."""
    i, k = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + k, i * sides + (k + 1) % sides
    lower = np.stack([a, b, a + sides], axis=-1)
    upper = np.stack([b, b + sides, a + sides], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]).astype(np.uint32)


def prism(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The solid between two rims, the first and the second half of `corners` (2·k, 3): vertices and faces, outwards."""
    k = len(corners) // 2
    faces = [(0, i + 1, i) for i in range(1, k - 1)]
    faces += [(k, k + i, k + i + 1) for i in range(1, k - 1)]
    for i in range(k):
        j = (i + 1) % k
        faces += [(i, j, k + i), (j, k + j, k + i)]
    out = np.array(faces, dtype=np.uint32)
    if corners[k:, 2].mean() < corners[:k, 2].mean():  # the second rim below the first: turn every face round
        out = out[:, ::-1]
    return np.asarray(corners, dtype=np.float64), np.ascontiguousarray(out)


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """A rotation matrix (3, 3) as (w, x, y, z)."""
    m = np.asarray(rotation)
    # The largest of the four components is found first, so that nothing is divided by a small number.
    squares = np.array(
        [
            1 + m[0, 0] + m[1, 1] + m[2, 2],
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    k = int(squares.argmax())
    products = np.array(
        [
            [squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], squares[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], squares[2], m[2, 1] + m[1, 2]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[3]],
        ]
    )
    w, x, y, z = (products[k] / (2 * np.sqrt(squares[k]))).tolist()
    return (w, x, y, z)


def rotation_to(direction: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) that brings z to `direction`, a unit vector."""
    helper = np.eye(3)[np.abs(direction).argmin()]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])


def seeds(magnet: Magnet, rings: tuple[float, ...] = (0.25, 0.55, 0.85), spokes: int = 10) -> np.ndarray:
    """Starting points of field lines just outside a magnet's north face, in its own frame, (rings·spokes, 3) m."""
    north, _ = body_halves(magnet)
    half, edge = north[:, 2].max(), np.abs(north[:, :2]).max()
    angle = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
    return np.array([(r * edge * np.cos(a), r * edge * np.sin(a), 1.02 * half) for r in rings for a in angle])


def field_lines(
    flux: Callable[[np.ndarray], np.ndarray],
    inside: Callable[[np.ndarray], np.ndarray],
    starts: np.ndarray,
    step: float,
    extent: float,
    steps: int = 90,
) -> tuple[np.ndarray, np.ndarray]:
    """Lines of the flux density from `starts` (n, 3) m on, in steps of `step` m, up to `extent` m from their middle.

    flux : points (n, 3) m → (n, 3) T
    inside : points (n, 3) m → (n,), whether they lie in a magnet, where a line ends

    Returns segments (k, 2, 3) m and the flux density at their starts (k,) T.
    """
    middle = starts.mean(axis=0)
    here, alive = starts.copy(), np.ones(len(starts), dtype=np.bool_)
    segments, strengths = [], []
    for _ in range(steps):
        points = here[alive]
        if not len(points):
            break
        first, size = _unit(flux(points))
        there = points + step * _unit(flux(points + step / 2 * first))[0]
        segments.append(np.stack([points, there], axis=1))
        strengths.append(size)
        here[alive] = there
        alive &= (np.linalg.norm(here - middle, axis=1) < extent) & ~inside(here)
    return np.concatenate(segments), np.concatenate(strengths)


def within(corners: np.ndarray, rotation: np.ndarray, centre: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether `points` (n, 3) m lie in the box about a body with `corners` (k, 3) m, turned and moved."""
    return (np.abs((points - centre) @ rotation) < np.abs(corners).max(axis=0)).all(axis=1)


def _unit(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = np.linalg.norm(vectors, axis=1)
    return vectors / size[:, None], size
