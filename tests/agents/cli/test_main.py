"""The `magwire` command: what it evaluates, and how it refuses bad input."""

from __future__ import annotations

import json

import pytest

from agents.cli.main import main as magwire


def test_the_command_evaluates_a_controller_and_a_model(run, tmp_path, capsys):
    magwire(["evaluate", "MaxForce", "--episodes", "4", "--out", str(tmp_path / "r.json")])
    assert "\nMaxForce  100.0% " in capsys.readouterr().out
    assert json.loads((tmp_path / "r.json").read_text())["MaxForce"]["summary"]["success_rate"] == 1.0
    magwire(["evaluate", str(run[0]), "--episodes", "4"])
    assert "\nsmall " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["evaluate", "NoSuch"],
            "folder, trained/…, an SB3 .zip, module:thing or one of MaxForce",
        ),
        (["evaluate", "MaxForce", "--episodes", "0"], "episodes must be a whole number of at least 1"),
        (["evaluate", "MaxForce", "--scenario", "missing"], "no shipped scenario of that name"),
        (["train", "--task", "MagWire/None-v9"], "task must be one of MagWire/Steer-v0"),
    ],
)
def test_the_command_ends_with_one_line_on_bad_input(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        magwire(arguments)
    message = str(stopped.value)
    assert message.startswith("magwire: ")
    assert words in message
    assert "\n" not in message
    assert not any(tmp_path.iterdir())
