"""Walls in bricks: each sample is taken once, and a large tree with a narrow end has a bound, which is said."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.named_trees import fork
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.free.bricks import CELLS, Bricks, depth_in_bricks
from magwire_env.simulation.free.vectors import load3, store3
from magwire_env.simulation.free.walls import _cell_of
from magwire_env.simulation.lanes import LANES, store


@njit
def found(grid, par, x, out):
    """Depth, gradient and second derivatives, ten numbers a lane."""
    depth, gradient, second = depth_in_bricks(grid, par, load3(x, 0))
    store(out, 0, depth)
    store3(out, LANES, gradient)
    store3(out, 4 * LANES, (second[0], second[1], second[2]))
    store3(out, 7 * LANES, (second[3], second[4], second[5]))


def test_second_derivatives_of_bricks_are_differences_of_their_gradient() -> None:
    """In a ball of 4 mm: points near its wall, and a lane that has no bricks."""
    radius, cell = 4e-3, 0.5e-3

    def depth(xyz: np.ndarray) -> np.ndarray:
        return radius - np.linalg.norm(xyz, axis=1)

    bricks = Bricks(depth, [-radius] * 3, [radius] * 3, cell, 2e-3, 1e-3)
    par = np.zeros(at.PAR_SIZE)
    for name, value in bricks.fields().items():
        par[getattr(at, name) : getattr(at, name) + LANES] = value
        par[getattr(at, name) + LANES - 1] = 0.0  # the last lane has none
    rng, axes = np.random.default_rng(1), ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    ways = rng.standard_normal((LANES, 3))
    points = ways / np.linalg.norm(ways, axis=1)[:, None] * rng.uniform(0.9, 1.05, (LANES, 1)) * radius

    def probe(shift: np.ndarray) -> np.ndarray:
        out = np.zeros(10 * LANES)
        found(bricks.data, par, np.ascontiguousarray((points + shift).T).reshape(-1), out)
        return out.reshape(10, LANES)

    step, middle = 1e-7, probe(np.zeros(3))
    assert np.isfinite(middle).all()
    assert middle[1:, -1].tolist() == [0.0] * 9
    lanes = slice(0, LANES - 1)
    assert middle[0, lanes] == pytest.approx(-depth(points)[lanes], abs=1e-5)
    for k, (i, j) in enumerate(axes):
        shift = step * np.eye(3)[j]
        slope = (probe(shift)[1 + i] - probe(-shift)[1 + i]) / (2 * step)
        assert middle[4 + k, lanes] == pytest.approx(slope[lanes], abs=1e-4 / radius)
        outwards = points / np.linalg.norm(points, axis=1)[:, None]
        ball = (float(i == j) - outwards[:, i] * outwards[:, j]) / np.linalg.norm(points, axis=1)
        assert middle[4 + k, lanes] == pytest.approx(ball[lanes], abs=0.15 / radius)


def test_a_wall_is_sampled_once_at_each_place() -> None:
    lumen, asked = fork(length=0.02), 0

    def depth(xyz: np.ndarray) -> np.ndarray:
        nonlocal asked
        asked += len(xyz)
        return lumen.wall_distance(xyz)

    low, high = lumen.bounds
    bricks = Bricks(depth, low.tolist(), high.tolist(), 1e-3, 1.5e-3, 3e-3)
    assert asked < 2.5 * CELLS**3 * len(bricks.coefficients)  # each brick by itself would ask 8 times a cell


def test_a_large_tree_with_a_narrow_end_is_kept_in_coarser_cells_and_says_so() -> None:
    lines = [("trunk", [(0, 0, 0), (0.2, 0, 0), (0.4, 0, 0)], 12e-3, None),
             ("twig", [(0.2, 0, 0), (0.2, 0.02, 0), (0.2, 0.04, 0)], 0.3e-3, "trunk")]  # fmt: skip
    with pytest.warns(UserWarning, match=r"cells of 0\.\d+ mm.*less than 0\.\d+ mm radius only roughly"):
        cell = _cell_of(Lumen.from_lines(lines, "large"), 0.2e-3)
    assert 0.3e-3 < cell < 0.8e-3
    assert _cell_of(fork(), 0.4e-3) == pytest.approx(fork().narrowest[0] / 5)
