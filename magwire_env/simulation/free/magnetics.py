"""Fields of the rig at the wire's magnets: the field, its gradient, and its second derivative along a direction."""

from __future__ import annotations

from ...compiled import inlined, kernel
from ..lanes import LANES, load, row, rsqrt, sin_cos, spread, store
from .vectors import apply9, back9, dot, load3, plus, store3, sub, times, zero3, zero6

# rig[m]: dof of turn 1, turn 2, slide x, y, z (−1 if absent), the axes of the two turns, dof of a coil and its axis
TURN_SLOTS, COIL_DOF, COIL_AXIS, SLOTS = 2, 7, 8, 9

# Given of a magnet: magnet[m * MAGNET_STRIDE + field + lane]. STRENGTH is μ0 m/4π or a coil's uniform field an ampere
CX, CY, CZ, STRENGTH, SLOPE_OF_COIL = (i * LANES for i in range(5))
MAGNET_STRIDE = 5 * LANES

# Sources of a cloud: cloud[k * SOURCE_STRIDE + field + lane]
SX, SY, SZ, WEIGHT = (i * LANES for i in range(4))
SOURCE_STRIDE = 4 * LANES

# Where a magnet is: pose[m * POSE_STRIDE + field + lane]; TURNED: the nine numbers of its rotation; a coil: its current
PLACE, TURNED, CURRENT = 0, 3 * LANES, 12 * LANES
POSE_STRIDE = 13 * LANES


@inlined
def about(axis, s, c, v):
    """The vector turned about a world axis by the angle of sine s and cosine c."""
    x, y, z = v
    if axis == 0:
        return x, c * y - s * z, s * y + c * z
    if axis == 1:
        return c * x + s * z, y, c * z - s * x
    return c * x - s * y, s * x + c * y, z


@kernel
def place_magnets(rig, magnets, q, pose):
    """Poses of all magnets with their degrees of freedom at `q`."""
    for m in range(rig.shape[0]):
        o = m * POSE_STRIDE
        x, y, z = load3(magnets, m * MAGNET_STRIDE + CX)
        if rig[m, COIL_DOF] >= 0:
            store(pose, o + CURRENT, load(q, rig[m, COIL_DOF] * LANES))
        else:
            if rig[m, TURN_SLOTS] >= 0:
                x = x + load(q, rig[m, TURN_SLOTS] * LANES)
            if rig[m, TURN_SLOTS + 1] >= 0:
                y = y + load(q, rig[m, TURN_SLOTS + 1] * LANES)
            if rig[m, TURN_SLOTS + 2] >= 0:
                z = z + load(q, rig[m, TURN_SLOTS + 2] * LANES)
            one, nil = spread(1.0), spread(0.0)
            a, b, c = (one, nil, nil), (nil, one, nil), (nil, nil, one)
            if rig[m, 0] >= 0:
                s, k = sin_cos(load(q, rig[m, 0] * LANES))
                a, b, c = about(rig[m, 5], s, k, a), about(rig[m, 5], s, k, b), about(rig[m, 5], s, k, c)
            if rig[m, 1] >= 0:
                s, k = sin_cos(load(q, rig[m, 1] * LANES))
                a, b, c = about(rig[m, 6], s, k, a), about(rig[m, 6], s, k, b), about(rig[m, 6], s, k, c)
            for i in range(3):
                store(pose, o + TURNED + 3 * i * LANES, a[i])
                store(pose, o + TURNED + (3 * i + 1) * LANES, b[i])
                store(pose, o + TURNED + (3 * i + 2) * LANES, c[i])
        store3(pose, o + PLACE, (x, y, z))


@inlined
def load9(array, at):
    a, b, c = load3(array, at), load3(array, at + 3 * LANES), load3(array, at + 6 * LANES)
    return a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]


