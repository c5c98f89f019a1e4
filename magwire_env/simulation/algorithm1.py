"""Algorithm 1 of the paper as one batched kernel, in arc-length coordinates.

The unit of work is a block of `LANES` wires. Every array keeps the lane as its last index, so each inner loop below
runs over the lanes of a block with a fixed trip count and compiles to vector code. A node's quantities stand in one
flat workspace, `w[node * STRIDE + FIELD + lane]`, because the compiler then sees constant distances between them and
needs no aliasing checks. All kernels stand in this one module: Numba's cache does not notice changes in others.

The paper's steps, and where they are here (`control_period` calls them in order):

i.    magnetic force on the tip dipole                      `magnetic_force`
ii.   integrate the tip magnet                              it is the chain's last node: solved with the others in vi
iii.  couple it to the rest of the wire                     by the last segment's spring, in iv
iv.   spring forces between segments                        `spring_forces`
v.    bending forces at the joints                          `bending_forces`
vi.   integrate the joints                                  `integrate` (linearly implicit)
vii.  project the forces on the tract's tangent             in i, iv and v, as each force is formed
viii. update the joints' positions                          `update`
ix.   snap the joints onto the spline                       `snap_all`: exact, since a joint *is* an arc length
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LANES = 16
"""Wires in a block."""

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

# Magnet parameters: magnets[m * MAGNET_STRIDE + field + lane]; STRENGTH is μ0 m / 4π
CX, CY, CZ, STRENGTH = (i * LANES for i in range(4))
MAGNET_STRIDE = 4 * LANES

# Degrees of freedom: dofs[d * DOF_STRIDE + field + lane]
SPEED, LOW, HIGH = (i * LANES for i in range(3))
DOF_STRIDE = 3 * LANES

# Sources of a cloud, in the magnet's frame: cloud[k * SOURCE_STRIDE + field + lane]; weights sum to 1
SX, SY, SZ, WEIGHT = (i * LANES for i in range(4))
SOURCE_STRIDE = 4 * LANES

# Results: out[field + lane]
OUT_FIELDS = (
    "FX", "FY", "FZ", "BX", "BY", "BZ", "DRIVE", "LATERAL", "TORQUE", "WALL",
    "TIP_X", "TIP_Y", "TIP_Z", "TAN_X", "TAN_Y", "TAN_Z", "CURV_X", "CURV_Y", "CURV_Z",
    "PEAK_LATERAL", "PEAK_WALL", "MEAN_WALL",
)  # fmt: skip
(
    FX, FY, FZ, BX, BY, BZ, DRIVE, LATERAL, TORQUE, WALL,
    TIP_X, TIP_Y, TIP_Z, TAN_X, TAN_Y, TAN_Z, CURV_X, CURV_Y, CURV_Z,
    PEAK_LATERAL, PEAK_WALL, MEAN_WALL,
) = (i * LANES for i in range(len(OUT_FIELDS)))  # fmt: skip
OUT_SIZE = len(OUT_FIELDS) * LANES

# Workspace of a node: w[node * STRIDE + field + lane]; U*, INV_LEN, A, B belong to the segment above the node
(
    S, V, PX, PY, PZ, TX, TY, TZ, UX, UY, UZ, INV_LEN, A, B, LOAD_X, LOAD_Y, LOAD_Z, Q, NORMAL, DIAG, OFF,
    V_NEW, G, G_SLOPE, RATIO, RIGHT, KX, KY, KZ, BACK,
) = (i * LANES for i in range(30))  # fmt: skip
STRIDE = 30 * LANES

# Magnet pose while its force is summed: pose[field + lane]
ROT, REL_X, REL_Y, REL_Z, TIP_TX, TIP_TY, TIP_TZ = (i * LANES for i in (0, 9, 10, 11, 12, 13, 14))
ACC_F, ACC_B = 15 * LANES, 18 * LANES
POSE_SIZE = 21 * LANES

TURN_SLOTS, SLOTS = 2, 7
"""rig[m] holds: dof index of turn 1, turn 2, slide x, y, z (−1 if absent), then the axes of the two turns."""

NEWTON_PATIENCE = 15
"""Newton steps before the slower secant takes over."""

MAX_NEWTON = 60
NEWTON_TOLERANCE = 1e-5
"""Largest error of a node's friction after its linearisation, as a share of μ n."""

