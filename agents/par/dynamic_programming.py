"""Dynamic programming on the quasi-static model over (tip arc length, magnet angle), for rigs of one turn.

In a control period the state moves while the magnet turns, at most as far as its servo goes. The value of a state is
the least time to the goal (`to_the_end`), the least time until a target has been held (`to_a_target`), or the least
sum of squared errors that is still to come (`along_a_reference`). Values are interpolated bilinearly between their
nodes, with angles around the circle. `choose` picks the turn with the best value.
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

TO_THE_END, TO_A_TARGET, ALONG_A_REFERENCE = range(3)
"""What `choose` is asked for."""

TURNS = 9
"""Number of turns tried in the recursion, from full speed one way to full speed the other."""

FINE_TURNS = 41
"""Number of turns tried by `choose`."""

_INSET = 3e-4
"""Allowance for the errors of the model, m: the recursion uses a tolerance that is smaller by this."""

_OFF = 25.0
"""Weight of the squared distance by which a state lies outside the rows around a reference."""


@njit(**_JIT)
def at(values: np.ndarray, row: float, column: float) -> float:
    """`values` (rows, angles) at a fractional row, clamped at the ends, and a fractional column, around the circle."""
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
def moved(
    speed: np.ndarray, spacing: float, s: float, column: float, turn: float, period: float
) -> tuple[float, float]:
    """Tip after half a period and after a whole one (midpoint rule); the magnet turns evenly by `turn` columns."""
    middle = column + 0.5 * turn
    half = s + 0.5 * period * at(speed, s / spacing, column + 0.25 * turn)
    return half, s + period * at(speed, half / spacing, middle)


@njit(**_JIT)
def moves(speed: np.ndarray, spacing: float, reach: float, period: float) -> np.ndarray:
    """How far `moved` takes the tip, for every turn tried from every node: (2, TURNS, rows, angles) m."""
    rows, columns = speed.shape
    travel = np.empty((2, TURNS, rows, columns))
    for u in range(TURNS):
        turn = reach * (2.0 * u / (TURNS - 1) - 1.0)
        for i in range(rows):
            for j in range(columns):
                half, after = moved(speed, spacing, i * spacing, j, turn, period)
                travel[0, u, i, j], travel[1, u, i, j] = half - i * spacing, after - i * spacing
    return travel


@njit(**_JIT)
def between(travel: np.ndarray, row: float, column: int) -> float:
    """A move, (rows, angles) m, at a fractional row, linear between rows."""
    row = min(max(row, 0.0), travel.shape[0] - 1.0)
    i = min(int(row), travel.shape[0] - 2)
    return travel[i, column] + (row - i) * (travel[i + 1, column] - travel[i, column])


@njit(**_JIT)
def to_the_end(
    travel: np.ndarray, spacing: float, goal: float, reach: float, period: float, sweeps: int, tolerance: float
) -> np.ndarray:
    """Least time (rows up to the goal, angles) s to the goal (m), the servo turning by `reach` columns a period.

    travel : of `moves`
    """
    rows, columns = min(math.ceil(goal / spacing) + 1, travel.shape[2]), travel.shape[3]
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
                    best = min(best, arrival(values, spacing, goal, s, s + travel[1, u, i, j], j + turn, period))
                change = max(change, values[i, j] - best)
                values[i, j] = best
        if change < tolerance:
            break
    return values


@njit(**_JIT)
def arrival(
    values: np.ndarray, spacing: float, goal: float, s: float, after: float, column: float, period: float
) -> float:
    """Time to the goal by way of `after`, which a period leads to from `s`."""
    if after >= goal:
        return period * (goal - s) / (after - s) if after > s else 0.0
    return period + at(values, after / spacing, column)


@njit(**_JIT)
def to_a_target(
    travel: np.ndarray,
    spacing: float,
    goal: float,
    width: float,
    hold: int,
    fine: float,
    first: int,
    last: int,
    reach: float,
    period: float,
    sweeps: int,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Least time until the tip has been within `width` (m) of a target for `hold` periods on end.

    travel : of `moves`; fine : m between the rows of the band; first, last : range of the rows that are computed

    Returns the time in s where nothing has been held yet, (rows, angles), and in the band with k = 1 … hold − 1 periods
    to hold, (hold, band's rows, angles); for k = 0 it is 0.
    """
    rows, columns = travel.shape[2:]
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
                        half, after = (
                            s + between(travel[0, u], s / spacing, j),
                            s + between(travel[1, u], s / spacing, j),
                        )
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
                    half, after = s + travel[0, u, i, j], s + travel[1, u, i, j]
                    left = time_after(goal, width, spacing, fine, values, held, hold, half, after, column)
                    best = min(best, period + left)
                change = max(change, values[i, j] - best)
                values[i, j] = best
        if change < tolerance and sweep > 1:
            break
    return values, held


