"""Vectors of three numbers, or of three `Lanes`, as tuples: inside kernels they live in registers."""

from __future__ import annotations

from ..compiled import inlined
from .lanes import load, rsqrt, store

__all__ = ["add", "cross", "dot", "load3", "scaled", "store3", "sub", "turned", "unit"]


@inlined
def load3(array, i):
    """The vector in rows `i` to `i` + 2 of a block's array."""
    return load(array, i), load(array, i + 1), load(array, i + 2)


@inlined
def store3(array, i, a):
    store(array, i, a[0])
    store(array, i + 1, a[1])
    store(array, i + 2, a[2])


@inlined
def add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def sub(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def scaled(factor, a):
    return factor * a[0], factor * a[1], factor * a[2]


@inlined
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def unit(a):
    """The direction of a vector of `Lanes`."""
    return scaled(rsqrt(dot(a, a)), a)


@inlined
def turned(axis, s, c, a):
    """`a` turned about a world axis by the angle of sine `s` and cosine `c`."""
    if axis == 0:
        return a[0], c * a[1] - s * a[2], s * a[1] + c * a[2]
    if axis == 1:
        return c * a[0] + s * a[2], a[1], c * a[2] - s * a[0]
    return c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]
