"""The command `magwire robustness`."""

from __future__ import annotations

import json

import pytest

from agents.cli.main import main as magwire
from agents.evaluation.robustness import DISTURBANCES


def test_the_command(tmp_path, capsys):
    magwire(["robustness", "MaxForce", "--episodes", "2", "--no-par", "--out", str(tmp_path)])
    assert {p.name for p in tmp_path.iterdir()} == {"MaxForce.png", "MaxForce.json"}
    assert "MaxForce.png" in capsys.readouterr().out
    data = json.loads((tmp_path / "MaxForce.json").read_text())
    assert len(data["rows"]) == len(DISTURBANCES)
    with pytest.raises(SystemExit, match="episodes must be a whole number of at least 1"):
        magwire(["robustness", "MaxForce", "--episodes", "0"])
