"""Algorithm 1 of the paper as one batched kernel, in arc-length coordinates.

The unit of work is a block of `LANES` wires. Every array keeps the lane as its last index, and a quantity of all
wires of a block is one `Lanes` value (see `lanes`), so the code below reads as if for one wire. Quantities of a node
stand in one flat workspace, ``w[node * STRIDE + FIELD + lane]``. All kernels stand in this one module: Numba's cache
does not notice changes in others.

The paper's steps, and where they are here (`control_period` calls them in order):

i.    magnetic force on the tip dipole                      `magnetic_force`
ii.   integrate the tip magnet                              it is the chain's last node: solved with the others in vi
iii.  couple it to the rest of the wire                     by the last segment's spring, in iv
iv.   spring forces between segments                        `spring_force`  } for each node in turn,
v.    bending forces at the joints                          `bending_force` } called by `joint_forces`
vi.   integrate the joints                                  `integrate` (linearly implicit)
vii.  project the forces on the tract's tangent             in i, iv and v, as each force is formed
viii. update the joints' positions                          `update`
ix.   snap the joints onto the spline                       `snap`: exact, since a joint *is* an arc length

Steps ix, iv, v and the solve's elimination run in a single pass from tail to tip: what a node needs of its neighbours
is then still in registers, and the divisions of the elimination hide behind the forces of the next node.
"""

from __future__ import annotations

import math

from numba import njit

from ..lanes import (
    LANES,
    absolute,
    anywhere,
    floor,
    gather,
    load,
    maximum,
    minimum,
    part,
    reciprocal,
    row,
    rsqrt,
    sin_cos,
    spread,
    sqrt,
    store,
    where,
)

# Lane parameters: par[field + lane]
_FIELDS = (
    "TABLE_ROW", "TABLE_LAST", "INV_SPACING", "SPACING", "PERIOD", "INV_PERIOD",
    "MU", "STICK", "INV_LEVER", "LEVER_FRICTION", "TIP_MOMENT", "WRENCH", "GX", "GY", "GZ",
)  # fmt: skip
(
    TABLE_ROW, TABLE_LAST, INV_SPACING, SPACING, PERIOD, INV_PERIOD,
    MU, STICK, INV_LEVER, LEVER_FRICTION, TIP_MOMENT, WRENCH, GX, GY, GZ,
) = (i * LANES for i in range(len(_FIELDS)))  # fmt: skip
PAR_SIZE = len(_FIELDS) * LANES

# Wire parameters: wire[node * WIRE_STRIDE + field + lane]; a segment or joint goes with its lower node
MASS, DRAG_NEW, DRAG_OLD, K_AXIAL, K_BEND, K_END, REST = (i * LANES for i in range(7))
WIRE_STRIDE = 7 * LANES

# Magnet parameters: magnets[m * MAGNET_STRIDE + field + lane]; STRENGTH is μ0 m / 4π, or a coil's uniform field an
# ampere, GRADIENT the coil's gradient
CX, CY, CZ, STRENGTH, GRADIENT = (i * LANES for i in range(5))
MAGNET_STRIDE = 5 * LANES

# Degrees of freedom: dofs[d * DOF_STRIDE + field + lane]
SPEED, LOW, HIGH = (i * LANES for i in range(3))
DOF_STRIDE = 3 * LANES

# Sources of a cloud, in the magnet's frame: cloud[k * SOURCE_STRIDE + field + lane]; weights sum to 1
SX, SY, SZ, WEIGHT = (i * LANES for i in range(4))
SOURCE_STRIDE = 4 * LANES

# Results: out[field + lane] while a block is worked on, then a row a field over all lanes, for readers without copies.
# Those of the state come first, those of the last control period (peaks, mean, the magnets' travel) after.
OUT_FIELDS = (
    "FX", "FY", "FZ", "BX", "BY", "BZ", "DRIVE", "LATERAL", "TORQUE", "WALL",
    "TIP_X", "TIP_Y", "TIP_Z", "TAN_X", "TAN_Y", "TAN_Z", "CURV_X", "CURV_Y", "CURV_Z", "TIP_S", "TIP_V",
    "PEAK_LATERAL", "PEAK_WALL", "MEAN_WALL", "TRAVEL",
)  # fmt: skip
(
    FX, FY, FZ, BX, BY, BZ, DRIVE, LATERAL, TORQUE, WALL,
    TIP_X, TIP_Y, TIP_Z, TAN_X, TAN_Y, TAN_Z, CURV_X, CURV_Y, CURV_Z, TIP_S, TIP_V,
    PEAK_LATERAL, PEAK_WALL, MEAN_WALL, TRAVEL,
) = (i * LANES for i in range(len(OUT_FIELDS)))  # fmt: skip
OUT_SIZE = len(OUT_FIELDS) * LANES
OF_STATE, OF_ALL = PEAK_LATERAL // LANES, len(OUT_FIELDS)

