"""How a rod in equilibrium moves when its load changes: implicit differentiation of the equilibrium.

With the energy's gradient g(q, p) over the coordinates q of a chart and the load's parameters p, g = 0 along the
branch, so that dq/dp = −H⁻¹ ∂g/∂p with H the energy's Hessian. A fold of the branch, where the rod snaps, is where H
becomes singular.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, solve

from ..rod_energy import Chain, Chart, Load, LoadSlope, Shape

__all__ = ["Response", "gradient_slopes", "motion", "respond", "softening", "softest"]


class Response(NamedTuple):
    """Rates at which a rod moves with P parameters of its load.

    coordinates : (3N, P), of the chart about the equilibrium
    moves : (nodes, 3, P), of the nodes, in the wire's length
    turns : (3, P), of the last segment's direction
    """

    coordinates: np.ndarray
    moves: np.ndarray
    turns: np.ndarray


def respond(chain: Chain, load: Load, shape: Shape, rates: Sequence[LoadSlope]) -> Response:
    """Of the equilibrium `shape` under `load`, whose parameters change it at `rates`."""
    chart = Chart(chain, load, shape)
    slopes = gradient_slopes(chart, rates)
    coordinates = -solve(chart.damped(chart.middle), slopes, assume_a="sym")
    return Response(coordinates, *motion(chart, coordinates))


def gradient_slopes(chart: Chart, rates: Sequence[LoadSlope]) -> np.ndarray:
    """∂g/∂p in the middle of `chart`, (3N, P)."""
    chain, shape = chart.chain, Shape(chart.normal, chart.strains)
    out = np.empty((3 * len(shape.strains), len(rates)))
    for k, rate in enumerate(rates):
        on_directions, on_strains = chain.slope(chart.load, shape, rate)
        rows = out[:, k].reshape(-1, 3)
        rows[:, :2] = np.einsum("nij,nj->ni", chart.across, on_directions)
        rows[:, 2] = on_strains * chain.stretch
    return out


def motion(chart: Chart, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How small changes of the chart's coordinates (3N, P) move the nodes, (nodes, 3, P), and turn the tip, (3, P)."""
    chain, n = chart.chain, len(chart.strains)
    change = coordinates.reshape(n, 3, -1)
    turns = np.einsum("nij,nip->njp", chart.across, change[:, :2])
    steps = (chain.cell * (1 + chart.strains))[:, None, None] * turns
    steps += chain.cell * chain.stretch * chart.normal[:, :, None] * change[:, 2:]
    moves = np.concatenate([np.zeros((1, 3, steps.shape[2])), np.cumsum(steps, axis=0)])
    return moves, turns[-1]


def softest(chain: Chain, load: Load, shape: Shape) -> tuple[float, np.ndarray]:
    """The least eigenvalue of the energy's Hessian, zero at a fold, where the rod snaps; and its mode, (3N,)."""
    chart = Chart(chain, load, shape)
    values, modes = eigh(chart.hessian(chart.middle), subset_by_index=[0, 0])
    return float(values[0]), modes[:, 0]


def softening(
    chain: Chain, ends: Sequence[tuple[Load, Load]], shape: Shape, mode: np.ndarray, response: Response, step: float
) -> np.ndarray:
    """Rates of the softest eigenvalue by P parameters, (P,): central differences of the Hessian along the branch.

    ends : for each parameter the load with it raised by `step` and lowered by `step`
    """
    out = np.empty(len(ends))
    for k, loads in enumerate(ends):
        sides = []
        for load, sign in zip(loads, (1.0, -1.0), strict=True):
            chart = Chart(chain, load, shape)
            sides.append(mode @ chart.hessian(sign * step * response.coordinates[:, k]) @ mode)
        out[k] = (sides[0] - sides[1]) / (2 * step)
    return out
