"""The search for the best parameters over their whole range: a spread of starts, or CMA-ES, then least squares."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ..physics.checks import one_of
from .problem import Problem

__all__ = ["METHODS", "search"]

METHODS = ("least-squares", "cma")


def search(problem: Problem, x: np.ndarray, method: str, samples: int, polished: int, seed: int) -> np.ndarray:
    """The best unknowns found.

    x : the scenario's own, always among the starts
    method : "least-squares" tries `samples` points spread over the range in one batch and improves the best `polished`;
        "cma" runs CMA-ES, a generation a batch, and improves its best (needs the package `cma`)
    """
    one_of("method", method, METHODS)
    starts = _spread(problem, x, samples, polished, seed) if method == "least-squares" else _evolved(problem, x, seed)
    found = [problem.solve(start) for start in starts]
    return min(found, key=lambda pair: pair[1])[0]


def _spread(problem: Problem, x: np.ndarray, samples: int, polished: int, seed: int) -> np.ndarray:
    points = np.tile(x, (samples, 1))
    n = problem.count
    rng = np.random.default_rng(seed)
    strata = rng.permuted(np.tile(np.arange(samples), (n, 1)), axis=1).T  # a Latin hypercube
    unit = (strata + rng.random((samples, n))) / samples
    points[:, :n] = problem.low[:n] + unit * (problem.high - problem.low)[:n]
    points = np.vstack([x, points])
    # Huber's loss ranks starts: far from the truth, a few moments tell little more than that it is far.
    gaps = np.abs(problem.residuals(points))
    cost = np.where(gaps < 5.0, gaps**2, 10.0 * gaps - 25.0).sum(axis=1)
    best = np.argsort(cost[1:], kind="stable")[:polished] + 1
    return np.vstack([x, points[best]])


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
