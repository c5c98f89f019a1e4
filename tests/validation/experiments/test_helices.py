"""Helices that buckle: the free rod's departure against theory and against the robot's measurements."""

import os
from pathlib import Path

import numpy as np
import pytest

from magwire_env.validation.experiments import helices
from magwire_env.validation.experiments.report import rows_of_file
from magwire_env.validation.free.twist import departure

FILE = Path(os.environ.get("MAGWIRE_DATA", Path(__file__).parents[4] / "shared" / "data")) / "e1_helix_buckling.csv"


def test_a_helix_that_never_holds_has_no_departure():
    assert np.isnan(departure(0.9, -0.3, 9.0, 20))


@pytest.mark.skipif(not FILE.is_file(), reason="the measured helices are not here")
def test_few_helices_of_fewer_segments_leave_where_theory_says():
    names = ("c1", "c2", "kL_measured", "kL_theory")
    rows = rows_of_file(FILE, names)[::37]
    c1, c2, measured, theory = (np.array([float(row[name]) for row in rows]) for name in names)
    np.testing.assert_allclose(helices.departures(c1, c2, measured, 50), theory, rtol=5e-3)


@pytest.mark.skipif(not FILE.is_file(), reason="the measured helices are not here")
def test_the_experiment_prints_its_rows_and_draws(tmp_path, monkeypatch):
    small = tmp_path / "e1.csv"
    lines = [line for line in FILE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    small.write_text("\n".join([lines[0], *lines[1::50]]), encoding="utf-8")
    monkeypatch.setattr(helices, "SEGMENTS", 50)
    monkeypatch.setattr(helices, "ROWS", 2)
    outcome = helices.run(small)
    assert [row.holds for row in outcome.rows[:3]] == [True] * 3
    assert outcome.free == "none"
    outcome.draw(tmp_path / "helices.png")
    assert (tmp_path / "helices.png").stat().st_size > 10_000
