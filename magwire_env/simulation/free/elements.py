"""Energies of the discrete elastic rod with their exact gradients and Hessians (Bergou et al. 2008, 2010).

A joint lies between the segment vectors e and f with unit directions u, w and inverse lengths p, q. Its curvature
binormal is κb = 2 u × w/(1 + u·w), of size 2 tan(φ/2). Derivatives are returned by e and f; a clamp is a segment of
fixed direction, that is, one with p = 0.

`exact` is 1 for the exact Hessian and 0 for a positive one, which is what is left where the exact one is no use.
"""

from __future__ import annotations

from ...compiled import inlined
from ..lanes import absolute, maximum, reciprocal, sin_cos, sqrt, where
from .vectors import (
    add,
    cross,
    diagonal,
    dot,
    full,
    outer,
    pair,
    plus,
    plus6,
    square,
    times,
)

FOLDED = 1e-6
"""Least 1 + cos φ of a joint: at φ = 180° the energy would be infinite."""


@inlined
def stretched(stiffness, rest, length, w, inv, exact):
    """Energy ½ E A/L (|e| − L)² of a segment, its gradient by e and Hessian; stiffness is E A/L."""
    tension = stiffness * (length - rest)
    energy = 0.5 * tension * (length - rest)
    across = tension * inv
    across = where(exact > 0.5, across, maximum(across, 0.0))
    return energy, tension, diagonal(square(stiffness - across, w), across)


@inlined
def bent(k, u, p, w, q, exact):
    """Energy ½ k |κb|² = 2 k (1 − c)/(1 + c), c = u·w: energy, gradients by e and f, Hessians ee, ef, ff."""
    c = dot(u, w)
    r = reciprocal(maximum(1.0 + c, FOLDED))
    d = plus(w, -1.0, u)
    energy = k * dot(d, d) * r  # 1 − c = ½ |w − u|², without loss of digits
    first = 4.0 * k * r * r  # −dE/dc
    second = 2.0 * first * r
    aw, bw = plus(w, -c, u), plus(u, -c, w)
    a, b = times(p, aw), times(q, bw)
    round_ = where(exact > 0.5, c, 1.0)
    slope = first * exact
    pp, qq, pq = first * p * p, first * q * q, first * p * q
    hee = diagonal(plus6(square(second, a), -pp * round_, square(1.0, u)), pp * round_)
    hee = plus6(hee, slope * p * p, pair(1.0, u, aw))
    hff = diagonal(plus6(square(second, b), -qq * round_, square(1.0, w)), qq * round_)
    hff = plus6(hff, slope * q * q, pair(1.0, w, bw))
    m = outer(second, a, b)
    n = full(pq, diagonal(plus6(square(1.0, w), 1.0, square(1.0, u)), -1.0))
    o = outer(pq * c, u, w)
    hef = (
        m[0] + n[0] - o[0], m[1] + n[1] - o[1], m[2] + n[2] - o[2],
        m[3] + n[3] - o[3], m[4] + n[4] - o[4], m[5] + n[5] - o[5],
        m[6] + n[6] - o[6], m[7] + n[7] - o[7], m[8] + n[8] - o[8],
    )  # fmt: skip
    return energy, times(-first, a), times(-first, b), hee, hef, hff


@inlined
def angle_of(s, c):
    """The angle in (−π, π) of sine s and cosine c, s² + c² = 1: tan of its eighth by halving, then a series."""
    t = s * reciprocal(maximum(1.0 + c, 1e-12))
    t = t * reciprocal(1.0 + sqrt(1.0 + t * t))
    t = t * reciprocal(1.0 + sqrt(1.0 + t * t))
    z = t * t
    series = 1.0 + z * (-1 / 3 + z * (1 / 5 + z * (-1 / 7 + z * (1 / 9 + z * (-1 / 11 + z * (1 / 13 + z * (
        -1 / 15 + z * (1 / 17 + z * (-1 / 19 + z * (1 / 21 + z * (-1 / 23 + z * (1 / 25 + z * (-1 / 27 + z * (
            1 / 29 + z * (-1 / 31 + z * (1 / 33))))))))))))))))  # fmt: skip
    return 8.0 * t * series


@inlined
def transported(m, u, w):
    """The director m of a segment along u, carried to the direction w without twist."""
    r = reciprocal(maximum(1.0 + dot(u, w), FOLDED))
    return plus(m, -r * dot(m, w), add(u, w))


@inlined
def turned(m, t, angle):
    """The director m turned about its segment's direction t."""
    s, c = sin_cos(angle)
    return plus(times(c, m), s, cross(t, m))


@inlined
def natural(k1, k2, t, m):
    """The natural κb that a director carries, k1 (t × m) − k2 m, and its derivative by a spin."""
    n = cross(t, m)
    return plus(times(k1, n), -k2, m), plus(times(-k1, m), -k2, n)


@inlined
def twisted(k, u, p, m, w, q, n, exact):
    """Energy ½ k τ² of the twist τ between the directors m of e and n of f.

    Returns the energy, dE/dτ, the vector κb/2 (dτ/de = p κb/2, dτ/df = q κb/2; dτ by the spins of e and f is −1 and
    +1), and the second derivatives of τ times dE/dτ: ee, ef, ff.
    """
    c = dot(u, w)
    r = reciprocal(maximum(1.0 + c, FOLDED))
    carried = plus(m, -r * dot(m, w), add(u, w))
    tau = angle_of(dot(cross(carried, n), w), dot(carried, n))
    torque = k * tau
    half = times(r, cross(u, w))
    tangent = times(r, add(u, w))
    twice = times(2.0, half)
    second = torque * exact
    hee = pair(-0.25 * second * p * p, twice, add(u, tangent))
    hff = pair(-0.25 * second * q * q, twice, add(w, tangent))
    s = 0.5 * second * p * q
    v = times(2.0 * r * s, u)
    o = outer(-s, twice, tangent)
    hef = (o[0], o[1] - v[2], o[2] + v[1], o[3] + v[2], o[4], o[5] - v[0], o[6] - v[1], o[7] + v[0], o[8])
    return 0.5 * torque * tau, torque, half, hee, hef, hff


