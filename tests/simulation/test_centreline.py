"""The three forms of the centreline's lookup agree: NumPy in `Tract`, compiled for one lane, compiled for a block."""

import numpy as np
import pytest

from magwire_env.compiled import kernel
from magwire_env.lumen.named import circle, helix, paper_spiral, straight
from magwire_env.simulation.centreline import COURSE, ahead, snap, tables
from magwire_env.simulation.lanes import LANES, load
from magwire_env.simulation.vectors import store3

TRACTS = [paper_spiral(), straight(0.5), circle(0.6), helix()]


@kernel
def snapped(s, course, table, found):
    """`snap` at a block's arc lengths, into (9, LANES)."""
    for row, vector in enumerate(snap(load(s, 0), course, table)):
        store3(found, 3 * row, vector)


@pytest.mark.parametrize("number", range(len(TRACTS)))
def test_the_forms_agree_inside_beyond_the_ends_and_round_a_loop(number):
    table, courses = tables(TRACTS)
    tract = TRACTS[number]
    s = np.linspace(-0.3, 1.3, 3 * LANES) * tract.length
    one = np.empty((len(s), 1, 9))
    ahead(s, np.zeros(1), np.full(len(s), number), courses, table, one)
    block = np.empty((9, LANES))
    for first in range(0, len(s), LANES):
        course = np.repeat(courses[number][:, None], LANES, axis=1)
        snapped(s[first : first + LANES].reshape(1, -1), course, table, block)
        assert np.allclose(block.T, one[first : first + LANES, 0], rtol=1e-12, atol=1e-13)
    assert np.allclose(one[:, 0, :3], tract.position(s), rtol=0, atol=1e-14)
    unit = one[:, 0, 3:6] / np.linalg.norm(one[:, 0, 3:6], axis=1, keepdims=True)
    assert np.allclose(unit, tract.tangent(s), rtol=0, atol=1e-14)
    bend = one[:, 0, 6:] - (one[:, 0, 6:] * unit).sum(axis=1, keepdims=True) * unit
    assert np.allclose(bend, tract.curvature_vector(s), rtol=1e-4, atol=1e-3)  # the tangent's length is 1 to 1e-5


def test_a_tract_stands_in_the_table_once():
    table, courses = tables([TRACTS[0], TRACTS[1], TRACTS[0]])
    assert len(table) == 12 * (len(TRACTS[0].table) + len(TRACTS[1].table))
    assert courses[0].tolist() == courses[2].tolist()
    assert courses[1][COURSE.first_row] == len(TRACTS[0].table)
