"""`magwire policies` collects, lists and plays."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from agents import shipped
from agents.cli import policies as policies_cli
from agents.cli.main import main as magwire
from agents.learning import load

ID = "MagWire/Steer-v0"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder in place of the package's own."""
    monkeypatch.setattr(shipped, "SHIPPED", tmp_path / "trained")
    return tmp_path / "trained"


def test_runs_are_collected_listed_and_played(run, folder, tmp_path, capsys):
    mine, _ = run
    other = tmp_path / "runs" / "worse"
    shutil.copytree(mine, other)
    curve = next(other.glob("checkpoints/*/learning_curve.csv"))
    head, *rows = curve.read_text().splitlines()
    worse = [",".join([*row.split(",")[:2], "0.0", "nan", *row.split(",")[4:]]) for row in rows]
    curve.write_text("\n".join([head, *worse]) + "\n")

    magwire(["policies"])
    assert "no trained policies" in capsys.readouterr().out
    magwire(["policies", "--collect", str(tmp_path / "runs"), str(mine), "--episodes", "4", "--no-par"])
    said = capsys.readouterr().out
    assert f"Steer-v0 is of {mine}" in said
    assert "  magwire play --against trained/Steer-v0" in said
    assert all(len(line) <= 120 for line in said.splitlines()), said

    (entry,) = shipped.manifest()
    policy, original = load("trained/Steer-v0"), load(mine)
    assert (entry.task, entry.episodes, entry.score) == (ID, 4, None)
    assert np.array_equal(policy.layers[0].weight, original.layers[0].weight.astype(np.float16))
    magwire(["evaluate", "trained/Steer-v0", "--episodes", "4", "--no-par"])
    assert "\nSteer-v0 " in capsys.readouterr().out

    (folder / "Steer-v0" / "policy.json").write_text("{}")
    with pytest.raises(ValueError, match="is damaged: its files are not those"):
        load("trained/Steer-v0")


def test_entries_of_other_names_stay_and_those_of_lost_tasks_go(run, folder, capsys):
    mine, _ = run
    policies_cli.collect([mine], folder, 2, par=False)
    (entry,) = shipped.manifest(folder)
    gone = {**shipped.content([entry])["policies"][0], "name": "Old-v0", "task": "MagWire/Old-v0"}
    kept = {**shipped.content([entry])["policies"][0], "name": "Steer-v0-hard"}
    (folder / "Old-v0").mkdir()
    (folder / shipped.MANIFEST).write_text(json.dumps({"format": 1, "policies": [gone, kept]}))
    policies_cli.collect([mine], folder, 2, par=False)
    assert "Old-v0 goes: there is no task MagWire/Old-v0" in capsys.readouterr().out
    assert [one.name for one in shipped.manifest(folder)] == ["Steer-v0", "Steer-v0-hard"]
    assert not (folder / "Old-v0").exists()


def test_what_cannot_be_shipped_is_passed_over(run, folder, tmp_path, capsys):
    mine, _ = run
    damaged = tmp_path / "runs" / "damaged"
    shutil.copytree(mine, damaged)
    next(damaged.glob("checkpoints/*/best/policy.safetensors")).write_bytes(b"nothing")
    begun = tmp_path / "runs" / "begun"
    begun.mkdir()
    (begun / "config.json").write_text("{}")
    assert list(policies_cli.candidates([tmp_path / "runs"])) == []
    said = capsys.readouterr().err
    assert f"{begun} is passed over: it was stopped before its first evaluation" in said
    assert f"{damaged} is passed over: " in said
    with pytest.raises(SystemExit, match=r"magwire: .* is no run's folder and holds none"):
        magwire(["policies", "--collect", str(tmp_path / "nowhere")])
