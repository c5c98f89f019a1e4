"""Hanging loops: the solver against a converged solution, and the experiment on the measured shapes."""

import os
from pathlib import Path

import numpy as np
import pytest

from agents.cli.main import main as magwire
from magwire_env.validation.experiments import EXPERIMENTS
from magwire_env.validation.experiments.loops import WIRES, hanging_loop

DATA = Path(os.environ.get("MAGWIRE_DATA", Path(__file__).parents[4] / "shared" / "data"))


def test_the_loop_is_that_of_a_converged_elastica():
    loop = hanging_loop(8.08e-5, 0.0174, (-0.123, 0.0))
    assert loop.points[:, 1].max() == pytest.approx(0.6884, abs=3e-4)
    assert loop.points[:, 0].max() == pytest.approx(36.9e-3, abs=0.2e-3)
    assert loop.points[:, 0].min() == pytest.approx(-159.9e-3, abs=0.2e-3)
    assert loop.moment == pytest.approx(4.49e-3, rel=0.005)
    np.testing.assert_allclose(loop.points[-1], (-0.123, 0.0), atol=1e-8)


def test_the_loop_converges_at_second_order():
    depth = [hanging_loop(8.08e-5, 0.0174, (-0.123, 0.0), segments=n).points[:, 1].max() for n in (60, 120, 240)]
    assert (depth[0] - depth[1]) / (depth[1] - depth[2]) == pytest.approx(4.0, rel=0.1)


@pytest.mark.skipif(not (DATA / "e3_hanging_loops.csv").is_file(), reason="the measured loops are not here")
def test_the_measured_loops_give_the_published_rigidities(tmp_path, capsys):
    outcome = EXPERIMENTS["loops"](DATA)
    rigidity = [row for row in outcome.rows if "E I" in row.quantity]
    assert len(rigidity) == 2 * len(WIRES)
    assert all(row.holds for row in rigidity)
    distance = [row.ours for row in outcome.rows if "distance" in row.quantity]
    np.testing.assert_array_less(distance, [4.5, 12.1, 11.6])
    outcome.draw(tmp_path / "loops.png")
    assert (tmp_path / "loops.png").stat().st_size > 10_000


def test_the_command_says_what_to_fetch(tmp_path):
    with pytest.raises(SystemExit) as stopped:
        magwire(["experiment", "loops", "--data", str(tmp_path), "--out", str(tmp_path / "out")])
    assert "e3_hanging_loops.csv is missing" in str(stopped.value)
    assert "qj25/adapteddlo_muj" in str(stopped.value)
    assert not (tmp_path / "out").exists()


def test_a_file_without_its_columns_is_refused(tmp_path):
    file = tmp_path / "e3.csv"
    file.write_text("wire,x\nwhite,1\n", encoding="utf-8")
    with pytest.raises(ValueError, match="it lacks s_over_L, y"):
        EXPERIMENTS["loops"](file)
