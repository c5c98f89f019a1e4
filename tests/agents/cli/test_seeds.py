"""`magwire train --seeds`: one run for each seed, and what is said of those that fail."""

from __future__ import annotations

import json

import pytest

from agents.cli.main import main as magwire
from agents.cli.seeds import numbers
from agents.engines import Task
from agents.learning import load


def test_texts_of_seeds():
    assert numbers("0-9") == list(range(10))
    assert numbers("3,0,5-6") == [3, 0, 5, 6]


@pytest.mark.parametrize("text", ["", "a", "1-", "5-3", "1,1", "0-3,2", "0-5000", "-1", "1000000000"])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match=r"^seeds must be "):
        numbers(text)


class Here:
    """An engine that does one task after the other in this process."""

    def __init__(self) -> None:
        self.given: list[tuple[Task, int]] = []

    def room(self) -> bool:
        return not self.given

    def submit(self, task: Task, attempt: int) -> str:
        self.given.append((task, attempt))
        return task.name

    def wait(self):
        task, attempt = self.given.pop()
        try:
            return [(task.name, task.work(*task.arguments, attempt=attempt), None)]
        except (ValueError, OSError) as failure:
            return [(task.name, None, failure)]

    def close(self, hurry: bool = False) -> None:
        pass


def test_a_run_for_each_seed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("agents.cli.seeds.engine", lambda workers, ray: Here())
    monkeypatch.setattr("agents.cli.pictures.leave_in", lambda *_, **__: [])  # they have their own tests
    asked = [
        "train",
        "--seeds",
        "0-1",
        "--timesteps",
        "1024",
        "--n-envs",
        "32",
        "--evaluations",
        "1",
        "--episodes",
        "2",
    ]
    magwire([*asked, "--run", str(tmp_path)])
    said = capsys.readouterr().out
    folders = [tmp_path / f"Steer-v1-ppo-seed{seed}" for seed in (0, 1)]
    for seed, folder in enumerate(folders):
        assert f"done      {folder}" in said
        assert json.loads((folder / "config.json").read_text())["config"]["seed"] == seed
        assert (folder / "results.json").is_file()
        assert "steps" in folder.with_name(f"{folder.name}.log").read_text()
    first, second = (load(folder).layers[0].weight for folder in folders)
    assert (first != second).any()

    with pytest.raises(SystemExit, match=r"failed: .*seed0: .*exists"):  # and overwrites nothing
        magwire([*asked, "--run", str(tmp_path)])
    assert capsys.readouterr().out.count("FAILED") == 2
    assert (load(folders[0]).layers[0].weight == first).all()