# Workspace of a node: w[node * STRIDE + field + lane]. A row of the solve is DIAG v − OFF v' = Q − NORMAL g(v), with
# NORMAL the friction μ n, g = v/√(v² + ε²) linearised as G + G_SLOPE (v' − v); RATIO and RIGHT are its elimination.
Q, NORMAL, DIAG, OFF, G, G_SLOPE, RATIO, RIGHT = (i * LANES for i in range(8))
STRIDE = 8 * LANES

TURN_SLOTS, COIL_DOF, COIL_AXIS, SLOTS = 2, 7, 8, 9
"""rig[m] holds: dof index of turn 1, turn 2, slide x, y, z (−1 if absent), the axes of the two turns; of a coil the
index of its current, and its axis."""

NEWTON_PATIENCE = 15
"""Newton steps before the slower secant takes over."""

MAX_NEWTON = 60
NEWTON_TOLERANCE = 1e-5
"""Largest error of a node's friction after its linearisation, as a share of μ n."""

_JIT = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}
_INLINE = {**_JIT, "forceinline": True}


# --- the tract --------------------------------------------------------------------------------------------------------


@njit(**_INLINE)
def place_in_table(s, par):
    """Where arc length `s` lies in the table: index of its row's first number, and the distance from its start."""
    s = s - load(par, PERIOD) * floor(s * load(par, INV_PERIOD))
    piece = minimum(maximum(floor(s * load(par, INV_SPACING)) + 1.0, 0.0), load(par, TABLE_LAST))
    return 12.0 * (piece + load(par, TABLE_ROW)), s - (piece - 1.0) * load(par, SPACING)


@njit(**_INLINE)
def snap(s, par, table):
    """Step ix. A joint is on the spline by construction: position, tangent and p'' follow from its arc length `s`."""
    at, u = place_in_table(s, par)
    bx, by, bz = gather(table, at, 3), gather(table, at, 4), gather(table, at, 5)
    cx, cy, cz = gather(table, at, 6), gather(table, at, 7), gather(table, at, 8)
    dx, dy, dz = gather(table, at, 9), gather(table, at, 10), gather(table, at, 11)
    px = gather(table, at, 0) + u * (bx + u * (cx + u * dx))
    py = gather(table, at, 1) + u * (by + u * (cy + u * dy))
    pz = gather(table, at, 2) + u * (bz + u * (cz + u * dz))
    v, w = 3.0 * u, 6.0 * u
    tx, ty, tz = bx + u * (2.0 * cx + v * dx), by + u * (2.0 * cy + v * dy), bz + u * (2.0 * cz + v * dz)
    return px, py, pz, tx, ty, tz, 2.0 * cx + w * dx, 2.0 * cy + w * dy, 2.0 * cz + w * dz


@njit(**_INLINE)
def curvature(tx, ty, tz, ax, ay, az):
    """The vector κ n = dt/ds from the tangent, whose length is 1 to 1e-5 only, and its derivative p''."""
    inv = rsqrt(dot(tx, ty, tz, tx, ty, tz))
    along = dot(tx, ty, tz, ax, ay, az) * inv * inv
    return inv * (ax - along * tx), inv * (ay - along * ty), inv * (az - along * tz)


@njit(**_INLINE)
def store3(array, at, x, y, z):
    store(array, at, x)
    store(array, at + LANES, y)
    store(array, at + 2 * LANES, z)


@njit(**_INLINE)
def load3(array, at):
    return load(array, at), load(array, at + LANES), load(array, at + 2 * LANES)


@njit(**_INLINE)
def dot(ax, ay, az, bx, by, bz):
    return ax * bx + ay * by + az * bz


@njit(**_JIT)
def tip_pose(s, par, table, out):
    """The tip's position, tangent and curvature vector, for the magnetic force and for the observer."""
    px, py, pz, tx, ty, tz, ax, ay, az = snap(load(s, len(s) - LANES), par, table)
    kx, ky, kz = curvature(tx, ty, tz, ax, ay, az)
    store3(out, TIP_X, px, py, pz)
    store3(out, TAN_X, tx, ty, tz)
    store3(out, CURV_X, kx, ky, kz)


# --- step i -----------------------------------------------------------------------------------------------------------