@kernel
def sum_sources(cloud, sources, r, t):
    """Field b, gradient g (six numbers) and ∇∇(t·b) of dipoles along z, all in the magnet's frame."""
    bx, by, bz = zero3()
    gxx, gxy, gxz, gyy, gyz, gzz = zero6()
    hxx, hxy, hxz, hyy, hyz, hzz = zero6()
    for k in range(sources):
        o = k * SOURCE_STRIDE
        x, y, z = r[0] - load(cloud, o + SX), r[1] - load(cloud, o + SY), r[2] - load(cloud, o + SZ)
        inv = rsqrt(dot((x, y, z), (x, y, z)))
        i2 = inv * inv
        w3 = load(cloud, o + WEIGHT) * i2 * inv
        w5 = 3.0 * w3 * i2
        w7 = 5.0 * w5 * i2
        w9 = 7.0 * w7 * i2
        f = w5 * z
        bx, by, bz = bx + f * x, by + f * y, bz + f * z - w3
        e = w7 * z
        gxx, gxy, gxz = gxx + (f - e * x * x), gxy - e * x * y, gxz + (w5 * x - e * x * z)
        gyy, gyz, gzz = gyy + (f - e * y * y), gyz + (w5 * y - e * y * z), gzz + (3.0 * f - e * z * z)
        a = t[0] * x + t[1] * y + t[2] * z
        p = w9 * z * a - w7 * t[2]
        m = w5 * t[2] - e * a
        u, s = w7 * a, e
        # ∇∇: p d dᵀ + m I − u (z dᵀ + d zᵀ) − s (t dᵀ + d tᵀ) + w5 (z tᵀ + t zᵀ)
        hxx = hxx + (p * x * x + m - 2.0 * s * t[0] * x)
        hxy = hxy + (p * x * y - s * (t[0] * y + t[1] * x))
        hxz = hxz + (p * x * z - u * x - s * (t[0] * z + t[2] * x) + w5 * t[0])
        hyy = hyy + (p * y * y + m - 2.0 * s * t[1] * y)
        hyz = hyz + (p * y * z - u * y - s * (t[1] * z + t[2] * y) + w5 * t[1])
        hzz = hzz + (p * z * z + m - 2.0 * u * z - 2.0 * s * t[2] * z + 2.0 * w5 * t[2])
    return (bx, by, bz), (gxx, gxy, gxz, gyy, gyz, gzz), (hxx, hxy, hxz, hyy, hyz, hzz)


@inlined
def outward(r, s):
    """r s rᵀ of a symmetric s."""
    x = (
        r[0] * s[0] + r[1] * s[1] + r[2] * s[2],
        r[0] * s[1] + r[1] * s[3] + r[2] * s[4],
        r[0] * s[2] + r[1] * s[4] + r[2] * s[5],
    )
    y = (
        r[3] * s[0] + r[4] * s[1] + r[5] * s[2],
        r[3] * s[1] + r[4] * s[3] + r[5] * s[4],
        r[3] * s[2] + r[4] * s[4] + r[5] * s[5],
    )
    z = (
        r[6] * s[0] + r[7] * s[1] + r[8] * s[2],
        r[6] * s[1] + r[7] * s[3] + r[8] * s[4],
        r[6] * s[2] + r[7] * s[4] + r[8] * s[5],
    )
    a, b, c = (r[0], r[1], r[2]), (r[3], r[4], r[5]), (r[6], r[7], r[8])
    return dot(x, a), dot(x, b), dot(x, c), dot(y, b), dot(y, c), dot(z, c)


@kernel
def field_at(block, par_field, rig, magnets, clouds, cloud_of, sources, pose, x, t):
    """Field b, its gradient and ∇∇(t·b) at x, of all magnets and coils and of the uniform field `par_field`."""
    b, g, h = par_field, zero6(), zero6()
    for m in range(rig.shape[0]):
        o = m * POSE_STRIDE
        r = sub(x, load3(pose, o + PLACE))
        if rig[m, COIL_DOF] >= 0:
            current = load(pose, o + CURRENT)
            uniform = load(magnets, m * MAGNET_STRIDE + STRENGTH) * current
            half = 0.5 * load(magnets, m * MAGNET_STRIDE + SLOPE_OF_COIL) * current
            b = plus(b, -half, r)
            long = 3.0 * half
            if rig[m, COIL_AXIS] == 0:
                b = (b[0] + uniform + long * r[0], b[1], b[2])
                g = (g[0] + 2.0 * half, g[1], g[2], g[3] - half, g[4], g[5] - half)
            elif rig[m, COIL_AXIS] == 1:
                b = (b[0], b[1] + uniform + long * r[1], b[2])
                g = (g[0] - half, g[1], g[2], g[3] + 2.0 * half, g[4], g[5] - half)
            else:
                b = (b[0], b[1], b[2] + uniform + long * r[2])
                g = (g[0] - half, g[1], g[2], g[3] - half, g[4], g[5] + 2.0 * half)
            continue
        turn = load9(pose, o + TURNED)
        strength = load(magnets, m * MAGNET_STRIDE + STRENGTH)
        bm, gm, hm = sum_sources(row(clouds, cloud_of[block, m]), sources[m], back9(turn, r), back9(turn, t))
        b = plus(b, 1.0, times(strength, apply9(turn, bm)))
        gw, hw = outward(turn, gm), outward(turn, hm)
        g = (
            g[0] + strength * gw[0], g[1] + strength * gw[1], g[2] + strength * gw[2],
            g[3] + strength * gw[3], g[4] + strength * gw[4], g[5] + strength * gw[5],
        )  # fmt: skip
        h = (
            h[0] + strength * hw[0], h[1] + strength * hw[1], h[2] + strength * hw[2],
            h[3] + strength * hw[3], h[4] + strength * hw[4], h[5] + strength * hw[5],
        )  # fmt: skip
    return b, g, h
