"""Policies that look at an image: trained by SB3, as plain arrays, in files, evaluated, resumed."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecFrameStack

from agents.catalogue import CONTROLLERS
from agents.env_kwargs import parsed
from agents.evaluation import evaluate
from agents.learning import load
from agents.learning.config import Config
from agents.learning.export import about_model, plain, save_all
from agents.learning.hyperparameters import hyperparameters
from agents.learning.plain_eyes import SeeingPolicy
from agents.learning.policy_file import read, write
from agents.learning.run import Run
from agents.learning.sb3 import make_model, make_vec_env
from agents.learning.training import learn
from agents.learning.untrained import untrained
from agents.policies import Function
from magwire_env.envs.fluoroscopy import Fluoroscopy
from tests.agents.learning.test_policy_file import meta
from tests.agents.learning.test_resuming import begun, end_of, few_episodes, resumed, stop_after  # noqa: F401

ID = "MagWire/Steer-v1"
IMAGE = {"size": 40, "lao": 20.0}
EYES = {"features_extractor_kwargs": {"cnn_output_dim": 16}, "net_arch": [8]}


def trained(algorithm="ppo", observe=(IMAGE, "tip_speed", "magnet"), frames=1, steps=128):
    venv = make_vec_env(ID, 8, seed=0, frame_stack=frames, observe=observe)
    small = {"policy_kwargs": EYES, "normalize": {}}
    if algorithm == "ppo":
        small |= {"n_steps": 8, "batch_size": 32, "n_epochs": 2}
    else:
        small |= {"learning_starts": 32, "batch_size": 16, "buffer_size": 400}
    torch.set_num_threads(1)
    model = make_model(algorithm, venv, 0, small)
    model.learn(steps)
    return model, plain(model, about_model(model, meta(algorithm, ID, env={"observe": list(observe)})), frames)


def as_sb3(model, seen):
    return model.predict(model.get_vec_normalize_env().normalize_obs(seen), deterministic=True)[0]


def test_sb3_s_own_policy_learns_from_images():
    venv = make_vec_env(ID, 4, seed=0, observe=("fluoroscopy", "magnet"))
    model = PPO("MultiInputPolicy", venv, n_steps=8, batch_size=16, n_epochs=1, device="cpu", policy_kwargs=EYES)
    before = model.policy.features_extractor.extractors["image"].cnn[0].weight.detach().clone()
    model.learn(64)
    assert not torch.equal(model.policy.features_extractor.extractors["image"].cnn[0].weight, before)


@pytest.mark.parametrize(
    ("algorithm", "observe", "frames"),
    [
        ("ppo", (IMAGE, "tip_speed", "magnet"), 1),
        ("ppo", (IMAGE,), 1),
        ("ppo", (IMAGE, "tip_speed"), 3),
        ("sac", (IMAGE, "tip_speed"), 1),
    ],
)
def test_a_policy_and_its_files_act_as_the_model_does(algorithm, observe, frames, tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime")
    model, made = trained(algorithm, observe, frames)
    save_all(made, tmp_path)
    policy = read(tmp_path)
    assert isinstance(policy, SeeingPolicy)
    assert (policy.image, policy.size) == ((1, 40, 40), made.size)
    rng = np.random.default_rng(0)
    seen = {"image": rng.integers(0, 256, (20, frames, 40, 40), dtype=np.uint8)}
    if policy.size:
        seen["state"] = rng.standard_normal((20, policy.size * frames)).astype(np.float32)
    wanted = as_sb3(model, seen)
    assert np.abs(policy.act(seen) - wanted).max() <= 1e-5
    assert np.ptp(wanted, axis=0).max() > 1e-4
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx", providers=["CPUExecutionProvider"])
    assert np.abs(session.run(["action"], seen)[0] - wanted).max() <= 1e-5
    if frames == 1:
        one, _ = policy.predict({name: part[3] for name, part in seen.items()})
        assert one.shape == (2,)
        assert np.abs(one - wanted[3]).max() <= 1e-5


def test_frames_are_stacked_as_sb3_stacks_them():
    observe = (IMAGE, "tip_speed")
    venv = make_vec_env(ID, 3, seed=0, frame_stack=3, observe=observe, time_limit=0.3)
    model = make_model("ppo", venv, 0, {"policy_kwargs": EYES, "n_steps": 8, "batch_size": 24})
    policy = plain(model, about_model(model, meta("ppo", ID)), 3)
    assert isinstance(venv, VecFrameStack)
    raw = make_vec_env(ID, 3, seed=0, observe=observe, time_limit=0.3)
    stacked, newest, state, starts = venv.reset(), raw.reset(), None, np.ones(3, dtype=bool)
    for _ in range(7):  # two ends of episodes among them
        actions, state = policy.predict(newest, state=state, episode_start=starts)
        for name, part in stacked.items():
            assert np.array_equal(state[name], part), name
        stacked, _, starts, _ = venv.step(actions)
        newest = raw.step(actions)[0]


def test_a_run_trains_on_images_is_evaluated_and_loaded_again(tmp_path, monkeypatch):
    """As `magwire train --env-kwargs observe=…`; stopped and resumed it is the same, bit for bit."""
    small = {"task": ID, "env_kwargs": ('observe=[{size = 36, noise = 0.02}, "magnet"]',), "n_envs": 4}
    nets = {"policy_kwargs": EYES, "n_steps": 8, "batch_size": 32, "n_epochs": 1, "use_sde": False}
    monkeypatch.setattr("tests.agents.learning.test_resuming.ON_POLICY", nets)
    assert learn(begun(tmp_path / "whole", "ppo", 128, **small))
    with monkeypatch.context() as patched:
        stop_after(patched, 64)
        assert not learn(begun(tmp_path / "parts", "ppo", 128, **small))
    assert learn(resumed(tmp_path / "parts"))
    whole, parts = end_of(tmp_path / "whole"), end_of(tmp_path / "parts")
    assert whole[1] == parts[1]
    assert all(np.array_equal(array, parts[0][name]) for name, array in whole[0].items())
    policy = load(tmp_path / "whole")
    assert policy.env_settings["observe"] == [{"size": 36, "noise": 0.02}, "magnet"]
    found = evaluate(policy, policy.task, 2, time_limit=0.5, **policy.env_settings)
    assert found.steps.tolist() == [5, 5]


def test_its_recipe_sees_an_image_alone_and_learns_from_numbers(tmp_path, monkeypatch, capsys):
    """As `magwire train --algorithm sees_ppo`, at a small size: what it saves sees the image, and no number."""
    navigate = hyperparameters("sees_ppo", "MagWire/Navigate-v0")
    assert [set(part) for part in navigate["env"]["observe"]] == [{"size"}]
    assert (navigate["imitate"]["teacher"], navigate["n_timesteps"]) == ("FollowRoute", 0)
    lesson = {"imitate": {"teacher": "MaxForce", "steps": 512, "rounds": 2, "epochs": 1}}
    found = hyperparameters("sees_ppo", ID) | lesson | {"n_steps": 8, "batch_size": 32, "n_timesteps": 0}
    monkeypatch.setattr("agents.learning.run.hyperparameters", lambda *_: dict(found))
    monkeypatch.setattr("agents.learning.training.VALIDATION_EPISODES", 2)
    asked = {"run": tmp_path / "run", "n_envs": 8, "evaluations": 1, "progress": False}
    assert learn(Run.open(Config(task=ID, algorithm="sees_ppo", **asked)))
    policy = load(tmp_path / "run")
    assert (policy.image, policy.size, policy.about.channels) == ((1, 48, 48), 0, ())
    assert "imitated MaxForce" in capsys.readouterr().err
    assert learn(Run.open(Config(task=ID, algorithm="sees_ppo", resume=True, **asked)))
    assert "imitated" not in capsys.readouterr().err
    assert evaluate(policy, ID, 2, time_limit=0.5, **policy.env_settings).steps.tolist() == [5, 5]


def test_a_replay_buffer_with_images_goes_on_too(tmp_path, monkeypatch):
    small = {"task": ID, "env_kwargs": ("observe={size = 36}",), "n_envs": 4}
    nets = {"policy_kwargs": EYES, "learning_starts": 32, "batch_size": 8, "gradient_steps": 1, "buffer_size": 200}
    monkeypatch.setattr("tests.agents.learning.test_resuming.OFF_POLICY", nets)
    assert learn(begun(tmp_path / "whole", "sac", 96, **small))
    with monkeypatch.context() as patched:
        stop_after(patched, 48)
        assert not learn(begun(tmp_path / "parts", "sac", 96, **small))
    assert learn(resumed(tmp_path / "parts"))
    whole, parts = end_of(tmp_path / "whole"), end_of(tmp_path / "parts")
    assert all(np.array_equal(array, parts[0][name]) for name, array in whole[0].items())


def test_a_policy_says_where_it_does_not_fit():
    _, policy = trained(steps=64)
    with pytest.raises(
        ValueError, match=r"to see an image of 40 × 40 px and 3 numbers \(tip_speed, magnet\), but .* shows 7"
    ):
        evaluate(policy, ID, 1)
    with pytest.raises(ValueError, match="shows an image of 84 × 84 px and 3 numbers"):
        evaluate(policy, ID, 1, observe=("fluoroscopy", "tip_speed", "magnet"))
    blind = untrained(gym.make(ID))
    with pytest.raises(ValueError, match=r"to see 7 numbers .* shows an image of 84 × 84 px$"):
        evaluate(blind, ID, 1, observe="fluoroscopy")
    for wrong in (
        np.zeros(3),
        {"image": np.zeros((1, 40, 40))},
        {"image": np.zeros((1, 40, 40)), "state": np.zeros(4)},
    ):
        with pytest.raises(ValueError, match=r"observation must be a dict of image \(1, 40, 40\), state \(3,\)"):
            policy.predict(wrong)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["eyes"].update(image=[1, 40]), "image must be three whole numbers"),
        (lambda d: d["eyes"].update(image=[1, 44, 44]), "layer must take the 256 numbers"),
        (lambda d: d["eyes"].update(image=[2000, 40, 40]), "image must have channels"),
        (lambda d: d["eyes"]["convolutions"][1].update(shape=[64, 3, 4, 4]), "shape must follow"),
        (lambda d: d["eyes"]["convolutions"][0].update(stride=0), "stride must be at least 1"),
        (lambda d: d["eyes"]["convolutions"][0].update(activation="eval"), "activation must be one of"),
        (lambda d: d.update(format=3), "is of format 3; this program reads up to 2"),
    ],
)
def test_a_damaged_description_is_refused(change, words, tmp_path):
    import json

    _, policy = trained(steps=64)
    write(policy, tmp_path)
    described = json.loads((tmp_path / "policy.json").read_text())
    assert described["format"] == 2
    change(described)
    (tmp_path / "policy.json").write_text(json.dumps(described))
    with pytest.raises(ValueError, match=words):
        read(tmp_path)


def test_what_cannot_see_images_says_so():
    venv = make_vec_env(ID, 2, observe="fluoroscopy")
    with pytest.raises(ValueError, match=r"algorithm must be one of ppo, sac, tqc, .* to see an image, got 'crossq'"):
        make_model("crossq", venv, 0, {})
    with pytest.raises(ValueError, match="size must be at least 36 for SB3's NatureCNN, got 20"):
        make_model("ppo", make_vec_env(ID, 2, observe={"size": 20}), 0, {})


def test_controllers_and_functions_play_where_an_image_is_shown():
    observe = ("fluoroscopy", "tip_arclength", "tip_speed", "magnet", "distance_left")
    assert evaluate(CONTROLLERS["Random"].from_env, ID, 2, time_limit=0.3, observe="fluoroscopy").steps.tolist() == [
        3,
        3,
    ]
    beside, alone = (evaluate(CONTROLLERS["MaxForce"].from_env, ID, 2, observe=o) for o in (observe, observe[1:]))
    assert np.array_equal(beside.time, alone.time)
    with pytest.raises(ValueError, match="observe must include"):
        evaluate(CONTROLLERS["MaxForce"].from_env, ID, 1, observe="fluoroscopy")
    mean = Function(lambda seen: np.repeat(seen["image"].mean(axis=(1, 2, 3))[:, None] / 255, 2, axis=1))
    assert evaluate(mean, ID, 2, time_limit=0.3, observe="fluoroscopy").steps.tolist() == [3, 3]


def test_env_kwargs_ask_for_images():
    assert parsed(["observe=fluoroscopy"]) == {"observe": ["fluoroscopy"]}
    env = gym.make(ID, **parsed(['observe=["magnet", {lao = 30}]']))
    assert env.unwrapped.core.shown.fluoroscope.options == Fluoroscopy(lao=30)
