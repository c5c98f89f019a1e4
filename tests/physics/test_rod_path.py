"""Paths of the free rod: following a branch, reporting where it ends; and what the rod refuses."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from magwire_env.physics import DipoleCloud, FreeRod, NotConverged, Profile
from magwire_env.validation.magnets import BLOCK, TIP
from magwire_env.validation.rods import (
    LENGTH,
    axial_snap_place,
    field_unit,
    make_rod,
    tip_angle,
)


@pytest.mark.parametrize("loads", [12, 97])
def test_path_reports_the_snap_into_contact(loads):
    rod = make_rod(12)
    expected = axial_snap_place(rod, 5.0)
    places = np.linspace(expected + 0.03, expected - 0.011, loads)
    path = rod.path([{"cloud": DipoleCloud([[x, 0, 0]], [[5.0, 0, 0]])} for x in places])
    assert path.snap == np.flatnonzero(places < expected)[0]
    assert path.converged.tolist() == [i < path.snap for i in range(loads)]
    assert np.isfinite(path.positions[: path.snap]).all()
    assert np.isnan(path.positions[path.snap :]).all()


def test_snap_place_is_sharp():
    rod = make_rod(12)
    expected = axial_snap_place(rod, 5.0)
    for share, snap in ((1 + 2e-5, None), (1 - 2e-5, 1)):
        path = rod.path(
            [{"cloud": DipoleCloud([[x, 0, 0]], [[5.0, 0, 0]])} for x in (expected + 0.02, expected * share)]
        )
        assert path.snap == snap


@pytest.mark.parametrize(("segments", "loads"), [(12, 10), (12, 48), (20, 24)])
def test_path_reports_the_jump_to_another_equilibrium(segments, loads):
    """A turning field, β = 2.5: the rod lags behind until the field passes antiparallel, then swings over.

    At 180° the bent rod may turn about its axis at no cost; just beyond, all of that turn runs downhill.
    """
    rod = make_rod(segments)
    angles = np.radians(np.linspace(0, 230, loads))
    fields = 2.5 * field_unit(rod) * np.stack([np.cos(angles), 0 * angles, np.sin(angles)], axis=1)
    path = rod.path([{"uniform_field": b} for b in fields])
    assert path.snap == np.flatnonzero(angles > math.pi)[0]
    assert path.converged.all()
    mirrored = rod.equilibrium(uniform_field=fields[-1] * [1, 1, -1])
    np.testing.assert_allclose(path.positions[-1], mirrored * [1, 1, -1], atol=1e-8)
    for nodes, b, angle in list(zip(path.positions, fields, angles, strict=True))[1:]:
        lag = angle if angle < math.pi else 2 * math.pi - angle
        phi = math.radians(tip_angle(nodes))  # the rod is an arc: φ = β sin(α − φ)
        assert phi == pytest.approx(2.5 * math.sin(lag - phi), rel=1e-6)
        np.testing.assert_allclose(rod.forces(nodes, uniform_field=b)[1:], 0, atol=1e-7 * rod.wire.axial_rigidity)


def test_a_smooth_path_has_no_snap_and_does_not_depend_on_its_steps():
    rod = make_rod(12)
    ends = []
    for loads in (2, 5, 40):
        heights = np.linspace(0.4, 0.12, loads)
        path = rod.path([{"cloud": DipoleCloud([[0.1, 0, h]], [[4.0, 0, 0]])} for h in heights])
        assert path.snap is None
        assert path.converged.all()
        ends.append(path.positions[-1])
    assert np.abs(ends[0] - np.linspace([0, 0, 0], [LENGTH, 0, 0], 13)).max() > 1e-3
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, atol=1e-9)


def test_a_path_that_comes_back_ends_where_it_began():
    rod = make_rod(12)
    turns = np.radians([0, 40, 80, 120, 80, 40, 0])
    path = rod.path([{"uniform_field": 2 * field_unit(rod) * np.array([math.cos(a), math.sin(a), 0])} for a in turns])
    assert path.snap is None
    np.testing.assert_allclose(path.positions[::-1], path.positions, atol=1e-9)


def test_a_magnet_led_through_the_tip_touches_it():
    """Between two loads the magnet passes the tip's place, which only steps in between can tell."""
    rod = make_rod(12)
    left, right = ({"cloud": DipoleCloud([[LENGTH, y, 0]], [[-1e-4, 0, 0]])} for y in (-0.05, 0.05))
    path = rod.path([left, right])
    assert path.snap == 1
    assert path.converged.tolist() == [True, False]
    assert rod.path([left, {}, right]).snap is None