@njit(**_JIT)
def time_after(
    goal: float,
    width: float,
    spacing: float,
    fine: float,
    values: np.ndarray,
    held: np.ndarray,
    k: int,
    half: float,
    after: float,
    column: float,
) -> float:
    """Time still to come after a period through `half` to `after`, before which `k` periods were still to be held."""
    inner = width - _INSET
    if abs(half - goal) <= inner and abs(after - goal) <= inner:
        return at(held[k - 1], (after - goal) / fine + held.shape[1] // 2, column)
    return at(values, after / spacing, column)


@njit(**_JIT)
def along_a_reference(
    travel: np.ndarray, spacing: float, reference: np.ndarray, fine: float, band: int, reach: float, period: float
) -> np.ndarray:
    """Least sum of squared errors from every step on, (steps + 1, band, angles) m², in rows `fine` m apart.

    travel : of `moves`
    """
    steps, columns = reference.shape[0] - 1, travel.shape[3]
    values = np.zeros((steps + 1, band, columns), dtype=np.float32)
    for t in range(steps - 1, -1, -1):
        for b in range(band):
            s = reference[t] + (b - band // 2) * fine
            for j in range(columns):
                best = np.inf
                for u in range(TURNS):
                    column = j + reach * (2.0 * u / (TURNS - 1) - 1.0)
                    after = s + between(travel[1, u], s / spacing, j)
                    best = min(best, error_after(values[t + 1], reference[t + 1], fine, after, column))
                values[t, b, j] = best
    return values


@njit(**_JIT)
def error_after(values: np.ndarray, reference: float, fine: float, after: float, column: float) -> float:
    """Squared error at `after` and the sum that then follows, m²; outside the rows the distance to them counts too."""
    off = after - reference
    beyond = max(abs(off) - (values.shape[0] // 2) * fine, 0.0)
    return off * off + _OFF * beyond * beyond + at(values, off / fine + values.shape[0] // 2, column)


@njit(**_JIT)
def choose(
    kind: int,
    speed: np.ndarray,
    spacing: float,
    values: np.ndarray,
    held: np.ndarray,
    k: int,
    goal: float,
    width: float,
    fine: float,
    reach: float,
    period: float,
    carry: float,
    tip: float,
    velocity: float,
    column: float,
) -> float:
    """The turn, in columns, that is best from a tip at `tip` m with `velocity` m/s and a magnet at `column`.

    kind : `TO_THE_END`; `TO_A_TARGET`, with `k` periods still to hold; `ALONG_A_REFERENCE`, whose next value is `goal`
    carry : s; a speed above the model's carries the tip farther by this time
    """
    best, chosen = np.inf, 0.0
    extra = carry * (velocity - at(speed, tip / spacing, column))
    for u in range(FINE_TURNS):
        turn = reach * (2.0 * u / (FINE_TURNS - 1) - 1.0)
        half, after = moved(speed, spacing, tip, column, turn, period)
        half, after = half + 0.5 * extra, after + extra
        if kind == TO_THE_END:
            cost = arrival(values, spacing, goal, tip, after, column + turn, period)
        elif kind == TO_A_TARGET:
            cost = time_after(goal, width, spacing, fine, values, held, k, half, after, column + turn)
        else:
            cost = error_after(values, goal, fine, after, column + turn)
        cost += 1e-9 * abs(turn)  # of equally good turns, the smallest
        if cost < best:
            best, chosen = cost, turn
    return chosen
