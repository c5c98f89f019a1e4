"""Policies as plain arrays: the same actions as Stable-Baselines3's, and nothing else that a file can ask for."""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import json
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from safetensors.numpy import load_file, save_file
from stable_baselines3.common.vec_env import VecFrameStack

from agents.learning import load
from agents.learning.export import about_model, plain, save_all
from agents.learning.plain_policy import PlainPolicy
from agents.learning.policy_file import ARRAYS, read, write
from agents.learning.sb3 import NativeVecEnv, make_model, make_vec_env
from agents.learning.scenario_copy import text_for
from agents.learning.untrained import untrained
from magwire_env import Scenario

ID = "MagWire/Steer-v0"
ALGORITHMS = ("ppo", "sac", "tqc", "crossq", "stacked_ppo")
LAYER = {"shape": [7, 64], "activation": "tanh", "parameters": []}
NO_SCENARIO = {"scenario": None, "scenario_given": False}


def meta(algorithm: str, task: str = ID, **changes) -> dict:
    return {"task": task, "algorithm": algorithm, "seed": 0, "env": {}, **NO_SCENARIO, **changes}


def trained(algorithm: str, task: str = ID, policy_kwargs=None, **settings):
    """A model after a few steps, so that its normalisation, its batch statistics and its weights have moved."""
    frames = 4 if algorithm == "stacked_ppo" else 1
    venv = make_vec_env(task, 16, seed=0, frame_stack=frames)
    small = {"policy_kwargs": policy_kwargs or {}, "normalize": {}} | settings
    if "ppo" in algorithm:
        small |= {"n_steps": 16, "batch_size": 128, "n_epochs": 2}
    else:
        small |= {"learning_starts": 64, "batch_size": 64, "train_freq": 8, "gradient_steps": 8, "buffer_size": 2000}
    torch.set_num_threads(1)
    model = make_model(algorithm, venv, 0, small)
    model.learn(512)
    return model, plain(model, about_model(model, meta(algorithm, task)), frames)


@pytest.fixture(scope="module", params=ALGORITHMS)
def pair(request, tmp_path_factory):
    """A model, and the policy that was written of it and read again."""
    model, policy = trained(request.param)
    folder = tmp_path_factory.mktemp(request.param)
    save_all(policy, folder)
    return model, read(folder), folder


def observations(policy: PlainPolicy, n: int = 500) -> np.ndarray:
    """What the network is shown in episodes, and far out, (n, frames · size)."""
    env = gym.make_vec(ID, num_envs=25)
    seen, rng = [env.reset(seed=0)[0]], np.random.default_rng(0)
    while sum(map(len, seen)) < n * policy.frames:
        seen.append(env.step(rng.uniform(-1, 1, (25, 1)).astype(np.float32))[0])
    rows = np.concatenate(seen)[: n * policy.frames].reshape(n, -1)
    rows[::5] *= rng.uniform(1, 100, (len(rows[::5]), 1))
    return rows.astype(np.float32)


def as_sb3(model, observation: np.ndarray) -> np.ndarray:
    return model.predict(model.get_vec_normalize_env().normalize_obs(observation), deterministic=True)[0]


def test_a_policy_acts_as_the_model_does(pair):
    model, policy, _ = pair
    seen = observations(policy)
    wanted = as_sb3(model, seen)
    assert np.abs(policy.act(seen) - wanted).max() <= 1e-6
    assert np.ptp(wanted) > 1e-3
    assert max(np.abs(policy.act(row) - as_sb3(model, row)).max() for row in seen[:50]) <= 1e-6


def test_one_observation_and_many_give_the_same(pair):
    _, policy, _ = pair
    seen = observations(policy, 600)[:, : policy.size]
    many, _ = policy.predict(seen)
    assert many.shape == (600, 1)
    assert many.dtype == np.float32
    one, _ = policy.predict(seen[0])
    assert one.shape == (1,)
    assert np.abs(one - many[0]).max() <= 1e-6


def test_the_onnx_graph_acts_alike(pair):
    onnxruntime = pytest.importorskip("onnxruntime")
    model, policy, folder = pair
    session = onnxruntime.InferenceSession(folder / "policy.onnx", providers=["CPUExecutionProvider"])
    seen = observations(policy)
    (action,) = session.run(["action"], {"observation": seen})
    assert np.abs(action - as_sb3(model, seen)).max() <= 1e-6


