"""A known tree, meshed by the test, is found again; and what a surface must say or be refused for."""

import numpy as np
import pytest

from magwire_env.lumen.named_trees import fork, straight, two_forks
from tests.lumen.accuracy import compared, even, loaded, meshed
from tests.support import lumen_writers as writers


@pytest.mark.parametrize("name", ["fork", "two forks"])
def test_a_meshed_tree_is_found_again(tmp_path, name):
    known = {"fork": lambda: fork(35.0, 4e-3, 0.03), "two forks": lambda: two_forks(35.0, 4e-3, 0.03)}[name]()
    path = tmp_path / "known.stl"
    meshed(known, 5.0 if name == "fork" else 4.0, path)
    found = loaded(known, path)
    error = compared(known, found, 30_000)
    assert error.topology
    assert error.centre < 0.1
    assert error.radius < 0.05
    assert error.ends < 0.1
    if name == "fork":
        assert abs(error.volume) < 0.01  # the mesh of a coarser grid cuts off more
    assert [b.name for b in found.branches] == [f"b{i}" for i in range(len(known.leaves))]


def test_a_capped_mesh_has_the_volume_of_its_lumen(tmp_path):
    known = fork(35.0, 4e-3, 0.03)
    path = tmp_path / "known.stl"
    meshed(known, 3.0, path)
    found = loaded(known, path)
    low, high = found.bounds
    xyz = even(low, high, 60_000)
    volume = np.prod(high - low) * found.contains(xyz).mean()
    vertices, faces = writers.meshed(known, known.narrowest[0] / 3.0)
    a, b, c = (1e-3 * vertices[faces[:, i]] for i in range(3))
    assert volume == pytest.approx(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6, rel=0.01)


@pytest.mark.parametrize("radius", [4e-3, 8e-3])
def test_a_closed_mesh_is_entered_through_its_wall_and_its_flat_end_has_no_branches(tmp_path, radius):
    known = straight(0.1, radius)
    path = tmp_path / "known.stl"
    meshed(known, 4.0, path, closed=True)
    found = loaded(known, path)
    assert found.leaves == ("b0",)
    assert np.linalg.norm(found.position("inlet") - known.position("inlet")) < 2e-4
    assert found.contains(np.array([-0.01, 0.0, 0.0]))  # the way in is open
    assert np.linalg.norm(found.position("b0") - known.position("trunk")) < 2e-4