@njit(**_INLINE)
def turn_about(axis, s, c, x, y, z):
    """The vector turned about a world axis by the angle of sine `s` and cosine `c`."""
    if axis == 0:
        return x, c * y - s * z, s * y + c * z
    if axis == 1:
        return c * x + s * z, y, c * z - s * x
    return c * x - s * y, s * x + c * y, z


@njit(**_JIT)
def sum_sources(cloud, sources, rx, ry, rz, tx, ty, tz):
    """Force on a unit tip moment along t at r, and field, of dipoles all along the magnet's z (Section III-A)."""
    fx, fy, fz, bx, by, bz = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for k in range(sources):
        o = k * SOURCE_STRIDE
        dx, dy, dz = rx - load(cloud, o + SX), ry - load(cloud, o + SY), rz - load(cloud, o + SZ)
        inv = rsqrt(dot(dx, dy, dz, dx, dy, dz))
        inv2 = inv * inv
        w3 = load(cloud, o + WEIGHT) * inv2 * inv
        w5 = 3.0 * w3 * inv2
        along = dot(tx, ty, tz, dx, dy, dz)
        e = w5 * (tz - 5.0 * along * dz * inv2)
        f = w5 * dz
        fx = fx + f * tx + e * dx
        fy = fy + f * ty + e * dy
        fz = fz + f * tz + e * dz + w5 * along
        bx = bx + f * dx
        by = by + f * dy
        bz = bz + f * dz - w3
    return fx, fy, fz, bx, by, bz


@njit(**_JIT)
def pull_of_magnet(rig, m, magnet, cloud, sources, q, out):
    """Force on a unit tip moment and field of one magnet, over its strength, in the world's frame.

    The tip is brought into the magnet's frame by the inverse turns, the last first, and the results back.
    """
    px, py, pz = load3(out, TIP_X)
    cx, cy, cz = load3(magnet, CX)
    rx, ry, rz = px - cx, py - cy, pz - cz
    tx, ty, tz = load3(out, TAN_X)
    if rig[m, TURN_SLOTS] >= 0:
        rx = rx - load(q, rig[m, TURN_SLOTS] * LANES)
    if rig[m, TURN_SLOTS + 1] >= 0:
        ry = ry - load(q, rig[m, TURN_SLOTS + 1] * LANES)
    if rig[m, TURN_SLOTS + 2] >= 0:
        rz = rz - load(q, rig[m, TURN_SLOTS + 2] * LANES)
    s1, c1, s2, c2 = spread(0.0), spread(1.0), spread(0.0), spread(1.0)
    if rig[m, 1] >= 0:
        s2, c2 = sin_cos(load(q, rig[m, 1] * LANES))
        rx, ry, rz = turn_about(rig[m, 6], -s2, c2, rx, ry, rz)
        tx, ty, tz = turn_about(rig[m, 6], -s2, c2, tx, ty, tz)
    if rig[m, 0] >= 0:
        s1, c1 = sin_cos(load(q, rig[m, 0] * LANES))
        rx, ry, rz = turn_about(rig[m, 5], -s1, c1, rx, ry, rz)
        tx, ty, tz = turn_about(rig[m, 5], -s1, c1, tx, ty, tz)
    fx, fy, fz, bx, by, bz = sum_sources(cloud, sources, rx, ry, rz, tx, ty, tz)
    if rig[m, 0] >= 0:
        fx, fy, fz = turn_about(rig[m, 5], s1, c1, fx, fy, fz)
        bx, by, bz = turn_about(rig[m, 5], s1, c1, bx, by, bz)
    if rig[m, 1] >= 0:
        fx, fy, fz = turn_about(rig[m, 6], s2, c2, fx, fy, fz)
        bx, by, bz = turn_about(rig[m, 6], s2, c2, bx, by, bz)
    return fx, fy, fz, bx, by, bz


@njit(**_INLINE)
def pull_of_coil(rig, m, coil, q, out):
    """Force on a unit tip moment and field of a pair of coils, in the world's frame."""
    px, py, pz = load3(out, TIP_X)
    cx, cy, cz = load3(coil, CX)
    rx, ry, rz = px - cx, py - cy, pz - cz
    tx, ty, tz = load3(out, TAN_X)
    current = load(q, rig[m, COIL_DOF] * LANES)
    uniform, half = load(coil, STRENGTH) * current, 0.5 * load(coil, GRADIENT) * current
    fx, fy, fz = -half * tx, -half * ty, -half * tz
    bx, by, bz = -half * rx, -half * ry, -half * rz
    if rig[m, COIL_AXIS] == 0:
        return fx + 3.0 * half * tx, fy, fz, bx + uniform + 3.0 * half * rx, by, bz
    if rig[m, COIL_AXIS] == 1:
        return fx, fy + 3.0 * half * ty, fz, bx, by + uniform + 3.0 * half * ry, bz
    return fx, fy, fz + 3.0 * half * tz, bx, by, bz + uniform + 3.0 * half * rz


