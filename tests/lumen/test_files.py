"""Centreline files by other tools' conventions load as the tracts they hold."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce
from magwire_env.lumen import read_centreline
from magwire_env.lumen.generator import sharpest_bend
from magwire_env.physics import Tract
from magwire_env.scenario import ActuatedMagnet, Rig, Scenario, Slide, Turn, above
from tests.support.centreline_writers import MISR, Vtp, csv_text, curve, markups, vessel, write


def assert_is_vessel(tract, tolerance=1e-4):
    """The tract runs through the vessel, in metres, from its first point to its last, with its radii."""
    xyz, radius = vessel()
    s = tract.project(xyz * 1e-3)
    assert np.linalg.norm(tract.position(s) - xyz * 1e-3, axis=1).max() < tolerance
    assert (np.diff(s) > -1e-6).all()
    assert s[0] < 1e-4
    assert s[-1] > tract.length - 1e-4
    assert np.abs(tract.radius_at(s) - radius * 1e-3).max() < 1e-4
    assert sharpest_bend(tract)[0] > 0.045


@pytest.mark.parametrize(
    ("header", "unit", "size"),
    [
        ("x [mm],y [mm],z [mm],radius [mm]", None, 1.0),
        ("x [mm],y [mm],z [mm],radius [mm]", "mm", 1.0),
        ("X (mm),Y (mm),Z (mm),Radius (mm)", None, 1.0),
        ("x_mm,y_mm,z_mm,radius_mm", None, 1.0),
        (f"x,y,z,{MISR}", "mm", 1.0),
        ("x [m],y [m],z [m],radius [m]", None, 1e-3),
        ("x,y,z,radius", "m", 1e-3),
        ("x [cm],y [cm],z [cm],radius [mm]", None, (0.1, 1.0)),
        ("# x [um], y [um], z [um], radius [um]", None, 1e3),
    ],
)
def test_csv_in_any_declared_unit(tmp_path, header, unit, size):
    xyz, radius = vessel()
    length, width = size if isinstance(size, tuple) else (size, size)
    path = write(tmp_path, "vessel.csv", csv_text(xyz * length, radius * width, header))
    assert_is_vessel(Tract.load(path, unit))


@pytest.mark.parametrize("name", ["r [mm]", "R_mm", "radius (mm)"])
def test_a_column_of_radii_may_be_called_r(tmp_path, name):
    rows = "\n".join(f"{10 * i},0,0,{5 + 0.1 * i}" for i in range(20))
    path = write(tmp_path, "short.csv", f"x [mm],y [mm],z [mm],{name}\n{rows}\n")
    assert Tract.load(path).radius[0] == pytest.approx(5e-3)


@pytest.mark.parametrize("name", ["Diameter [mm]", "d", "rad", "radii"])
def test_a_column_that_looks_like_radii_is_not_ignored_in_silence(tmp_path, name):
    rows = "\n".join(f"{10 * i},0,0,{5 + 0.1 * i},1" for i in range(20))
    path = write(tmp_path, "other.csv", f"x [mm],y [mm],z [mm],{name},branch\n{rows}\n")
    with pytest.warns(UserWarning, match=r"a column '.*', which is not read: a column of radii is called radius or r"):
        assert Tract.load(path).radius == 7.5e-3


def test_csv_of_other_programs(tmp_path):
    xyz, radius = vessel()
    rows = "".join(
        f'{i}\t"{x:.9g}"\t{y:.9g}\t{z:.9g}\t{r:.9g}\n' for i, (x, y, z, r) in enumerate(np.column_stack([xyz, radius]))
    )
    text = "\ufeff\nindex\tx_mm\ty_mm\tz_mm\tradius_mm\n# from a segmentation\n\n" + rows
    assert_is_vessel(Tract.load(write(tmp_path, "tabs.csv", text)))
    assert_is_vessel(Tract.load(write(tmp_path, "semicolons.CSV", csv_text(xyz, radius).replace(",", ";"))))
    plain = Tract.load(write(tmp_path, "plain.csv", csv_text(xyz)))
    assert plain.radius == 7.5e-3  # a number, not one a point
    assert Tract.load(tmp_path / "plain.csv", radius=4e-3).radius == 4e-3


LAYOUTS = [
    {"form": "ascii", "compressed": False},
    {"form": "binary", "compressed": True},
    {"form": "binary", "compressed": False},
    {"form": "binary", "compressed": True, "header": "UInt64", "order": "BigEndian"},
    {"form": "binary", "compressed": False, "header": "UInt64"},
    {"form": "appended", "compressed": True},
    {"form": "appended", "compressed": True, "header": "UInt64", "block": 32768},
    {"form": "appended", "compressed": False, "order": "BigEndian"},
    {"form": "appended", "compressed": True, "encoding": "raw", "header": "UInt64"},
    {"form": "appended", "compressed": False, "encoding": "raw"},
]


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: "-".join(map(str, layout.values())))
def test_vmtk_vtp_in_every_layout_of_vtk(tmp_path, layout):
    xyz, radius = vessel()
    path = write(tmp_path, "vessel.vtp", Vtp(**layout).file([xyz], [radius]))
    assert_is_vessel(Tract.load(path, "mm"))


def test_bytes_that_vtk_itself_wrote(tmp_path):
    """Two whole numbers, 211 and 409, as vtkXMLPolyDataWriter compressed them: not by this file's writer."""
    xyz, _ = vessel(409)
    text = Vtp("binary").file([xyz[:211], xyz[211:]])
    ours = Vtp("binary").array("offsets", np.array([211, 409], "i8"))
    theirs = ours.split(b">")[0] + b">\n AQAAAACAAAAQAAAADwAAAA==eJy7zAABMxkhNAASDwFu\n </DataArray>"
    assert text.count(ours) == 1
    path = write(tmp_path, "two.vtp", text.replace(ours, theirs))
    first, second = (read_centreline(path, "mm", line=i) for i in (0, 1))
    assert first.points[-1] == pytest.approx(xyz[210] * 1e-3, abs=1e-8)
    assert second.points[0] == pytest.approx(xyz[211] * 1e-3, abs=1e-8)