_JIT = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}


@njit(**_JIT)
def snap(w, node, par, table):
    """Position and tangent of `node` at its arc length."""
    o = node * STRIDE
    for l in range(LANES):
        s = w[o + S + l]
        s -= par[PERIOD + l] * np.floor(s * par[INV_PERIOD + l])
        row = min(max(np.floor(s * par[INV_SPACING + l]) + 1.0, 0.0), par[TABLE_LAST + l])
        u = s - (row - 1.0) * par[SPACING + l]
        c = 12 * np.int64(row + par[TABLE_ROW + l])
        w[o + PX + l] = table[c] + u * (table[c + 3] + u * (table[c + 6] + u * table[c + 9]))
        w[o + PY + l] = table[c + 1] + u * (table[c + 4] + u * (table[c + 7] + u * table[c + 10]))
        w[o + PZ + l] = table[c + 2] + u * (table[c + 5] + u * (table[c + 8] + u * table[c + 11]))
        w[o + TX + l] = table[c + 3] + u * (2.0 * table[c + 6] + 3.0 * u * table[c + 9])
        w[o + TY + l] = table[c + 4] + u * (2.0 * table[c + 7] + 3.0 * u * table[c + 10])
        w[o + TZ + l] = table[c + 5] + u * (2.0 * table[c + 8] + 3.0 * u * table[c + 11])


@njit(**_JIT)
def curve_at(w, node, par, table):
    """Curvature vector κ n of the tract at `node`."""
    o = node * STRIDE
    for l in range(LANES):
        s = w[o + S + l]
        s -= par[PERIOD + l] * np.floor(s * par[INV_PERIOD + l])
        row = min(max(np.floor(s * par[INV_SPACING + l]) + 1.0, 0.0), par[TABLE_LAST + l])
        u = s - (row - 1.0) * par[SPACING + l]
        c = 12 * np.int64(row + par[TABLE_ROW + l])
        w[o + KX + l] = 2.0 * table[c + 6] + 6.0 * u * table[c + 9]
        w[o + KY + l] = 2.0 * table[c + 7] + 6.0 * u * table[c + 10]
        w[o + KZ + l] = 2.0 * table[c + 8] + 6.0 * u * table[c + 11]


@njit(**_JIT)
def tip_pose(w, tip, par, table, out):
    """The tip's position, tangent and curvature vector, for the magnetic force and for the observer."""
    curve_at(w, tip, par, table)
    o = tip * STRIDE
    for field in range(3):
        c = field * LANES
        for l in range(LANES):
            out[TIP_X + c + l] = w[o + PX + c + l]
            out[TAN_X + c + l] = w[o + TX + c + l]
            out[CURV_X + c + l] = w[o + KX + c + l]


@njit(**_JIT)
def turn_about(pose, axis, angle, at):
    """Turn the magnet's frame (columns of the matrix at ROT) about a world axis by angle[at + lane]."""
    i, j = 3 * LANES * ((axis + 1) % 3), 3 * LANES * ((axis + 2) % 3)
    for l in range(LANES):
        # sin and cos by Taylor series on a quarter of the wrapped angle, then doubled twice: no library call, so the
        # loop vectorises; error below 4e-16.
        x = angle[at + l]
        x = 0.25 * (x - 2.0 * math.pi * np.rint(x * (0.5 / math.pi)))
        z = x * x
        sin = x * (
            1 - z / 6 * (1 - z / 20 * (1 - z / 42 * (1 - z / 72 * (1 - z / 110 * (1 - z / 156 * (1 - z / 210))))))
        )
        vers = z / 2 * (1 - z / 12 * (1 - z / 30 * (1 - z / 56 * (1 - z / 90 * (1 - z / 132 * (1 - z / 182))))))
        for _ in range(2):
            sin, vers = 2.0 * sin * (1.0 - vers), 2.0 * vers * (2.0 - vers)
        cos = 1.0 - vers
        for col in range(3):
            a, b = pose[ROT + i + col * LANES + l], pose[ROT + j + col * LANES + l]
            pose[ROT + i + col * LANES + l] = cos * a - sin * b
            pose[ROT + j + col * LANES + l] = sin * a + cos * b


