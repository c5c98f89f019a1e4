"""The named tracts: what their docstrings say of bends, size and clearance, and lumens that vary."""

from __future__ import annotations

import numpy as np
import pytest

from magwire_env.lumen import named
from magwire_env.lumen.generator import extent, self_clearance, sharpest_bend
from magwire_env.lumen.named import NAMED, planar_course
from magwire_env.physics import Tract
from magwire_env.scenario import Scenario

# Least bend radius in mm, as the docstrings give it; the paper's spiral is held by PHYSICS.md, not here.
BENDS = {"helix": 40, "colon_frame": 35, "small_bowel_loops": 36, "aortic_arch": 47, "s_bend": 73, "circle": 64}


def brute_bend_and_gap(tract: Tract) -> tuple[float, float]:
    """Least bend radius by finite differences of the tangent, least wall-to-wall distance over all pairs of points."""
    s = np.linspace(0.0, tract.length, 1601)
    turn = np.linalg.norm(np.diff(tract.tangent(s), axis=0), axis=1).max() / (s[1] - s[0])
    s = s[::2]
    p = tract.position(s)
    along = np.abs(s[:, None] - s)
    along = np.minimum(along, tract.length - along) if tract.closed else along
    gap = np.linalg.norm(p[:, None] - p, axis=2) - tract.radius_at(s)[:, None] - tract.radius_at(s)
    return 1 / max(turn, 1e-9), gap[along >= 4 * tract.widest].min()


@pytest.mark.parametrize("name", NAMED)
def test_bends_clearance_and_length_of_every_named_tract(name):
    tract = NAMED[name]()
    bend, gap = brute_bend_and_gap(tract)
    assert bend >= 0.03
    assert gap >= 3e-3
    assert 0.4 <= round(tract.length, 9) <= 0.9
    assert sharpest_bend(tract)[0] == pytest.approx(bend, rel=0.015) or name == "straight"
    loose = 1.5 * tract.widest  # beyond this, what counts is only where neighbours end
    assert min(self_clearance(tract)[0], loose) == pytest.approx(min(gap, loose), abs=2e-4)
    if name in BENDS:
        assert round(1e3 * sharpest_bend(tract)[0]) == BENDS[name]


@pytest.mark.parametrize("name", NAMED)
def test_length_scales_the_shape_and_radius_is_the_lumen_s(name):
    tract, half = NAMED[name](), NAMED[name](length=NAMED[name]().length / 2, radius=3e-3)
    assert half.length == pytest.approx(tract.length / 2, rel=1e-9)
    assert half.widest == 3e-3
    assert np.allclose(2 * np.array(half.points), tract.points, atol=1e-9)


def test_the_registry_holds_every_public_function_under_its_name():
    functions = {name for name in named.__all__ if name not in ("NAMED", "planar_course")}
    assert set(NAMED) == functions
    assert all(f.__name__ == name and f.__doc__ for name, f in NAMED.items())


def test_circle_is_closed_and_bends_evenly():
    tract = NAMED["circle"](length=0.5)
    s = np.linspace(0.0, 0.5, 200)
    assert tract.closed
    assert tract.curvature(s) == pytest.approx(2 * np.pi / 0.5, rel=2e-3)
    assert tract.position(0.1) == pytest.approx(tract.position(0.6), abs=1e-12)
    assert np.linalg.norm(tract.position(s), axis=1) == pytest.approx(0.5 / (2 * np.pi), rel=1e-4)


def test_helix_has_the_curvature_of_its_radius_and_pitch():
    tract = NAMED["helix"]()
    p = tract.position(np.linspace(0.1, 0.7, 300))
    r = np.hypot(p[:, 0], p[:, 1]).mean()
    climb = (p[-1, 2] - p[0, 2]) / 0.6  # per metre of length
    assert tract.curvature(0.4) == pytest.approx((1 - climb**2) / r, rel=3e-3)


