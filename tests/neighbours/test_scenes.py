"""The scenes that the neighbours share: their closed forms, and ours in them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.neighbours import __main__ as command
from tests.neighbours.cylinder import Cylinder
from tests.neighbours.free_wire import coiled, drawn_round
from tests.neighbours.tube import OFF, Helix


@pytest.mark.parametrize(
    ("wrap", "friction", "ratio"), [(180, 0.1, 1.2210), (180, 0.5, 2.6180), (90, 0.3, 1.5237), (90, 0.5, 2.0)]
)
def test_the_ratio_of_the_pulls_is_that_of_row_f13(wrap, friction, ratio):
    assert Cylinder(math.radians(wrap), friction).expected == pytest.approx(ratio, abs=1e-4)


def test_the_rod_starts_round_the_cylinder_pulled_to_both_sides_alike():
    scene = Cylinder()
    away = np.hypot(*scene.start[:, :2].T)
    assert away.min() == pytest.approx(scene.radius, rel=0.01)
    np.testing.assert_allclose(scene.start[0, 1], scene.start[-1, 1], atol=1e-3)
    np.testing.assert_allclose(scene.directions[1], [0.0, -1.0, 0.0], atol=1e-12)


def test_a_helix_is_measured_as_it_is():
    scene = Helix(200)
    found = scene.measured(scene.start, np.full(201, 0.2 * scene.rest[0]))
    assert found.pitch == pytest.approx(OFF * scene.expected.pitch, rel=1e-3)
    assert found.load == pytest.approx(0.2)


def test_ours_comes_near_both_closed_forms():
    scene = Cylinder(fine=0.05)
    assert drawn_round(scene, 1e-2) == pytest.approx(scene.expected, rel=5e-3)
    helix = Helix(100)
    found = coiled(helix, 1e-3)
    assert found.pitch == pytest.approx(helix.expected.pitch, rel=1e-2)
    assert found.load == pytest.approx(helix.expected.load, rel=5e-3)


def test_a_neighbour_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setitem(command.PACKAGES, "mujoco", "a_module_that_does_not_exist")
    found, missing = command.solvers(["magwire", "mujoco"])
    assert list(found) == ["magwire"]
    assert len(missing) == 1
    assert missing[0].startswith("mujoco was not run: ")


def test_a_run_that_fails_is_a_row_with_its_reason():
    case = next(iter(command.in_a_tube("magwire", lambda scene, step: scene.expected)))
    assert command.timed(case)[4] == "pitch +0.00%, load +0.00%"

    def fails() -> str:
        raise RuntimeError("it has blown up")

    assert command.timed(replace(case, run=fails))[4] == "failed: it has blown up"
