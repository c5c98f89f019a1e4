"""Contact of a point of the wire with the wall, and Coulomb friction there.

The lumen is a tube about a centreline, given as rows of cubics (see `layout.TABLE_STRIDE`). Its signed distance is
φ = R − d, d the distance from the nearest point of the centreline, its foot; beyond the centreline's ends the tube is
closed by a half sphere. A negative R is an obstacle of that radius, met from outside.

A wire of radius r is in contact where r > φ. The wall pushes back with k (r − φ) a metre of wire.
"""

from __future__ import annotations

from ...compiled import inlined, kernel
from ..lanes import (
    LANES,
    anywhere,
    floor,
    gather,
    load,
    maximum,
    minimum,
    reciprocal,
    rsqrt,
    spread,
    sqrt,
    store,
    where,
)
from .bricks import depth_in_bricks
from .layout import ALONG, FOUND, GRID_NX, KEPT, LAGGED, ROW, TABLE_STRIDE
from .vectors import (
    add6,
    apply6,
    cross,
    diagonal,
    dot,
    load3,
    plus,
    plus6,
    select3,
    square,
    store3,
    sub,
    times,
    zero3,
    zero6,
)

NOT_CONTACT = 1e-15
"""m, guards a division at the centreline."""


@inlined
def cubic(table, row, field, u):
    a, b = gather(table, row, field), gather(table, row, field + 1)
    c, d = gather(table, row, field + 2), gather(table, row, field + 3)
    return a + u * (b + u * (c + u * d)), b + u * (2.0 * c + 3.0 * u * d), 2.0 * c + 6.0 * u * d


@inlined
def tube(table, foot, at, spacing, x, moves, taken, work, load_at):
    """Depth −φ of a point in the wall, its gradient, and the inverse of its distance from its foot.

    Also returns 1 where the wall closes round the point, −1 where it is an obstacle, and the centreline's direction.
    The foot moves along by a Newton step, from the iterate's foot where the last trial was refused (and, in lanes where
    `moves` holds not, stays there): the depth is stationary in it, so its error is second order in what is left.
    """
    row = where(taken, load(foot, at + ROW), load(work, load_at + KEPT))
    u = where(taken, load(foot, at + ALONG), load(work, load_at + KEPT + LANES))
    store(work, load_at + KEPT, row)
    store(work, load_at + KEPT + LANES, u)
    first = TABLE_STRIDE * row
    cx, tx, kx = cubic(table, first, 0, u)
    cy, ty, ky = cubic(table, first, 4, u)
    cz, tz, kz = cubic(table, first, 8, u)
    r, t, k = sub(x, (cx, cy, cz)), (tx, ty, tz), (kx, ky, kz)
    tt = dot(t, t)
    ahead = dot(r, t) / maximum(tt - dot(r, k), 0.2)
    least, most = gather(table, first, 16), gather(table, first, 17)
    goal = minimum(maximum(u + ahead, least), most)
    ahead = goal - u
    # The centreline there, to the third order of the cubic.
    jx, jy, jz = gather(table, first, 3), gather(table, first, 7), gather(table, first, 11)
    half, cube = 0.5 * ahead * ahead, ahead * ahead * ahead
    r = plus(plus(plus(r, -ahead, t), -half, k), -cube, (jx, jy, jz))
    t = plus(plus(t, ahead, k), 6.0 * half, (jx, jy, jz))
    k = plus(k, 6.0 * ahead, (jx, jy, jz))
    d2 = dot(r, r)
    d = sqrt(d2)
    inv = reciprocal(maximum(d, NOT_CONTACT))
    out = times(inv, r)
    ra, rb = gather(table, first, 12), gather(table, first, 13)
    rc, rd = gather(table, first, 14), gather(table, first, 15)
    radius = ra + goal * (rb + goal * (rc + goal * rd))
    widening = rb + goal * (2.0 * rc + 3.0 * goal * rd)
    sign = where(radius > 0.0, spread(1.0), spread(-1.0))
    ends = (goal <= least) | (goal >= most)
    slope = where(ends, 0.0, widening / maximum(dot(t, t) - dot(r, k), 0.2))
    gradient = plus(times(sign, out), -slope, t)
    # On to the next row, where there is one.
    moved = minimum(maximum(floor(goal / spacing), -1.0), 1.0)
    step = where(moves, 1.0, 0.0) * where(
        moved < 0.0, gather(table, first, 18), where(moved > 0.0, gather(table, first, 19), 0.0)
    )
    goes = (step > 0.5) | (step < -0.5)
    store(foot, at + ROW, row + step)
    store(foot, at + ALONG, where(moves, where(goes, goal - moved * spacing, goal), u))
    return sign * d - radius, gradient, inv, sign, t


