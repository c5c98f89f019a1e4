"""Where the search starts: loads that would nearly balance the wanted shape, and loads that leave a shape as it is.

In the wanted shape itself the energy's gradient is a known function of the load (linear in a uniform field), so the
load under which that shape is nearest to equilibrium is found without solving for any equilibrium.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import least_squares

from ..rod_energy import Chart, Shape, Touched
from .points import Point, Problem
from .response import gradient_slopes, motion

__all__ = ["aside", "balances", "sketch"]

_BATCH = 6
"""Seeds from which the balance of forces is sought before the best of them is followed."""

_SLIDES = (1.0, -1.0, 3.0, -3.0, 10.0, -10.0)
"""How far along a direction that leaves the rod as it is another load is looked for, from which it gets there."""

_STILL = 1e-3
"""Singular values below this share of the greatest leave the rod as it is."""

_Function = Callable[[np.ndarray], np.ndarray]


def sketch(problem: Problem) -> Shape:
    """A rod much as wanted, without stretch."""
    steps = np.diff(problem.aim.sketch(), axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    steps[lengths < 1e-9] = [1.0, 0.0, 0.0]
    return Shape(steps / np.linalg.norm(steps, axis=1)[:, None], np.zeros(len(steps)))


def balances(problem: Problem, shape: Shape) -> Iterator[np.ndarray]:
    """Parameters under which `shape` is nearest to equilibrium, from the seeds of the means: the best of every batch
    first, a good one at once."""
    imbalance, slopes = _imbalance(problem, shape)
    low, high = problem.means.low, problem.means.high
    inner = 1e-6 * np.where(np.isfinite(high - low), high - low, 1.0)
    seeds, kept = problem.means.seeds(), list[np.ndarray]()
    for first in range(0, len(seeds), _BATCH):
        found = []
        for seed in seeds[first : first + _BATCH]:
            z = np.clip(seed, low + inner, high - inner)
            if not np.isfinite(imbalance(z)).all():
                continue
            result = least_squares(imbalance, z, slopes, bounds=(low, high), max_nfev=30, ftol=1e-4, xtol=1e-6)
            found.append((float(np.linalg.norm(result.fun)), result.x))
            if found[-1][0] < 1:
                break
        for _, z in sorted(found, key=lambda entry: entry[0]):
            if all(np.abs(z - other).max() > 0.02 for other in kept):
                kept.append(z)
                yield z


def _imbalance(problem: Problem, shape: Shape) -> tuple[_Function, _Function]:
    """How far the nodes would move off `shape` against the unloaded rod's stiffness there, root mean square in
    tolerances, (3 nodes,) by z; and its slopes."""
    chain = problem.chain
    bare = Chart(chain, problem.rod._load(), shape)
    values, modes = eigh(bare.hessian(bare.middle))
    values = np.maximum(np.abs(values), 0.05 / len(values))  # a bent rod without its load may be unstable, or neutral
    nodes = len(shape.strains) + 1
    scale = problem.rod.wire.length / (problem.aim.within * math.sqrt(nodes))

    def moved(chart: Chart, pushes: np.ndarray) -> np.ndarray:
        coordinates = modes @ ((modes.T @ pushes) / values[:, None])
        return scale * motion(chart, coordinates)[0].reshape(-1, pushes.shape[1])

    def imbalance(z: np.ndarray) -> np.ndarray:
        chart = Chart(chain, problem.load(z), shape)
        try:
            return moved(chart, chart.value(chart.middle)[1][:, None])[:, 0]
        except Touched:
            return np.full(3 * nodes, np.inf)

    def slopes(z: np.ndarray) -> np.ndarray:
        chart = Chart(chain, problem.load(z), shape)
        return moved(chart, gradient_slopes(chart, problem.rates(z)))

    return imbalance, slopes


def aside(problem: Problem, point: Point) -> list[np.ndarray]:
    """Other parameters under which the rod has the shape of `point`, as far as its derivative tells."""
    j = problem.slopes(point, problem.response(point))
    _, values, rows = np.linalg.svd(j, full_matrices=True)
    values = np.r_[values, np.zeros(len(rows) - len(values))]
    still = rows[values <= _STILL * values[0]]
    tried = [point.z + step * row for step in _SLIDES for row in still]
    return [np.clip(z, problem.means.low, problem.means.high) for z in tried]
