"""The real tree of the shared data."""

import numpy as np
import pytest

from tests.lumen.real_tree import both, distances, folder, matched


@pytest.fixture(scope="module")
def trees(tmp_path_factory):
    if folder() is None:
        pytest.skip("the shared data are absent: set MAGWIRE_DATA")
    return both(folder())


def test_every_curve_of_a_real_tree_becomes_a_branch_of_one_lumen(trees):
    curves, _ = trees
    assert len(curves.branches) == 25
    assert {"LCCA", "RCCA", "LVA", "RVA"} <= {b.name for b in curves.branches}
    assert curves.axes == "LPS"
    assert sum(b.parent is None for b in curves.branches) == 1
    for leaf in curves.leaves:
        route = curves.route("inlet", leaf)
        x = np.linspace(0.0, route.length, 200)
        assert (curves.wall_distance(route.position(x)) > 0.9 * curves.narrowest[0]).all()


def test_its_surface_gives_a_tree_beside_the_curves(trees):
    """The surface is not that of the curves' balls: 4 % of the curves lie outside it. See the module's command."""
    curves, surface = trees
    turn, shift = matched(curves, surface)
    assert np.array_equal(turn, np.eye(3))
    gap = np.concatenate(list(distances(curves, surface, turn, shift).values()))
    assert np.median(gap) < 2e-3
    assert (gap < 2e-3).mean() > 0.65
    assert any("normals pointed inwards" in note for note in surface.notes)
