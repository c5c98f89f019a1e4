"""The way back from a shape to the field or the rig that makes it: round trips, limits that are named, bad input."""

import math

import numpy as np
import pytest

from magwire_env.physics import Curve, CylinderMagnet, FreeRod, Guidewire, TipPose
from magwire_env.scenario import ActuatedMagnet, Rig, Scenario, Slide, Turn
from magwire_env.validation.inverse import MEANS, arc, arc_verdicts, round_trips, tip_magnetised

WIRE = Guidewire(0.1, 2.5e-3, 600e3, 550e3, 1100.0, 12)
ROD = FreeRod(WIRE, CylinderMagnet(2e-3, 3e-3, 1.37))
BLOCK = Scenario.paper().rig.magnets[0].magnet


def one_magnet() -> Rig:
    return Rig((ActuatedMagnet(BLOCK, (0.09, 0.0, 0.2), (Slide("x", -0.06, 0.06), Turn("y")), ("fitted", 9)),))


@pytest.mark.parametrize("name", [name for name in MEANS if "two" not in name])
@pytest.mark.parametrize("pose", [False, True], ids=["curve", "pose"])
def test_what_a_load_has_made_is_reached_again(name, pose):
    trips = round_trips(MEANS[name](), 3, pose, seed=7)
    assert trips.reached == trips.made == 3


@pytest.mark.parametrize("pose", [False, True], ids=["curve", "pose"])
def test_verdicts_on_random_targets_agree_with_the_nearest_arc(pose):
    verdicts = arc_verdicts(12, pose, seed=3)
    assert 0 < verdicts.reachable < verdicts.made
    assert verdicts.wrong == 0
    assert verdicts.nameless == 0


def test_the_field_for_an_arc_is_the_closed_form():
    """The couple m B sin of a uniform field bends the rod to an arc: E I φ/L = m B for a field across the tip."""
    turn = 0.6
    found = ROD.field_for(arc(turn, math.pi / 2))
    assert found.reached
    field = found.load["uniform_field"]
    tip = np.array([math.cos(turn), 0.0, math.sin(turn)])
    couple = ROD.reference_moment * np.linalg.norm(np.cross(tip, field))
    assert couple == pytest.approx(WIRE.bending_rigidity * turn / WIRE.length, rel=0.02)


def test_a_shape_that_needs_more_than_the_field_allows_says_range():
    found = ROD.field_for(arc(1.2, 0.0), limit=1e-3)
    assert (found.reached, found.limit) == (False, "range")
    assert "the field is at its limit of 0.001 T" in found.why


def test_a_shape_out_of_reach_says_so_and_where_it_got():
    s_shape = arc(0.0, 0.0)
    s_shape[:, 2] = 0.02 * np.sin(2 * math.pi * s_shape[:, 0] / 0.1)
    found = ROD.field_for(s_shape)
    assert not found.reached
    assert found.limit in ("directions", "snap", "range")
    assert found.distance == pytest.approx(np.linalg.norm(found.positions - s_shape, axis=1).max())


def test_the_rod_comes_to_rest_in_the_shape_that_the_solution_shows():
    wanted = ROD.equilibrium(uniform_field=(0.0, 0.004, 0.003))
    found = ROD.field_for(TipPose(wanted[-1], wanted[-1] - wanted[-2]))
    np.testing.assert_allclose(ROD.path(found.loads).positions[-1], found.positions, atol=1e-6)
    assert np.linalg.norm(found.positions[-1] - wanted[-1]) < 1e-3


def test_the_command_of_a_rig_keeps_its_limits():
    rig = one_magnet()
    found = ROD.rig_for(TipPose((0.05, 0.0, 0.06)), rig)
    assert len(found.names) == len(found.parameters) == 2
    assert -0.06 <= found.parameters[0] <= 0.06


def test_a_rod_without_a_tip_magnet_is_brought_into_shape_by_its_own_magnetisation():
    rod = tip_magnetised()
    wanted = rod.equilibrium(uniform_field=(0.0, 0.0, 0.003))
    assert np.linalg.norm(wanted[-1] - [0.1, 0.0, 0.0]) > 5e-3
    assert rod.field_for(Curve(wanted)).reached


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Curve([[0, 0, 0]]), r"Curve\.points must hold at least 2 points"),
        (lambda: Curve([[0, 0, 0], [np.nan, 0, 0]]), r"Curve\.points"),
        (lambda: Curve([[0, 0, 0], [0.1, 0, 0]], arclengths=[0.05, 0.02]), r"Curve\.arclengths must be 2 rising"),
        (lambda: Curve([[0, 0, 0], [0.1, 0, 0]], within=0.0), r"Curve\.within must be greater than 0"),
        (lambda: TipPose((0.1, 0.0)), r"TipPose\.position"),
        (lambda: TipPose((0.1, 0, 0), (0, 0, 0)), r"TipPose\.direction must not be zero"),
        (lambda: ROD.field_for(Curve([[0, 0, 0], [1, 0, 0]], [0.0, 0.2])), r"must end within the wire's 0\.1 m"),
        (lambda: ROD.field_for(arc(0.5, 0.0), limit=-1.0), r"limit must be greater than 0"),
    ],
)  # fmt: skip
def test_bad_targets_are_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()
