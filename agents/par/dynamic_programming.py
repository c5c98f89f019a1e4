"""Dynamic programming on the quasi-static model over (tip arc length, magnet angle), for rigs of one turn.

The state moves for a control period under a turn of the magnet by at most what its servo does; the value of a state is
the least time to the goal (`to_the_end`), the least time until a target has been held (`to_a_target`), or the least
sum of squared errors that is left (`along_a_reference`). Values are read between their nodes by bilinear
interpolation, angles around the circle. `choose` picks the turn that is best by a value.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

__all__ = ["along_a_reference", "choose", "moves", "to_a_target", "to_the_end"]

_JIT: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}

NEVER = 1e3
"""Time to a goal that cannot be reached, s."""

TURNS = 9
"""Turns tried in the recursion, from full speed one way to full speed the other."""

FINE_TURNS = 41
"""Turns tried by `choose`."""

_INSET = 3e-4
"""A target's tolerance is taken smaller by this, m, which the model's errors use up."""

_OFF = 25.0
"""Weight of the squared way beyond the rows around a reference."""


@njit(**_JIT)
def at(values, row, column):
    """`values` (rows, angles) at a fractional row, held at the ends, and a fractional column, round the circle."""
    rows, columns = values.shape
    row = min(max(row, 0.0), rows - 1.0)
    i = min(int(row), rows - 2)
    a = row - i
    floor = math.floor(column)
    b = column - floor
    j = int(floor) % columns
    k = (j + 1) % columns
    return (1.0 - a) * ((1.0 - b) * values[i, j] + b * values[i, k]) + a * (
        (1.0 - b) * values[i + 1, j] + b * values[i + 1, k]
    )


@njit(**_JIT)
def moved(speed, spacing, s, column, turn, period):
    """Tip after half a period and after a whole one (midpoint rule), the magnet turning evenly by `turn` columns."""
    middle = column + 0.5 * turn
    half = s + 0.5 * period * at(speed, s / spacing, column + 0.25 * turn)
    return half, s + period * at(speed, half / spacing, middle)


@njit(**_JIT)
def moves(speed, spacing, reach, period):
    """`moved` less where it started, for every turn tried from every node: (2, TURNS, rows, angles) m."""
    rows, columns = speed.shape
    way = np.empty((2, TURNS, rows, columns))
    for u in range(TURNS):
        turn = reach * (2.0 * u / (TURNS - 1) - 1.0)
        for i in range(rows):
            for j in range(columns):
                half, after = moved(speed, spacing, i * spacing, j, turn, period)
                way[0, u, i, j], way[1, u, i, j] = half - i * spacing, after - i * spacing
    return way


@njit(**_JIT)
def between(way, row, column):
    """A move, (rows, angles) m, at a fractional row, linear between rows."""
    row = min(max(row, 0.0), way.shape[0] - 1.0)
    i = min(int(row), way.shape[0] - 2)
    return way[i, column] + (row - i) * (way[i + 1, column] - way[i, column])


@njit(**_JIT)
def to_the_end(way, spacing, goal, reach, period, sweeps, tolerance):
    """Least time (rows up to the goal, angles) s to the goal (m), the servo turning by `reach` columns a period.

    way : of `moves`
    """
    rows, columns = min(math.ceil(goal / spacing) + 1, way.shape[2]), way.shape[3]
    values = np.full((rows, columns), NEVER)
    for i in range(rows):
        if i * spacing >= goal:
            values[i] = 0.0
    for _ in range(sweeps):
        change = 0.0
        for i in range(rows - 1, -1, -1):
            s = i * spacing
            if s >= goal:
                continue
            for j in range(columns):
                best = values[i, j]
                for u in range(TURNS):
                    turn = reach * (2.0 * u / (TURNS - 1) - 1.0)
                    best = min(best, arrival(values, spacing, goal, s, s + way[1, u, i, j], j + turn, period))
                change = max(change, values[i, j] - best)
                values[i, j] = best
        if change < tolerance:
            break
    return values


@njit(**_JIT)
def arrival(values, spacing, goal, s, after, column, period):
    """Time to the goal by way of `after`, which a period leads to from `s`."""
    if after >= goal:
        return period * (goal - s) / (after - s) if after > s else 0.0
    return period + at(values, after / spacing, column)


@njit(**_JIT)
def to_a_target(way, spacing, goal, width, hold, fine, first, last, reach, period, sweeps, tolerance):
    """Least time until the tip has been within `width` (m) of a target for `hold` periods on end.

    way : of `moves`; fine : m between the rows of the band; first, last : the rows of the way that are worked on

    Returns the time where nothing has been held yet, (rows, angles) s, and in the band with k = 1 … hold − 1 periods
    left, (hold, band's rows, angles) s; k = 0 is 0.
    """
    rows, columns = way.shape[2:]
    band = 2 * math.ceil(width / fine) + 1
    values, held = np.full((rows, columns), NEVER), np.full((hold, band, columns), NEVER)
    held[0] = 0.0
    for sweep in range(sweeps):
        change = 0.0
        for k in range(1, hold):
            for b in range(band):
                s = goal + (b - band // 2) * fine
                for j in range(columns):
                    best = held[k, b, j]
                    for u in range(TURNS):
                        column = j + reach * (2.0 * u / (TURNS - 1) - 1.0)
                        half, after = s + between(way[0, u], s / spacing, j), s + between(way[1, u], s / spacing, j)
                        left = time_after(goal, width, spacing, fine, values, held, k, half, after, column)
                        best = min(best, period + left)
                    change = max(change, held[k, b, j] - best)
                    held[k, b, j] = best
        for n in range(last - first + 1):
            i = first + n if sweep % 2 else last - n
            s = i * spacing
            for j in range(columns):
                best = values[i, j]
                for u in range(TURNS):
                    column = j + reach * (2.0 * u / (TURNS - 1) - 1.0)
                    half, after = s + way[0, u, i, j], s + way[1, u, i, j]
                    left = time_after(goal, width, spacing, fine, values, held, hold, half, after, column)
                    best = min(best, period + left)
                change = max(change, values[i, j] - best)
                values[i, j] = best
        if change < tolerance and sweep > 1:
            break
    return values, held


@njit(**_JIT)
def time_after(goal, width, spacing, fine, values, held, k, half, after, column):
    """Time left after a period through `half` to `after`, with `k` periods of the hold left before it."""
    inner = width - _INSET
    if abs(half - goal) <= inner and abs(after - goal) <= inner:
        return at(held[k - 1], (after - goal) / fine + held.shape[1] // 2, column)
    return at(values, after / spacing, column)


@njit(**_JIT)
def along_a_reference(way, spacing, reference, fine, band, reach, period):
    """Least sum of squared errors from every step on, (steps + 1, band, angles) m², rows `fine` m apart about it.

    way : of `moves`
    """
    steps, columns = reference.shape[0] - 1, way.shape[3]
    values = np.zeros((steps + 1, band, columns), dtype=np.float32)
    for t in range(steps - 1, -1, -1):
        for b in range(band):
            s = reference[t] + (b - band // 2) * fine
            for j in range(columns):
                best = np.inf
                for u in range(TURNS):
                    column = j + reach * (2.0 * u / (TURNS - 1) - 1.0)
                    after = s + between(way[1, u], s / spacing, j)
                    best = min(best, error_after(values[t + 1], reference[t + 1], fine, after, column))
                values[t, b, j] = best
    return values


@njit(**_JIT)
def error_after(values, reference, fine, after, column):
    """Squared error at `after` and the sum that is then left, m²; beyond the rows the way to them counts too."""
    off = after - reference
    beyond = max(abs(off) - (values.shape[0] // 2) * fine, 0.0)
    return off * off + _OFF * beyond * beyond + at(values, off / fine + values.shape[0] // 2, column)


@njit(**_JIT)
def choose(kind, speed, spacing, values, held, k, goal, width, fine, reach, period, carry, tip, velocity, column):
    """The turn, in columns, that is best from a tip at `tip` m with `velocity` m/s and a magnet at `column`.

    kind : 0 to the end, 1 to a target, with `k` periods of the hold left, 2 along a reference, `goal` the next value
    carry : s, by which a speed above the model's carries the tip further
    """
    best, chosen = np.inf, 0.0
    extra = carry * (velocity - at(speed, tip / spacing, column))
    for u in range(FINE_TURNS):
        turn = reach * (2.0 * u / (FINE_TURNS - 1) - 1.0)
        half, after = moved(speed, spacing, tip, column, turn, period)
        half, after = half + 0.5 * extra, after + extra
        if kind == 0:
            cost = arrival(values, spacing, goal, tip, after, column + turn, period)
        elif kind == 1:
            cost = time_after(goal, width, spacing, fine, values, held, k, half, after, column + turn)
        else:
            cost = error_after(values, goal, fine, after, column + turn)
        cost += 1e-9 * abs(turn)  # of equals the smallest
        if cost < best:
            best, chosen = cost, turn
    return chosen