@njit(**_JIT)
def magnetic_force(block, par, rig, magnets, clouds, cloud_of, sources, q, out):
    """Step i. Force and field of all magnets and coils at the tip, the drive along the tract, the loads on the wall.

    `force` drives by F·t, the paper's projection; `wrench` by F·t + m κ n·B, the gradient of the energy −m t·B.
    """
    fx, fy, fz, bx, by, bz = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for m in range(rig.shape[0]):
        magnet, cloud = part(magnets, m * MAGNET_STRIDE, MAGNET_STRIDE), row(clouds, cloud_of[block, m])
        if rig[m, COIL_DOF] >= 0:
            gx, gy, gz, hx, hy, hz = pull_of_coil(rig, m, magnet, q, out)
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            bx, by, bz = bx + hx, by + hy, bz + hz
            continue
        gx, gy, gz, hx, hy, hz = pull_of_magnet(rig, m, magnet, cloud, sources[m], q, out)
        strength = load(magnet, STRENGTH)
        fx, fy, fz = fx + strength * gx, fy + strength * gy, fz + strength * gz
        bx, by, bz = bx + strength * hx, by + strength * hy, bz + strength * hz
    m = load(par, TIP_MOMENT)
    fx, fy, fz = m * fx, m * fy, m * fz
    tx, ty, tz = load3(out, TAN_X)
    kx, ky, kz = load3(out, CURV_X)
    along = dot(fx, fy, fz, tx, ty, tz)
    gx, gy, gz = fx - along * tx, fy - along * ty, fz - along * tz
    lateral = sqrt(dot(gx, gy, gz, gx, gy, gz))
    cx, cy, cz = ty * bz - tz * by, tz * bx - tx * bz, tx * by - ty * bx
    torque = m * sqrt(dot(cx, cy, cz, cx, cy, cz))
    store3(out, FX, fx, fy, fz)
    store3(out, BX, bx, by, bz)
    store(out, DRIVE, along + load(par, WRENCH) * m * dot(kx, ky, kz, bx, by, bz))
    store(out, LATERAL, lateral)
    store(out, TORQUE, torque)
    store(out, WALL, lateral + 2.0 * torque * load(par, INV_LEVER))


# --- steps iv and v ---------------------------------------------------------------------------------------------------


@njit(**_INLINE)
def spring_force(dx, dy, dz, stiffness, rest):
    """Step iv. A segment from its lower to its upper node: direction, inverse length and tension."""
    d2 = maximum(dot(dx, dy, dz, dx, dy, dz), 1e-24)
    inv = rsqrt(d2)
    return dx * inv, dy * inv, dz * inv, inv, stiffness * (d2 * inv - rest)


@njit(**_INLINE)
def stiffened(k, cos):
    """k φ/sin φ, the factor of a rotational spring's forces, from the angle's cosine.

    With x = 1 − cos φ it is k (1 + x/3 + 2x²/15 + 2x³/35 + 8x⁴/315 + …), cut after x⁴: relative error 6e-6 at 30°,
    4e-4 at 60°; at the 16° of a 10 mm segment in a 36 mm bend below 1e-8.
    """
    x = 1.0 - cos
    return k * (1.0 + x * (1.0 / 3.0 + x * (2.0 / 15.0 + x * (2.0 / 35.0 + x * (8.0 / 315.0)))))


@njit(**_INLINE)
def bending_force(k, cos, inv_lower, inv_upper, before, after, a0, b0, a1, b1):
    """Step v, projected (vii). A joint's energy ½ k φ²: forces on the node below, the joint, and the node above.

    before, after : the lower node's tangent along the upper segment, the upper node's along the lower one
    a0, b0, a1, b1 : the tangents of the lower and the upper segment's ends along them
    """
    g = stiffened(k, cos)
    lower, upper = g * inv_lower, g * inv_upper
    here = lower * (a1 - cos * b0) - upper * (b0 - cos * a1)
    return lower * (cos * a0 - before), here, upper * (after - cos * b1)


