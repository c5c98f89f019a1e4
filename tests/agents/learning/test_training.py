"""A small run: what it leaves behind, its interruption, what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from agents.catalogue import FLOORS
from agents.cli.train import train
from agents.learning import load
from agents.learning.config import Config
from agents.learning.run_folder import Checkpoints
from agents.learning.sb3 import make_vec_env
from agents.learning.training import CURVE, Run, goodness, read_curve
from magwire_env.quasistatic.pool import scenario_pool
from tests.support.training import SMALL

ID = "MagWire/Steer-v0"
ROOT = Path(__file__).parents[3]


def test_a_run_leaves_everything_behind(run):
    folder, results = run
    names = {p.name for p in folder.iterdir()}
    assert {"config.json", "versions.json", "results.json", "learning_curve.csv", "learning_curve.png"} <= names
    assert {"checkpoints", "scenario.toml", "tensorboard"} <= names
    checkpoint = Checkpoints(folder).newest()
    assert [p.name for p in (folder / "checkpoints").iterdir()] == [checkpoint.name]
    for place in ("best", "last"):
        assert {"policy.json", "policy.safetensors", "policy.onnx"} <= {p.name for p in (checkpoint / place).iterdir()}
    assert json.loads((folder / "results.json").read_text()) == results
    assert set(results) == {"trained PPO", "MaxForce", *FLOORS}
    assert json.loads((folder / "config.json").read_text())["config"]["seed"] == 0
    assert "torch" in json.loads((folder / "versions.json").read_text())
    assert (folder / "learning_curve.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_the_best_model_keeps_a_tasks_limit_on_the_cost():
    nan = float("nan")
    free = {"success_rate": 0.9, "median_time_s": 5.0, "median_rms_error_m": nan, "within_limit_rate": nan}
    assert goodness(free) == (0.9, -5.0)
    assert goodness(free | {"median_rms_error_m": 2e-3}) == (0.9, -2e-3)
    assert goodness(free | {"within_limit_rate": 0.8}) == (0.8, -5.0)
    assert goodness(free | {"within_limit_rate": 0.95}) == (0.9, -5.0)


def test_a_curve_of_an_earlier_version_is_read(tmp_path):
    columns = "timesteps,seconds,success_rate,median_time_s,mean_reward,median_rms_error_m"
    (tmp_path / CURVE).write_text(f"{columns}\n512,1.5,0.9,5.0,3.0,nan\n")
    (row,) = read_curve(tmp_path / CURVE)
    assert goodness(row) == (0.9, -5.0)
    (tmp_path / CURVE).write_text("timesteps,seconds\n512,1.5\n")
    with pytest.raises(ValueError, match="must have the columns timesteps, seconds"):
        read_curve(tmp_path / CURVE)


def test_same_seed_same_model(tmp_path):
    settings = SMALL | {"timesteps": 2048, "episodes": 1}
    for name in ("a", "b"):
        train(Config(run=tmp_path / name, threads=1, **settings))
    observation, _ = gym.make(ID).reset(seed=0)
    first, again = (load(tmp_path / name).predict(observation)[0] for name in ("a", "b"))
    assert np.array_equal(first, again)


def test_a_run_folder_that_exists_is_left_alone(run):
    folder, _ = run
    before = (folder / "config.json").read_bytes()
    with pytest.raises(FileExistsError, match="exists: choose another --run, or --resume"):
        train(Config(run=folder, **SMALL))
    assert (folder / "config.json").read_bytes() == before


def test_resume_needs_a_run(tmp_path):
    with pytest.raises(FileNotFoundError, match="--resume needs --run"):
        train(Config(run=tmp_path / "none", resume=True, **SMALL))


def test_resume_of_a_finished_run_only_evaluates_again(run):
    folder, results = run
    assert train(Config(run=folder, resume=True, **SMALL)) == results


@pytest.mark.parametrize("algorithm", ["sac", "tqc", "crossq", "stacked_ppo"])
def test_the_other_algorithms_train_too(tmp_path, algorithm):
    settings = SMALL | {"timesteps": 4096, "n_envs": 128, "evaluations": 1, "episodes": 2}
    results = train(Config(run=tmp_path / algorithm, algorithm=algorithm, **settings))
    assert f"trained {algorithm.upper()}" in results
    policy = load(tmp_path / algorithm)
    env = gym.make(ID, **policy.env_settings)
    assert env.action_space.contains(policy.predict(env.reset(seed=0)[0])[0])


def test_what_is_for_training_alone_reaches_no_evaluation(tmp_path):
    settings = SMALL | {"timesteps": 4096, "n_envs": 128, "evaluations": 1, "episodes": 2}
    run = Run.open(Config(run=tmp_path / "r", algorithm="stacked_ppo", **settings))
    assert run.settings["training_env"] == {"time_limit": 4.0, "reward": {"time": 0.5}}
    assert "time_limit" not in run.validation | run.held_out | run.meta["env"]
    core = make_vec_env(ID, 1, **run.settings["training_env"]).env.core
    assert core.step_limit == 40
    assert core.step(np.zeros((1, 1)))[3]["reward/time"] == -0.5


def test_generated_tasks_choose_their_model_on_tracts_of_neither_training_nor_test(tmp_path):
    config = Config(run=tmp_path / "r", **SMALL | {"task": "MagWire/SteerAny-v0"})
    run = Run.open(config, {"env": {"pool_size": 2}})
    chosen_on = set(run.validation["scenario"])
    for split in ("train", "test"):
        assert not chosen_on & set(scenario_pool("SteerAny", split, 2))
