"""Three-vectors and 3 × 3 matrices of `Lanes`, as tuples that Numba keeps in registers.

A vector is (x, y, z); a symmetric matrix (xx, xy, xz, yy, yz, zz); a matrix its nine numbers row by row.
"""

from __future__ import annotations

from ...compiled import inlined
from ..lanes import LANES, load, maximum, reciprocal, spread, store, where


@inlined
def load3(array, at):
    return load(array, at), load(array, at + LANES), load(array, at + 2 * LANES)


@inlined
def store3(array, at, v):
    store(array, at, v[0])
    store(array, at + LANES, v[1])
    store(array, at + 2 * LANES, v[2])


@inlined
def zero3():
    return spread(0.0), spread(0.0), spread(0.0)


@inlined
def zero6():
    return spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)


@inlined
def zero9():
    o = spread(0.0)
    return o, o, o, o, o, o, o, o, o


@inlined
def add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def sub(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(s, a):
    return s * a[0], s * a[1], s * a[2]


@inlined
def plus(a, s, b):
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@inlined
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def select3(mask, a, b):
    return where(mask, a[0], b[0]), where(mask, a[1], b[1]), where(mask, a[2], b[2])


@inlined
def select6(mask, a, b):
    return (
        where(mask, a[0], b[0]), where(mask, a[1], b[1]), where(mask, a[2], b[2]), where(mask, a[3], b[3]),
        where(mask, a[4], b[4]), where(mask, a[5], b[5]),
    )  # fmt: skip


@inlined
def add6(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@inlined
def sub6(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5]


@inlined
def plus6(a, s, b):
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2], a[3] + s * b[3], a[4] + s * b[4], a[5] + s * b[5]


@inlined
def diagonal(a, s):
    """Symmetric a + s I."""
    return a[0] + s, a[1], a[2], a[3] + s, a[4], a[5] + s


@inlined
def square(s, a):
    """Symmetric s a aᵀ."""
    x, y, z = s * a[0], s * a[1], s * a[2]
    return x * a[0], x * a[1], x * a[2], y * a[1], y * a[2], z * a[2]


@inlined
def pair(s, a, b):
    """Symmetric s (a bᵀ + b aᵀ)."""
    x, y, z = s * a[0], s * a[1], s * a[2]
    return (
        2.0 * x * b[0], x * b[1] + y * b[0], x * b[2] + z * b[0], 2.0 * y * b[1], y * b[2] + z * b[1], 2.0 * z * b[2]
    )  # fmt: skip


@inlined
def add9(a, b):
    return (
        a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7],
        a[8] + b[8],
    )  # fmt: skip


@inlined
def sub9(a, b):
    return (
        a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5], a[6] - b[6], a[7] - b[7],
        a[8] - b[8],
    )  # fmt: skip


@inlined
def full(s, a):
    """The nine numbers of s times the symmetric a."""
    xx, xy, xz, yy, yz, zz = s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5]
    return xx, xy, xz, xy, yy, yz, xz, yz, zz


@inlined
def outer(s, a, b):
    """s a bᵀ."""
    x, y, z = s * a[0], s * a[1], s * a[2]
    return x * b[0], x * b[1], x * b[2], y * b[0], y * b[1], y * b[2], z * b[0], z * b[1], z * b[2]


@inlined
def symmetric(a):
    """The symmetric part's double, a + aᵀ, as six numbers."""
    return 2.0 * a[0], a[1] + a[3], a[2] + a[6], 2.0 * a[4], a[5] + a[7], 2.0 * a[8]


@inlined
def apply6(a, v):
    """Symmetric a times v."""
    return (
        a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
        a[1] * v[0] + a[3] * v[1] + a[4] * v[2],
        a[2] * v[0] + a[4] * v[1] + a[5] * v[2],
    )


@inlined
def apply9(a, v):
    return (
        a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
        a[3] * v[0] + a[4] * v[1] + a[5] * v[2],
        a[6] * v[0] + a[7] * v[1] + a[8] * v[2],
    )


@inlined
def back9(a, v):
    """aᵀ v."""
    return (
        a[0] * v[0] + a[3] * v[1] + a[6] * v[2],
        a[1] * v[0] + a[4] * v[1] + a[7] * v[2],
        a[2] * v[0] + a[5] * v[1] + a[8] * v[2],
    )


@inlined
def product6(a, b):
    """Symmetric a times the matrix b."""
    x0, x1, x2 = apply6(a, (b[0], b[3], b[6]))
    y0, y1, y2 = apply6(a, (b[1], b[4], b[7]))
    z0, z1, z2 = apply6(a, (b[2], b[5], b[8]))
    return x0, y0, z0, x1, y1, z1, x2, y2, z2


@inlined
def less_gram(s, a, w):
    """Symmetric s − aᵀ w, for w = (symmetric) a."""
    return (
        s[0] - a[0] * w[0] - a[3] * w[3] - a[6] * w[6],
        s[1] - a[0] * w[1] - a[3] * w[4] - a[6] * w[7],
        s[2] - a[0] * w[2] - a[3] * w[5] - a[6] * w[8],
        s[3] - a[1] * w[1] - a[4] * w[4] - a[7] * w[7],
        s[4] - a[1] * w[2] - a[4] * w[5] - a[7] * w[8],
        s[5] - a[2] * w[2] - a[5] * w[5] - a[8] * w[8],
    )


@inlined
def less_product(m, a, w):
    """m − aᵀ w."""
    return (
        m[0] - a[0] * w[0] - a[3] * w[3] - a[6] * w[6],
        m[1] - a[0] * w[1] - a[3] * w[4] - a[6] * w[7],
        m[2] - a[0] * w[2] - a[3] * w[5] - a[6] * w[8],
        m[3] - a[1] * w[0] - a[4] * w[3] - a[7] * w[6],
        m[4] - a[1] * w[1] - a[4] * w[4] - a[7] * w[7],
        m[5] - a[1] * w[2] - a[4] * w[5] - a[7] * w[8],
        m[6] - a[2] * w[0] - a[5] * w[3] - a[8] * w[6],
        m[7] - a[2] * w[1] - a[5] * w[4] - a[8] * w[7],
        m[8] - a[2] * w[2] - a[5] * w[5] - a[8] * w[8],
    )


@inlined
def less_back(v, a, y):
    """v − aᵀ y."""
    return sub(v, back9(a, y))


@inlined
def lifted(d, floor):
    """A pivot made positive: itself, or its size where it is not, but at least `floor`."""
    return where(d > floor, d, maximum(-d, floor))


@inlined
def inverse6(a, floor):
    """Inverse of a symmetric matrix by LDLᵀ, with pivots made positive (see `lifted`)."""
    d1 = reciprocal(lifted(a[0], floor))
    l21, l31 = a[1] * d1, a[2] * d1
    d2 = reciprocal(lifted(a[3] - l21 * a[1], floor))
    c32 = a[4] - l31 * a[1]
    l32 = c32 * d2
    zz = reciprocal(lifted(a[5] - l31 * a[2] - l32 * c32, floor))
    yz = -l32 * zz
    yy = d2 - l32 * yz
    xz = -l21 * yz - l31 * zz
    xy = -l21 * yy - l31 * yz
    xx = d1 - l21 * xy - l31 * xz
    return xx, xy, xz, yy, yz, zz
