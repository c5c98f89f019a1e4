"""A small run from train.py to a loaded policy, its interruption, and what it refuses."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import yaml
from stable_baselines3.common.vec_env import VecFrameStack

import train
from agents.cli.main import main as magwire
from agents.learning.sb3 import NativeVecEnv, frozen, hyperparameters, load, make_model, make_vec_env
from agents.learning.training import Run
from agents.learning.tuning import SPACES, tune
from magwire_env.quasistatic.pool import scenario_pool

ID = "MagWire/Steer-v0"
ROOT = Path(train.__file__).parent
SMALL = {"timesteps": 8192, "n_envs": 32, "evaluations": 2, "episodes": 8, "progress": False}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "small"
    results = train.main(train.Config(run=folder, **SMALL))
    return folder, results


def test_a_run_leaves_everything_behind(run):
    folder, results = run
    names = {p.name for p in folder.iterdir()}
    assert {"config.json", "versions.json", "results.json", "learning_curve.csv", "learning_curve.png"} <= names
    assert {"best", "last", "tensorboard"} <= names
    assert json.loads((folder / "results.json").read_text()) == results
    assert set(results) == {"trained PPO", "MaxForce", "ConstantRotation", "Random"}
    assert json.loads((folder / "config.json").read_text())["config"]["seed"] == 0
    assert "torch" in json.loads((folder / "versions.json").read_text())
    assert (folder / "learning_curve.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_loaded_model_brings_its_normalisation(run):
    policy = load(run[0])
    observation, _ = gym.make(ID).reset(seed=0)
    action, _ = policy.predict(observation)
    raw, _ = policy.model.predict(observation, deterministic=True)
    assert not np.allclose(action, raw)
    assert np.allclose(
        action, policy.model.predict(policy.normalization.normalize_obs(observation), deterministic=True)[0]
    )
    assert np.array_equal(load(run[0]).predict(observation)[0], action)


def test_same_seed_same_model(tmp_path):
    settings = SMALL | {"timesteps": 2048, "episodes": 1}
    for name in ("a", "b"):
        train.main(train.Config(run=tmp_path / name, threads=1, **settings))
    observation, _ = gym.make(ID).reset(seed=0)
    first, again = (load(tmp_path / name).predict(observation)[0] for name in ("a", "b"))
    assert np.array_equal(first, again)


def test_a_run_folder_that_exists_is_left_alone(run):
    folder, _ = run
    before = (folder / "config.json").read_bytes()
    with pytest.raises(FileExistsError, match="exists: choose another --run, or --resume"):
        train.main(train.Config(run=folder, **SMALL))
    assert (folder / "config.json").read_bytes() == before


def test_resume_needs_a_run(tmp_path):
    with pytest.raises(FileNotFoundError, match="--resume needs --run"):
        train.main(train.Config(run=tmp_path / "none", resume=True, **SMALL))


def test_resume_of_a_finished_run_only_evaluates_again(run):
    folder, results = run
    assert train.main(train.Config(run=folder, resume=True, **SMALL)) == results


@pytest.mark.parametrize("name", ["model.zip", "normalization.pkl", "model.json"])
def test_a_truncated_model_file_is_named(run, tmp_path, name):
    folder = tmp_path / "copy"
    shutil.copytree(run[0] / "best", folder)
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=f"{name} is (truncated|damaged)"):
        load(folder)
    (folder / name).unlink()
    with pytest.raises(FileNotFoundError, match=f"holds no {name}"):
        load(folder)


def test_a_model_of_an_env_that_is_no_more_says_so(run, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(run[0] / "best", folder)
    meta = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps(meta | {"env": {"observe": ["no_such_channel"]}}))
    with pytest.raises(ValueError, match="asks for an env that cannot be made: observe must name"):
        load(folder)


def test_ctrl_c_saves_and_resume_goes_on(tmp_path):
    folder = tmp_path / "stopped"
    command = [sys.executable, "train.py", "--run", str(folder), "--timesteps", "400000", "--n-envs", "32"]
    process = subprocess.Popen(
        [*command, "--evaluations", "200", "--episodes", "4"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    deadline = time.monotonic() + 120
    while not (folder / "best" / "model.json").exists() and time.monotonic() < deadline:
        time.sleep(0.2)
    os.kill(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err.decode()
    assert b"interrupted and saved" in out
    from agents.learning.sb3 import load_parts

    done = load_parts(folder / "last")[0].num_timesteps
    assert 0 < done < 400_000
    config = json.loads((folder / "config.json").read_text())
    config["hyperparameters"]["n_timesteps"] = done + 2048
    (folder / "config.json").write_text(json.dumps(config))
    results = train.main(train.Config(run=folder, resume=True, episodes=4, progress=False))
    assert load_parts(folder / "last")[0].num_timesteps >= done + 2048
    assert results["MaxForce"]["summary"]["episodes"] == 4


@pytest.mark.parametrize("algorithm", ["sac", "tqc", "crossq", "stacked_ppo"])
def test_the_other_algorithms_train_too(tmp_path, algorithm):
    settings = SMALL | {"timesteps": 4096, "n_envs": 128, "evaluations": 1, "episodes": 2}
    results = train.main(train.Config(run=tmp_path / algorithm, algorithm=algorithm, **settings))
    assert f"trained {algorithm.upper()}" in results
    policy = load(tmp_path / algorithm)
    env = gym.make(ID, **policy.meta["env"])
    assert env.action_space.contains(policy.predict(env.reset(seed=0)[0])[0])


def test_a_policy_of_stacked_frames_sees_what_sb3_showed_it():
    venv = make_vec_env(ID, 3, seed=0, frame_stack=4, time_limit=0.3)
    model = make_model("stacked_ppo", venv, 0, {"normalize": {}})
    policy = frozen(model, {"frame_stack": 4})
    assert isinstance(venv, VecFrameStack)
    raw = NativeVecEnv(gym.make_vec(ID, num_envs=3, autoreset_mode="SameStep", time_limit=0.3).unwrapped, seed=0)
    stacked, newest, state, starts = venv.reset(), raw.reset(), None, np.ones(3, dtype=bool)
    for _ in range(7):  # two ends of episodes among them
        actions, state = policy.predict(newest, state=state, episode_start=starts)
        assert np.array_equal(state, stacked)
        stacked, _, starts, _ = venv.step(actions)
        newest = raw.step(actions)[0]
    one, _ = policy.predict(newest[0])
    assert one.shape == (1,)


def test_what_is_for_training_alone_reaches_no_evaluation(tmp_path):
    settings = SMALL | {"timesteps": 4096, "n_envs": 128, "evaluations": 1, "episodes": 2}
    run = Run.open(train.Config(run=tmp_path / "r", algorithm="stacked_ppo", **settings))
    assert run.settings["training_env"] == {"time_limit": 4.0, "reward": {"time": 0.5}}
    assert "time_limit" not in run.validation | run.held_out | run.meta["env"]
    core = make_vec_env(ID, 1, **run.settings["training_env"]).env.core
    assert core.step_limit == 40
    assert core.step(np.zeros((1, 1)))[3]["reward/time"] == -0.5


def test_generated_tasks_choose_their_model_on_tracts_of_neither_training_nor_test(tmp_path):
    config = train.Config(run=tmp_path / "r", task="MagWire/SteerAny-v0", **SMALL)
    run = Run.open(config, {"env": {"pool_size": 2}})
    chosen_on = set(run.validation["scenario"])
    for split in ("train", "test"):
        assert not chosen_on & set(scenario_pool("SteerAny", split, 2))


def test_a_study_is_written_with_its_trials(tmp_path):
    magwire(["tune", "--trials", "2", "--timesteps", "1024", "--out", str(tmp_path)])
    study = yaml.safe_load((tmp_path / "ppo-Steer-v0.yml").read_text())
    assert [set(t) - {"value", "seconds"} for t in study["trials"]] == [set(SPACES["ppo"])] * 2
    given = hyperparameters("ppo", ID)
    first = study["trials"][0]
    assert first["n_steps"] == given["n_steps"]
    assert first["learning_rate"] == "lin_0.001"
    assert first["policy_kwargs.log_std_init"] == given["policy_kwargs"]["log_std_init"]
    assert study["best"]["value"] == max(t["value"] for t in study["trials"])
    with pytest.raises(ValueError, match="algorithm must be one of 'ppo'"):
        tune(ID, "dqn", out=tmp_path)
    with pytest.raises(ValueError, match="trials must be at least 1, got 0"):
        tune(ID, "ppo", trials=0, out=tmp_path)


def test_the_adapter_gives_sb3_what_it_wants():
    venv = make_vec_env(ID, 4, seed=3, time_limit=0.3)
    observation = venv.reset()
    assert np.array_equal(observation[1], gym.make(ID).reset(seed=4)[0])
    for _ in range(3):
        observation, _, done, infos = venv.step(np.zeros((4, 1), dtype=np.float32))
    assert done.all()
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"]
        assert info["episode"]["l"] == 3
        assert not np.array_equal(info["terminal_observation"], observation[i])
    with pytest.raises(ValueError, match="autoreset_mode must be SAME_STEP"):
        NativeVecEnv(gym.make_vec(ID, num_envs=2).unwrapped)


def test_hyperparameters_of_an_unknown_algorithm():
    with pytest.raises(ValueError, match=r"algorithm must be one of 'ppo', 'sac', .*got 'dqn'"):
        hyperparameters("dqn", ID)


def test_the_command_evaluates_a_controller_and_a_model(run, tmp_path, capsys):
    magwire(["evaluate", "MaxForce", "--episodes", "4", "--out", str(tmp_path / "r.json")])
    assert "| MaxForce | 100.0% |" in capsys.readouterr().out
    assert json.loads((tmp_path / "r.json").read_text())["MaxForce"]["summary"]["success_rate"] == 1.0
    magwire(["evaluate", str(run[0]), "--episodes", "4"])
    assert "| small |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["evaluate", "NoSuch"], "policy must be a model folder or one of MaxForce"),
        (["evaluate", "MaxForce", "--episodes", "0"], "episodes must be at least 1"),
        (["evaluate", "MaxForce", "--scenario", "missing"], "no shipped scenario of that name"),
        (["train", "--task", "MagWire/None-v9"], "exist in namespace MagWire"),
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
