"""Every parameter is read from a scenario as it was put into it."""

import pytest

from magwire_env import Scenario
from magwire_env.identification import PARAMETERS
from magwire_env.identification.parameters import chosen

PAPER = Scenario.paper()


@pytest.mark.parametrize("name", ["friction", "bending_rigidity", "axial_rigidity", "drag", "tip_remanence"])
def test_a_value_that_is_put_is_read_again(name):
    parameter = PARAMETERS[name]
    value = 1.25 * parameter.read(PAPER)
    assert parameter.read(parameter.put(PAPER, value)) == pytest.approx(value)
    assert parameter.put(PAPER, parameter.read(PAPER)).tract == PAPER.tract


def test_the_rig_shifts_and_strengthens_as_a_whole():
    moved = PARAMETERS["rig_y"].put(PAPER, 5e-3).rig.magnets[0]
    was = PAPER.rig.magnets[0]
    assert moved.position == pytest.approx((was.position[0], was.position[1] + 5e-3, was.position[2]))
    assert PARAMETERS["remanence"].put(PAPER, 1.1).rig.magnets[0].magnet.remanence == pytest.approx(1.43)


def test_clearance_is_refused_for_a_wire_without_walls():
    with pytest.raises(ValueError, match="'locked', which has no walls"):
        chosen(PAPER, ["clearance"])


@pytest.mark.parametrize(
    ("names", "bounds", "told"),
    [
        ([], {}, "must be different names"),
        (["friction", "friction"], {}, "must be different names"),
        (["stiffness"], {}, "must be one of"),
        (["friction"], {"drag": (0.1, 1.0)}, "got 'drag'"),
        (["drag"], {"drag": (0.0, 1.0)}, "0 < low < high"),
        (["friction"], {"friction": (0.2, 0.1)}, "low < high"),
    ],
)
def test_bad_choices_are_named(names, bounds, told):
    with pytest.raises(ValueError, match=told):
        chosen(PAPER, names, bounds)
