"""Ways through a lumen's tree, compiled: where a tip is, how far it has come and has to go, what lies ahead.

All of it is scalar, one lane at a time, and a function of the lane's state alone. Branches of all lumens stand one
after another; those of a lane begin at its `first`, and its own numbers count from there, parents before children.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...compiled import kernel
from ...lumen.tube_kernels import KEPT, deepest
from ..centreline import COURSE, curve_at

__all__ = ["Ways", "ahead", "astray", "carry", "lay", "place_of", "remaining", "route_place"]

_PREFERRED = 10.0
"""Radii by which a branch of the route wins over others where the point is inside both."""


class Ways(NamedTuple):
    """The trees of a batch's scenarios.

    first, branches : (entries,) a lumen's first branch, and how many
    parent : (branches,) within the lumen, −1 for the trunk
    start : (branches,) m on the parent, at which a branch leaves it
    begin : (branches,) m from the inlet to the branch's start
    length : (branches,) m
    course : (branches, 6) see `magwire_env.simulation.centreline.Course`
    table : flat, all centrelines
    curve, radius, rows, spacing, balls, chunks : see `magwire_env.lumen.tube_kernels.deepest`
    """

    first: np.ndarray
    branches: np.ndarray
    parent: np.ndarray
    start: np.ndarray
    begin: np.ndarray
    length: np.ndarray
    course: np.ndarray
    table: np.ndarray
    curve: np.ndarray
    radius: np.ndarray
    rows: np.ndarray
    spacing: np.ndarray
    balls: np.ndarray
    chunks: np.ndarray


@kernel
def foot_of(ways, b, x, y, z, s):
    """The arc length on branch `b` (of all) of the centreline's point nearest to a point, from a guess."""
    course = ways.course[b]
    for _ in range(3):
        p, t, k = curve_at(s, course, ways.table)
        rx, ry, rz = x - p[0], y - p[1], z - p[2]
        slope = t[0] * t[0] + t[1] * t[1] + t[2] * t[2] - (rx * k[0] + ry * k[1] + rz * k[2])
        ahead = (rx * t[0] + ry * t[1] + rz * t[2]) / max(slope, 0.2)
        s += min(max(ahead, -course[COURSE.spacing]), course[COURSE.spacing])
    return s


@kernel
def on_route(ways, first, b, goal):
    """Whether branch `b` lies on the way from the inlet to branch `goal`, both within the lumen."""
    g = goal
    while g > b:
        g = ways.parent[first + g]
    return g == b


@kernel
def place_of(ways, entry, goal, x, y, z, guess, point, depth, branch, arc):
    """The branch (within the lumen) and the arc length on it of a point.

    guess : m, near which to look in a lumen of one branch
    goal : the branch of the lane's goal, whose route wins where the point is inside it
    point (1, 3), depth, branch, arc (1, KEPT) : to work in
    """
    first = ways.first[entry]
    if ways.branches[entry] == 1:
        return 0, foot_of(ways, first, x, y, z, guess)
    last = first + ways.branches[entry]
    point[0, 0], point[0, 1], point[0, 2] = x, y, z
    deepest(
        point, ways.curve, ways.radius, ways.rows[first:last], ways.spacing[first:last], ways.balls, ways.chunks,
        depth, branch, arc,
    )  # fmt: skip
    best, found, s = -np.inf, 0, 0.0
    for k in range(KEPT):
        b = branch[0, k]
        if b < 0:
            continue
        row = min(max(int(arc[0, k] / ways.spacing[first + b]), 0), ways.rows[first + b, 1] - 1)
        share = depth[0, k] / ways.radius[ways.rows[first + b, 0] + row, 0]
        if depth[0, k] > 0.0 and on_route(ways, first, b, goal):
            share += _PREFERRED
        if share > best:
            best, found, s = share, b, arc[0, k]
    s = foot_of(ways, first + found, x, y, z, s)
    return found, (s if found == 0 else max(s, 0.0))


@kernel
def remaining(ways, entry, b, s, goal, goal_s):
    """The way left from a place to a goal, m: in a wrong branch the way back counts, past the goal it is negative."""
    first, g, sg, way, down = ways.first[entry], goal, goal_s, 0.0, False
    while b != g:
        if b > g:
            way, s, b = way + s, ways.start[first + b], ways.parent[first + b]
        else:
            way, sg, g, down = way + sg, ways.start[first + g], ways.parent[first + g], True
    if not down and s > sg:
        return -(way + s - sg)
    return way + abs(sg - s)


@kernel
def astray(ways, entry, b, s, goal):
    """The way back, m, from a place in a wrong branch to the route from the inlet to branch `goal`; 0 on the route."""
    first, way = ways.first[entry], 0.0
    while not on_route(ways, first, b, goal):
        way, s, b = way + s, ways.start[first + b], ways.parent[first + b]
    return way


