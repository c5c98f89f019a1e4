"""Walls in bricks: each sample is taken once, and a large tree with a narrow end has a bound, which is said."""

from __future__ import annotations

import numpy as np
import pytest

from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.named_trees import fork
from magwire_env.simulation.free.bricks import CELLS, Bricks
from magwire_env.simulation.free.walls import _cell_of


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
