"""Elimination of a node and of a segment's spin from the band: block LDLᵀ, each node once its rows are complete.

The window holds three nodes, a below, b here and c above, and for wires that twist the spin s of the segment a–b and t
of b–c. Names of two letters are the Hessian's blocks, g… the right-hand sides.
"""

from __future__ import annotations

from ...compiled import inlined
from ..lanes import LANES, reciprocal, store
from .layout import RIGHT, S1, S2, S3, SPIN_RIGHT, U1, U2, W1, W2
from .vectors import (
    apply6,
    back9,
    dot,
    inverse6,
    less_back,
    less_gram,
    less_product,
    lifted,
    outer,
    plus,
    product6,
    square,
    store3,
    sub,
    sub6,
    sub9,
    times,
)


@inlined
def store9(array, at, m):
    store3(array, at, (m[0], m[1], m[2]))
    store3(array, at + 3 * LANES, (m[3], m[4], m[5]))
    store3(array, at + 6 * LANES, (m[6], m[7], m[8]))


@inlined
def eliminate_node(work, o, floor, aa, ab, ac, ga, bb, bc, cc, gb, gc):
    """Take node a out of the system; returns its inverse block, the rest, and gᵀ a⁻¹ g."""
    inv = inverse6(aa, floor)
    w1, w2, y = product6(inv, ab), product6(inv, ac), apply6(inv, ga)
    store9(work, o + W1, w1)
    store9(work, o + W2, w2)
    store3(work, o + RIGHT, y)
    bb, bc, cc = less_gram(bb, ab, w1), less_product(bc, ab, w2), less_gram(cc, ac, w2)
    gb, gc = less_back(gb, ab, y), less_back(gc, ac, y)
    return inv, y, bb, bc, cc, gb, gc, dot(ga, y)


@inlined
def node_from_spins(work, o, inv, y, ab, ac, sa, ta, ss, st, tt, sb, sc, tb, tc, gs, gt):
    """What taking node a out leaves of the spins' rows; sa, ta : the spins' mixed blocks with a, and so on."""
    u1, u2 = apply6(inv, sa), apply6(inv, ta)
    store3(work, o + U1, u1)
    store3(work, o + U2, u2)
    ss, st, tt = ss - dot(sa, u1), st - dot(sa, u2), tt - dot(ta, u2)
    gs, gt = gs - dot(sa, y), gt - dot(ta, y)
    sb, sc = sub(sb, back9(ab, u1)), sub(sc, back9(ac, u1))
    tb, tc = sub(tb, back9(ab, u2)), sub(tc, back9(ac, u2))
    return ss, st, tt, sb, sc, tb, tc, gs, gt


@inlined
def eliminate_spin(work, o, floor, ss, st, tt, sb, sc, tb, tc, gs, gt, bb, bc, cc, gb, gc):
    """Take spin s out of the system; returns the rest, and g² / s."""
    inv = reciprocal(lifted(ss, floor))
    s1, s2, s3, y = times(inv, sb), times(inv, sc), inv * st, inv * gs
    store(work, o + SPIN_RIGHT, y)
    store3(work, o + S1, s1)
    store3(work, o + S2, s2)
    store(work, o + S3, s3)
    bb, bc, cc = sub6(bb, square(inv, sb)), sub9(bc, outer(inv, sb, sc)), sub6(cc, square(inv, sc))
    gb, gc = plus(gb, -y, sb), plus(gc, -y, sc)
    return tt - st * s3, plus(tb, -s3, sb), plus(tc, -s3, sc), gt - s3 * gs, bb, bc, cc, gb, gc, gs * y