def test_clouds_of_different_size_fade_into_each_other():
    rod = make_rod(12)
    clouds = [BLOCK.dipoles("gauss", n).moved(translation=np.array([0.1, 0.1, 0.2])) for n in (4, 5, 1)]
    path = rod.path([{"cloud": cloud} for cloud in clouds])
    assert path.snap is None
    for nodes, cloud in zip(path.positions, clouds, strict=True):
        np.testing.assert_allclose(nodes, rod.equilibrium(cloud), atol=1e-9)


def test_a_path_whose_first_load_has_no_equilibrium_says_so():
    rod = make_rod(12)
    near, far = (DipoleCloud([[x, 0, 0]], [[5.0, 0, 0]]) for x in (axial_snap_place(rod, 5.0) - 1e-3, 0.4))
    path = rod.path([{"cloud": near}, {"cloud": far}])
    assert path.snap == 0
    assert not path.converged.any()
    assert np.isnan(path.positions).all()


def test_contact_raises_with_the_residual():
    rod = make_rod(12)
    cloud = DipoleCloud([[axial_snap_place(rod, 5.0) - 1e-3, 0, 0]], [[5.0, 0, 0]])
    with pytest.raises(NotConverged, match=r"contact with a magnet; gradient norm \S+ E·I/L") as caught:
        rod.equilibrium(cloud)
    assert caught.value.touched
    assert 0 < caught.value.residual < math.inf
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.residual, again.touched) == (str(caught.value), caught.value.residual, True)


def test_contact_is_as_near_as_asked_for():
    cloud = DipoleCloud([[LENGTH, 0, 0.01]], [[1e-5, 0, 0]])  # too weak to move the rod
    nodes = make_rod(4, contact=0.0099).equilibrium(cloud)
    assert np.abs(nodes[-1] - [LENGTH, 0, 0]).max() < 1e-4
    with pytest.raises(NotConverged, match="contact") as caught:
        make_rod(4, contact=0.0102).equilibrium(cloud)
    assert caught.value.touched
    with pytest.raises(ValueError, match="positions must keep the tip out of contact"):
        make_rod(4, contact=0.0102).forces(nodes, cloud=cloud)
    assert make_rod(4, contact=0.0102).energy(nodes, cloud=cloud) == math.inf


def test_an_unreachable_tolerance_is_said():
    with pytest.raises(NotConverged, match="no stable equilibrium") as caught:
        make_rod(8, tolerance=1e-30).equilibrium(tip_force=(0, 0, 1e-3))
    assert 0 < caught.value.residual < 1e-9


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: FreeRod("wire", TIP), "FreeRod.wire must be a wire"),
        (lambda: FreeRod(make_rod(4).wire, 0.01), "FreeRod.tip must be a tip"),
        (lambda: FreeRod(replace(make_rod(4).wire, bending=Profile.steps((1.0, 1e-5))), TIP), "Guidewire.bending"),
        (lambda: FreeRod(replace(make_rod(4).wire, curl=20.0, twisting=1e-5), TIP), "Guidewire.curl"),
        (lambda: make_rod(4, gravity=(0, 0)), r"FreeRod.gravity must be 3 finite numbers \(in m/s²\)"),
        (lambda: make_rod(4, contact=0), r"FreeRod.contact must be greater than 0 \(in m\), got 0"),
        (lambda: make_rod(4, tolerance=-1), "FreeRod.tolerance must be greater than 0"),
        (lambda: make_rod(4).equilibrium(cloud=[1, 2]), "cloud must be a DipoleCloud or None, got list"),
        (lambda: make_rod(4).equilibrium(uniform_field=(0, math.nan, 0)), "uniform_field must be 3 finite numbers"),
        (lambda: make_rod(4).equilibrium(tip_force=1.0), r"tip_force must be 3 numbers \(in N\), got 1.0"),
        (lambda: make_rod(4).equilibrium(start=np.zeros((3, 3))), r"start must be \(5, 3\) m"),
        (lambda: make_rod(4).energy(np.zeros((5, 3))), "positions must have distinct neighbours"),
        (lambda: make_rod(4).energy(np.ones((5, 3))), "first node at the origin"),
        (lambda: make_rod(4).path([{}, {"force": (0, 0, 1)}]), r"loads\[1\] must be a mapping with keys among cloud"),
        (lambda: make_rod(4).path([{"start": None}]), r"loads\[0\] must be"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
