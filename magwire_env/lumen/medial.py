"""The balls that fit into a closed surface: the centres of the tetrahedra of points spread over it.

As in Antiga et al. 2003 (the way of VMTK): the centres of the Delaunay tetrahedra of points on the surface approximate
the medial axis. Two balls that fit and overlap have no wall between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.spatial import Delaunay, KDTree

from .surface import Surface

__all__ = ["Balls", "balls_in", "samples_of"]

_SPACING = 0.45
"""Distance between the surface's sample points, in radii of the ball that touches there."""

_COARSE = 6_000
"""Points by area, and as many by face, at which the lumen's width is looked at first."""

_MOST_SAMPLES = 50_000


@dataclass
class Balls:
    """The balls that fit in: centres (n, 3), radii (n,), and which of them overlap, (n, n) by length and cost."""

    centres: np.ndarray
    radii: np.ndarray
    lengths: csr_matrix
    costs: csr_matrix


def balls_in(surface: Surface, points: np.ndarray) -> Balls:
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
    return Balls(where, gaps, lengths, costs)


def samples_of(surface: Surface) -> np.ndarray:
    """Points on the surface, dense where it is narrow, (n, 3)."""
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
    return _even(_within(surface, faces, rng), np.repeat(spacing, count))


def _within(surface: Surface, faces: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random point on each of the faces."""
    u, v = rng.random(len(faces)), rng.random(len(faces))
    over = u + v > 1
    u[over], v[over] = 1 - u[over], 1 - v[over]
    a, b, c = (surface.vertices[surface.faces[faces, i]] for i in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a)


def _even(points: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Without those that crowd a point before them, nearer than half the spacing."""
    pairs = KDTree(points).query_pairs(float(np.quantile(spacing, 0.9)) * 0.5, output_type="ndarray")
    close = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) < 0.4 * spacing[pairs].min(axis=1)
    drop = np.zeros(len(points), dtype=bool)
    drop[pairs[close].max(axis=1)] = True
    return points[~drop]


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
