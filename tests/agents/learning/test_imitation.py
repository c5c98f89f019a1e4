"""Imitation: a policy that is taught does what its teacher does, and the sentences where it cannot be taught."""

from __future__ import annotations

import json
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from agents.catalogue import CONTROLLERS
from agents.evaluation import evaluate
from agents.learning import training as training_module
from agents.learning.config import Config
from agents.learning.export import about_model, plain
from agents.learning.hyperparameters import hyperparameters
from agents.learning.imitation import imitate
from agents.learning.run import Run
from agents.learning.sb3 import make_model, make_vec_env
from agents.learning.training import curve_of, learn, read_curve

TASK = "MagWire/Steer-v0"
SETTINGS = {
    "policy_kwargs": {"net_arch": [32, 32], "log_std_init": -2.0},
    "n_steps": 16,
    "batch_size": 64,
    "gamma": 0.9,
}


def pupil(frames: int = 1, algorithm: str = "ppo", **env):
    venv = make_vec_env(TASK, 16, seed=0, frame_stack=frames, **env)
    return make_model(algorithm, venv, 0, (SETTINGS if algorithm == "ppo" else {}) | {"normalize": {}})


def test_a_taught_policy_does_what_its_teacher_does():
    model = pupil()
    error = imitate(model, "MaxForce", 8192)
    assert error < 0.25
    meta = {"task": TASK, "algorithm": "ppo", "seed": 0, "env": {}, "scenario": None, "scenario_given": False}
    taught = evaluate(plain(model, about_model(model, meta)), TASK, 8)
    teacher = evaluate(CONTROLLERS["MaxForce"].from_env, TASK, 8)
    assert taught.success.all()
    assert np.median(taught.time) < 1.1 * np.median(teacher.time)


def test_a_teacher_may_see_what_its_pupil_does_not():
    env = {"action_mode": "rate", "observe": ["drive_force", "magnet", "magnet_preview"]}
    model = pupil(**env)
    error = imitate(model, "SlopeAscent", 32768, learning_rate="lin_3.0e-3")
    assert error < 0.3
    meta = {"task": TASK, "algorithm": "ppo", "seed": 0, "env": env, "scenario": None, "scenario_given": False}
    taught = evaluate(plain(model, about_model(model, meta)), TASK, 20, **env)
    teacher = evaluate(CONTROLLERS["SlopeAscent"].from_env, TASK, 20, **CONTROLLERS["SlopeAscent"].env_kwargs)
    assert taught.success.mean() >= teacher.success.mean() - 0.1


def test_the_critic_learns_what_the_policy_is_worth():
    """A state near the goal is worth more than one at the start, in the scale of the normalised rewards."""
    model = pupil()
    imitate(model, "MaxForce", 8192)
    venv = model.env
    model.env.training = False
    observation = venv.reset()
    first = model.policy.predict_values(model.policy.obs_to_tensor(observation)[0]).mean().item()
    for _ in range(50):
        observation, *_ = venv.step(model.predict(observation, deterministic=True)[0])
    later = model.policy.predict_values(model.policy.obs_to_tensor(observation)[0]).mean().item()
    assert np.isfinite([first, later]).all()
    assert later > first


def mean_action(model, seen):
    return model.predict(model.get_vec_normalize_env().normalize_obs(seen), deterministic=True)[0]


@pytest.mark.parametrize(("observe", "frames"), [(({"size": 36},), 1), (({"size": 36}, "tip_speed"), 2)])
def test_a_policy_that_looks_at_images_learns_from_one_that_reads_numbers(observe, frames):
    """Wherever the tip is, the taught policy turns the magnet as its teacher does; the untaught one does not."""
    model = pupil(frames, observe=observe)
    model.env.seed(5)
    before = mean_action(model, model.env.venv.reset())
    imitate(model, "MaxForce", 8192, rounds=2, epochs=8)
    venv = model.env.venv
    venv.seed(5)
    seen = venv.reset()
    core = (venv.venv if frames > 1 else venv).env.core
    wanted, _ = CONTROLLERS["MaxForce"].from_env(venv_of(core)).predict(core.beside(core.task.observe).observer.read())
    off, first = (np.sqrt(np.mean((actions - wanted) ** 2)) for actions in (mean_action(model, seen), before))
    assert off < 0.5 * first
    assert off < 0.45


