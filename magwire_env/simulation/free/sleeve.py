"""Nodes come out of the sleeve and go back into it.

The cell, the segment that the feed pushes out, is kept between 0.45 and 1.5 rest lengths. One node more comes out by
splitting it, the last one goes in by joining it with the next. Both keep the strain of the wire and let the bend and
the twist of the cell go on as they are, so that no force jumps; the curve that two chords follow is a little longer
than the one chord's, so the length fed changes by about κ² ℓ³/20 (2 µm for 5 mm segments in a bend of 40 mm radius).

All of it is scalar, lane by lane: it happens once in many steps.
"""

from __future__ import annotations

import math

from ...compiled import kernel
from ..lanes import LANES
from . import layout as at

SPLIT, JOIN = 1.5, 0.45


@kernel
def regrid(l, points, par, wire, lane, node, spin, foot, work, h):
    """Split or join the cell of lane `l` if its length asks for it; returns whether it did."""
    nodes = node.shape[0] // at.NODE_STRIDE
    f = int(lane[at.FIRST + l])
    cell = lane[at.CELL + l]
    rest = wire[f * at.WIRE_STRIDE + at.REST + l]
    if cell > SPLIT * rest and f > 0:
        split(l, f, points, par, wire, lane, node, spin, foot, work, h)
        return True
    if cell < JOIN * rest and f < nodes - 3:
        join(l, f, points, par, wire, lane, node, spin, foot, work)
        return True
    return False


@kernel
def split(l, f, points, par, wire, lane, node, spin, foot, work, h):
    n, w = at.NODE_STRIDE, at.WORK_STRIDE
    rest, cell = wire[f * at.WIRE_STRIDE + at.REST + l], lane[at.CELL + l]
    a = (cell - rest) / cell
    length, one, two = 0.0, 0.0, 0.0
    for k in range(3):
        e = node[(f + 1) * n + at.X + k * LANES + l] - par[at.BASE_X + k * LANES + l]
        length += e * e
    length = math.sqrt(length)
    stretch = length / cell
    for k in range(3):
        d = par[at.BASE_TX + k * LANES + l]
        c = (node[(f + 1) * n + at.X + k * LANES + l] - par[at.BASE_X + k * LANES + l]) / length
        t = c + a * (c - d)
        two += t * t
    two = math.sqrt(two)
    rate = 0.0
    if spin is not None:
        rate = clamp_twist(l, f, par, lane, node, spin) / (0.5 * cell)
    for k in range(3):
        o = k * LANES + l
        d, mouth, above = par[at.BASE_TX + o], par[at.BASE_X + o], node[(f + 1) * n + at.X + o]
        c = (above - mouth) / length
        x = above - rest * stretch * (c + a * (c - d)) / two
        v = (1.0 - a) * lane[at.CELL_SPEED + l] * d + a * node[(f + 1) * n + at.VX + o]
        node[f * n + at.X + o], node[f * n + at.VX + o] = x, v
        work[f * w + at.START + o], work[f * w + at.MOVE + o] = x, h * v * par[at.MEMORY + l]
        node[(f - 1) * n + at.X + o], node[(f - 1) * n + at.VX + o] = mouth, 0.0
        work[(f - 1) * w + at.START + o], work[(f - 1) * w + at.MOVE + o] = mouth, 0.0
        one += (x - mouth) ** 2
    short = math.sqrt(one) / stretch
    if spin is not None:
        s = at.SPIN_STRIDE
        put_director(l, f - 1, rate * 0.5 * short, par, lane, node, spin)
        put_director(l, f, rate * (short + 0.5 * rest), par, lane, node, spin)
        spin[(f - 1) * s + at.RATE + l] = spin[f * s + at.RATE + l]
        for i in (f - 1, f):
            work[i * w + at.TURN + l] = 0.0
            work[i * w + at.TURN_MOVE + l] = 0.0
            for k in range(3):
                work[i * w + at.N0 + k * LANES + l] = spin[i * s + at.MX + k * LANES + l]
    goal = lane[at.FEED_GOAL + l] - cell
    lane[at.FIRST + l] = f - 1.0
    lane[at.CELL + l], lane[at.CELL_START + l], lane[at.FEED_GOAL + l] = short, short, short + goal
    lane[at.OUT + l] += rest
    lane[at.CELL_REST + l] = wire[(f - 1) * at.WIRE_STRIDE + at.REST + l]
    seek_feet(l, f - 1, points, short, 0.0, par, foot)
    seek_feet(l, f, points, rest, short, par, foot)


