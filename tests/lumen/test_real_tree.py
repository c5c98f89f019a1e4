"""The real tree of the shared data."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from tests.lumen.real_tree import both, centreline, course, distances, folder, matched, middles


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


def test_its_surface_gives_a_tree_beside_the_curves_and_in_its_own_middle(trees):
    """The surface is not that of the curves' balls: a fifth of the curves lies off its middle. See the command."""
    curves, surface = trees
    turn, shift = matched(curves, surface)
    assert np.array_equal(turn.round(), np.eye(3))
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) > 0
    gap = np.concatenate(list(distances(curves, surface, turn, shift).values()))
    assert np.median(gap) < 1.2e-3
    assert (gap < 2e-3).mean() > 0.75
    points, _, tangents = (np.concatenate(x) for x in zip(*map(course, curves.branches), strict=True))
    points, tangents = points[::5] @ turn.T + shift, tangents[::5] @ turn.T
    inside = surface.contains(points)
    middle = middles(surface, points[inside], tangents[inside])
    left = KDTree(centreline(surface, 2e-4)[0]).query(middle)[0]
    assert np.median(left) < 0.3e-3
    assert (left < 2e-3).mean() > 0.93
    assert any("normals pointed inwards" in note for note in surface.notes)
