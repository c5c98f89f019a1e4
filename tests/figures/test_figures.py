"""The figures: every file is written, the PNGs are whole pictures, and the CSVs hold what the model says."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.cli.main import main
from magwire_env.physics import PointDipole, field, force
from magwire_env.quasistatic.reach import distance, recorded
from magwire_env.scenario import Scenario
from magwire_env.simulation import drive_at
from magwire_env.validation.rods import make_rod

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

import matplotlib.image

from magwire_env.figures import FIGURES, draw, shapes

TIP = Scenario.paper().tip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("figures")
    main(["figures", "--out", str(out)])
    return out


def read(path) -> dict[str, np.ndarray]:
    with path.open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))


@pytest.mark.parametrize("name", FIGURES)
def test_each_figure_is_a_picture_a_page_and_its_data(folder, name):
    picture = matplotlib.image.imread(folder / f"{name}.png")
    height, width = picture.shape[:2]
    assert 500 < height < 1000
    assert 1000 < width < 1500
    ink = (picture[..., :3] < 0.5).any(axis=2)
    assert 0.01 < ink.mean() < 0.6
    edges = np.concatenate([ink[0], ink[-1], ink[:, 0], ink[:, -1]])
    assert not edges.any(), "something is cut at the edge"
    assert (folder / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    tables = sorted(folder.glob(f"{name}*.csv"))
    assert tables
    for table in tables:
        assert all(len(column) for column in read(table).values())


def test_small_enough_for_the_docs(folder):
    assert sum(path.stat().st_size for path in folder.glob("*.png")) < 2e6


def test_figure_1_stops_at_the_snap_and_is_an_equilibrium(folder):
    data = read(folder / "figure1_approaching_dipole.csv")
    converged = data["converged"] == 1
    snap = int(converged.argmin())
    assert converged[:snap].all()
    assert not converged[snap:].any()
    assert np.isnan(data["tip_z_m"][snap:]).all()
    assert (np.diff(data["tip_z_m"][:snap]) > 0).all()
    cloud = PointDipole(20.0).dipoles().moved([[0, 0, -1], [0, 1, 0], [1, 0, 0]], [0.1, 0, data["dipole_height_m"][10]])
    nodes = make_rod(40).equilibrium(cloud)
    assert data["tip_z_m"][10] == pytest.approx(nodes[-1, 2], rel=1e-6)


def test_figure_2_is_odd_about_the_snap(folder):
    data = read(folder / "figure2_turning_dipole.csv")
    assert (data["converged"] == 1).all()
    z = data["tip_z_m"]
    jump = int(np.abs(np.diff(z)).argmax())
    assert data["dipole_angle_rad"][jump] == pytest.approx(np.pi, abs=0.01)
    assert z[: jump + 1].min() < -0.02
    np.testing.assert_allclose(z[jump + 1 :], -z[: len(z) - jump - 1][::-1], atol=1e-6)


def test_figure_3_and_4_show_the_objects_that_are_simulated(folder):
    nodes = read(folder / "figure3_wire_model.csv")
    paper = Scenario.paper()
    xyz = np.stack([nodes["x_m"], nodes["y_m"], nodes["z_m"]], axis=1)
    assert len(xyz) == paper.wire.segments + 1
    np.testing.assert_allclose(xyz, paper.tract.position(nodes["arclength_m"]), atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(np.diff(xyz, axis=0), axis=1), paper.wire.segment_length, rtol=1e-5)
    magnet = read(folder / "figure4_setup_magnet.csv")
    assert [magnet[k][0] for k in ("x_m", "y_m", "z_m")] == pytest.approx(paper.rig.magnets[0].position, rel=1e-6)


def test_figure_5_is_the_flux_and_force_of_2000_dipoles(folder):
    paper, angle = Scenario.paper(), np.radians(215)
    c, s = np.cos(angle), np.sin(angle)
    mount = paper.rig.magnets[0]
    cloud = mount.magnet.dipoles("grid", (10, 10, 20))
    cloud = cloud.moved(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.array(mount.position))
    flux = read(folder / "figure5_flux_and_force_flux.csv")
    points, b = (
        np.stack([flux[k] for k in keys], axis=1) for keys in (("x_m", "y_m", "z_m"), ("bx_T", "by_T", "bz_T"))
    )
    np.testing.assert_allclose(field(cloud, points[::97]), b[::97], rtol=1e-4, atol=1e-7)
    data = read(folder / "figure5_flux_and_force_force.csv")
    tangent = paper.tract.tangent(data["tip_arclength_m"])
    push = force(cloud, paper.tract.position(data["tip_arclength_m"]), TIP.moment * tangent)
    np.testing.assert_allclose(data["force_x_N"], push[:, 0], rtol=1e-6)
    np.testing.assert_allclose(data["projected_N"], (push * tangent).sum(axis=1), rtol=1e-5, atol=1e-10)


def test_figures_6_and_7_agree(folder):
    map_, most = (read(folder / f"figure6_force_against_angle_{name}.csv") for name in ("map", "maximum"))
    seven = read(folder / "figure7_best_angle.csv")
    np.testing.assert_allclose(seven["force_N"], most["force_N"], rtol=1e-6)
    np.testing.assert_allclose(seven["angle_rad"], most["angle_rad"], rtol=1e-6)
    columns = np.stack([map_[k] for k in map_ if k.startswith("force_N_at_s_")])
    highest, at = columns.max(axis=1), most["force_N"][::5]
    assert len(highest) == len(at)
    assert (highest <= at * (1 + 1e-6)).all()
    assert (highest >= at * (1 - 2e-3)).all()
    assert (columns.min(axis=1) < 0).all()
    assert at.min() > 2.5e-3


def test_figure_8_is_the_drive_under_both_couplings(folder):
    data = read(folder / "figure8_coupling.csv")
    paper, rows = Scenario.paper(), slice(None, None, 50)
    s, angle = data["tip_arclength_m"][rows], data["angle_rad"][rows, None]
    np.testing.assert_allclose(drive_at(paper, angle, s), data["force_N"][rows], rtol=1e-5)
    wrench = drive_at(paper.replace(coupling="wrench"), angle, s)
    np.testing.assert_allclose(wrench, data["wrench_N"][rows], rtol=1e-5, atol=1e-9)
    assert (data["best_wrench_N"] >= data["wrench_N"] - 1e-9).all()
    assert 0.1 < (data["wrench_N"] < 0).mean() < 0.3


@pytest.mark.parametrize("case", ["one_magnet", "two_magnets", "magnetised_tip"])
@pytest.mark.parametrize("shape", ["bend", "S"])
def test_figure_9_shows_wanted_shapes_and_how_far_off_they_are(folder, case, shape):
    name = f"figure9_wanted_shapes_{case}_{shape}.csv"
    data, commands = read(folder / name), read(folder / "figure9_wanted_shapes_commands.csv")
    off = np.hypot(data["x_m"] - data["wanted_x_m"], data["z_m"] - data["wanted_z_m"])
    assert commands[f"{case}_{shape}_distance_m"][0] == pytest.approx(off.max(), rel=1e-5)
    reached = commands[f"{case}_{shape}_reached"][0]
    assert reached == float(off.max() < 1e-3)
    assert reached == float((case, shape) != ("magnetised_tip", "S"))


def test_figure_9_holds_the_command_that_bends_the_rod(folder):
    data = read(folder / "figure9_wanted_shapes_one_magnet_bend.csv")
    commands = read(folder / "figure9_wanted_shapes_commands.csv")
    case = shapes.columns(len(data["x_m"]) - 1)["one_magnet"]
    x, z, angle = (
        commands[f"one_magnet_bend_{knob}"][0]
        for knob in ("slide_x_of_magnet_0_m", "slide_z_of_magnet_0_m", "turn_y_of_magnet_0_rad")
    )
    (mount,) = case.rig.magnets
    c, s = np.cos(angle), np.sin(angle)
    place = np.array(mount.position) + [x, 0.0, z]
    cloud = mount.magnet.dipoles(*mount.dipoles).moved(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), place)
    nodes = case.rod.equilibrium(cloud)
    np.testing.assert_allclose(nodes[:, 0], data["x_m"], atol=1e-6)
    np.testing.assert_allclose(nodes[:, 2], data["z_m"], atol=1e-6)


def test_figure_10_is_the_record_and_what_the_rigs_do(folder):
    tracts, paper = (read(folder / f"figure10_reach_{name}.csv") for name in ("tracts", "paper"))
    rows = recorded()
    assert tracts["both"].tolist() == [row.both for row in rows]
    assert tracts["distance_m"].tolist() == pytest.approx([distance(row.reading) for row in rows])
    force = paper["wrench"] == 0
    assert paper["rig"][force].tolist() == [0, 1, 2, 3]
    assert (np.diff(paper["least_drive_N"][force]) > 0).all()
    assert (paper["spared_torque_Nm"] <= paper["median_torque_Nm"]).all()


def test_the_page_on_physics_shows_every_figure():
    page = (Path(__file__).parents[2] / "docs/physics.md").read_text(encoding="utf-8")
    for name in FIGURES:
        assert f"(figures/{name}.png)" in page
        assert (Path(__file__).parents[2] / f"docs/figures/{name}.png").stat().st_size > 10_000


def test_an_unknown_figure_is_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match="only must be one of 'figure1_approaching_dipole'"):
        draw(tmp_path / "none", ["figure9"])
    assert not (tmp_path / "none").exists()


def test_matplotlib_is_loaded_only_when_something_is_drawn():
    code = "import sys, magwire_env.figures; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
