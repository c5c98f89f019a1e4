"""The scenes that the neighbours share: their closed forms, and ours in them."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.neighbours.cases import PACKAGES, Answer, answered, at_equal_accuracy, cases, solvers
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
    monkeypatch.setitem(PACKAGES, "mujoco", "a_module_that_does_not_exist")
    found, missing = solvers(["magwire", "mujoco"])
    assert list(found) == ["magwire"]
    assert len(missing) == 1
    assert missing[0].startswith("mujoco was not run: ")


def test_a_run_that_fails_is_a_row_with_its_reason():
    exact = SimpleNamespace(coiled=lambda scene, step: scene.expected)
    case = cases("tube", {"magwire": exact})[0]
    assert answered(case).row()[4] == "pitch +0.00%, load +0.00%"

    def fails():
        raise RuntimeError("it has blown up")

    answer = answered(replace(case, run=fails))
    assert answer.row()[4] == "failed: it has blown up"
    assert answer.worst == math.inf


def test_the_fastest_answer_that_is_good_enough_counts():
    case = cases("tube", {"magwire": None})[0]
    good, better = Answer(case, {"pitch": -0.009, "load": 0.0}, 1.0), Answer(case, {"pitch": 0.001}, 9.0)
    fast = Answer(case, {"pitch": 0.02}, 0.1)
    assert at_equal_accuracy([good, better, fast], 0.01) == {"magwire": good}
    assert at_equal_accuracy([fast], 0.01) == {}
