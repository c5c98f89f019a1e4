"""The search for the best parameters over their whole range: a spread of starts, or CMA-ES, then least squares."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ..physics.checks import one_of
from .problem import Problem

__all__ = ["METHODS", "search"]

METHODS = ("least-squares", "cma")

_HORIZONS = (0.2, 0.5)
"""Shares of the log that are fitted before the whole of it: a short time has few local minima, a long one is exact."""


def search(problem: Problem, x: np.ndarray, method: str, samples: int, polished: int, seed: int) -> np.ndarray:
    """The best unknowns found.

    x : the scenario's own, always among the starts
    method : "least-squares" tries `samples` points spread over the range in one batch and improves the best `polished`,
        on the first fifth of the log, on its first half, then on all of it; "cma" runs CMA-ES, a generation a batch,
        and improves its best (needs the package `cma`)
    """
    one_of("method", method, METHODS)
    others = _spread(problem, x, samples, polished, seed) if method == "least-squares" else _evolved(problem, x, seed)
    found = [x, *others]
    for share in _HORIZONS:
        problem.horizon = max(2, round(share * problem.predictor.rows))
        solved = [problem.solve(start) for start in found]
        found = _different([place for place, _ in sorted(solved, key=lambda pair: pair[1])], problem)
    problem.horizon = problem.predictor.rows
    return min((problem.solve(start) for start in found), key=lambda pair: pair[1])[0]


def _different(found: list[np.ndarray], problem: Problem) -> list[np.ndarray]:
    """Of places that are nearly the same, the first."""
    kept: list[np.ndarray] = []
    width = problem.high - problem.low
    for place in found:
        if all(np.abs((place - other) / width).max() > 1e-3 for other in kept):
            kept.append(place)
    return kept


def _spread(problem: Problem, x: np.ndarray, samples: int, polished: int, seed: int) -> np.ndarray:
    """The best of a Latin hypercube on the first part of the log."""
    points = np.tile(x, (samples, 1))
    n = problem.count
    rng = np.random.default_rng(seed)
    strata = rng.permuted(np.tile(np.arange(samples), (n, 1)), axis=1).T
    points[:, :n] = problem.low[:n] + (strata + rng.random((samples, n))) / samples * (problem.high - problem.low)[:n]
    problem.horizon = max(2, round(_HORIZONS[0] * problem.predictor.rows))
    cost = (problem.residuals(points) ** 2).sum(axis=1)
    return points[np.argsort(cost, kind="stable")[:polished]]


def _evolved(problem: Problem, x: np.ndarray, seed: int) -> np.ndarray:
    try:
        import cma
    except ImportError as error:
        raise ValueError("method must be 'least-squares' unless the package cma is installed, got 'cma'") from error
    width = problem.high - problem.low
    options: dict[str, Any] = {
        "bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9, "maxfevals": 400 * problem.size, "tolfun": 1e-3,
    }  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # cma warns of its own settings
        evolution = cma.CMAEvolutionStrategy(np.clip((x - problem.low) / width, 0.01, 0.99), 0.2, options)
        while not evolution.stop():
            units = np.array(evolution.ask())
            cost = (problem.residuals(problem.low + units * width) ** 2).sum(axis=1)
            evolution.tell(units, np.log1p(cost))
        return (problem.low + np.asarray(evolution.result.xbest) * width)[None]