def venv_of(core):
    return SimpleNamespace(unwrapped=SimpleNamespace(core=core.beside(core.task.observe)))


def test_a_policy_with_a_memory_learns_from_frames():
    model = pupil(frames=4, observe=("drive_force", "magnet"))
    assert imitate(model, "MaxForce", 8192) < 0.35


def test_what_is_seen_changes_no_lesson():
    """The teacher reads the same numbers, and says the same, whatever else the policy is shown."""
    asked = []
    for observe in (None, ("drive_force", "magnet_speed")):
        core = make_vec_env(TASK, 4, seed=0, **({} if observe is None else {"observe": observe})).env.core
        core.begin(np.arange(4), [np.random.default_rng(i) for i in range(4)], None)
        asked.append(core.beside(core.task.observe).observer.read())
    assert np.array_equal(*asked)


def test_what_cannot_be_taught_says_why():
    with pytest.raises(ValueError, match="imitate must teach ppo under running normalisation, got SAC"):
        imitate(pupil(algorithm="sac"), "MaxForce", 8192)
    with pytest.raises(ValueError, match=r"imitate.teacher must be one of MaxForce, .*, got 'Nobody'"):
        imitate(pupil(), "Nobody", 8192)
    with pytest.raises(ValueError, match=r"imitate.steps must be a whole number of at least 64, got 8"):
        imitate(pupil(), "MaxForce", 8)
    for rate in ("fast", "cos_1e-3", 0.0):
        with pytest.raises(ValueError, match=r"imitate.learning_rate must be a number greater than 0"):
            imitate(pupil(), "MaxForce", 8192, learning_rate=rate)
    with pytest.raises(ValueError, match="under action_mode 'angle', got 'SlopeAscent', which acts under 'rate'"):
        imitate(pupil(), "SlopeAscent", 8192)
    for wrong in ({"rounds": 0}, {"epochs": 2.5}):
        name, value = next(iter(wrong.items()))
        with pytest.raises(ValueError, match=rf"imitate.{name} must be a whole number of at least 1, got {value}"):
            imitate(pupil(), "MaxForce", 8192, **wrong)


def test_a_training_begins_with_its_lesson_and_a_resumed_one_does_not(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(training_module, "VALIDATION_EPISODES", 4)
    lesson = {"teacher": "MaxForce", "steps": 1024}
    found = hyperparameters("ppo", TASK) | SETTINGS | {"imitate": lesson, "n_epochs": 2}
    monkeypatch.setattr("agents.learning.run.hyperparameters", lambda *_: dict(found))
    config = Config(task=TASK, run=tmp_path / "run", timesteps=512, n_envs=16, evaluations=2, progress=False)
    assert learn(Run.open(config))
    assert "imitated MaxForce for 1024 steps" in "".join(capsys.readouterr())
    curve = curve_of(tmp_path / "run")
    assert [row["timesteps"] for row in read_curve(curve)] == [0, 256, 512]  # the taught policy is a candidate too
    assert learn(Run.open(Config(**asdict(config) | {"resume": True})))
    assert "imitated" not in "".join(capsys.readouterr())
    file = tmp_path / "run" / "config.json"
    stored = json.loads(file.read_text())
    for name, wrong, words in (
        ("steps", "all of them", "steps"),
        ("rounds", 0, "rounds must be at least 1"),
        ("batch", 64, "imitate must set only teacher, steps, rounds, epochs, learning_rate; got 'batch'"),
    ):
        changed = json.loads(json.dumps(stored))
        changed["hyperparameters"]["imitate"][name] = wrong
        file.write_text(json.dumps(changed))
        with pytest.raises(ValueError, match=words):
            Run.at(tmp_path / "run")
