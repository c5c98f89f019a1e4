"""Compiled: triangles of a surface that cut each other."""

from __future__ import annotations

import numpy as np

from ..compiled import precise

__all__ = ["crossing_faces"]

_MOST = 64
"""Pairs reported; more say no more."""


def crossing_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Pairs of faces that share no vertex and cut each other, (k, 2), up to a few dozen: (n, 3), (m, 3) → (k, 2)."""
    corners = np.ascontiguousarray(vertices[faces])
    low, high = corners.min(axis=1), corners.max(axis=1)
    sides = high - low
    cell = max(float(np.median(sides.max(axis=1))) * 2.0, float(np.ptp(vertices, axis=0).max()) / 500, 1e-300)
    origin = vertices.min(axis=0)
    first = np.floor((low - origin) / cell).astype(np.int64)
    last = np.floor((high - origin) / cell).astype(np.int64)
    shape = last.max(axis=0) + 1
    counts = np.prod(last - first + 1, axis=1)
    if counts.sum() > 40 * len(faces) + 1_000_000:  # a few huge faces among many small ones: larger cells
        cell = max(float(np.quantile(sides.max(axis=1), 0.99)), cell)
        first = np.floor((low - origin) / cell).astype(np.int64)
        last = np.floor((high - origin) / cell).astype(np.int64)
        shape = last.max(axis=0) + 1
        counts = np.prod(last - first + 1, axis=1)
    keys, owners = _listed(first, last, shape, int(counts.sum()))
    order = np.argsort(keys, kind="stable")
    found = np.zeros((_MOST, 2), dtype=np.int64)
    number = _pairs(keys[order], owners[order], first, shape, corners, low, high, np.ascontiguousarray(faces), found)
    return found[:number]


@precise
def _listed(first, last, shape, total):
    keys, owners = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
    k = 0
    for f in range(len(first)):
        for i in range(first[f, 0], last[f, 0] + 1):
            for j in range(first[f, 1], last[f, 1] + 1):
                for l in range(first[f, 2], last[f, 2] + 1):
                    keys[k] = (i * shape[1] + j) * shape[2] + l
                    owners[k] = f
                    k += 1
    return keys, owners


@precise
def _pairs(keys, owners, first, shape, corners, low, high, faces, found):
    number, start = 0, 0
    while start < len(keys) and number < len(found):
        end = start
        while end < len(keys) and keys[end] == keys[start]:
            end += 1
        for p in range(start, end):
            f = owners[p]
            for q in range(p + 1, end):
                g = owners[q]
                apart = False
                for a in range(3):
                    if low[f, a] > high[g, a] or low[g, a] > high[f, a]:
                        apart = True
                if apart:
                    continue
                shared = False
                for a in range(3):
                    for b in range(3):
                        if faces[f, a] == faces[g, b]:
                            shared = True
                if shared:
                    continue
                cell = (max(first[f, 0], first[g, 0]) * shape[1] + max(first[f, 1], first[g, 1])) * shape[2]
                if cell + max(first[f, 2], first[g, 2]) != keys[start]:  # the pair is met in several cells: count one
                    continue
                crosses = _cut(corners[f], corners[g]) or _cut(corners[g], corners[f])
                if crosses and number < len(found):
                    found[number, 0], found[number, 1] = f, g
                    number += 1
        start = end
    return number


@precise
def _cut(t, s):
    """Whether an edge of triangle t passes through triangle s."""
    one = _pierces(t[0], t[1], s[0], s[1], s[2])
    return one or _pierces(t[1], t[2], s[0], s[1], s[2]) or _pierces(t[2], t[0], s[0], s[1], s[2])


@precise
def _pierces(p, q, a, b, c):
    """Whether the segment p–q passes through the triangle, by the signs of volumes; touching does not count."""
    over, under = _volume(p, a, b, c), _volume(q, a, b, c)
    if over * under >= 0.0:
        return False
    one, two, three = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
    return (one > 0.0 and two > 0.0 and three > 0.0) or (one < 0.0 and two < 0.0 and three < 0.0)


@precise
def _volume(a, b, c, d):
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)
