"""Turning while pushing lowers friction by as much as measured and calculated."""

from pathlib import Path

from magwire_env.validation.experiments import EXPERIMENTS


def test_turning_lowers_friction_as_measured_and_calculated_without_any_file(tmp_path):
    outcome = EXPERIMENTS["turning"](Path("nowhere"))
    assert outcome.holds
    assert len(outcome.columns["ratio"]) == 7
    outcome.draw(tmp_path / "turning.png")
    assert (tmp_path / "turning.png").stat().st_size > 10_000
