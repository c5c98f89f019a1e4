"""Every format that is read: small files that the tests write, of one and the same fork."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from scipy.spatial import KDTree

from magwire_env.lumen.loading import LumenNote
from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.surface_files import read_surface
from magwire_env.lumen.volume_files import read_volume
from tests.support import lumen_writers as writers

NAMES = {"surfaces": tuple(writers.surfaces()), "volumes": tuple(writers.volumes()), "trees": tuple(writers.trees())}


def quietly(path, **arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LumenNote)
        return Lumen.load(path, cache=False, progress=False, **arguments)


def written(tmp_path, kind, name):
    path = tmp_path / name
    path.write_bytes(getattr(writers, kind)()[name])
    return path


def same_fork(lumen, within):
    """The ends and the inlet lie where the fork has them, and its centrelines lie in the middle, to `within` m."""
    known = writers.the_fork()
    assert len(lumen.leaves) == 2
    ends = np.array([lumen.position(leaf) for leaf in lumen.leaves])
    for name in ("left", "right"):
        assert np.linalg.norm(ends - known.position(name), axis=1).min() < within
    assert np.linalg.norm(lumen.position("inlet") - known.position("inlet")) < within
    s = [np.linspace(0.0, b.length, 60) for b in known.branches]
    tree = KDTree(np.concatenate([b.curve.position(x) for b, x in zip(known.branches, s, strict=True)]))
    for b in lumen.branches:
        assert tree.query(b.curve.position(np.linspace(0.0, b.length, 60)))[0].max() < within


@pytest.mark.parametrize("name", NAMES["surfaces"])
def test_a_surface_is_the_same_in_every_format(tmp_path, name):
    raw = read_surface(written(tmp_path, "surfaces", name))
    vertices, faces = writers.mesh()
    assert raw.vertices[raw.faces].reshape(-1, 9) == pytest.approx(vertices[faces].reshape(-1, 9), abs=2e-5)


@pytest.mark.parametrize("name", NAMES["volumes"])
def test_a_volume_keeps_its_spacing_its_directions_and_its_flips(tmp_path, name):
    volume = read_volume(written(tmp_path, "volumes", name))
    cells = np.argwhere(volume.values > 0 if not name.startswith("level.nii") else volume.values < 0)
    xyz = 1e-3 * (cells @ volume.affine[:3, :3].T + volume.affine[:3, 3])
    distance = writers.the_fork().wall_distance(xyz)
    assert (distance > -1e-6).all()
    assert len(xyz) * abs(np.linalg.det(volume.affine[:3, :3])) == pytest.approx(3.42e3, rel=0.05)  # mm³
    assert volume.axes == ("RAS" if ".nii" in name else "LPS")
    assert volume.unit == "mm"


@pytest.mark.parametrize("name", ["mask.nii", "packed.mha", "level.nrrd"])
def test_a_mask_becomes_a_lumen(tmp_path, name):
    lumen = quietly(written(tmp_path, "volumes", name), inlet=(0, 0, 0))
    same_fork(lumen, 1.0e-3)
    assert lumen.axes == ("RAS" if ".nii" in name else "LPS")
    middle = lumen.position((lumen.trunk.name, 0.015))
    assert lumen.wall_distance(middle) == pytest.approx(4e-3, rel=0.1)


@pytest.mark.parametrize("name", [n for n in NAMES["trees"] if n not in ("one.csv", "path.pth", "rings.ctgr")])
def test_a_tree_is_the_same_in_every_format(tmp_path, name):
    lumen = quietly(written(tmp_path, "trees", name), unit=None if ".json" in name else "mm", inlet=(0, 0, 0))
    same_fork(lumen, 0.7e-3)
    for b in lumen.branches:
        s = 0.8 * b.length
        assert b.radius(s) in (pytest.approx(4e-3, rel=0.02), pytest.approx(3.175e-3, rel=0.02))
    if name == "fork.mrk.json":
        assert {b.name for b in lumen.branches} == {"trunk", "left", "right"}
        assert lumen.axes == "LPS"


@pytest.mark.parametrize(("name", "radius"), [("one.csv", None), ("path.pth", 4e-3), ("rings.ctgr", None)])
def test_a_file_of_one_line_is_one_branch(tmp_path, name, radius):
    lumen = quietly(written(tmp_path, "trees", name), unit="mm" if "csv" not in name else None, radius=radius)
    known = writers.the_fork()
    assert len(lumen.branches) == 1
    assert np.linalg.norm(lumen.position(lumen.trunk.name) - known.position("left")) < 1e-4
    assert lumen.trunk.radius(0.01) == pytest.approx(4e-3, rel=0.02)


def test_a_folder_of_curves_is_one_lumen_called_by_the_files(tmp_path):
    for name, line in writers.fork_lines().items():
        (tmp_path / f"tree_{name}.mrk.json").write_bytes(writers.markups({name: line}))
    lumen = quietly(tmp_path, inlet="trunk")
    assert {b.name for b in lumen.branches} == {"trunk", "left", "right"}
    same_fork(lumen, 0.7e-3)


def readers_of(path):
    """The libraries of readers and kernels that another process loads for a lumen which is kept."""
    program = f"""
import sys, warnings
warnings.simplefilter("ignore")
from magwire_env.lumen import Lumen
Lumen.load({str(path)!r}, unit="mm", progress=False)
print(sorted({{"numba", "scipy.ndimage", "nibabel", "trimesh", "magwire_env.lumen.assembling"}} & set(sys.modules)))
"""
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip()


def test_a_lumen_is_read_again_from_the_cache_and_from_its_own_file(tmp_path, monkeypatch):
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path / "cache"))
    path = written(tmp_path, "surfaces", "binary.stl")
    with pytest.warns(LumenNote, match="is turned|are capped|taken"):
        first = Lumen.load(path, unit="mm", progress=False)
    kept = list((tmp_path / "cache").rglob("*.lumen"))
    assert len(kept) == 1
    with pytest.warns(LumenNote):
        assert Lumen.load(path, unit="mm", progress=False) == first
    assert readers_of(path) == "[]"
    kept[0].write_bytes(b"damaged")
    with pytest.warns(LumenNote):
        assert Lumen.load(path, unit="mm", progress=False) == first
    first.save(tmp_path / "mine.lumen")
    assert Lumen.load(tmp_path / "mine.lumen") == first
