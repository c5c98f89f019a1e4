"""Compiled: which tube of a tree a point lies in, how deep, and beside which point of its centreline."""

from __future__ import annotations

import numpy as np

from ..compiled import precise

__all__ = ["CHUNK", "KEPT", "deepest"]

CHUNK = 8
"""Rows of a branch's table that share one bounding ball."""

KEPT = 6
"""Branches kept for each point, the deepest first."""


@precise
def _depth(x, y, z, curve, radius, row, u):
    """Depth in the ball about the centreline point (`row`, `u`): r − ρ, and its derivative along the centreline."""
    c = curve[row]
    px = c[0] + u * (c[3] + u * (c[6] + u * c[9])) - x
    py = c[1] + u * (c[4] + u * (c[7] + u * c[10])) - y
    pz = c[2] + u * (c[5] + u * (c[8] + u * c[11])) - z
    tx = c[3] + u * (2.0 * c[6] + 3.0 * u * c[9])
    ty = c[4] + u * (2.0 * c[7] + 3.0 * u * c[10])
    tz = c[5] + u * (2.0 * c[8] + 3.0 * u * c[11])
    r = radius[row]
    rho = np.sqrt(px * px + py * py + pz * pz)
    depth = r[0] + u * (r[1] + u * (r[2] + u * r[3])) - rho
    slope = r[1] + u * (2.0 * r[2] + 3.0 * u * r[3])
    return depth, slope - (px * tx + py * ty + pz * tz) / max(rho, 1e-15)


@precise
def _at(x, y, z, s, curve, radius, first, rows, spacing):
    row = min(max(int(np.floor(s / spacing)), 0), rows - 1)
    return _depth(x, y, z, curve, radius, first + row, s - row * spacing)


@precise
def _refined(x, y, z, s, curve, radius, first, rows, spacing):
    """The largest depth near `s`, by the Illinois form of false position on the derivative, and its arc length."""
    best, best_s = _at(x, y, z, s, curve, radius, first, rows, spacing)[0], s
    a, b = max(s - 0.5 * spacing, 0.0), min(s + 0.5 * spacing, rows * spacing)
    fa = _at(x, y, z, a, curve, radius, first, rows, spacing)[1]
    fb = _at(x, y, z, b, curve, radius, first, rows, spacing)[1]
    if not (fa > 0.0 and fb < 0.0):  # the end of a branch, or a kink of the radius
        for end in (a, b):
            depth = _at(x, y, z, end, curve, radius, first, rows, spacing)[0]
            if depth > best:
                best, best_s = depth, end
        return best, best_s
    for i in range(40):
        m = (a * fb - b * fa) / (fb - fa) if i % 8 != 7 else 0.5 * (a + b)
        depth, fm = _at(x, y, z, m, curve, radius, first, rows, spacing)
        if depth > best:
            best, best_s = depth, m
        if abs(fm) < 1e-9 or b - a < 1e-10:
            break
        if fm > 0.0:
            a, fa = m, fm
            fb *= 0.5
        else:
            b, fb = m, fm
            fa *= 0.5
    return best, best_s


@precise
def _behind(x, y, z, curve, radius, row):
    """Depth in the straight extension before the inlet, and the arc length there (below 0); −∞ if it lies ahead."""
    c = curve[row]
    size = np.sqrt(c[3] * c[3] + c[4] * c[4] + c[5] * c[5])
    px, py, pz = x - c[0], y - c[1], z - c[2]
    along = (px * c[3] + py * c[4] + pz * c[5]) / size
    if along >= 0.0:
        return -np.inf, 0.0
    across = np.sqrt(max(px * px + py * py + pz * pz - along * along, 0.0))
    return radius[row, 0] - across, along


@precise
def _bound(x, y, z, ball):
    """The largest depth that the balls of a chunk allow."""
    return ball[4] - np.sqrt((x - ball[0]) ** 2 + (y - ball[1]) ** 2 + (z - ball[2]) ** 2) + ball[3]


@precise
def _scan(x, y, z, curve, radius, row, count, spacing, best, best_s, s0):
    """The deepest of the knots and midpoints of `count` rows."""
    for k in range(count):
        for half in range(2):
            depth = _depth(x, y, z, curve, radius, row + k, 0.5 * half * spacing)[0]
            if depth > best:
                best, best_s = depth, s0 + (k + 0.5 * half) * spacing
    depth = _depth(x, y, z, curve, radius, row + count - 1, spacing)[0]
    if depth > best:
        best, best_s = depth, s0 + count * spacing
    return best, best_s


@precise
def deepest(points, curve, radius, branches, spacings, balls, chunks, depth, branch, arc):
    """For each point the tubes about it, the deepest first: fills depth, branch and arc, (n, `KEPT`).

    points : (n, 3) m
    curve, radius : (rows, 12) and (rows, 4), the branches' tables end to end
    branches : (b, 6) first row, rows, first chunk, chunks, whether the tube goes on straight before its start, whether
        it is a ring
    spacings : (b,) m, arc length of a row
    balls : (c, 5) m, about each chunk: centre, how far its centreline reaches from it, its largest radius
    chunks : (c, 2) first row, rows

    A tube is kept if it is the deepest (depth may be negative: outside), or near enough to hide the deepest's wall:
    its depth exceeds minus the deepest's. Empty places have branch −1 and depth −∞.
    """
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        top = -np.inf
        for b in range(len(branches)):
            if branches[b, 4]:
                top = max(top, _behind(x, y, z, curve, radius, branches[b, 0])[0])
            for c in range(branches[b, 2], branches[b, 2] + branches[b, 3]):
                if _bound(x, y, z, balls[c]) > top:
                    top = _scan(x, y, z, curve, radius, chunks[c, 0], chunks[c, 1], spacings[b], top, 0.0, 0.0)[0]
        for k in range(KEPT):
            depth[i, k], branch[i, k], arc[i, k] = -np.inf, -1, 0.0
        for b in range(len(branches)):
            least = -abs(top) - spacings[b]  # a knot may miss the deepest point by half a row
            best, at = -np.inf, 0.0
            for c in range(branches[b, 2], branches[b, 2] + branches[b, 3]):
                if _bound(x, y, z, balls[c]) > max(best, least):
                    s0 = (chunks[c, 0] - branches[b, 0]) * spacings[b]
                    best, at = _scan(x, y, z, curve, radius, chunks[c, 0], chunks[c, 1], spacings[b], best, at, s0)
            if best > -np.inf:
                best, at = _refined(x, y, z, at, curve, radius, branches[b, 0], branches[b, 1], spacings[b])
            if branches[b, 5] and (at <= 0.0 or at >= branches[b, 1] * spacings[b]):  # a ring: look across its seam
                seam = branches[b, 1] * spacings[b] - at
                depth_there, s = _refined(x, y, z, seam, curve, radius, branches[b, 0], branches[b, 1], spacings[b])
                if depth_there > best:
                    best, at = depth_there, s
            if branches[b, 4]:
                behind, s = _behind(x, y, z, curve, radius, branches[b, 0])
                if behind > best:
                    best, at = behind, s
            if best == -np.inf:
                continue
            k = KEPT - 1
            if best <= depth[i, k]:
                continue
            while k > 0 and depth[i, k - 1] < best:
                depth[i, k], branch[i, k], arc[i, k] = depth[i, k - 1], branch[i, k - 1], arc[i, k - 1]
                k -= 1
            depth[i, k], branch[i, k], arc[i, k] = best, b, at