@njit(**_INLINE)
def end_bending(k, per, tx, ty, tz, kx, ky, kz, ux, uy, uz, ex, ey, ez):
    """Step v at a wire's end: half a cell of bend between the end segment and the tract's tangent it is locked to.

    With K_END = 2 E I/ℓ this is ½ E I κ² over the half segment that no joint stands for; left out, the bending
    resistance would be felt half a segment late, which was nearly all of the mesh's error.

    per : 1/length of the end segment u, negative at the tail; t, κ n : the end node's tangent and curvature vector;
    e : the tangent at the segment's other end. Returns the forces on the end node and on the other.
    """
    inv = rsqrt(dot(tx, ty, tz, tx, ty, tz))
    nx, ny, nz = tx * inv, ty * inv, tz * inv
    along = dot(tx, ty, tz, ux, uy, uz)
    cos = along * inv
    g = stiffened(k, cos)
    here = dot(kx, ky, kz, ux, uy, uz) + per * (dot(tx, ty, tz, nx, ny, nz) - cos * along)
    return g * here, g * per * (cos * dot(ex, ey, ez, ux, uy, uz) - dot(ex, ey, ez, nx, ny, nz))


@njit(**_INLINE)
def eliminate(w, node, v, q, normal, diag, off, off_below, ratio, right):
    """One node's row of the tridiagonal solve, friction linearised about speed `v` (Thomas, upwards)."""
    o = node * STRIDE
    slope = normal * load(w, o + G_SLOPE)
    inv = reciprocal(diag + slope - off_below * ratio)
    ratio = off * inv
    right = (q - normal * load(w, o + G) + slope * v - off_below * right) * inv
    store(w, o + RATIO, ratio)
    store(w, o + RIGHT, right)
    return ratio, right


@njit(**_INLINE)
def store_row(w, node, q, normal, diag, off):
    o = node * STRIDE
    store(w, o + Q, q)
    store(w, o + NORMAL, normal)
    store(w, o + DIAG, diag)
    store(w, o + OFF, off)


@njit(**_JIT)
def joint_forces(w, nodes, spare, wire, par, table, out, s, v, h):
    """Steps ix, iv, v, vii for every node from the tail up, and its row of the solve of step vi, once eliminated.

    The springs act at the stretch a full step at the new speeds would lead to, which damps the stiff axial modes and
    leaves the slow motion second order: they enter the matrix with h k, and `back` takes half a step's stretch off.
    Normal load of a node: the lateral part of weight, tensions and, at the tip, the magnetic force.
    """
    tip = nodes - 1
    zero, mu = spread(0.0), load(par, MU)
    gx, gy, gz = load3(par, GX)
    px, py, pz, tx, ty, tz, ax, ay, az = snap(load(s, 0), par, table)
    # Of the node below: tangent, what has been summed of its row. Of the segment below: direction, tension, ends.
    sx, sy, sz, q_below, normal_below, diag_below, off_below = zero, zero, zero, zero, zero, zero, zero
    ux, uy, uz, inv, a, b, fx, fy, fz = zero, zero, zero, zero, zero, zero, zero, zero, zero
    ratio, right, off_last = zero, zero, zero
    q, diag = zero, zero  # what segments and joints below have already added to this node's row
    for i in range(tip):
        w0, n = i * WIRE_STRIDE, (i + 1) * LANES
        speed, mass = load(v, i * LANES), load(wire, w0 + MASS)
        inertia = mass * (1.0 / h)
        if i + 1 < tip:
            nx, ny, nz, ex, ey, ez, cx, cy, cz = snap(load(s, n), par, table)
        else:
            nx, ny, nz = load3(out, TIP_X)
            ex, ey, ez = load3(out, TAN_X)
            cx, cy, cz = zero, zero, zero
        k = load(wire, w0 + K_AXIAL)
        lx, ly, lz, inv_up, tension = spring_force(nx - px, ny - py, nz - pz, k, load(wire, w0 + REST))
        a_up, b_up = dot(tx, ty, tz, lx, ly, lz), dot(ex, ey, ez, lx, ly, lz)
        back = 0.5 * h * k * (b_up * load(v, n) - a_up * speed)
        hx, hy, hz = tension * lx, tension * ly, tension * lz
        ox, oy, oz = mass * gx + hx - fx, mass * gy + hy - fy, mass * gz + hz - fz
        along = dot(ox, oy, oz, tx, ty, tz)
        normal = mu * sqrt(maximum(dot(ox, oy, oz, ox, oy, oz) - along * along, 0.0))
        q = q + along + (inertia - load(wire, w0 + DRAG_OLD)) * speed - a_up * back
        diag = diag + inertia + load(wire, w0 + DRAG_NEW) + h * k * a_up * a_up
        off = -h * k * a_up * b_up
        q_up = b_up * back
        if i > 0:
            cos = dot(ux, uy, uz, lx, ly, lz)
            before, after = dot(sx, sy, sz, lx, ly, lz), dot(ex, ey, ez, ux, uy, uz)
            lower, here, upper = bending_force(
                load(wire, w0 + K_BEND), cos, inv, inv_up, before, after, a, b, a_up, b_up
            )
            q_below, q, q_up = q_below + lower, q + here, q_up + upper
            store_row(w, i - 1, q_below, normal_below, diag_below, off_below)
            below = load(v, (i - 1) * LANES)
            ratio, right = eliminate(
                w, i - 1, below, q_below, normal_below, diag_below, off_below, off_last, ratio, right
            )
            off_last = off_below
        if i <= spare:  # a tail: the batch's wires differ by up to `spare` nodes
            kx, ky, kz = curvature(tx, ty, tz, ax, ay, az)
            here, far = end_bending(load(wire, w0 + K_END), -inv_up, tx, ty, tz, kx, ky, kz, lx, ly, lz, ex, ey, ez)
            q, q_up = q + here, q_up + far
        sx, sy, sz, q_below, normal_below, diag_below, off_below = tx, ty, tz, q, normal, diag, off
        ux, uy, uz, inv, a, b, fx, fy, fz = lx, ly, lz, inv_up, a_up, b_up, hx, hy, hz
        px, py, pz, tx, ty, tz, ax, ay, az = nx, ny, nz, ex, ey, ez, cx, cy, cz
        q, diag = q_up, h * k * b_up * b_up
    w0 = tip * WIRE_STRIDE
    speed, mass = load(v, tip * LANES), load(wire, w0 + MASS)
    inertia = mass * (1.0 / h)
    mx, my, mz = load3(out, FX)
    ox, oy, oz = mass * gx - fx + mx, mass * gy - fy + my, mass * gz - fz + mz
    along = dot(ox, oy, oz, tx, ty, tz)
    normal = sqrt(maximum(dot(ox, oy, oz, ox, oy, oz) - along * along, 0.0))
    normal = mu * (normal + load(par, LEVER_FRICTION) * (load(out, WALL) - load(out, LATERAL)))
    # Under `wrench` the drive is more than F·t: the tip's couple pushes along the bend too.
    q = q + along + load(out, DRIVE) - dot(mx, my, mz, tx, ty, tz)
    q = q + (inertia - load(wire, w0 + DRAG_OLD)) * speed
    diag = diag + inertia + load(wire, w0 + DRAG_NEW)
    kx, ky, kz = load3(out, CURV_X)
    here, far = end_bending(load(wire, w0 + K_END), inv, tx, ty, tz, kx, ky, kz, ux, uy, uz, sx, sy, sz)
    q, q_below = q + here, q_below + far
    below = load(v, (tip - 1) * LANES)
    store_row(w, tip - 1, q_below, normal_below, diag_below, off_below)
    ratio, right = eliminate(w, tip - 1, below, q_below, normal_below, diag_below, off_below, off_last, ratio, right)
    store_row(w, tip, q, normal, diag, zero)
    eliminate(w, tip, speed, q, normal, diag, zero, off_below, ratio, right)


