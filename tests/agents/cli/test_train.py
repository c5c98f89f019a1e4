"""`python train.py` and `magwire train` are the same thing."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from agents.cli.main import main as magwire
from agents.cli.train import main as script

ROOT = Path(__file__).parents[3]
ARGUMENTS = ["--timesteps", "1024", "--n-envs", "32", "--evaluations", "1", "--episodes", "1", "--no-progress"]


def test_the_script_and_the_command_train_the_same(tmp_path, capsys):
    subprocess.run(
        [sys.executable, "train.py", "--run", str(tmp_path / "script"), *ARGUMENTS], cwd=ROOT, check=True, timeout=120
    )
    magwire(["train", "--run", str(tmp_path / "command"), *ARGUMENTS])
    assert "\ntrained PPO " in capsys.readouterr().out
    first, second = (json.loads((tmp_path / name / "results.json").read_text()) for name in ("script", "command"))
    assert first == second


def test_the_script_ends_with_one_line_on_bad_input(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"^train\.py: task must be one of MagWire/Steer-v0"):
        script(None, ["--task", "MagWire/None-v9"])
    assert not any(tmp_path.iterdir())


def test_nothing_imports_the_script_and_the_wheel_leaves_it_out():
    assert "train.py" not in (ROOT / "pyproject.toml").read_text()
    for folder in ("agents", "magwire_env"):
        for path in (ROOT / folder).rglob("*.py"):
            lines = path.read_text(encoding="utf-8").splitlines()
            assert not [line for line in lines if line.startswith(("import train", "from train "))], path
