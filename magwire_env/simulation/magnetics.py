"""Step i of Algorithm 1: force and field of the rig's magnets and coils at a dipole (paper Section III-A).

Shared by all wire models: nothing here knows how the wire moves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import inlined, kernel
from .lanes import load, row, rsqrt, sin_cos, spread
from .vectors import add, dot, load3, scaled, sub, turned

__all__ = ["MAGNET", "SLOT", "SOURCE", "Magnetics", "Slot", "rig_pull"]


class Magnet(NamedTuple):
    """Fields of a magnet or coil: ``magnets[block, m, field, lane]``.

    centre_x … centre_z : m, with every slide at 0
    strength : T·m³, μ0 m/4π; of a coil its uniform field, T/A
    gradient : T/(m·A), of a coil
    """

    centre_x: int
    centre_y: int
    centre_z: int
    strength: int
    gradient: int


class Source(NamedTuple):
    """Fields of one dipole of a cloud, in the magnet's frame: ``clouds[number, k, field, lane]``.

    x, y, z : m
    weight : share of the magnet's moment; a cloud's weights sum to 1
    """

    x: int
    y: int
    z: int
    weight: int


class Slot(NamedTuple):
    """Fields of ``slots[m]``: which command entry moves what of magnet or coil m, −1 for none.

    turn_1, turn_2 : the two turns, the second about a world axis after the first
    slide_x … slide_z : the slides
    axis_1, axis_2 : the turns' axes, 0 to 2
    current, coil_axis : of a coil
    """

    turn_1: int
    turn_2: int
    slide_x: int
    slide_y: int
    slide_z: int
    axis_1: int
    axis_2: int
    current: int
    coil_axis: int


MAGNET = Magnet(*range(len(Magnet._fields)))
SOURCE = Source(*range(len(Source._fields)))
SLOT = Slot(*range(len(Slot._fields)))


class Magnetics(NamedTuple):
    """The rig as kernels read it.

    slots : (m, `Slot`) int64
    magnets : (blocks, m, `Magnet`, LANES)
    clouds : (tables, k, `Source`, LANES)
    cloud_of : (blocks, m) int64, which table is a block's
    sources : (m,) int64, how many of its rows count
    """

    slots: np.ndarray
    magnets: np.ndarray
    clouds: np.ndarray
    cloud_of: np.ndarray
    sources: np.ndarray


@kernel
def sum_sources(cloud, sources, r, t):
    """Force on a unit moment along `t` at `r`, and field, of dipoles all along the magnet's z (Section III-A)."""
    fx, fy, fz, bx, by, bz = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    tx, ty, tz = t
    for k in range(sources):
        dx, dy, dz = sub(r, (load(cloud, k, SOURCE.x), load(cloud, k, SOURCE.y), load(cloud, k, SOURCE.z)))
        inv = rsqrt(dot((dx, dy, dz), (dx, dy, dz)))
        inv2 = inv * inv
        w3 = load(cloud, k, SOURCE.weight) * inv2 * inv
        w5 = 3.0 * w3 * inv2
        along = dot(t, (dx, dy, dz))
        e = w5 * (tz - 5.0 * along * dz * inv2)
        f = w5 * dz
        fx = fx + f * tx + e * dx
        fy = fy + f * ty + e * dy
        fz = fz + f * tz + e * dz + w5 * along
        bx = bx + f * dx
        by = by + f * dy
        bz = bz + f * dz - w3
    return (fx, fy, fz), (bx, by, bz)


@kernel
def pull_of_magnet(slots, m, magnet, cloud, sources, q, position, direction):
    """Force on a unit moment and field of one magnet, over its strength, in the world's frame.

    The place is brought into the magnet's frame by the inverse turns, the last first, and the results back.
    """
    rx, ry, rz = sub(position, load3(magnet, MAGNET.centre_x))
    if slots[m, SLOT.slide_x] >= 0:
        rx = rx - load(q, slots[m, SLOT.slide_x])
    if slots[m, SLOT.slide_y] >= 0:
        ry = ry - load(q, slots[m, SLOT.slide_y])
    if slots[m, SLOT.slide_z] >= 0:
        rz = rz - load(q, slots[m, SLOT.slide_z])
    r, t = (rx, ry, rz), direction
    s1, c1, s2, c2 = spread(0.0), spread(1.0), spread(0.0), spread(1.0)
    if slots[m, SLOT.turn_2] >= 0:
        s2, c2 = sin_cos(load(q, slots[m, SLOT.turn_2]))
        r, t = turned(slots[m, SLOT.axis_2], -s2, c2, r), turned(slots[m, SLOT.axis_2], -s2, c2, t)
    if slots[m, SLOT.turn_1] >= 0:
        s1, c1 = sin_cos(load(q, slots[m, SLOT.turn_1]))
        r, t = turned(slots[m, SLOT.axis_1], -s1, c1, r), turned(slots[m, SLOT.axis_1], -s1, c1, t)
    f, b = sum_sources(cloud, sources, r, t)
    if slots[m, SLOT.turn_1] >= 0:
        f, b = turned(slots[m, SLOT.axis_1], s1, c1, f), turned(slots[m, SLOT.axis_1], s1, c1, b)
    if slots[m, SLOT.turn_2] >= 0:
        f, b = turned(slots[m, SLOT.axis_2], s2, c2, f), turned(slots[m, SLOT.axis_2], s2, c2, b)
    return f, b


@inlined
def pull_of_coil(slots, m, coil, q, position, direction):
    """Force on a unit moment and field of a pair of coils, in the world's frame."""
    rx, ry, rz = sub(position, load3(coil, MAGNET.centre_x))
    tx, ty, tz = direction
    current = load(q, slots[m, SLOT.current])
    uniform, half = load(coil, MAGNET.strength) * current, 0.5 * load(coil, MAGNET.gradient) * current
    fx, fy, fz = -half * tx, -half * ty, -half * tz
    bx, by, bz = -half * rx, -half * ry, -half * rz
    if slots[m, SLOT.coil_axis] == 0:
        return (fx + 3.0 * half * tx, fy, fz), (bx + uniform + 3.0 * half * rx, by, bz)
    if slots[m, SLOT.coil_axis] == 1:
        return (fx, fy + 3.0 * half * ty, fz), (bx, by + uniform + 3.0 * half * ry, bz)
    return (fx, fy, fz + 3.0 * half * tz), (bx, by, bz + uniform + 3.0 * half * rz)


@inlined
def rig_pull(block, rig, q, position, direction):
    """Force on a unit moment along `direction` at `position`, N/(A·m²), and field, T, of all magnets and coils.

    rig : `Magnetics`
    q : (dof, LANES), where the rig's degrees of freedom are
    """
    f = spread(0.0), spread(0.0), spread(0.0)
    b = spread(0.0), spread(0.0), spread(0.0)
    for m in range(rig.slots.shape[0]):
        magnet = row(row(rig.magnets, block), m)
        if rig.slots[m, SLOT.current] >= 0:
            g, h = pull_of_coil(rig.slots, m, magnet, q, position, direction)
            f, b = add(f, g), add(b, h)
            continue
        cloud = row(rig.clouds, rig.cloud_of[block, m])
        g, h = pull_of_magnet(rig.slots, m, magnet, cloud, rig.sources[m], q, position, direction)
        strength = load(magnet, MAGNET.strength)
        f, b = add(f, scaled(strength, g)), add(b, scaled(strength, h))
    return f, b