# --- step vi ----------------------------------------------------------------------------------------------------------


@njit(**_JIT)
def integrate(w, nodes, par, v):
    """Step vi. New speeds from the system `joint_forces` left: springs, drag and friction implicit, tridiagonal.

    Friction −μ n v/√(v² + ε²) is solved by Newton within the solve: its slope lagged by a step would be badly wrong
    near stick–slip. A guess that would change sign restarts from rest, from where Newton is monotone. A lane that
    has converged is left alone, so its result does not depend on the lanes beside it. Sliding wires need one step,
    wires about to stick or to let go three to six.
    """
    still_open = load(par, STICK) > 0.0  # all
    iteration = 1
    while True:
        still_open = back_substitute(w, nodes, par, v, still_open, iteration >= NEWTON_PATIENCE)
        if iteration == MAX_NEWTON or not anywhere(still_open):
            break
        iteration += 1
        ratio, right, off_below = spread(0.0), spread(0.0), spread(0.0)
        for i in range(nodes):
            o = i * STRIDE
            off = load(w, o + OFF)
            ratio, right = eliminate(
                w,
                i,
                load(v, i * LANES),
                load(w, o + Q),
                load(w, o + NORMAL),
                load(w, o + DIAG),
                off,
                off_below,
                ratio,
                right,
            )
            off_below = off