@kernel
def join(l, f, points, par, wire, lane, node, spin, foot, work):
    n, w = at.NODE_STRIDE, at.WORK_STRIDE
    cell, rest = lane[at.CELL + l], wire[(f + 1) * at.WIRE_STRIDE + at.REST + l]
    one, two, whole = 0.0, 0.0, 0.0
    for k in range(3):
        o = k * LANES + l
        mouth, x, above = par[at.BASE_X + o], node[(f + 1) * n + at.X + o], node[(f + 2) * n + at.X + o]
        one += (x - mouth) ** 2
        two += (above - x) ** 2
        whole += (above - mouth) ** 2
    stretch = (math.sqrt(one) + math.sqrt(two)) / (cell + rest)
    long = math.sqrt(whole) / stretch
    twist = 0.0
    if spin is not None:
        twist = clamp_twist(l, f, par, lane, node, spin) / (0.5 * cell)
    for k in range(3):
        o = k * LANES + l
        mouth, d = par[at.BASE_X + o], par[at.BASE_TX + o]
        node[(f + 1) * n + at.X + o], node[(f + 1) * n + at.VX + o] = mouth, 0.0
        work[(f + 1) * w + at.START + o], work[(f + 1) * w + at.MOVE + o] = mouth, 0.0
        behind = mouth
        for i in range(f, -1, -1):  # no two nodes in the sleeve may coincide
            behind -= d * wire[i * at.WIRE_STRIDE + at.REST + l]
            node[i * n + at.X + o], node[i * n + at.VX + o] = behind, 0.0
            work[i * w + at.START + o], work[i * w + at.MOVE + o] = behind, 0.0
    if spin is not None:
        s = at.SPIN_STRIDE
        put_director(l, f + 1, twist * 0.5 * long, par, lane, node, spin)
        work[(f + 1) * w + at.TURN + l] = 0.0
        work[(f + 1) * w + at.TURN_MOVE + l] = 0.0
        for k in range(3):
            o = k * LANES + l
            work[(f + 1) * w + at.N0 + o] = spin[(f + 1) * s + at.MX + o]
            spin[f * s + at.MX + o] = lane[at.BASE_MX + o]
            work[f * w + at.N0 + o] = lane[at.BASE_MX + o]
        spin[f * s + at.RATE + l] = 0.0
    goal = lane[at.FEED_GOAL + l] - cell
    lane[at.FIRST + l] = f + 1.0
    lane[at.CELL + l], lane[at.CELL_START + l], lane[at.FEED_GOAL + l] = long, long, long + goal
    lane[at.OUT + l] -= rest
    lane[at.CELL_REST + l] = rest
    seek_feet(l, f + 1, points, long, 0.0, par, foot)


@kernel
def seek_feet(l, i, points, length, behind, par, foot):
    """Where the contact points of segment `i` will look for the wall: along the inlet's own direction."""
    spacing = par[at.SPACING + l]
    for k in range(points):
        s = behind + length * k / points
        row = math.floor(s / spacing)
        o = (i * points + k) * at.FOOT_STRIDE
        foot[o + at.ROW + l] = par[at.INLET_ROW + l] + row
        foot[o + at.ALONG + l] = s - row * spacing


@kernel
def carried(l, i, par, lane, node):
    """The clamp's director carried to segment `i`, the cell, without twist, and the segment's direction."""
    n = at.NODE_STRIDE
    e = (
        node[(i + 1) * n + at.X + l] - node[i * n + at.X + l], node[(i + 1) * n + at.Y + l] - node[i * n + at.Y + l],
        node[(i + 1) * n + at.Z + l] - node[i * n + at.Z + l],
    )  # fmt: skip
    size = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    w = (e[0] / size, e[1] / size, e[2] / size)
    u = (par[at.BASE_TX + l], par[at.BASE_TY + l], par[at.BASE_TZ + l])
    m = (lane[at.BASE_MX + l], lane[at.BASE_MY + l], lane[at.BASE_MZ + l])
    r = (m[0] * w[0] + m[1] * w[1] + m[2] * w[2]) / (1.0 + u[0] * w[0] + u[1] * w[1] + u[2] * w[2])
    x, y, z = m[0] - r * (u[0] + w[0]), m[1] - r * (u[1] + w[1]), m[2] - r * (u[2] + w[2])
    return x, y, z, w


@kernel
def clamp_twist(l, i, par, lane, node, spin):
    """Twist between the clamp and segment `i`, rad; call it with the mouth's node still in its place."""
    x, y, z, w = carried(l, i, par, lane, node)
    o = i * at.SPIN_STRIDE + l
    m = (spin[o + at.MX], spin[o + at.MY], spin[o + at.MZ])
    c = x * m[0] + y * m[1] + z * m[2]
    s = w[0] * (y * m[2] - z * m[1]) + w[1] * (z * m[0] - x * m[2]) + w[2] * (x * m[1] - y * m[0])
    return math.atan2(s, c)


@kernel
def put_director(l, i, angle, par, lane, node, spin):
    """Give segment `i` the clamp's director, carried there without twist and turned by `angle`."""
    x, y, z, w = carried(l, i, par, lane, node)
    c, s = math.cos(angle), math.sin(angle)
    o = i * at.SPIN_STRIDE + l
    spin[o + at.MX] = c * x + s * (w[1] * z - w[2] * y)
    spin[o + at.MY] = c * y + s * (w[2] * x - w[0] * z)
    spin[o + at.MZ] = c * z + s * (w[0] * y - w[1] * x)
