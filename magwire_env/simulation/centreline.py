"""The compiled lookup of a centreline: the table of `magwire_env.lumen.curve.Tract`, for a block's lanes and for one.

`Tract` itself has the same lookup in NumPy; `tests/simulation/test_centreline.py` holds the three against each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiled import inlined, kernel
from ..lumen.curve import Tract
from .lanes import floor, gather, load, maximum, minimum

__all__ = ["COURSE", "Course", "ahead", "curve_at", "snap", "tables"]


class Course(NamedTuple):
    """Row numbers that say where a lane's centreline lies in the table of all of them.

    first_row, last_row : its first row in the table; the number of its last one, counted from there
    inv_spacing, spacing : 1/m, m, of arc length a row
    period, inv_period : m, 1/m, the length of a closed centreline; 0 for an open one
    """

    first_row: int
    last_row: int
    inv_spacing: int
    spacing: int
    period: int
    inv_period: int


COURSE = Course(*range(len(Course._fields)))


def tables(tracts: Sequence[Tract]) -> tuple[np.ndarray, np.ndarray]:
    """All tracts' tables one after another, each tract once, flat; and every tract's `Course`, (n, 6)."""
    first: dict[Tract, int] = {}
    rows = 0
    for tract in tracts:
        if tract not in first:
            first[tract] = rows
            rows += len(tract.table)
    courses = []
    for tract in tracts:
        period = tract.length if tract.closed else 0.0
        spacing, inv_period = tract.row_spacing, 1.0 / period if period else 0.0
        courses.append((first[tract], len(tract.table) - 1, 1.0 / spacing, spacing, period, inv_period))
    return np.ascontiguousarray(np.vstack([tract.table for tract in first])).reshape(-1), np.array(courses)


@inlined
def place_in_table(s, course):
    """Where arc length `s` lies: index of its row's first number, and the distance from the row's start."""
    s = s - load(course, COURSE.period) * floor(s * load(course, COURSE.inv_period))
    piece = minimum(maximum(floor(s * load(course, COURSE.inv_spacing)) + 1.0, 0.0), load(course, COURSE.last_row))
    return 12.0 * (piece + load(course, COURSE.first_row)), s - (piece - 1.0) * load(course, COURSE.spacing)


@inlined
def snap(s, course, table):
    """Point, tangent and second derivative p'' at arc length `s` of a block's lanes, each a vector of three.

    The tangent's length is 1 to 1e-5.
    """
    at, u = place_in_table(s, course)
    bx, by, bz = gather(table, at, 3), gather(table, at, 4), gather(table, at, 5)
    cx, cy, cz = gather(table, at, 6), gather(table, at, 7), gather(table, at, 8)
    dx, dy, dz = gather(table, at, 9), gather(table, at, 10), gather(table, at, 11)
    px = gather(table, at, 0) + u * (bx + u * (cx + u * dx))
    py = gather(table, at, 1) + u * (by + u * (cy + u * dy))
    pz = gather(table, at, 2) + u * (bz + u * (cz + u * dz))
    v, w = 3.0 * u, 6.0 * u
    tangent = bx + u * (2.0 * cx + v * dx), by + u * (2.0 * cy + v * dy), bz + u * (2.0 * cz + v * dz)
    return (px, py, pz), tangent, (2.0 * cx + w * dx, 2.0 * cy + w * dy, 2.0 * cz + w * dz)


@inlined
def curve_at(s, course, table):
    """As `snap`, of one lane: `course` (6,), `table` flat."""
    s -= course[COURSE.period] * math.floor(s * course[COURSE.inv_period])
    piece = min(max(math.floor(s * course[COURSE.inv_spacing]) + 1.0, 0.0), course[COURSE.last_row])
    u = s - (piece - 1.0) * course[COURSE.spacing]
    c = 12 * int(piece + course[COURSE.first_row])
    bx, by, bz = table[c + 3], table[c + 4], table[c + 5]
    cx, cy, cz = table[c + 6], table[c + 7], table[c + 8]
    dx, dy, dz = table[c + 9], table[c + 10], table[c + 11]
    point = (
        table[c] + u * (bx + u * (cx + u * dx)),
        table[c + 1] + u * (by + u * (cy + u * dy)),
        table[c + 2] + u * (bz + u * (cz + u * dz)),
    )
    tangent = (
        bx + u * (2.0 * cx + 3.0 * u * dx),
        by + u * (2.0 * cy + 3.0 * u * dy),
        bz + u * (2.0 * cz + 3.0 * u * dz),
    )
    return point, tangent, (2.0 * cx + 6.0 * u * dx, 2.0 * cy + 6.0 * u * dy, 2.0 * cz + 6.0 * u * dz)


@kernel
def ahead(tips, offsets, entries, courses, table, found):
    """Points, tangents and second derivatives at every tip's arc length plus every offset.

    tips : (n,) m or more
    offsets : (k,) m
    entries : (n,), which of the courses is a lane's
    courses : (m, 6)
    table : flat
    found : (n, k, 9), receives them
    """
    for lane in range(found.shape[0]):
        course = courses[entries[lane]]
        for k in range(offsets.shape[0]):
            point, tangent, bend = curve_at(tips[lane] + offsets[k], course, table)
            for axis in range(3):
                found[lane, k, axis] = point[axis]
                found[lane, k, 3 + axis] = tangent[axis]
                found[lane, k, 6 + axis] = bend[axis]