@pytest.mark.parametrize("name", ["ReLU", "ELU", "LeakyReLU", "SiLU", "Sigmoid"])
def test_every_activation_has_its_plain_form(name, tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime")
    model, policy = trained("ppo", policy_kwargs={"activation_fn": name, "net_arch": [16, 16]}, use_sde=True)
    seen = observations(policy)
    assert np.abs(policy.act(seen) - as_sb3(model, seen)).max() <= 1e-6
    save_all(policy, tmp_path)
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx", providers=["CPUExecutionProvider"])
    assert np.abs(session.run(["action"], {"observation": seen})[0] - policy.act(seen)).max() <= 1e-6


def test_an_unknown_network_is_refused():
    model, policy = trained("ppo")
    model.policy.mlp_extractor.policy_net[1] = torch.nn.Softsign()
    with pytest.raises(ValueError, match="linear layers and known activations, got Softsign"):
        plain(model, policy.about)


def test_frames_are_stacked_as_sb3_stacks_them():
    venv = make_vec_env(ID, 3, seed=0, frame_stack=4, time_limit=0.3)
    model = make_model("stacked_ppo", venv, 0, {"normalize": {}})
    policy = plain(model, about_model(model, meta("stacked_ppo")), 4)
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


def test_a_policy_refuses_what_it_was_not_trained_on(pair):
    _, policy, _ = pair
    with pytest.raises(ValueError, match=r"must have shape \(7,\).*of the channels tip_arclength.*got \(9,\)"):
        policy.predict(np.zeros(9, dtype=np.float32))
    with pytest.raises(ValueError, match="deterministic must be True"):
        policy.predict(np.zeros(7, dtype=np.float32), deterministic=False)


# --- the scenario inside ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", ["MagWire/Steer-v1", "MagWire/Reach-v1"])
def test_a_policy_fits_the_task_that_it_was_trained_on_as_registered(task):
    env = gym.make(task)
    policy = untrained(env)
    policy.about = dataclasses.replace(policy.about, env={})  # as a run has it that changes nothing
    assert policy.misfit(env) == ""
    other = "angle" if env.unwrapped.core.actuation.mode == "rate" else "rate"
    assert f"(action_mode '{other}')" in policy.misfit(gym.make(task, action_mode=other))


def test_the_scenario_goes_with_the_policy(tmp_path):
    model, policy = trained("ppo")
    rough = Scenario.paper().replace(name="rough", contact__friction=0.2)
    kept = about_model(model, meta("ppo", scenario=rough.dumps(), scenario_given=True))
    write(PlainPolicy(policy.layers, None, policy.low, policy.high, False, 1, kept), tmp_path)
    assert load(tmp_path).env_settings["scenario"] == rough
    # The task's own is left to the task, unless it has changed since.
    for text, expected in ((text_for(ID, None), {}), (rough.dumps(), {"scenario": rough})):
        kept = about_model(model, meta("ppo", scenario=text, scenario_given=False))
        write(PlainPolicy(policy.layers, None, policy.low, policy.high, False, 1, kept), tmp_path)
        assert load(tmp_path).env_settings == expected


# --- damaged and hostile files ----------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    _, policy = _POLICY or trained("ppo")
    _POLICY[:] = [None, policy]
    kept = policy.about.__class__(**policy.about.__dict__ | {"scenario": text_for(ID, None)})
    policy = PlainPolicy(policy.layers, policy.normalization, policy.low, policy.high, False, 1, kept)
    write(policy, tmp_path / "policy")
    return tmp_path / "policy"


_POLICY: list = []


def rewritten(folder: Path, **changes) -> None:
    path = folder / "policy.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize("name", ["policy.json", "policy.safetensors"])
def test_a_truncated_or_missing_file_is_named(folder, name):
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=f"{name} is (truncated|damaged)"):
        load(folder)
    (folder / name).unlink()
    with pytest.raises(FileNotFoundError, match=f"holds no {name}"):
        load(folder)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"task": "this:MagWire/Steer-v0"},
            "registered MagWire/… task, got 'this:MagWire/Steer-v0'; nothing",
        ),
        ({"task": "CartPole-v1"}, "id of a registered MagWire/… task"),
        ({"env": {"scenario": "/etc/passwd"}}, "env must set only .*; got 'scenario'"),
        ({"env": {"render_mode": "human"}}, "env must set only"),
        ({"scenario": "name = 1"}, "scenario is not the one that scenario_sha256"),
        ({"format": 99}, "is of format 99; this program reads up to 2"),
        ({"frames": 10**9}, "must take 7000000000 numbers"),
        ({"frames": -1}, "frames must be at least 1, got -1"),
        ({"frames": True}, "frames must be a whole number, got True"),
        ({"layers": []}, "layers must end in 1 number, as an action has"),
        (
            {"layers": [{"shape": [7, 64], "activation": "__import__('os').system('x')", "parameters": []}]},
            "activation",
        ),
        (
            {"layers": [{"shape": [7, 10**12], "activation": "tanh", "parameters": []}]},
            r"layers.0.weight must have shape",
        ),
        ({"layers": {"a": 1}}, "layers must be a list"),
        ({"normalization_clip": "x"}, "normalization_clip must be a whole number or a number or null"),
        ({"channels": [1]}, "channels must hold strings"),
        ({"arrays_sha256": 5}, "arrays_sha256 must be a string"),
    ],
)
def test_what_no_policy_may_ask_for_is_refused(folder, changes, words, capsys):
    rewritten(folder, **changes)
    with pytest.raises(ValueError, match=words):
        load(folder)
    assert "Zen of Python" not in capsys.readouterr().out


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a": ' * 50_000, "[]", "nul", "\x00", "9" * 5000, '{"format": NaN}'])
def test_json_of_another_kind_is_refused(folder, text):
    (folder / "policy.json").write_text(text)
    with pytest.raises(ValueError, match=r"policy\.json"):
        load(folder)