@njit(**_JIT)
def back_substitute(w, nodes, par, v, still_open, secant):
    """Speeds of the linearised system, taken as the next guess in the open lanes; returns which are open still.

    With `secant` the next linearisation is the chord through rest, which converges from anywhere, if slowly.
    """
    stick2 = load(par, STICK) * load(par, STICK)
    worst, above = spread(0.0), spread(0.0)
    for i in range(nodes - 1, -1, -1):
        o = i * STRIDE
        new = load(w, o + RIGHT) - load(w, o + RATIO) * above
        above = new
        old, g_old, slope_old = load(v, i * LANES), load(w, o + G), load(w, o + G_SLOPE)
        rubs = load(w, o + NORMAL) > 0.0
        if secant:
            guess = new
            inv = rsqrt(guess * guess + stick2)
            g, slope = guess * inv, inv
            error = absolute(g - g_old - slope_old * (guess - old))
        else:
            crossed = rubs & (old * new < 0.0)
            guess = where(crossed, 0.0, new)
            inv = rsqrt(guess * guess + stick2)
            g, slope = guess * inv, stick2 * (inv * inv * inv)
            error = where(crossed, 1.0, absolute(g - g_old - slope_old * (guess - old)))
        worst = maximum(worst, where(rubs, error, 0.0))
        store(v, i * LANES, where(still_open, guess, old))
        store(w, o + G, where(still_open, g, g_old))
        store(w, o + G_SLOPE, where(still_open, slope, slope_old))
    return still_open & (worst > NEWTON_TOLERANCE)


@njit(**_JIT)
def friction_of_speed(w, nodes, par, v):
    """g = v/√(v² + ε²), friction being −μ n g, and its slope at the present speeds."""
    stick2 = load(par, STICK) * load(par, STICK)
    for i in range(nodes):
        speed = load(v, i * LANES)
        inv = rsqrt(speed * speed + stick2)
        store(w, i * STRIDE + G, speed * inv)
        store(w, i * STRIDE + G_SLOPE, stick2 * (inv * inv * inv))


# --- step viii and the servo ------------------------------------------------------------------------------------------


@njit(**_JIT)
def update(nodes, s, v, half):
    """Step viii. Every joint drifts for half a step at its present speed."""
    for i in range(nodes):
        store(s, i * LANES, load(s, i * LANES) + half * load(v, i * LANES))


@njit(**_JIT)
def servo(dofs, is_turn, q, command, lane, mean, h):
    """Each degree of freedom moves towards its command at its limited speed, a turn the short way round.

    `mean` receives where it was on average over `h`, with which the magnet acts: a servo that arrives within the step
    would otherwise make it first order. Returns how far they moved, summed.
    """
    travel = spread(0.0)
    for d in range(is_turn.shape[0]):
        o, at = d * DOF_STRIDE, load(q, d * LANES)
        goal = load(row(command, d), lane)
        if is_turn[d]:
            gap = goal - at
            gap = gap - 2.0 * math.pi * floor(gap * (0.5 / math.pi) + 0.5)
        else:
            gap = minimum(maximum(goal, load(dofs, o + LOW)), load(dofs, o + HIGH)) - at
        most = load(dofs, o + SPEED) * h
        moved = minimum(maximum(gap, -most), most)
        store(mean, d * LANES, at + moved * (1.0 - 0.5 * minimum(absolute(gap) / most, 1.0)))
        store(q, d * LANES, at + moved)
        travel = travel + absolute(moved)
    return travel


@njit(**_JIT)
def control_period(
    blocks, substeps, h, spare, par, wire, rig, magnets, dofs, is_turn, clouds, cloud_of, sources, table,
    s, v, q, command, trace, out, work,
):  # fmt: skip
    """Move `blocks` through one control period of `substeps` steps of `h` s, in place.

    A step is a drift of half its length, a kick with the forces found there, and another drift: second order in h,
    and symplectic where no friction or drag takes energy out. `trace` receives the tip's arc length at the start and
    after every step; `out` ends with the loads of the final state.
    """
    nodes, dof = s.shape[1] // LANES, is_turn.shape[0]
    tip, above = (nodes - 1) * LANES, nodes * STRIDE
    w, o = part(work, 0, above), part(work, above, OUT_SIZE)
    angles, mean = part(work, above + OUT_SIZE, dof * LANES), part(work, above + OUT_SIZE + dof * LANES, dof * LANES)
    for block in blocks:
        p, wires, magnet, limits = row(par, block), row(wire, block), row(magnets, block), row(dofs, block)
        arcs, speeds, lane = row(s, block), row(v, block), block * LANES
        for d in range(dof):
            store(angles, d * LANES, load(row(q, d), lane))
        friction_of_speed(w, nodes, p, speeds)
        store(row(trace, 0), lane, load(arcs, tip))
        peak_lateral, peak_wall, sum_wall, travel = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
        for step in range(substeps):
            update(nodes, arcs, speeds, 0.5 * h)
            travel = travel + servo(limits, is_turn, angles, command, lane, mean, h)
            tip_pose(arcs, p, table, o)
            magnetic_force(block, p, rig, magnet, clouds, cloud_of, sources, mean, o)
            joint_forces(w, nodes, spare, wires, p, table, o, arcs, speeds, h)
            integrate(w, nodes, p, speeds)
            update(nodes, arcs, speeds, 0.5 * h)
            store(row(trace, step + 1), lane, load(arcs, tip))
            peak_lateral = maximum(peak_lateral, load(o, LATERAL))
            peak_wall = maximum(peak_wall, load(o, WALL))
            sum_wall = sum_wall + load(o, WALL)
        tip_pose(arcs, p, table, o)
        magnetic_force(block, p, rig, magnet, clouds, cloud_of, sources, angles, o)
        store(o, PEAK_LATERAL, peak_lateral)
        store(o, PEAK_WALL, peak_wall)
        store(o, MEAN_WALL, sum_wall / substeps)
        store(o, TRAVEL, travel)
        for d in range(dof):
            store(row(q, d), lane, load(angles, d * LANES))
        publish(o, arcs, speeds, OF_ALL, out, lane)


