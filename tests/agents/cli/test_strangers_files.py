"""A run folder from a stranger, with a payload in every file that one could stand in: nothing of it is executed."""

from __future__ import annotations

import base64
import json
import pickle
import shutil
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from stable_baselines3.common.save_util import json_to_data

from agents.cli.main import main as magwire
from agents.learning import load
from agents.learning.config import Config
from agents.learning.run_folder import Checkpoints
from agents.learning.sb3 import make_model, make_vec_env
from agents.learning.training import Run, learn

ID = "MagWire/Steer-v0"
TINY = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "policy_kwargs": {"net_arch": [8]}}


class Payload:
    """Unpickling one makes a file."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


@pytest.fixture
def mark(tmp_path, monkeypatch):
    """The file that every payload makes; importing `payload_mod` makes it too."""
    mark, modules = tmp_path / "PWNED", tmp_path / "modules"
    modules.mkdir()
    (modules / "payload_mod.py").write_text(f"import pathlib; pathlib.Path({str(mark)!r}).touch()\n")
    monkeypatch.syspath_prepend(str(modules))
    yield mark
    sys.modules.pop("payload_mod", None)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of this version."""
    folder = tmp_path_factory.mktemp("runs") / "mine"
    config = Config(run=folder, timesteps=128, n_envs=8, evaluations=1, episodes=1, progress=False)
    assert learn(Run.open(config, TINY))
    return folder


@pytest.fixture(scope="module")
def old(tmp_path_factory):
    """A run as earlier versions saved it, and the actions its model takes."""
    folder = tmp_path_factory.mktemp("runs") / "old"
    model = make_model("ppo", make_vec_env(ID, 8, seed=0), 0, TINY)
    model.learn(128)
    meta = {"task": ID, "algorithm": "ppo", "seed": 0, "env": {}, "frame_stack": 1}
    for name in ("best", "last"):
        (folder / name).mkdir(parents=True)
        model.save(folder / name / "model.zip")
        model.get_vec_normalize_env().save(str(folder / name / "normalization.pkl"))
        (folder / name / "model.json").write_text(json.dumps(meta))
    config = {"task": ID, "algorithm": "ppo", "seed": 0, "scenario": None, "threads": 1, "evaluations": 1}
    config |= {"episodes": 1, "progress": False}
    stored = {"config": config, "hyperparameters": TINY | {"n_envs": 8, "n_timesteps": 256}}
    (folder / "config.json").write_text(json.dumps(stored))
    seen = np.random.default_rng(0).standard_normal((5, 7)).astype(np.float32)
    normal = model.get_vec_normalize_env().normalize_obs(seen)
    return folder, seen, model.predict(normal, deterministic=True)[0]


def copied(folder: Path, tmp_path: Path) -> Path:
    shutil.copytree(folder, tmp_path / "copy")
    return tmp_path / "copy"


COMMANDS = (
    ["evaluate", "RUN", "--episodes", "1", "--no-par"],
    ["video", "RUN"],
    ["plot", "RUN"],
    ["robustness", "RUN", "--episodes", "1", "--no-par"],
    ["train", "--run", "RUN", "--resume"],
    ["view", "RUN"],
    ["play", "--against", "RUN"],
    ["export", "RUN"],
)
BY_NAME = {"argvalues": COMMANDS, "ids": [command[0] for command in COMMANDS]}


def asked(command: list[str], folder: Path) -> str:
    """What a command ends with on a run folder."""
    with pytest.raises(SystemExit) as stopped:
        magwire([str(folder) if word == "RUN" else word for word in command])
    return str(stopped.value)


# --- runs of earlier versions -----------------------------------------------------------------------------------------


def in_pickle(folder: Path, mark: Path) -> None:
    for place in ("best", "last"):
        (folder / place / "normalization.pkl").write_bytes(pickle.dumps(Payload(mark)))


def in_zip(folder: Path, mark: Path) -> None:
    evil = base64.b64encode(pickle.dumps(Payload(mark))).decode()
    for place in ("best", "last"):
        path = folder / place / "model.zip"
        with zipfile.ZipFile(path) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        data = json.loads(files["data"]) | {"extra": {":type:": "x", ":serialized:": evil}}
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, json.dumps(data) if name == "data" else content)


def in_model_json(folder: Path, mark: Path) -> None:
    for place in ("best", "last"):
        path = folder / place / "model.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"task": f"payload_mod:{ID}"}))


@pytest.mark.parametrize("plant", [in_pickle, in_zip, in_model_json])
@pytest.mark.parametrize("command", **BY_NAME)
def test_an_earlier_versions_files_are_not_opened(command, plant, old, mark, tmp_path):
    folder = copied(old[0], tmp_path)
    plant(folder, mark)
    message = asked(command, folder)
    assert "can carry a program" in message
    assert "--trust" in message
    assert not mark.exists()