@njit(**_JIT)
def place_magnet(m, rig, magnets, q, out, pose):
    """The magnet's frame from its degrees of freedom, and the tip's position and tangent seen from it."""
    for row in range(3):
        for col in range(3):
            for l in range(LANES):
                pose[ROT + (3 * row + col) * LANES + l] = 1.0 if row == col else 0.0
    for slot in range(TURN_SLOTS):
        if rig[m, slot] >= 0:
            turn_about(pose, rig[m, 5 + slot], q, rig[m, slot] * LANES)
    base = m * MAGNET_STRIDE
    for axis in range(3):
        to = REL_X + axis * LANES
        for l in range(LANES):
            pose[to + l] = out[TIP_X + axis * LANES + l] - magnets[base + CX + axis * LANES + l]
        dof = rig[m, TURN_SLOTS + axis]
        if dof >= 0:
            for l in range(LANES):
                pose[to + l] -= q[dof * LANES + l]
    for l in range(LANES):
        x, y, z = pose[REL_X + l], pose[REL_Y + l], pose[REL_Z + l]
        tx, ty, tz = out[TAN_X + l], out[TAN_Y + l], out[TAN_Z + l]
        for col in range(3):
            rx = pose[ROT + col * LANES + l]
            ry = pose[ROT + (3 + col) * LANES + l]
            rz = pose[ROT + (6 + col) * LANES + l]
            pose[REL_X + col * LANES + l] = rx * x + ry * y + rz * z
            pose[TIP_TX + col * LANES + l] = rx * tx + ry * ty + rz * tz
            pose[ACC_F + col * LANES + l] = 0.0
            pose[ACC_B + col * LANES + l] = 0.0


@njit(**_JIT)
def sum_sources(cloud, sources, pose):
    """Force on a unit tip moment and field, over the cloud's dipoles, all along the magnet's z (Section III-A)."""
    for k in range(sources):
        o = k * SOURCE_STRIDE
        for l in range(LANES):
            dx = pose[REL_X + l] - cloud[o + SX + l]
            dy = pose[REL_Y + l] - cloud[o + SY + l]
            dz = pose[REL_Z + l] - cloud[o + SZ + l]
            tx, ty, tz = pose[TIP_TX + l], pose[TIP_TY + l], pose[TIP_TZ + l]
            inv2 = 1.0 / (dx * dx + dy * dy + dz * dz)
            w3 = cloud[o + WEIGHT + l] * inv2 * np.sqrt(inv2)
            w5 = 3.0 * w3 * inv2
            along = tx * dx + ty * dy + tz * dz
            e = w5 * (tz - 5.0 * along * dz * inv2)
            f = w5 * dz
            pose[ACC_F + l] += f * tx + e * dx
            pose[ACC_F + LANES + l] += f * ty + e * dy
            pose[ACC_F + 2 * LANES + l] += f * tz + e * dz + w5 * along
            pose[ACC_B + l] += f * dx
            pose[ACC_B + LANES + l] += f * dy
            pose[ACC_B + 2 * LANES + l] += f * dz - w3