@kernel
def route_place(ways, entry, goal, x):
    """The branch and arc length after a way of `x` m from the inlet towards branch `goal`; both ends go on straight."""
    first, b = ways.first[entry], goal
    while b > 0 and x < ways.begin[first + b]:
        b = ways.parent[first + b]
    return b, x - ways.begin[first + b]


@kernel
def ahead(ways, entries, goals, travelled, offsets, found):
    """Points, tangents and second derivatives of the route `offsets` (k,) m ahead of the tips → found (n, k, 9).

    ways : the fields of `Ways`
    """
    ways = Ways(*ways)
    for lane in range(found.shape[0]):
        first = ways.first[entries[lane]]
        for k in range(offsets.shape[0]):
            b, s = route_place(ways, entries[lane], goals[lane], travelled[lane] + offsets[k])
            point, tangent, bend = curve_at(s, ways.course[first + b], ways.table)
            for axis in range(3):
                found[lane, k, axis] = point[axis]
                found[lane, k, 3 + axis] = tangent[axis]
                found[lane, k, 6 + axis] = bend[axis]


@kernel
def lay(course, table, tips, rest, spare, fed, positions, along, cells):
    """Wires laid out at rest behind their tips along a centreline, every chord at its rest length.

    course : (n, 6), table : flat, of the centrelines; tips : (n,) m along them
    rest : (n, nodes) m, of the segments above the nodes
    spare : (n,) first nodes that a shorter wire does not have
    fed : (n,) whether the wire comes out of a sleeve at arc length 0; the nodes behind lie straight
    positions : (n, nodes, 3) m, along : (n, nodes) m, receive places and arc lengths
    cells : (n, 3) receives, of a wire that is fed, the first node outside, the cell's length, and the wire above it, m
    """
    nodes = rest.shape[1]
    for lane in range(len(tips)):
        s, own, first = tips[lane], course[lane], spare[lane]
        along[lane, nodes - 1] = s
        n, _, _ = curve_at(s, own, table)
        out = 0.0
        i = nodes - 2
        while i >= first:
            length = rest[lane, i]
            at = s - length
            for _ in range(8):
                p, t, _ = curve_at(at, own, table)
                dx, dy, dz = n[0] - p[0], n[1] - p[1], n[2] - p[2]
                chord = math.sqrt(dx * dx + dy * dy + dz * dz)
                at += (chord - length) / max((dx * t[0] + dy * t[1] + dz * t[2]) / chord, 0.2)
            if fed[lane] and (at < 0.45 * length or i == first):
                break
            s, along[lane, i] = at, at
            n, _, _ = curve_at(at, own, table)
            out += length
            i -= 1
        p, t, _ = curve_at(0.0, own, table)
        if fed[lane]:
            cells[lane, 0] = i
            cells[lane, 1] = math.sqrt((n[0] - p[0]) ** 2 + (n[1] - p[1]) ** 2 + (n[2] - p[2]) ** 2)
            cells[lane, 2] = out
            along[lane, i] = 0.0
            behind = 0.0
            for j in range(i - 1, first - 1, -1):
                behind -= rest[lane, j]
                along[lane, j] = behind
        for j in range(first):
            along[lane, j] = along[lane, first] - rest[lane, j] * (first - j)
        for j in range(nodes):
            p, _, _ = curve_at(along[lane, j], own, table)
            for axis in range(3):
                positions[lane, j, axis] = p[axis]


@kernel
def carry(positions, first, directors):
    """Directors (n, nodes, 3) of segments carried along wires (n, nodes, 3) without twist, from `first` (n, 3) on."""
    nodes = positions.shape[1]
    for lane in range(len(positions)):
        m0, m1, m2 = first[lane, 0], first[lane, 1], first[lane, 2]
        ux, uy, uz = 0.0, 0.0, 0.0
        for i in range(nodes - 1):
            wx = positions[lane, i + 1, 0] - positions[lane, i, 0]
            wy = positions[lane, i + 1, 1] - positions[lane, i, 1]
            wz = positions[lane, i + 1, 2] - positions[lane, i, 2]
            size = math.sqrt(wx * wx + wy * wy + wz * wz)
            wx, wy, wz = wx / size, wy / size, wz / size
            along = m0 * wx + m1 * wy + m2 * wz
            if i > 0:
                along /= 1.0 + ux * wx + uy * wy + uz * wz
            m0, m1, m2 = m0 - along * (ux + wx), m1 - along * (uy + wy), m2 - along * (uz + wz)
            size = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
            m0, m1, m2 = m0 / size, m1 / size, m2 / size
            directors[lane, i, 0], directors[lane, i, 1], directors[lane, i, 2] = m0, m1, m2
            ux, uy, uz = wx, wy, wz
        directors[lane, nodes - 1, 0], directors[lane, nodes - 1, 1], directors[lane, nodes - 1, 2] = m0, m1, m2