def test_shapes_are_what_they_are_named_for():
    s_bend = NAMED["s_bend"]()
    ends, middle = s_bend.tangent(np.array([0.0, 0.4])), s_bend.tangent(0.2)
    assert ends[0] @ ends[1] == pytest.approx(1.0, abs=1e-3)
    assert abs(ends[0] @ middle) < 0.12  # 83° to 97°: the bends ease into each other

    loops = NAMED["small_bowel_loops"]()
    x = loops.tangent(np.linspace(0.0, loops.length, 400))[:, 0]
    assert (np.diff(np.sign(x[np.abs(x) > 0.5])) != 0).sum() == 3  # three hairpins
    assert extent(loops)[2] < 0.045

    colon = NAMED["colon_frame"]()
    rectum, descending, transverse, ascending = colon.position(colon.length * np.array([0.03, 0.45, 0.68, 0.95]))
    assert descending[0] > 0.08
    assert ascending[0] < -0.08
    assert transverse[2] > rectum[2] + 0.02  # hangs forward
    assert colon.tangent(0.45 * colon.length)[1] > 0.95
    assert colon.tangent(0.95 * colon.length)[1] < -0.95

    arch = NAMED["aortic_arch"]()
    up, down = arch.tangent(0.02), arch.tangent(0.9 * arch.length)
    assert up[1] > 0.9
    assert down[1] < -0.9
    top = arch.position(np.linspace(0.0, arch.length, 300))[:, 1].argmax() / 300
    assert 0.2 < top < 0.5
    assert arch.radius_at(0.0) == pytest.approx(13e-3)
    assert arch.radius_at(arch.length) == pytest.approx(13e-3 * 2 / 3)


def test_planar_course_turns_by_its_legs():
    points = planar_course([(0.1, 0), (0.1, 90), (0.1, -30), (0.1, 0)], spacing=0.002)
    first, last = points[1] - points[0], points[-1] - points[-2]
    turn = np.rad2deg(np.arctan2(last[1], last[0]) - np.arctan2(first[1], first[0]))
    assert turn == pytest.approx(60, abs=0.5)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(0.4, rel=5e-3)
    assert points.max(axis=0) + points.min(axis=0) == pytest.approx(0.0, abs=1e-12)


# --- a lumen that varies ----------------------------------------------------------------------------------------------

LINE = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.3, 0.0, 0.0), (0.4, 0.0, 0.0)]


def test_radius_goes_linearly_from_point_to_point_and_on_beyond_the_ends():
    tract = Tract.from_points(LINE, radius=[4e-3, 6e-3, 10e-3, 8e-3])
    s = np.array([-0.05, 0.0, 0.05, 0.1, 0.2, 0.3, 0.35, 0.4, 0.5])
    assert tract.radius_at(s) == pytest.approx(np.array([4, 4, 5, 6, 8, 10, 9, 8, 8]) * 1e-3)
    assert tract.widest == 10e-3
    assert Tract.from_points(LINE, 5e-3).radius_at(s) == pytest.approx(5e-3)
    assert Tract.from_points(LINE, 5e-3).widest == 5e-3


def test_radius_of_a_loop_wraps_round():
    turn = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    xyz = 0.05 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    tract = Tract.from_points(xyz, radius=[5e-3] * 4 + [9e-3] * 4, closed=True)
    seventh = 15 / 16 * tract.length  # halfway from the last point back to the first
    assert tract.radius_at(seventh) == pytest.approx(7e-3)
    assert tract.radius_at(seventh - tract.length) == pytest.approx(7e-3)
    assert tract.radius_at(seventh + 2 * tract.length) == pytest.approx(7e-3)


def test_tracts_with_radii_are_values():
    one, same, other = (Tract.from_points(LINE, radius=r) for r in ([4e-3] * 4, np.full(4, 4e-3), [4e-3] * 3 + [5e-3]))
    assert one == same
    assert hash(one) == hash(same)
    assert one != other
    assert one != Tract.from_points(LINE, 4e-3)


@pytest.mark.parametrize(
    ("radius", "words"),
    [
        ([4e-3, 5e-3], "each of the 4 points"),
        ([4e-3, 5e-3, 0.0, 5e-3], r"Tract.radius\[2\] must be greater than 0"),
        ([4e-3, 5e-3, float("nan"), 5e-3], r"Tract.radius\[2\] must be finite"),
        ([4e-3, "wide", 4e-3, 4e-3], r"Tract.radius\[1\] must be a number"),
        (None, "Tract.radius must be a number"),
        (-1.0, "Tract.radius must be greater than 0"),
    ],
)
def test_impossible_radii_are_refused(radius, words):
    with pytest.raises(ValueError, match=words):
        Tract.from_points(LINE, radius=radius)


def test_a_scenario_keeps_radii_through_toml_and_clears_the_widest(tmp_path):
    scenario = Scenario.paper()
    points = scenario.tract.points
    radii = tuple(np.linspace(6e-3, 9e-3, len(points)).tolist())
    scenario = scenario.replace(tract=Tract.from_points(points, radii))
    scenario.save(tmp_path / "varied.toml")
    again = Scenario.load(tmp_path / "varied.toml")
    assert again == scenario
    assert again.tract.radius == radii
    with pytest.raises(ValueError, match="magnet enters the tract"):  # 44 mm of magnet and 30 mm of lumen exceed 70 mm
        scenario.replace(tract=Tract.from_points(points, (*radii[:-1], 30e-3)))