@njit(**_JIT)
def magnetic_force(par, rig, magnets, clouds, cloud_of, sources, q, out, pose):
    """Step i. Force and field of every magnet at the tip, the drive along the tract, and the loads on the wall.

    `force` drives by F·t, the paper's projection; `wrench` by F·t + m κ n·B, the gradient of the energy −m t·B.
    """
    for l in range(LANES):
        for c in range(6):
            out[FX + c * LANES + l] = 0.0
    for m in range(rig.shape[0]):
        place_magnet(m, rig, magnets, q, out, pose)
        sum_sources(clouds[cloud_of[m]], sources[m], pose)
        base = m * MAGNET_STRIDE
        for l in range(LANES):
            strength = magnets[base + STRENGTH + l]
            for row in range(3):
                f = 0.0
                b = 0.0
                for col in range(3):
                    turn = pose[ROT + (3 * row + col) * LANES + l]
                    f += turn * pose[ACC_F + col * LANES + l]
                    b += turn * pose[ACC_B + col * LANES + l]
                out[FX + row * LANES + l] += strength * par[TIP_MOMENT + l] * f
                out[BX + row * LANES + l] += strength * b
    for l in range(LANES):
        fx, fy, fz = out[FX + l], out[FY + l], out[FZ + l]
        bx, by, bz = out[BX + l], out[BY + l], out[BZ + l]
        tx, ty, tz = out[TAN_X + l], out[TAN_Y + l], out[TAN_Z + l]
        m = par[TIP_MOMENT + l]
        along = fx * tx + fy * ty + fz * tz
        bend = out[CURV_X + l] * bx + out[CURV_Y + l] * by + out[CURV_Z + l] * bz
        out[DRIVE + l] = along + par[WRENCH + l] * m * bend
        gx, gy, gz = fx - along * tx, fy - along * ty, fz - along * tz
        out[LATERAL + l] = np.sqrt(gx * gx + gy * gy + gz * gz)
        cx, cy, cz = ty * bz - tz * by, tz * bx - tx * bz, tx * by - ty * bx
        out[TORQUE + l] = m * np.sqrt(cx * cx + cy * cy + cz * cz)
        out[WALL + l] = out[LATERAL + l] + 2.0 * out[TORQUE + l] * par[INV_LEVER + l]


@njit(**_JIT)
def spring_forces(w, nodes, wire, par, out, h):
    """Step iv, projected (vii). Tension of each segment, its implicit stiffness, and each node's lateral load."""
    tip = nodes - 1
    for i in range(nodes):
        o = i * STRIDE
        for l in range(LANES):
            m = wire[i * WIRE_STRIDE + MASS + l]
            w[o + LOAD_X + l] = m * par[GX + l]
            w[o + LOAD_Y + l] = m * par[GY + l]
            w[o + LOAD_Z + l] = m * par[GZ + l]
            w[o + DIAG + l] = m / h + wire[i * WIRE_STRIDE + DRAG_NEW + l]
    for i in range(tip):
        o, n = i * STRIDE, (i + 1) * STRIDE
        for l in range(LANES):
            dx = w[n + PX + l] - w[o + PX + l]
            dy = w[n + PY + l] - w[o + PY + l]
            dz = w[n + PZ + l] - w[o + PZ + l]
            inv = 1.0 / np.sqrt(max(dx * dx + dy * dy + dz * dz, 1e-24))
            ux, uy, uz = dx * inv, dy * inv, dz * inv
            k = wire[i * WIRE_STRIDE + K_AXIAL + l]
            tension = k * (1.0 / inv - wire[i * WIRE_STRIDE + REST + l])
            a = w[o + TX + l] * ux + w[o + TY + l] * uy + w[o + TZ + l] * uz
            b = w[n + TX + l] * ux + w[n + TY + l] * uy + w[n + TZ + l] * uz
            # The solve adds the stretch of a whole step at the new speeds, counted from the step's start.
            w[o + BACK + l] = 0.5 * h * k * (b * w[n + V + l] - a * w[o + V + l])
            w[o + UX + l], w[o + UY + l], w[o + UZ + l] = ux, uy, uz
            w[o + INV_LEN + l], w[o + A + l], w[o + B + l] = inv, a, b
            w[o + LOAD_X + l] += tension * ux
            w[o + LOAD_Y + l] += tension * uy
            w[o + LOAD_Z + l] += tension * uz
            w[n + LOAD_X + l] -= tension * ux
            w[n + LOAD_Y + l] -= tension * uy
            w[n + LOAD_Z + l] -= tension * uz
            w[o + DIAG + l] += h * k * a * a
            w[n + DIAG + l] += h * k * b * b
            w[o + OFF + l] = -h * k * a * b
    o = tip * STRIDE
    for l in range(LANES):
        w[o + LOAD_X + l] += out[FX + l]
        w[o + LOAD_Y + l] += out[FY + l]
        w[o + LOAD_Z + l] += out[FZ + l]
    for i in range(nodes):
        o = i * STRIDE
        for l in range(LANES):
            x, y, z = w[o + LOAD_X + l], w[o + LOAD_Y + l], w[o + LOAD_Z + l]
            along = x * w[o + TX + l] + y * w[o + TY + l] + z * w[o + TZ + l]
            w[o + Q + l] = along
            w[o + NORMAL + l] = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    o = tip * STRIDE
    for l in range(LANES):
        fx, fy, fz = out[FX + l], out[FY + l], out[FZ + l]
        # Under `wrench` the drive is more than F·t: the tip's couple pushes along the bend too.
        w[o + Q + l] += out[DRIVE + l] - (fx * w[o + TX + l] + fy * w[o + TY + l] + fz * w[o + TZ + l])
        w[o + NORMAL + l] += par[LEVER_FRICTION + l] * (out[WALL + l] - out[LATERAL + l])


