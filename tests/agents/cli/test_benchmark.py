"""The command `magwire benchmark`."""

from __future__ import annotations

import pytest

from agents.cli.main import main as magwire


def test_the_command_lists_makes_and_goes_on(tmp_path, capsys):
    arguments = ["benchmark", "--out", str(tmp_path), "--episodes", "2", "--only", "evaluate Steer MaxForce"]
    magwire([*arguments, "--dry-run"])
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "missing   evaluate Steer MaxForce"
    assert said[1].startswith("1 cell missing: about ")
    assert not any(tmp_path.iterdir())
    magwire([*arguments, "--workers", "1"])
    assert "1 cell to make, 0 finished" in capsys.readouterr().out
    written = (tmp_path / "evaluate" / "Steer-MaxForce.json").stat().st_mtime_ns
    magwire([*arguments, "--workers", "1"])
    assert "0 cells to make, 1 finished" in capsys.readouterr().out
    assert (tmp_path / "evaluate" / "Steer-MaxForce.json").stat().st_mtime_ns == written
    page = (tmp_path / "benchmark.md").read_text()
    assert "| MaxForce | 100 % |" in page
    assert "evaluate Steer NetForce" in page.partition("**Missing**")[2].splitlines()[0]
    with pytest.raises(SystemExit, match="only must match some cell's name"):
        magwire([*arguments[:-1], "nonsense"])