def test_numbers_that_are_none_are_refused(folder):
    arrays = load_file(folder / "policy.safetensors")
    arrays["layers.1.bias"] = arrays["layers.1.bias"] * np.float32(np.nan)
    save_file(arrays, folder / "policy.safetensors")

    rewritten(folder, arrays_sha256=hashlib.sha256((folder / "policy.safetensors").read_bytes()).hexdigest())
    with pytest.raises(ValueError, match=r"layers\.1\.bias must be finite, got NaN or infinity"):
        load(folder)


def test_other_files_mean_nothing(folder, capsys):
    (folder / "model.zip").write_bytes(b"anything")
    load(folder)
    assert "model.zip; such files can carry a program, and were not opened" in capsys.readouterr().err


# --- without torch ----------------------------------------------------------------------------------------------------


def test_evaluating_a_policy_imports_no_torch(folder):
    code = (
        "import sys; from agents.cli.main import main; main(sys.argv[1:]); "
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, "evaluate", str(folder), "--episodes", "2", "--no-par"],
        capture_output=True, text=True, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "policy  " in done.stdout


def test_weights_in_half_precision_take_half_the_room(pair, tmp_path):
    """Each is kept to three figures; the numbers that are read are in single precision again."""
    _, policy, folder = pair
    write(policy, tmp_path, halved=True)
    again = read(tmp_path)
    assert (tmp_path / ARRAYS).stat().st_size < 0.75 * (folder / ARRAYS).stat().st_size
    for one, other in zip(policy.layers, again.layers, strict=True):
        assert other.weight.dtype == np.float32
        assert np.abs(one.weight - other.weight).max() <= 1e-3 * np.abs(one.weight).max()
        assert np.array_equal(one.bias, other.bias)


def test_a_weight_too_large_for_half_precision_stays_as_it_is(pair, tmp_path):
    _, policy, _ = pair
    large = dataclasses.replace(policy.layers[0], weight=policy.layers[0].weight * np.float32(1e9))
    policy = copy.copy(policy)
    policy.layers = (large, *policy.layers[1:])
    write(policy, tmp_path, halved=True)
    assert np.array_equal(read(tmp_path).layers[0].weight, large.weight)