@kernel
def touch(
    table,
    grid,
    par,
    foot,
    at,
    load_at,
    work,
    x,
    x0,
    t,
    radius,
    spun,
    stiffness,
    friction,
    slow,
    spacing,
    exact,
    taken,
    moves,
    foresees,
):
    """Wall and friction at one contact point.

    table, grid : the wall, as rows of a tube or, in lanes that have bricks, as bricks
    x, x0 : the point now and at the step's start; t : the wire's direction; spun : rad turned since then
    stiffness : N/m, the wall's times the length the point stands for; slow : m, the stick speed times the step
    taken : whether the last trial became the iterate, whose load is then the friction's
    moves : whether the lane moves at all; else its foot stays, as that of a lane with bricks does
    foresees : where a point that the trial before pressed into the wall counts as one that the wall holds

    Returns the energies with the lagged and with the present load, the normal force, the gradient, the Hessian, the
    gradient by the spin, its own second derivative and its mixed ones with x; the part of the normal force that the
    iterate has not, and what foreseen contacts add to the gradient.
    """
    depth, normal, inv, sign, along = spread(0.0), zero3(), spread(0.0), spread(1.0), t
    bend = zero6()
    in_bricks = load(par, GRID_NX) > 0.0
    in_tube = load(par, GRID_NX) <= 0.0
    if anywhere(in_tube):
        moves = moves & in_tube
        stays = where(moves, 0.0, 1.0) > 0.5
        depth, normal, inv, sign, along = tube(table, foot, at, spacing, x, moves, taken | stays, work, load_at)
    if len(grid) > 0 and anywhere(in_bricks):
        deep, towards, bend = depth_in_bricks(grid, par, x)
        depth, normal = where(in_bricks, deep, depth), select3(in_bricks, towards, normal)
        inv, sign, along = where(in_bricks, 0.0, inv), where(in_bricks, 1.0, sign), select3(in_bricks, t, along)
    depth = depth + radius
    inside = depth > 0.0
    lagged = where(taken, load(work, load_at + FOUND), load(work, load_at + LAGGED))
    lag_n = select3(taken, load3(work, load_at + FOUND + LANES), load3(work, load_at + LAGGED + LANES))
    store(work, load_at + LAGGED, lagged)
    store3(work, load_at + LAGGED + LANES, lag_n)
    force, energy = spread(0.0), spread(0.0)
    gradient, hessian = zero3(), zero6()
    old, new, by_spin, spin_spin, spin_x = spread(0.0), spread(0.0), spread(0.0), spread(0.0), zero3()
    foreseen, pull = foresees & (load(work, load_at + FOUND) > 0.0) & (depth <= 0.0), zero3()
    if anywhere(foreseen):
        held = where(foreseen, stiffness, 0.0)
        pull, hessian = times(held * depth, normal), square(held, normal)
    if anywhere(inside | (lagged > 0.0)):
        pressed = where(inside, stiffness, 0.0)
        force = pressed * depth
        energy = 0.5 * force * depth
        gradient = times(force, normal)
        round_ = where(sign > 0.0, force * inv, 0.0)
        hessian = add6(hessian, diagonal(square(pressed - round_, normal), round_))
        hessian = plus6(hessian, -round_, square(1.0 / maximum(dot(along, along), 1e-30), along))
        hessian = plus6(hessian, where(in_bricks, exact * force, 0.0), bend)
        old, new = energy, energy
        if anywhere(friction > 0.0):
            n = times(rsqrt(maximum(dot(normal, normal), 1e-30)), normal)
            store3(work, load_at + FOUND + LANES, n)
            moved = sub(x, x0)
            v = plus(moved, spun * radius, cross(t, lag_n))
            v = plus(v, -dot(v, lag_n), lag_n)
            old = old + friction * lagged * (sqrt(dot(v, v) + slow * slow) - slow)
            ring = times(radius, cross(t, n))
            v = plus(moved, spun, ring)
            v = plus(v, -dot(v, n), n)
            size2 = dot(v, v) + slow * slow
            size_inv = rsqrt(size2)
            size = size2 * size_inv
            new = new + friction * force * (size - slow)
            rub = friction * force * size_inv
            gradient = plus(gradient, rub, v)
            h = plus6(diagonal(square(-rub, n), rub), -exact * rub * size_inv * size_inv, square(1.0, v))
            hessian = add6(hessian, h)
            by_spin = rub * dot(v, ring)
            spin_x = apply6(h, ring)
            spin_spin = dot(spin_x, ring)
    store(work, load_at + FOUND, force)
    fresh = where(lagged > 0.0, 0.0, force)
    return old, new, force, gradient, hessian, by_spin, spin_spin, spin_x, fresh, pull