@njit(**_JIT)
def bending_forces(w, nodes, wire):
    """Step v, projected (vii). Each joint's energy ½ k φ², φ the angle between its segments.

    The forces need φ/sin φ; with x = 1 − cos φ it is 1 + x/3 + 2x²/15 + 2x³/35 + 8x⁴/315 + …, cut after x⁴: relative
    error 6e-6 at 30°, 4e-4 at 60°; at the 16° of a 10 mm segment in a 36 mm bend below 1e-8.
    """
    for i in range(1, nodes - 1):
        p, o, n = (i - 1) * STRIDE, i * STRIDE, (i + 1) * STRIDE
        for l in range(LANES):
            ax, ay, az = w[p + UX + l], w[p + UY + l], w[p + UZ + l]
            bx, by, bz = w[o + UX + l], w[o + UY + l], w[o + UZ + l]
            cos = ax * bx + ay * by + az * bz
            x = 1.0 - cos
            g = wire[i * WIRE_STRIDE + K_BEND + l]
            g *= 1.0 + x * (1.0 / 3.0 + x * (2.0 / 15.0 + x * (2.0 / 35.0 + x * (8.0 / 315.0))))
            lower, upper = g * w[p + INV_LEN + l], g * w[o + INV_LEN + l]
            after = w[n + TX + l] * ax + w[n + TY + l] * ay + w[n + TZ + l] * az
            before = w[p + TX + l] * bx + w[p + TY + l] * by + w[p + TZ + l] * bz
            a0, b0, a1, b1 = w[p + A + l], w[p + B + l], w[o + A + l], w[o + B + l]
            w[n + Q + l] += upper * (after - cos * b1)
            w[p + Q + l] -= lower * (before - cos * a0)
            w[o + Q + l] += lower * (a1 - cos * b0) - upper * (b0 - cos * a1)


@njit(**_JIT)
def end_bending(w, node, segment, towards, wire):
    """Step v at a wire's end: half a cell of bend between the end segment and the tract's tangent it is locked to.

    With K_END = 2 E I/ℓ this is ½ E I κ² over the half segment that no joint stands for; left out, the bending
    resistance would be felt half a segment late, which was nearly all of the mesh's error. `towards` is +1 at the tip
    (the segment ends there) and −1 at the tail.
    """
    o, g, far = node * STRIDE, segment * STRIDE, (2 * segment + 1 - node) * STRIDE
    for l in range(LANES):
        ux, uy, uz = w[g + UX + l], w[g + UY + l], w[g + UZ + l]
        tx, ty, tz = w[o + TX + l], w[o + TY + l], w[o + TZ + l]
        cos = tx * ux + ty * uy + tz * uz
        x = 1.0 - cos
        k = wire[node * WIRE_STRIDE + K_END + l]
        k *= 1.0 + x * (1.0 / 3.0 + x * (2.0 / 15.0 + x * (2.0 / 35.0 + x * (8.0 / 315.0))))
        per = towards * w[g + INV_LEN + l]
        here = w[o + KX + l] * ux + w[o + KY + l] * uy + w[o + KZ + l] * uz
        fx, fy, fz = w[far + TX + l], w[far + TY + l], w[far + TZ + l]
        w[o + Q + l] += k * (here + per * (1.0 - cos * cos))
        w[far + Q + l] -= k * per * ((fx * tx + fy * ty + fz * tz) - cos * (fx * ux + fy * uy + fz * uz))


