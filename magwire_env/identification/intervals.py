"""How well the data know each parameter: intervals, and combinations that they do not know."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from ..physics.checks import one_of
from .problem import Problem

__all__ = ["INTERVALS", "Interval", "Precision", "intervals", "precision", "unknown_combinations"]

INTERVALS = ("profile", "laplace")

_WEAK = 0.25
"""A combination counts as unknown if its standard deviation exceeds this share of the searched range."""

_ALIKE = 0.98
"""Correlation beyond which two parameters are told of."""


@dataclass(frozen=True)
class Interval:
    """low, high : ends, in the parameter's unit
    open_low, open_high : the end is the search's bound: the data set no limit there
    """

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True, eq=False)
class Precision:
    """The curvature of the sum of squares at its least.

    covariance : (size, size) of the unknowns; the ranges searched count as a weak prior, so that it always exists
    spread : standard deviation of a residual, in units of the assumed noise
    freedom : number of measurements less unknowns
    """

    covariance: np.ndarray
    spread: float
    freedom: int

    @property
    def deviations(self) -> np.ndarray:
        """(size,) standard deviations of the unknowns."""
        return np.sqrt(np.diag(self.covariance))


def precision(problem: Problem, x: np.ndarray, squares: float) -> Precision:
    """Of a solved problem with the sum of squares `squares`."""
    jacobian = problem.jacobian(x, np.arange(problem.size))
    freedom = len(jacobian) - problem.size
    spread = math.sqrt(squares / freedom)
    width = problem.high - problem.low
    scaled = jacobian * (width / spread)
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(problem.size))
    return Precision(covariance * np.outer(width, width), spread, freedom)


def intervals(problem: Problem, x: np.ndarray, squares: float, known: Precision, level: float, method: str) -> list:
    """An `Interval` for each parameter at `level`, such as 0.9.

    method : "profile", where the sum of squares, least over all other unknowns, has risen by t² s² (profile
        likelihood with Student's t for the estimated noise); "laplace", from the curvature at the best alone
    """
    one_of("intervals", method, INTERVALS)
    quantile = float(student.ppf(0.5 * (1.0 + level), known.freedom))
    found = []
    for i, parameter in enumerate(problem.parameters):
        ends, opens = [], []
        for sign in (-1.0, 1.0):
            if method == "laplace":
                end = x[i] + sign * quantile * known.deviations[i]
            else:
                end = _profile_end(problem, x, squares, known, i, sign, quantile)
            bound = problem.low[i] if sign < 0 else problem.high[i]
            beyond = sign * (end - bound) >= 0
            opens.append(bool(beyond))
            ends.append(parameter.from_search(float(bound if beyond else end)))
        found.append(Interval(ends[0], ends[1], opens[0], opens[1]))
    return found


def _profile_end(
    problem: Problem, x: np.ndarray, squares: float, known: Precision, i: int, sign: float, quantile: float
) -> float:
    """Where the profile of unknown i reaches the quantile; the bound, or a place beyond, if it does not."""
    others = np.array([k for k in range(problem.size) if k != i])
    slope = known.covariance[others, i] / known.covariance[i, i]
    bound = problem.low[i] if sign < 0 else problem.high[i]
    inside = 0.0, 0.0  # distance from x[i], and the root of what the sum of squares rose by, over the spread
    outside: tuple[float, float] | None = None
    step, start = quantile * float(known.deviations[i]), x
    for _ in range(12):
        step = min(step, sign * (bound - x[i]))
        trial = start.copy()
        trial[others] += slope * sign * (step - abs(start[i] - x[i]))
        trial[i] = x[i] + sign * step
        solved, rest = problem.solve(trial, others)
        rise = math.sqrt(max(rest - squares, 0.0)) / known.spread
        if abs(rise - quantile) < 0.01 * quantile:
            return x[i] + sign * step
        if rise < quantile:
            inside, start = (step, rise), solved
            if step >= sign * (bound - x[i]):
                return float(bound)
        else:
            outside = step, rise
        if outside is None:
            step *= min(4.0, quantile / max(rise, 0.25 * quantile))
        else:
            share = (quantile - inside[1]) / (outside[1] - inside[1])
            step = inside[0] + min(max(share, 0.05), 0.95) * (outside[0] - inside[0])
    return x[i] + sign * step


def unknown_combinations(problem: Problem, known: Precision) -> list[str]:
    """What the data cannot tell, in sentences; empty if they tell everything that was asked."""
    n = problem.count
    width = (problem.high - problem.low)[:n]
    scaled = known.covariance[:n, :n] / np.outer(width, width)
    names = [p.name for p in problem.parameters]
    told: list[str] = []
    spreads, directions = np.linalg.eigh(scaled)
    for spread, direction in zip(spreads[::-1], directions.T[::-1], strict=True):
        if math.sqrt(spread) < _WEAK:
            break
        part = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) > 0.25]
        if len(part) == 1:
            told.append(
                f"the data say nearly nothing of {names[part[0]]}: anything in its range explains them alike; fix it, "
                "or measure something that it changes"
            )
        else:
            told.append(
                f"the data cannot tell {_listed([names[i] for i in part])} apart: they can change together and explain "
                "the data alike; fix one of them, or measure a force as well"
            )
    deviations = np.sqrt(np.diag(scaled))
    correlation = scaled / np.outer(deviations, deviations)
    for i in range(n):
        for k in range(i + 1, n):
            if abs(correlation[i, k]) > _ALIKE and not any(names[i] in s and names[k] in s for s in told):
                told.append(
                    f"the data hardly tell {names[i]} and {names[k]} apart (correlation {correlation[i, k]:+.3f}): "
                    "each is known far worse than the two together"
                )
    return told


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]])