@njit(**_INLINE)
def publish(o, s, v, count, out, lane):
    """The first `count` results of a block to their places among all lanes'."""
    store(o, TIP_S, load(s, len(s) - LANES))
    store(o, TIP_V, load(v, len(v) - LANES))
    for field in range(count):
        store(row(out, field), lane, load(o, field * LANES))


@njit(**_JIT)
def refresh(blocks, par, rig, magnets, clouds, cloud_of, sources, table, s, v, q, out, work):
    """The loads of the present state: needed once whenever a state was set from outside."""
    dof = q.shape[0]
    o, angles = part(work, 0, OUT_SIZE), part(work, OUT_SIZE, dof * LANES)
    for block in blocks:
        p, arcs, lane = row(par, block), row(s, block), block * LANES
        for d in range(dof):
            store(angles, d * LANES, load(row(q, d), lane))
        tip_pose(arcs, p, table, o)
        magnetic_force(block, p, rig, row(magnets, block), clouds, cloud_of, sources, angles, o)
        publish(o, arcs, row(v, block), OF_STATE, out, lane)


@njit(**_JIT)
def lay_at_rest(lanes, tip_arclength, wire, par, table, s, v, work):
    """Lay wires out behind their tips with every segment's chord at its rest length, at rest.

    lanes : (n,) which; they are packed `LANES` at a time, wherever they stand, since few are reset at once
    tip_arclength : (n,) m
    """
    nodes = s.shape[1] // LANES
    tip = (nodes - 1) * LANES
    p, arcs = part(work, 0, PAR_SIZE), part(work, PAR_SIZE, nodes * LANES)
    rest = part(work, PAR_SIZE + nodes * LANES, nodes * LANES)
    for first in range(0, len(lanes), LANES):
        count = min(LANES, len(lanes) - first)
        for l in range(LANES):
            lane = lanes[first + min(l, count - 1)]
            block, own = lane // LANES, lane % LANES
            for field in range(0, PAR_SIZE, LANES):
                p[field + l] = par[block, field + own]
            for i in range(nodes):
                rest[i * LANES + l] = wire[block, i * WIRE_STRIDE + REST + own]
            arcs[tip + l] = tip_arclength[first + min(l, count - 1)]
        nx, ny, nz, _, _, _, _, _, _ = snap(load(arcs, tip), p, table)
        for i in range(nodes - 2, -1, -1):
            length = load(rest, i * LANES)
            at = load(arcs, (i + 1) * LANES) - length
            for _ in range(5):  # Newton on chord = rest length; it starts within a few per cent and is quadratic
                px, py, pz, tx, ty, tz, _, _, _ = snap(at, p, table)
                dx, dy, dz = nx - px, ny - py, nz - pz
                chord = sqrt(dot(dx, dy, dz, dx, dy, dz))
                at = at + (chord - length) / maximum(dot(dx, dy, dz, tx, ty, tz) / chord, 0.2)
            store(arcs, i * LANES, at)
            nx, ny, nz, _, _, _, _, _, _ = snap(at, p, table)
        for l in range(count):
            lane = lanes[first + l]
            block, own = lane // LANES, lane % LANES
            for i in range(nodes):
                s[block, i * LANES + own] = arcs[i * LANES + l]
                v[block, i * LANES + own] = 0.0


def workspace_size(nodes: int, dof: int) -> int:
    """Length of the float64 workspace one thread needs for wires of `nodes` nodes and commands of `dof` numbers."""
    return nodes * STRIDE + OUT_SIZE + 2 * dof * LANES