@njit(**_JIT)
def integrate(w, nodes, wire, par, lane_open, h):
    """Step vi. Speeds after `h`: axial springs, drag and friction implicit, in a tridiagonal matrix.

    Springs act at the stretch a full step at the new speeds would lead to, which damps the stiff axial modes and
    leaves the slow motion second order.

    Friction −μ n v/√(v² + ε²) is solved by Newton within the solve: its slope lagged by a step would be badly wrong
    near stick–slip. A guess that would change sign restarts from rest, from where Newton is monotone. A lane that
    has converged is left alone, so its result does not depend on the lanes beside it.
    """
    tip = nodes - 1
    for i in range(nodes):
        o = i * STRIDE
        for l in range(LANES):
            w[o + NORMAL + l] *= par[MU + l]  # from here on μ n
            m = wire[i * WIRE_STRIDE + MASS + l]
            w[o + Q + l] += (m / h - wire[i * WIRE_STRIDE + DRAG_OLD + l]) * w[o + V + l]
    for i in range(tip):
        o, n = i * STRIDE, (i + 1) * STRIDE
        for l in range(LANES):
            w[o + Q + l] -= w[o + A + l] * w[o + BACK + l]
            w[n + Q + l] += w[o + B + l] * w[o + BACK + l]
    for l in range(LANES):
        lane_open[l] = 1.0
    still_open = 1.0
    iteration = 0
    while still_open > 0.0 and iteration < MAX_NEWTON:
        iteration += 1
        for l in range(LANES):
            slope = w[NORMAL + l] * w[G_SLOPE + l]
            right = w[Q + l] - w[NORMAL + l] * w[G + l] + slope * w[V + l]
            inv = 1.0 / (w[DIAG + l] + slope)
            w[RATIO + l] = w[OFF + l] * inv
            w[RIGHT + l] = right * inv
        for i in range(1, nodes):
            p, o = (i - 1) * STRIDE, i * STRIDE
            for l in range(LANES):
                slope = w[o + NORMAL + l] * w[o + G_SLOPE + l]
                right = w[o + Q + l] - w[o + NORMAL + l] * w[o + G + l] + slope * w[o + V + l]
                off = w[p + OFF + l]
                inv = 1.0 / (w[o + DIAG + l] + slope - off * w[p + RATIO + l])
                w[o + RATIO + l] = w[o + OFF + l] * inv
                w[o + RIGHT + l] = (right - off * w[p + RIGHT + l]) * inv
        for l in range(LANES):
            w[tip * STRIDE + V_NEW + l] = w[tip * STRIDE + RIGHT + l]
        for i in range(tip - 1, -1, -1):
            o, n = i * STRIDE, (i + 1) * STRIDE
            for l in range(LANES):
                w[o + V_NEW + l] = w[o + RIGHT + l] - w[o + RATIO + l] * w[n + V_NEW + l]
        still_open = accept(w, nodes, par, lane_open, iteration >= NEWTON_PATIENCE)


