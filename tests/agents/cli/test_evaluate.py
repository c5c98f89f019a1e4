"""The command `magwire evaluate`."""

from __future__ import annotations

import json

from agents.cli.main import main as magwire


def test_the_command_without_a_par(tmp_path, capsys):
    magwire(["evaluate", "NetForce", "--episodes", "2", "--no-par", "--out", str(tmp_path / "r.json")])
    text = capsys.readouterr().out
    assert "\nNetForce  100.0% " in text
    assert "\nMaxForce  100.0% " in text
    assert "score" not in text
    stored = json.loads((tmp_path / "r.json").read_text())["NetForce"]
    assert len(stored["episodes"]["cost"]) == 2
    assert "score" not in stored["summary"]
