"""The commands `magwire record`, `identify` and `twins`."""

from __future__ import annotations

import json

import pytest

from agents.cli.main import main as magwire
from magwire_env import Scenario
from magwire_env.identification import Log


def test_a_policy_s_log_is_written_and_fitted(tmp_path, capsys):
    log, out = tmp_path / "log.csv", tmp_path / "found"
    magwire(["record", str(log), "--policy", "MaxForce", "--columns", "tip_arclength", "--noise", "arc length=5e-4"])
    assert len(Log.load(log).episodes[0]) > 50
    magwire(["identify", str(log), "--fit", "friction", "drag", "--interval", "laplace", "--out", str(out)])
    text = capsys.readouterr().out
    assert "friction" in text
    found = json.loads((out / "identified.json").read_text())["parameters"]
    assert found["friction"]["value"] == pytest.approx(0.05, rel=0.2)
    assert found["drag"]["value"] == pytest.approx(0.5, rel=0.1)
    assert Scenario.load(out / "scenario.toml").contact.drag == pytest.approx(found["drag"]["value"])
    assert Scenario.load(out / "randomised.toml").variation.friction > 0
    assert (out / "residuals.png").stat().st_size > 10_000


def test_twins_print_coverage(tmp_path, capsys):
    magwire(["twins", "--fit", "friction", "--count", "2", "--seconds", "3", "--interval", "laplace",
             "--out", str(tmp_path / "twins.json")])  # fmt: skip
    assert "friction          covered" in capsys.readouterr().out
    assert len(json.loads((tmp_path / "twins.json").read_text())["twins"]) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["identify", "missing.csv"], "missing.csv"),
        (["record", "log.csv", "--noise", "position"], "noise must be given as kind=value, got 'position'"),
        (["record", "log.csv", "--columns", "tip"], "columns must be one of"),
    ],
)
def test_bad_input_ends_in_one_line(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        magwire(arguments)
    assert str(stopped.value).startswith("magwire: ")
    assert words in str(stopped.value)
    assert not any(tmp_path.iterdir())
