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
    mesh = meshed(known, 5.0 if name == "fork" else 4.0, path)
    found = loaded(known, path)
    error = compared(known, found, mesh, 30_000)
    assert error.topology
    assert error.centre < 0.1
    assert error.radius < 0.05
    assert error.ends < 0.1
    assert error.mouth < 0.1
    assert abs(error.volume) < 0.01
    if name == "fork":
        assert abs(error.mesh) < 0.01  # that of a coarser grid cuts off more
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


def test_sides_that_neighbours_share_are_those_of_each_point_itself(tmp_path):
    known = fork(35.0, 4e-3, 0.03)
    meshed(known, 3.0, tmp_path / "known.stl")
    lumen = loaded(known, tmp_path / "known.stl")
    rng = np.random.default_rng(0)
    low, high = lumen.bounds
    on_wall = lumen.wall.vertices[rng.integers(len(lumen.wall.vertices), size=10_000)]
    xyz = np.concatenate(
        [rng.uniform(low - 0.01, high + 0.01, (10_000, 3)), on_wall + rng.normal(0, 5e-4, (10_000, 3))]
    )
    inside = lumen.wall.inside(xyz)
    assert 0.1 < inside.mean() < 0.9
    assert np.array_equal(lumen.wall.distance(xyz)[0] > 0.0, inside)
    corner = np.tile(lumen.wall.vertices[:1], (200, 1))
    assert np.allclose(lumen.wall.distance(corner)[0], 0.0)


def test_the_way_in_opens_the_wall_wherever_it_reaches(tmp_path):
    known = fork(35.0, 4e-3, 0.03)
    meshed(known, 3.0, tmp_path / "known.stl")
    lumen = loaded(known, tmp_path / "known.stl")
    rng = np.random.default_rng(1)
    xyz = lumen.position("inlet") + np.concatenate([rng.normal(0, size, (5_000, 3)) for size in (3e-3, 0.01, 0.05)])
    of_surface, of_entry = lumen.wall.distance(xyz), lumen._entry.distance(xyz)
    better = of_entry[0] > of_surface[0]
    assert 0.1 < better.mean() < 0.9
    distance, gradient = lumen.wall_distance_and_gradient(xyz)
    assert np.array_equal(distance, np.maximum(of_surface[0], of_entry[0]))
    assert np.array_equal(gradient, np.where(better[:, None], of_entry[1], of_surface[1]))