@njit(**_JIT)
def accept(w, nodes, par, lane_open, secant):
    """Take the solved speeds as the next guess in the open lanes; returns 1 while any lane is still open.

    With `secant` the next linearisation is the chord through rest, which converges from anywhere, if slowly.
    """
    for l in range(LANES):
        lane_open[LANES + l] = 0.0
    for i in range(nodes):
        o = i * STRIDE
        for l in range(LANES):
            old, new, rubs = w[o + V + l], w[o + V_NEW + l], w[o + NORMAL + l] > 0.0
            stick = par[STICK + l]
            crossed = rubs and (not secant) and old * new < 0.0
            guess = 0.0 if crossed else new
            inv2 = 1.0 / (guess * guess + stick * stick)
            inv = np.sqrt(inv2)
            g = guess * inv
            error = abs(g - w[o + G + l] - w[o + G_SLOPE + l] * (guess - old)) if rubs else 0.0
            error = 1.0 if crossed else error
            slope = inv if secant else stick * stick * inv2 * inv
            is_open = lane_open[l] > 0.0
            w[o + V + l] = guess if is_open else old
            w[o + G + l] = g if is_open else w[o + G + l]
            w[o + G_SLOPE + l] = slope if is_open else w[o + G_SLOPE + l]
            lane_open[LANES + l] = max(lane_open[LANES + l], error)
    still_open = 0.0
    for l in range(LANES):
        lane_open[l] = 1.0 if (lane_open[l] > 0.0 and lane_open[LANES + l] > NEWTON_TOLERANCE) else 0.0
        still_open = max(still_open, lane_open[l])
    return still_open


@njit(**_JIT)
def friction_of_speed(w, nodes, par):
    """g = v/√(v² + ε²), friction being −μ n g, and its slope at the present speeds."""
    for i in range(nodes):
        o = i * STRIDE
        for l in range(LANES):
            v, stick = w[o + V + l], par[STICK + l]
            inv2 = 1.0 / (v * v + stick * stick)
            inv = np.sqrt(inv2)
            w[o + G + l] = v * inv
            w[o + G_SLOPE + l] = stick * stick * inv2 * inv


@njit(**_JIT)
def update(w, nodes, half):
    """Step viii. Every joint drifts for half a step at its present speed."""
    for i in range(nodes):
        o = i * STRIDE
        for l in range(LANES):
            w[o + S + l] += half * w[o + V + l]


@njit(**_JIT)
def servo(dofs, is_turn, q, command, mean, h):
    """Each degree of freedom moves towards its command at its limited speed, a turn the short way round.

    `mean` receives where it was on average over `h`, with which the magnet acts: a servo that arrives within the step
    would otherwise make it first order.
    """
    for d in range(is_turn.shape[0]):
        o = d * DOF_STRIDE
        for l in range(LANES):
            i = d * LANES + l
            gap = command[i] - q[i]
            if is_turn[d]:
                gap -= 2.0 * math.pi * np.floor(gap * (0.5 / math.pi) + 0.5)
            else:
                gap = min(max(command[i], dofs[o + LOW + l]), dofs[o + HIGH + l]) - q[i]
            most = dofs[o + SPEED + l] * h
            moved = min(max(gap, -most), most)
            mean[i] = q[i] + moved * (1.0 - 0.5 * min(abs(gap) / most, 1.0))
            q[i] += moved


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
    nodes = s.shape[1] // LANES
    tip = nodes - 1
    w, rest = work[: nodes * STRIDE], work[nodes * STRIDE :]
    pose, lane_open, mean = rest[:POSE_SIZE], rest[POSE_SIZE : POSE_SIZE + 2 * LANES], rest[POSE_SIZE + 2 * LANES :]
    for block in blocks:
        p, o, wires = par[block], out[block], wire[block]
        unpack(w, nodes, s[block], v[block])
        friction_of_speed(w, nodes, p)
        for l in range(LANES):
            trace[block, l] = w[tip * STRIDE + S + l]
            o[PEAK_LATERAL + l], o[PEAK_WALL + l], o[MEAN_WALL + l] = 0.0, 0.0, 0.0
        for step in range(substeps):
            update(w, nodes, 0.5 * h)
            snap_all(w, nodes, p, table)
            servo(dofs[block], is_turn, q[block], command[block], mean, h)
            tip_pose(w, tip, p, table, o)
            magnetic_force(p, rig, magnets[block], clouds, cloud_of[block], sources, mean, o, pose)
            spring_forces(w, nodes, wires, p, o, h)
            bending_forces(w, nodes, wires)
            for tail in range(spare + 1):  # the batch's wires differ by up to `spare` nodes
                curve_at(w, tail, p, table)
                end_bending(w, tail, tail, -1.0, wires)
            end_bending(w, tip, tip - 1, 1.0, wires)
            integrate(w, nodes, wires, p, lane_open, h)
            update(w, nodes, 0.5 * h)
            for l in range(LANES):
                trace[block, (step + 1) * LANES + l] = w[tip * STRIDE + S + l]
                o[PEAK_LATERAL + l] = max(o[PEAK_LATERAL + l], o[LATERAL + l])
                o[PEAK_WALL + l] = max(o[PEAK_WALL + l], o[WALL + l])
                o[MEAN_WALL + l] += o[WALL + l] / substeps
        snap(w, tip, p, table)
        tip_pose(w, tip, p, table, o)
        magnetic_force(p, rig, magnets[block], clouds, cloud_of[block], sources, q[block], o, pose)
        for i in range(nodes):
            for l in range(LANES):
                s[block, i * LANES + l] = w[i * STRIDE + S + l]
                v[block, i * LANES + l] = w[i * STRIDE + V + l]