def test_the_payloads_are_live(mark, old, tmp_path):
    """What is planted would run: else the tests above say nothing."""
    pickle.loads(pickle.dumps(Payload(mark)))
    assert mark.exists()
    mark.unlink()
    in_zip(folder := copied(old[0], tmp_path), mark)
    with zipfile.ZipFile(folder / "best" / "model.zip") as archive:
        json_to_data(archive.read("data").decode())
    assert mark.exists()


def test_an_earlier_version_is_converted_with_trust(old, tmp_path, capsys):
    folder, seen, wanted = old
    folder = copied(folder, tmp_path)
    with pytest.raises(ValueError, match=f"magwire export {folder} --trust"):
        load(folder)
    assert np.abs(load(folder, trust=True).predict(seen)[0] - wanted).max() <= 1e-6
    magwire(["export", str(folder), "--trust"])
    assert "policy.safetensors" in capsys.readouterr().out
    assert np.abs(load(folder).predict(seen)[0] - wanted).max() <= 1e-6
    assert (
        "model.zip, normalization.pkl; such files can carry a program, and were not opened" in capsys.readouterr().err
    )


def test_an_earlier_version_resumes_with_trust_and_says_what_is_lost(old, tmp_path, capsys):
    folder = copied(old[0], tmp_path)
    assert learn(Run.open(Config(run=folder, resume=True, trust=True)))
    assert "kept no replay buffer, episodes or random states: these begin anew" in capsys.readouterr().err
    assert load(folder).about.timesteps == 256


def test_an_earlier_version_cannot_have_any_file_read_as_its_scenario(old, tmp_path):
    folder, secret = copied(old[0], tmp_path), tmp_path / "secret.toml"
    secret.write_text("password = 'hunter2'")
    stored = json.loads((folder / "config.json").read_text())
    stored["config"]["scenario"] = str(secret)
    (folder / "config.json").write_text(json.dumps(stored))
    message = asked(["train", "--run", "RUN", "--resume"], folder)
    assert "was not opened" in message
    assert "hunter2" not in message


# --- runs of this version ---------------------------------------------------------------------------------------------


def task_of_policy(folder: Path) -> None:
    for path in Checkpoints(folder).newest().glob("*/policy.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"task": f"payload_mod:{ID}"}))


def task_of_config(folder: Path) -> None:
    stored = json.loads((folder / "config.json").read_text())
    stored["config"]["task"] = f"payload_mod:{ID}"
    (folder / "config.json").write_text(json.dumps(stored))


@pytest.mark.parametrize("command", [c for c in COMMANDS if c[0] != "train"], ids=lambda c: c[0])
def test_a_module_in_front_of_a_policys_task_is_not_imported(command, run, mark, tmp_path):
    folder = copied(run, tmp_path)
    task_of_policy(folder)
    assert "nothing was imported for it" in asked(command, folder)
    assert not mark.exists()


@pytest.mark.parametrize("command", [["train", "--run", "RUN", "--resume"], ["plot", "RUN"]], ids=lambda c: c[0])
def test_a_module_in_front_of_a_runs_task_is_not_imported(command, run, mark, tmp_path):
    folder = copied(run, tmp_path)
    task_of_config(folder)
    assert "nothing was imported for it" in asked(command, folder)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"policy_kwargs": {"activation_fn": "Module.__init__"}}, "activation_fn must be one of 'Tanh'"),
        ({"policy_kwargs": {"optimizer_class": "os.system"}}, "hyperparameters that make no model"),
        ({"rollout_buffer_class": "os.system"}, "hyperparameters that make no model"),
        ({"env": {"scenario": "/etc/passwd"}}, "must set only"),
        ({"training_env": {"render_mode": "human"}}, "must set only"),
        ({"learning_rate": "__import__('os')"}, "learning_rate must be a number greater than 0 or"),
        ({"tensorboard_log": "/tmp"}, "hyperparameters that make no model"),
    ],
)
def test_hyperparameters_name_nothing_that_is_run(changes, words, run, tmp_path):
    folder = copied(run, tmp_path)
    stored = json.loads((folder / "config.json").read_text())
    stored["hyperparameters"] |= changes
    (folder / "config.json").write_text(json.dumps(stored))
    message = asked(["train", "--run", "RUN", "--resume"], folder)
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize("command", [COMMANDS[0], COMMANDS[2], COMMANDS[4], COMMANDS[7]], ids=lambda c: c[0])
def test_planted_files_are_named_and_left_alone(command, run, mark, tmp_path, capsys):
    """The run itself is sound, so the command does its work."""
    folder = copied(run, tmp_path)
    for place in (folder, Checkpoints(folder).newest() / "last"):
        (place / "normalization.pkl").write_bytes(pickle.dumps(Payload(mark)))
        (place / "model.yml").write_text(f"!!python/object/apply:pathlib.Path.touch [{mark}]\n")
    magwire([str(folder) if word == "RUN" else word for word in command])
    assert "normalization.pkl; such files can carry a program, and were not opened" in capsys.readouterr().err
    assert not mark.exists()