def test_a_line_of_several_is_chosen_by_number(tmp_path):
    xyz, radius = vessel()
    branch, slim = xyz[:200] + np.array([0, 0, 40]), radius[:200] / 2
    path = write(tmp_path, "tree.vtp", Vtp().file([branch, xyz], [slim, radius]))
    assert_is_vessel(Tract.load(path, "mm", line=1))
    assert Tract.load(path, "mm", line=0).widest < 4e-3
    path = write(tmp_path, "two.mrk.json", markups({"type": "Fiducial"}, curve(branch, slim), curve(xyz, radius)))
    assert_is_vessel(Tract.load(path, line=1))


@pytest.mark.parametrize(
    ("changes", "unit"),
    [
        ({}, None),
        ({"units": ["mm", "UCUM", "millimeter"]}, None),
        ({"units": None}, "mm"),
        ({"system": None}, None),  # the schema's default is LPS
    ],
)
def test_slicer_curve(tmp_path, changes, unit):
    xyz, radius = vessel()
    assert_is_vessel(Tract.load(write(tmp_path, "vessel.mrk.json", markups(curve(xyz, radius, **changes))), unit))


def test_slicer_ras_is_lps_turned_round_z(tmp_path):
    xyz, radius = vessel()
    path = write(tmp_path, "ras.mrk.json", markups(curve(xyz * (-1, -1, 1), radius, system="RAS")))
    assert_is_vessel(Tract.load(path))


def test_slicer_leaves_out_points_not_placed(tmp_path):
    xyz, radius = vessel()
    markup = curve(np.insert(xyz, 30, [[900.0, 0, 0]], axis=0), np.insert(radius, 30, 99.0))
    markup["controlPoints"][30] = {"id": "31", "positionStatus": "undefined"}
    assert_is_vessel(Tract.load(write(tmp_path, "preview.mrk.json", markups(markup))))


def test_loops(tmp_path):
    turn = np.linspace(0.0, 2 * np.pi, 61)[:-1]
    xyz = 55 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    slicer = Tract.load(write(tmp_path, "ring.mrk.json", markups(curve(xyz, kind="ClosedCurve"))))
    comma = Tract.load(write(tmp_path, "ring.csv", csv_text(np.vstack([xyz, xyz[:1]]))))  # ends where it began
    ids = np.r_[np.arange(60), 0]
    vmtk = Vtp().file([xyz, xyz[:1]], connect=ids).replace(b'NumberOfLines="2"', b'NumberOfLines="1"')
    one = Vtp().array("offsets", np.array([61], "i8"))
    vmtk = vmtk.replace(Vtp().array("offsets", np.array([60, 61], "i8")), one)
    vtk = Tract.load(write(tmp_path, "ring.vtp", vmtk), "mm")
    for tract in (slicer, comma, vtk):
        assert tract.closed
        assert tract.length == pytest.approx(2 * np.pi * 0.055, rel=1e-4)
        assert tract.curvature(np.linspace(0, 0.3, 50)) == pytest.approx(1 / 0.055, rel=0.01)
    smooth = Tract.load(tmp_path / "ring.csv", smooth=1e-4)
    assert smooth.closed
    assert smooth.length == pytest.approx(2 * np.pi * 0.055, rel=2e-3)


def test_repeated_points_are_dropped(tmp_path):
    xyz, radius = vessel(60)
    double = np.repeat(np.arange(60), np.where(np.arange(60) % 7 == 0, 3, 1))
    once = Tract.load(write(tmp_path, "once.csv", csv_text(xyz, radius)))
    assert Tract.load(write(tmp_path, "often.csv", csv_text(xyz[double], radius[double]))) == once