@njit(**_JIT)
def unpack(w, nodes, s, v):
    """Arc lengths and speeds of a block into the workspace."""
    for i in range(nodes):
        for l in range(LANES):
            w[i * STRIDE + S + l] = s[i * LANES + l]
            w[i * STRIDE + V + l] = v[i * LANES + l]


@njit(**_JIT)
def snap_all(w, nodes, par, table):
    """Step ix. Every joint is on the spline by construction: its place follows from its arc length."""
    for i in range(nodes):
        snap(w, i, par, table)


@njit(**_JIT)
def refresh(blocks, par, rig, magnets, clouds, cloud_of, sources, table, s, v, q, out, work):
    """The loads of the present state: needed once whenever a state was set from outside."""
    nodes = s.shape[1] // LANES
    w, pose = work[: nodes * STRIDE], work[nodes * STRIDE : nodes * STRIDE + POSE_SIZE]
    for block in blocks:
        unpack(w, nodes, s[block], v[block])
        snap(w, nodes - 1, par[block], table)
        tip_pose(w, nodes - 1, par[block], table, out[block])
        magnetic_force(par[block], rig, magnets[block], clouds, cloud_of[block], sources, q[block], out[block], pose)


@njit(**_JIT)
def lay_at_rest(blocks, chosen, tip_arclength, wire, par, table, s, v, work):
    """Lay the `chosen` lanes out behind their tips with every segment's chord at its rest length, at rest."""
    nodes = s.shape[1] // LANES
    w = work[: nodes * STRIDE]
    for block in blocks:
        for l in range(LANES):
            w[(nodes - 1) * STRIDE + S + l] = tip_arclength[block, l]
        snap(w, nodes - 1, par[block], table)
        for i in range(nodes - 2, -1, -1):
            o, n = i * STRIDE, (i + 1) * STRIDE
            for l in range(LANES):
                w[o + S + l] = w[n + S + l] - wire[block, i * WIRE_STRIDE + REST + l]
            for _ in range(5):  # Newton on chord = rest length; it starts within a few per cent and is quadratic
                snap(w, i, par[block], table)
                for l in range(LANES):
                    dx, dy, dz = (
                        w[n + PX + l] - w[o + PX + l],
                        w[n + PY + l] - w[o + PY + l],
                        w[n + PZ + l] - w[o + PZ + l],
                    )
                    chord = np.sqrt(dx * dx + dy * dy + dz * dz)
                    along = (dx * w[o + TX + l] + dy * w[o + TY + l] + dz * w[o + TZ + l]) / chord
                    w[o + S + l] += (chord - wire[block, i * WIRE_STRIDE + REST + l]) / max(along, 0.2)
            snap(w, i, par[block], table)
        for i in range(nodes):
            for l in range(LANES):
                if chosen[block, l]:
                    s[block, i * LANES + l] = w[i * STRIDE + S + l]
                    v[block, i * LANES + l] = 0.0


def workspace_size(nodes: int, dof: int) -> int:
    """Length of the float64 workspace one thread needs for wires of `nodes` nodes and commands of `dof` numbers."""
    return nodes * STRIDE + POSE_SIZE + (2 + dof) * LANES
