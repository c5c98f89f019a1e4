"""Identification finds the truth again, says how well, and says what it cannot know."""

import json

import numpy as np
import pytest

from magwire_env import Scenario
from magwire_env.identification import identify, record, residual_plot
from magwire_env.identification.twins import twins

PAPER = Scenario.paper()
TRUE = PAPER.replace(contact__friction=0.09, wire__bending_modulus=6.4e5, contact__drag=0.6)
FAST = {"samples": 24, "polished": 1, "interval": "laplace", "threads": 1}


@pytest.fixture(scope="module")
def found():
    return identify(PAPER, record(TRUE, seconds=10.0, seed=1), samples=48, polished=2, threads=1)


def test_friction_and_bending_come_back_within_five_per_cent_at_a_millimetre_of_noise(found):
    assert found.value("friction") == pytest.approx(0.09, rel=0.05)
    assert found.value("bending_rigidity") == pytest.approx(TRUE.wire.bending_rigidity, rel=0.05)
    assert found.value("drag") == pytest.approx(0.6, rel=0.05)
    assert found.noise["position"] == pytest.approx(1e-3, rel=0.15)
    assert found.warnings == ()


def test_intervals_hold_the_values_and_are_narrow(found):
    for parameter, value in zip(found.parameters, found.values, strict=True):
        interval = found.interval(parameter.name)
        assert interval.low < value < interval.high
        assert interval.high - interval.low < 0.3 * value
        assert not interval.open_low
        assert not interval.open_high


def test_profile_and_laplace_agree_where_the_data_are_plenty(found):
    quick = identify(found.scenario, found.predictor.log, **FAST)
    for name in ("friction", "drag"):
        a, b = found.interval(name), quick.interval(name)
        assert a.high - a.low == pytest.approx(b.high - b.low, rel=0.25)


def test_twins_are_drawn_anew_and_found_again():
    done = twins(PAPER, ("friction", "bending_rigidity"), count=3, seconds=8.0, episodes=2, **FAST)
    errors = np.array([twin.errors for twin in done.each])
    assert len({twin.truth[0] for twin in done.each}) == 3
    assert np.abs(errors).max() < 0.05
    assert done.coverage.min() > 0.3
    assert "covered" in done.table()
    json.dumps(done.to_json())


def test_two_remanences_cannot_be_told_apart():
    log = record(PAPER, seconds=6.0, seed=2)
    told = identify(PAPER, log, ["remanence", "tip_remanence"], **FAST).warnings
    assert any("remanence" in line and "tip_remanence" in line and "apart" in line for line in told)


def test_a_parameter_that_nothing_shows_is_told():
    told = identify(PAPER, record(PAPER, seconds=3.0, seed=2), ["axial_rigidity"], **FAST).warnings
    assert any("say nearly nothing of axial_rigidity" in line for line in told)


def test_without_friction_the_interval_reaches_zero():
    found = identify(PAPER, record(PAPER.replace(contact__friction=0.0), seconds=6.0, seed=5), ["friction"], **FAST)
    interval = found.interval("friction")
    assert interval.low == 0.0
    assert interval.open_low
    assert interval.high < 0.01


def test_an_angle_that_is_read_wrongly_is_found():
    found = identify(PAPER, _misread(0.2), ["friction", "angle_offset"], **FAST)
    assert found.value("angle_offset") == pytest.approx(0.2, abs=0.01)
    assert found.value("friction") == pytest.approx(0.05, rel=0.1)


def _misread(offset):
    from magwire_env.identification.twins import _true_log

    return _true_log(PAPER, ["angle_offset"], np.array([offset]), ("tip_x", "tip_y", "tip_z"), None, 8.0, 3)


def test_a_model_that_misses_something_is_told():
    log = record(PAPER.replace(gravity=(0.0, 4.0, 0.0)), seconds=6.0, seed=4)
    told = identify(PAPER, log, ["friction"], noise={"position": 1e-3}, **FAST).warnings
    assert any("follow one another" in line for line in told)
    assert any("does not explain the data" in line for line in told)


def test_forces_and_positions_have_noise_of_their_own():
    columns, noise = ("tip_arclength", "lateral_force"), {"arc length": 1e-3, "force": 2e-4}
    log = record(PAPER, seconds=6.0, columns=columns, noise=noise, seed=6)
    found = identify(PAPER, log, ["friction", "remanence", "tip_remanence"][:2], **FAST)
    assert found.noise["arc length"] == pytest.approx(1e-3, rel=0.3)
    assert found.noise["force"] == pytest.approx(2e-4, rel=0.3)
    assert found.value("remanence") == pytest.approx(1.0, rel=0.03)


def test_cma_finds_the_same(found):
    pytest.importorskip("cma")
    log = record(PAPER.replace(contact__friction=0.12), seconds=4.0, seed=7)
    by_cma = identify(PAPER, log, ["friction"], method="cma", **FAST)
    assert by_cma.value("friction") == pytest.approx(identify(PAPER, log, ["friction"], **FAST).value("friction"), 1e-3)


def test_ranges_for_randomisation_follow_from_the_intervals(found):
    drawn, interval = found.randomised(), found.interval("friction")
    spread = drawn.variation.friction * drawn.contact.friction
    assert drawn.contact.friction - spread == pytest.approx(interval.low)
    assert drawn.contact.friction + spread == pytest.approx(interval.high)
    assert drawn.contact.drag == pytest.approx(found.value("drag"))


def test_residuals_are_drawn(found, tmp_path):
    assert residual_plot(found, tmp_path / "residuals.png").stat().st_size > 10_000


def test_what_cannot_be_fitted_is_refused():
    log = record(PAPER, seconds=0.3, columns=("tip_arclength",))
    with pytest.raises(ValueError, match="more measurements than there are unknowns"):
        identify(PAPER, log)
    with pytest.raises(ValueError, match="columns must be one of"):
        identify(PAPER, log, columns=["tip_x"])
    with pytest.raises(ValueError, match="noise must be one of"):
        identify(PAPER, log, ["friction"], noise={"length": 1e-3})