def test_dense_jitter_is_thinned_and_smoothed_on_request(tmp_path):
    noisy, radius = vessel(900, noise=0.05)  # a point every 0.29 mm, 0.05 mm off
    path = write(tmp_path, "noisy.vtp", Vtp().file([noisy], [radius]))
    clean, _ = vessel(2000)
    raw, thinned, smoothed = (
        Tract.load(path, "mm", **how) for how in ({"spacing": 0.3e-3}, {}, {"smooth": 0.1e-3, "spacing": 8e-3})
    )
    assert sharpest_bend(raw)[0] < 0.01  # what a spline through every point would be: no vessel
    assert sharpest_bend(thinned)[0] > 0.015  # the jitter still shows, at 5 mm; smoothing is for that
    s = np.linspace(0.02, smoothed.length - 0.02, 300)
    assert smoothed.curvature(s) == pytest.approx(60 / (60**2 + 8**2) * 1e3, rel=0.15)
    off = np.linalg.norm(smoothed.position(smoothed.project(noisy * 1e-3)) - noisy * 1e-3, axis=1)
    assert np.sqrt((off**2).mean()) < 0.1e-3
    back = np.linalg.norm(smoothed.position(smoothed.project(clean * 1e-3)) - clean * 1e-3, axis=1)
    assert back.max() < 0.2e-3  # worst at the ends, where the allowed deviation is used up
    assert np.abs(smoothed.radius_at(smoothed.project(noisy * 1e-3)) - radius * 1e-3).max() < 0.1e-3


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(1.0, 9.0), min_size=5, max_size=80), st.floats(1.0, 30.0))
def test_thinning_keeps_some_points_of_the_file(tmp_path_factory, steps, spacing):
    along = np.r_[0.0, np.cumsum(steps)]
    xyz = np.stack([along, 20 * np.sin(along / 200), 0 * along], axis=1)
    path = write(tmp_path_factory.mktemp("thin"), "line.csv", csv_text(xyz))
    kept = read_centreline(path, spacing=spacing * 1e-3).points * 1e3
    index = np.abs(kept[:, None] - xyz).max(axis=2).argmin(axis=1)
    assert np.abs(kept - xyz[index]).max() < 1e-5
    assert index[0] == 0
    assert index[-1] == len(xyz) - 1
    arc = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
    apart, wanted = np.diff(arc[index]), min(spacing, arc[-1] / 8)
    assert apart[:-1].min(initial=np.inf) >= 0.99 * wanted  # none closer but the last, which must be kept
    assert apart[-1] >= 0.5 * wanted or len(steps) < 8
    assert apart.max() <= 1.5 * wanted + max(steps)


@pytest.mark.parametrize("name", ["vessel.csv", "vessel.vtp", "vessel.mrk.json"])
def test_a_loaded_tract_makes_a_scenario(tmp_path, name):
    xyz, radius = vessel()
    content = {"csv": csv_text(xyz, radius), "vtp": Vtp().file([xyz], [radius]), "json": markups(curve(xyz, radius))}
    path = write(tmp_path, name, content[name.split(".")[-1]])
    tract = Tract.load(path, "mm")
    assert_is_vessel(tract)
    paper = Scenario.paper()
    rig = Rig((ActuatedMagnet(paper.rig.magnets[0].magnet, above(tract, 0.07)),))
    scenario = paper.replace(tract=tract, rig=rig)
    scenario.save(tmp_path / "mine.toml")
    path.unlink()  # a saved scenario stands alone
    assert Scenario.load(tmp_path / "mine.toml") == scenario


@pytest.mark.parametrize("name", ["vessel.csv", "vessel.vtp", "vessel.mrk.json"])
def test_a_loaded_tract_is_steered_to_its_end_and_drawn(tmp_path, name):
    pytest.importorskip("pygame", reason="frames need the extra 'view'")
    xyz, radius = vessel()
    content = {"csv": csv_text(xyz, radius), "vtp": Vtp().file([xyz], [radius]), "json": markups(curve(xyz, radius))}
    tract = Tract.load(write(tmp_path, name, content[name.split(".")[-1]]), "mm")
    paper = Scenario.paper()
    slides = (Turn("y", home=np.pi), Slide("x", -0.07, 0.07), Slide("y", -0.07, 0.07))
    rig = Rig((ActuatedMagnet(paper.rig.magnets[0].magnet, (0.0, 0.0, 0.12), slides),))
    env = gym.make("MagWire/Steer-v0", scenario=paper.replace(tract=tract, rig=rig), render_mode="rgb_array")
    observation, _ = env.reset(seed=0)
    controller = MaxForce.from_env(env, spacing=0.01)
    terminated = truncated = False
    while not (terminated or truncated):
        observation, _, terminated, truncated, info = env.step(controller.predict(observation)[0])
    assert info["is_success"]
    frame = env.render()
    assert frame.shape == (480, 640, 3)
    assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 20
    env.close()
