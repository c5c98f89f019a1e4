"""A training that was stopped and resumed is the training that was not."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from agents.cli.train import train
from agents.learning import load
from agents.learning import training as training_module
from agents.learning.config import Config
from agents.learning.run_folder import Checkpoints, locked, made_whole, write_whole
from agents.learning.training import Progress, Run, curve_of, learn, read_curve
from magwire_env import Scenario
from magwire_env.scenario import Reading

ROOT = Path(__file__).parents[3]
TINY = {"task": "MagWire/Steer-v0", "n_envs": 8, "evaluations": 2, "episodes": 2, "progress": False}
SMALL_NET = {"policy_kwargs": {"net_arch": [8, 8]}}
ON_POLICY = SMALL_NET | {"n_steps": 16, "batch_size": 64, "n_epochs": 2}
OFF_POLICY = SMALL_NET | {"learning_starts": 64, "batch_size": 32, "gradient_steps": 2, "buffer_size": 400}


@pytest.fixture(autouse=True)
def few_episodes(monkeypatch):
    monkeypatch.setattr(training_module, "VALIDATION_EPISODES", 4)


def begun(folder: Path, algorithm: str, timesteps: int = 768, **settings) -> Run:
    changes = ON_POLICY if "ppo" in algorithm else OFF_POLICY
    config = Config(run=folder, algorithm=algorithm, timesteps=timesteps, **TINY | settings)
    return Run.open(config, changes)


def resumed(folder: Path) -> Run:
    return Run.open(Config(run=folder, resume=True))


def stop_after(monkeypatch, steps: int) -> None:
    """Ask for a stop, as a signal does, once so many env steps are done."""
    plain_watch = Progress.watch

    def watch(self: Progress) -> None:
        plain_watch(self)
        collect = self.model.collect_rollouts

        def collected(*args, **options):
            if self.model.num_timesteps >= steps:
                self.ask_to_stop()
            return collect(*args, **options)

        self.model.collect_rollouts = collected

    monkeypatch.setattr(Progress, "watch", watch)


def end_of(folder: Path) -> tuple[dict[str, np.ndarray], dict, list]:
    checkpoint = Checkpoints(folder).newest()
    last = checkpoint / "last"
    rows = [{k: v for k, v in row.items() if k != "seconds"} for row in read_curve(checkpoint / "learning_curve.csv")]
    return load_file(last / "training.safetensors"), json.loads((last / "training.json").read_text()), rows


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "tqc", "crossq", "stacked_ppo"])
def test_a_resumed_training_is_the_same_training(algorithm, tmp_path, monkeypatch):
    """Bit for bit: parameters, optimisers, normalisation, buffers, episodes under way, and every generator."""
    assert learn(begun(tmp_path / "whole", algorithm))
    with monkeypatch.context() as patched:
        stop_after(patched, 256)
        assert not learn(begun(tmp_path / "parts", algorithm))
        stop_after(patched, 512)
        assert not learn(resumed(tmp_path / "parts"))
    assert learn(resumed(tmp_path / "parts"))
    whole, parts = end_of(tmp_path / "whole"), end_of(tmp_path / "parts")
    assert whole[1] == parts[1]
    assert set(whole[0]) == set(parts[0])
    for name, array in whole[0].items():
        assert np.array_equal(array, parts[0][name]), name
    assert repr(whole[2]) == repr(parts[2])  # a median time may be NaN


def test_episodes_with_imperfect_readings_and_variation_go_on_too(tmp_path, monkeypatch):
    sc = Scenario.paper().replace(
        sensing__force=Reading(noise=1e-3, bias=1e-3), sensing__delay=2, variation__friction=0.5
    )
    sc.save(tmp_path / "rough.toml")
    rough = {"scenario": str(tmp_path / "rough.toml")}
    assert learn(begun(tmp_path / "whole", "ppo", 512, **rough))
    with monkeypatch.context() as patched:
        stop_after(patched, 256)
        assert not learn(begun(tmp_path / "parts", "ppo", 512, **rough))
    (tmp_path / "rough.toml").unlink()  # the run has its own copy
    assert learn(resumed(tmp_path / "parts"))
    assert end_of(tmp_path / "whole")[1] == end_of(tmp_path / "parts")[1]


def test_a_run_stopped_before_its_first_evaluation_resumes(tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        stop_after(patched, 0)
        assert not learn(begun(tmp_path / "run", "ppo", 256))
    assert curve_of(tmp_path / "run") is not None
    with pytest.raises(FileNotFoundError, match="stopped before its first evaluation"):
        load(tmp_path / "run")
    assert learn(resumed(tmp_path / "run"))
    load(tmp_path / "run")


def test_a_run_killed_before_its_first_checkpoint_begins_again(tmp_path, capsys):
    run = begun(tmp_path / "run", "ppo", 256)
    (run.folder / "checkpoints" / ".unfinished-000001-ab12").mkdir(parents=True)
    assert learn(resumed(run.folder))
    assert "stopped before its first checkpoint, and begins again" in capsys.readouterr().err
    assert [p.name for p in (run.folder / "checkpoints").iterdir()] == [Checkpoints(run.folder).newest().name]


def test_best_and_the_curve_never_disagree(tmp_path, monkeypatch):
    """The disk fails while the second evaluation is saved: what stands there is the first one, whole."""
    run = begun(tmp_path / "run", "ppo", 512)
    scores = iter([0.25, 0.75, 0.5])
    real = training_module.evaluate

    def evaluated(*args, **options):
        found = real(*args, **options)
        score, n = next(scores), len(found.success)
        found.success[:] = np.arange(n) < score * n
        return found

    monkeypatch.setattr(training_module, "evaluate", evaluated)
    writes, save_tree = [], training_module.save_tree

    def failing(*args):
        writes.append(1)
        if len(writes) == 2:
            raise OSError(28, "No space left on device")
        save_tree(*args)

    monkeypatch.setattr(training_module, "save_tree", failing)
    with pytest.raises(OSError, match="No space left"):
        learn(run)
    (row,) = read_curve(curve_of(run.folder))
    assert row["success_rate"] == 0.25
    assert load(run.folder).about.timesteps == row["timesteps"] == 256
    # The end is trained again and saved, and is the best.
    assert learn(resumed(run.folder))
    rows = read_curve(curve_of(run.folder))
    assert [r["success_rate"] for r in rows] == [0.25, 0.5]
    assert load(run.folder).about.timesteps == rows[-1]["timesteps"]


def test_a_full_disk_on_the_way_loses_nothing(tmp_path, monkeypatch, capsys):
    run = begun(tmp_path / "run", "ppo", 512)
    writes, save_tree = [], training_module.save_tree

    def failing(*args):
        writes.append(1)
        if len(writes) == 1:
            raise OSError(28, "No space left on device")
        save_tree(*args)

    monkeypatch.setattr(training_module, "save_tree", failing)
    assert learn(run)
    assert "no checkpoint at 256 steps ([Errno 28] No space left on device)" in capsys.readouterr().err
    assert len(read_curve(curve_of(run.folder))) == 2


def test_a_second_writer_is_refused(tmp_path):
    run = begun(tmp_path / "run", "ppo", 256)
    with locked(run.folder), pytest.raises(ValueError, match="is being written by another process, which holds"):
        learn(run)
    code = "import sys; from agents.cli.main import main; main(['train', '--run', sys.argv[1], '--resume'])"
    with locked(run.folder):
        done = subprocess.run([sys.executable, "-c", code, run.folder], cwd=ROOT, capture_output=True, text=True)
    assert "is being written by another process" in done.stderr


def test_other_versions_are_said(tmp_path, monkeypatch, capsys):
    with monkeypatch.context() as patched:
        stop_after(patched, 128)
        learn(begun(tmp_path / "run", "ppo", 256))
    versions = json.loads((tmp_path / "run" / "versions.json").read_text())
    (tmp_path / "run" / "versions.json").write_text(json.dumps(versions | {"torch": "1.0"}))
    learn(resumed(tmp_path / "run"))
    assert f"(torch 1.0 → {versions['torch']}): its numbers may differ" in capsys.readouterr().err


# --- damaged folders --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished") / "run"
    before, training_module.VALIDATION_EPISODES = training_module.VALIDATION_EPISODES, 4
    learn(begun(folder, "ppo", 256))
    training_module.VALIDATION_EPISODES = before
    return folder


@pytest.mark.parametrize(
    "name",
    ["config.json", "last/training.json", "last/training.safetensors", "learning_curve.csv", "checkpoint.json",
     "best/policy.json", "best/policy.safetensors"],
)  # fmt: skip
def test_a_truncated_file_is_named(finished, tmp_path, name):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    path = folder / name if name == "config.json" else Checkpoints(folder).newest() / name
    content = path.read_bytes()
    path.write_bytes(content[: 3 * len(content) // 4])
    with pytest.raises(ValueError, match=f"{path.name}|last is damaged"):
        learn(resumed(folder))


def test_another_scenario_in_the_folder_is_refused(finished, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    text = (folder / "scenario.toml").read_text()
    (folder / "scenario.toml").write_text(text.replace("friction = 0.05", "friction = 0.5"))
    with pytest.raises(ValueError, match=r"scenario\.toml is not the scenario that the run was begun in"):
        resumed(folder)


# --- the folder itself ------------------------------------------------------------------------------------------------


def fill_with(text: str):
    return lambda folder: (folder / "checkpoint.json").write_text(text)


def test_checkpoints_follow_one_another(tmp_path):
    checkpoints = Checkpoints(tmp_path)
    assert checkpoints.newest() is None
    for text in "abc":
        made = checkpoints.write(fill_with(text))
        assert checkpoints.newest() == made
        assert [p.name for p in checkpoints.folder.iterdir()] == [made.name]
    assert (made.name, (made / "checkpoint.json").read_text()) == ("000003", "c")


def test_an_interrupted_write_leaves_the_newest(tmp_path, monkeypatch):
    checkpoints = Checkpoints(tmp_path)
    kept = checkpoints.write(fill_with("a"))

    def refused(*_):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(os, "rename", refused)
    with pytest.raises(OSError, match="Read-only"):
        checkpoints.write(fill_with("b"))
    assert [p.name for p in checkpoints.folder.iterdir()] == [kept.name]


def test_what_a_killed_program_left_is_swept(tmp_path):
    checkpoints = Checkpoints(tmp_path)
    kept = checkpoints.write(fill_with("a"))
    for name in (".unfinished-000002-00", "000000"):
        (checkpoints.folder / name).mkdir()
    (checkpoints.folder / "000007").mkdir()  # half removed, without its mark
    assert checkpoints.newest() == kept
    checkpoints.sweep()
    assert [p.name for p in checkpoints.folder.iterdir()] == [kept.name]


def test_files_and_folders_are_whole_or_not_there(tmp_path):
    def failing(folder: Path) -> None:
        (folder / "half").write_text("x")
        raise OSError("no space")

    with pytest.raises(OSError, match="no space"):
        made_whole(tmp_path / "new", failing)
    write_whole(tmp_path / "file", "before")
    with pytest.raises(UnicodeEncodeError):
        write_whole(tmp_path / "file", "\ud800")
    assert (tmp_path / "file").read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    with pytest.raises(FileExistsError):
        made_whole(tmp_path / "file", fill_with(""))


# --- signals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_saves_and_resume_goes_on(kind, tmp_path):
    folder = tmp_path / "stopped"
    command = [sys.executable, "train.py", "--run", str(folder), "--timesteps", "4000000", "--n-envs", "32"]
    process = subprocess.Popen(
        [*command, "--evaluations", "1", "--episodes", "4"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    deadline = time.monotonic() + 120
    while not list(folder.glob("tensorboard/*")) and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(1.0)
    os.kill(process.pid, kind)
    out, err = process.communicate(timeout=240)
    assert process.returncode == 0, err.decode()
    assert b"interrupted and saved" in out
    checkpoint = Checkpoints(folder).newest()
    done = json.loads((checkpoint / "checkpoint.json").read_text())["timesteps"]
    assert 0 <= done < 4_000_000
    config = json.loads((folder / "config.json").read_text())
    config["hyperparameters"]["n_timesteps"] = done + 2048
    (folder / "config.json").write_text(json.dumps(config))
    results = train(Config(run=folder, resume=True, episodes=4, progress=False))
    checkpoint = Checkpoints(folder).newest()
    assert json.loads((checkpoint / "checkpoint.json").read_text())["timesteps"] >= done + 2048
    assert results["MaxForce"]["summary"]["episodes"] == 4