@inlined
def precurved(k, u, p, w, q, a, b, a1, b1, exact):
    """The part −k S, S = κb·(a + b)/2, by which a natural curvature departs from `bent`.

    a, b : natural κb of the joint carried by the directors of e and f; a1, b1 : their derivatives by the spins
    Returns −k S, its gradients by e, f and the two spins; Hessians ee, ef, ff; e and f by each spin; spin by spin.
    """
    c = dot(u, w)
    r = reciprocal(maximum(1.0 + c, FOLDED))
    kb = times(2.0 * r, cross(u, w))
    both, tangent = add(a, b), times(r, add(u, w))
    tilde = times(r, both)
    s = 0.5 * dot(kb, both)
    by_u, by_w = cross(w, tilde), cross(tilde, u)  # parts of dS/de and dS/df
    ge = times(-k * p, plus(by_u, -s, tangent))
    gf = times(-k * q, plus(by_w, -s, tangent))
    sa, sb = 0.5 * dot(kb, a1), 0.5 * dot(kb, b1)
    ka, kb_ = -k * sa, -k * sb
    hea = times(-k * p, plus(times(r, cross(w, a1)), -sa, tangent))
    heb = times(-k * p, plus(times(r, cross(w, b1)), -sb, tangent))
    hfa = times(-k * q, plus(times(r, cross(a1, u)), -sa, tangent))
    hfb = times(-k * q, plus(times(r, cross(b1, u)), -sb, tangent))
    haa, hbb = 0.5 * k * dot(kb, a), 0.5 * k * dot(kb, b)
    haa, hbb = where(exact > 0.5, haa, absolute(haa)), where(exact > 0.5, hbb, absolute(hbb))
    z = -k * exact
    hea, heb, hfa, hfb = times(exact, hea), times(exact, heb), times(exact, hfa), times(exact, hfb)
    zee, zff, zef = z * p * p, z * q * q, z * p * q
    tt = square(2.0 * s, tangent)
    hee = plus6(plus6(tt, -1.0, pair(1.0, by_u, tangent)), 0.25, pair(1.0, kb, a))
    hee = plus6(diagonal(hee, -s * r), s * r, square(1.0, u))
    hff = plus6(plus6(tt, -1.0, pair(1.0, by_w, tangent)), 0.25, pair(1.0, kb, b))
    hff = plus6(diagonal(hff, -s * r), s * r, square(1.0, w))
    hee, hff = times6(zee, hee), times6(zff, hff)
    t2 = full(1.0, diagonal(tt, -s * r))
    o1, o2, o3 = outer(s * r, u, w), outer(1.0, by_u, tangent), outer(1.0, tangent, by_w)
    x, y, t = tilde
    hef = (
        zef * (t2[0] - o1[0] - o2[0] - o3[0]), zef * (t2[1] - o1[1] - o2[1] - o3[1] + t),
        zef * (t2[2] - o1[2] - o2[2] - o3[2] - y), zef * (t2[3] - o1[3] - o2[3] - o3[3] - t),
        zef * (t2[4] - o1[4] - o2[4] - o3[4]), zef * (t2[5] - o1[5] - o2[5] - o3[5] + x),
        zef * (t2[6] - o1[6] - o2[6] - o3[6] + y), zef * (t2[7] - o1[7] - o2[7] - o3[7] - x),
        zef * (t2[8] - o1[8] - o2[8] - o3[8]),
    )  # fmt: skip
    return -k * s, ge, gf, ka, kb_, hee, hef, hff, hea, heb, hfa, hfb, haa, hbb


@inlined
def times6(s, a):
    return s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5]


@inlined
def perpendicular(m, w):
    """The unit vector nearest to m across the unit vector w."""
    m = plus(m, -dot(m, w), w)
    return times(reciprocal(maximum(sqrt(dot(m, m)), 1e-12)), m)


@inlined
def aligned(m, t, inv, b, g, x, exact):
    """Energy −m t·B(x) of a moment along a segment of direction t, from the field b, its gradient g and x = ∇∇(t·B).

    Returns the energy, gradients by the segment vector and by the place, Hessians segment–segment, segment–place (nine
    numbers), place–place.
    """
    along = dot(t, b)
    across = plus(b, -along, t)
    energy = -m * along
    ge = times(-m * inv, across)
    force = (
        g[0] * t[0] + g[1] * t[1] + g[2] * t[2],
        g[1] * t[0] + g[3] * t[1] + g[4] * t[2],
        g[2] * t[0] + g[4] * t[1] + g[5] * t[2],
    )
    gx = times(-m, force)
    mii = m * inv * inv
    rise = where(exact > 0.5, along, maximum(along, 0.0))
    hee = diagonal(plus6(times6(mii * exact, pair(1.0, t, across)), -mii * rise, square(1.0, t)), mii * rise)
    wide = full(1.0, g)
    o = outer(1.0, t, force)
    s = -m * inv * exact
    hex_ = (
        s * (wide[0] - o[0]), s * (wide[1] - o[1]), s * (wide[2] - o[2]),
        s * (wide[3] - o[3]), s * (wide[4] - o[4]), s * (wide[5] - o[5]),
        s * (wide[6] - o[6]), s * (wide[7] - o[7]), s * (wide[8] - o[8]),
    )  # fmt: skip
    return energy, ge, gx, hee, hex_, times6(-m * exact, x)
