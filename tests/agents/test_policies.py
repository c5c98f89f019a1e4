"""Policies of users: functions, networks, classes, SB3's own files; in every command; refusals that name both."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import VecNormalize

from agents.catalogue import resolve
from agents.cli.main import main as magwire
from agents.controllers import MaxForce
from agents.evaluation.episodes import built
from agents.evaluation.evaluator import evaluate
from agents.learning import make_vec_env
from agents.policies import Function

ID = "MagWire/Steer-v0"

SOURCE = '''
import numpy as np
import torch


def sine(observation):
    return observation[:, 4:5]


class Called:
    def __call__(self, observation):
        return np.full((len(observation), 1), 0.3)


class Remembers:
    """SB3's form with a memory: counts the steps of every lane's episode."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        steps = np.zeros(len(observation)) if state is None else np.where(episode_start, 0, state + 1)
        return np.where(steps < 20, 0.3, -0.2)[:, None].astype(np.float32), steps


class FromEnv:
    @classmethod
    def from_env(cls, env):
        return Remembers()


class Network(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.inner = torch.nn.Sequential(torch.nn.Linear(7, 1), torch.nn.Dropout(0.9), torch.nn.Tanh())

    def forward(self, observation):
        return self.inner(observation)


class SeesForce:
    """Needs an env of its own."""

    env_kwargs = {"observe": ["drive_force", "tip_speed"], "action_mode": "rate"}

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert observation.shape[-1] == 2
        return -np.sign(observation[..., :1]), state


class Needs:
    def __init__(self, weights, gain):
        pass

    def predict(self, *_, **__):
        pass


ready = Remembers()
network = Network()
two = lambda observation: np.zeros((len(observation), 2))
broken = lambda observation: observation @ np.zeros((67, 1))
number = 3
'''


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to stand in, with a module of policies that nothing has put on the path."""
    (tmp_path / "own_policies.py").write_text(SOURCE)
    monkeypatch.chdir(tmp_path)
    path = list(sys.path)
    yield tmp_path
    sys.path[:] = path
    sys.modules.pop("own_policies", None)


# --- what a policy may be ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sine", "Called", "Remembers", "FromEnv", "Network", "ready", "network", "SeesForce"])
@pytest.mark.parametrize("place", ["own_policies", "own_policies.py"])
def test_the_command_evaluates_it(place, name, own, capsys):
    magwire(["evaluate", f"{place}:{name}", "--task", ID, "--episodes", "2", "--no-par"])
    assert f"\n{name} " in capsys.readouterr().out


def test_a_function_of_observations_plays_single_and_batched():
    policy = Function(lambda observation: 0.5 * observation[:, 4:5])
    env, envs = gym.make(ID), gym.make_vec(ID, num_envs=2)
    one, many = env.reset(seed=3)[0], envs.reset(seed=3)[0]
    assert policy.predict(one)[0].shape == (1,)
    assert policy.predict(many)[0].shape == (2, 1)
    assert policy.predict(one)[0] == policy.predict(many)[0][0]
    with pytest.raises(ValueError, match="act must be a function of observations, got 3"):
        Function(3)  # type: ignore[arg-type]


def test_networks_play_as_in_evaluation(own):
    """No dropout, no gradients."""
    sys.path.append(str(own))
    policy = resolve("own_policies:Network").policy(None)
    x = np.ones((3, 7), dtype=np.float32)
    first, again = policy.predict(x)[0], policy.predict(x)[0]
    assert np.array_equal(first, again)
    assert first.dtype == np.float32


def test_a_memory_starts_afresh_with_every_episode():
    seen = []

    class Watches:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            seen.append(None if episode_start is None else episode_start.copy())
            return np.zeros((len(observation), 1), dtype=np.float32), state

    evaluate(Watches(), ID, 2)
    assert seen[0].all()
    assert not seen[1].any()


# --- SB3's own files --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_a_zip_of_sb3_plays_with_its_normalisation(algorithm, own, capsys):
    venv = VecNormalize(make_vec_env(ID, 4, seed=0))
    small = {"n_steps": 8, "batch_size": 32} if algorithm is PPO else {"learning_starts": 10, "batch_size": 16}
    model = algorithm("MlpPolicy", venv, seed=0, device="cpu", policy_kwargs={"net_arch": [8]}, **small)
    model.learn(64)
    saved = own / algorithm.__name__
    saved.mkdir()
    model.save(saved / "mine.zip")
    with pytest.raises(SystemExit, match=r"mine\.zip is a file of Stable-Baselines3's own.*--trust opens it"):
        magwire(["evaluate", f"{saved.name}/mine.zip", "--task", ID, "--episodes", "2", "--no-par"])
    magwire(["evaluate", f"{saved.name}/mine.zip", "--task", ID, "--trust", "--episodes", "2", "--no-par"])
    printed = capsys.readouterr()
    assert "\nmine " in printed.out
    assert f"no vecnormalize.pkl beside {saved.name}/mine.zip" in printed.err
    venv.save(str(saved / "vecnormalize.pkl"))
    observations = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32)
    expected, _ = model.predict(venv.normalize_obs(observations), deterministic=True)
    assert np.allclose(
        resolve(f"{saved.name}/mine.zip", trust=True).policy.predict(observations)[0], expected, atol=1e-6
    )


def test_a_zip_of_something_else_is_refused(own):
    (own / "text.zip").write_text("no archive")
    with pytest.raises(ValueError, match=r"text\.zip must be a model that Stable-Baselines3 saved"):
        resolve("text.zip", trust=True)


# --- where they do not fit --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "two",
            r"the policy two must answer observations of shape \(2, 7\) of MagWire/Steer-v0, .*with actions",
        ),
        ("number", "policy must name a class with from_env"),
        ("Needs", "made without arguments, or one with from_env.*needs weights, gain"),
        ("nothing", "importable module:thing"),
    ],
)
def test_what_is_no_policy_ends_in_a_sentence(name, words, own):
    with pytest.raises(SystemExit, match=words) as stopped:
        magwire(["evaluate", f"own_policies:{name}", "--task", ID, "--episodes", "2", "--no-par"])
    assert "\n" not in str(stopped.value)


def test_a_policy_s_own_failure_keeps_its_traceback_and_says_what_it_was_given(own):
    with pytest.raises(ValueError, match="matmul") as caught:
        evaluate(resolve("own_policies.py:broken").policy, ID, 2)
    assert caught.value.__notes__ == ["broken was given observations of shape (2, 7), one row a lane"]


def test_a_trained_policy_of_another_task_names_both(run):
    for task, words in (
        (
            "MagWire/Chase-v0",
            r"trained on MagWire/Steer-v0 to see 7 numbers \(tip_arc.*Chase-v0 shows \d+ numbers \(",
        ),
        ("MagWire/Track-v0", r"but MagWire/Track-v0 shows 11 numbers \(.*reference_preview\)"),
    ):
        with pytest.raises(SystemExit, match=words):
            magwire(["evaluate", str(run[0]), "--task", task, "--episodes", "1", "--no-par"])
    with pytest.raises(SystemExit, match=r"to give 1 number \(action_mode 'angle'\).*\(action_mode 'rate'\)"):
        magwire(["evaluate", str(run[0]), "--episodes", "1", "--no-par", "--env-kwargs", "action_mode=rate"])
    magwire(["evaluate", str(run[0]), "--task", "MagWire/Reach-v0", "--episodes", "1", "--no-par"])  # the same spaces


def test_spaces_are_compared_where_a_policy_has_them():
    class Model:
        observation_space = gym.spaces.Box(-1, 1, (3,))
        action_space = gym.spaces.Box(-1, 1, (1,))

        def predict(self, observation, **_):
            return np.zeros((len(observation), 1)), None

    words = r"Model sees observations of shape \(3,\), but those of MagWire/Steer-v0, which shows 7 numbers .*\(7"
    with pytest.raises(ValueError, match=words):
        built(Model(), gym.make_vec(ID, num_envs=2))
    with pytest.raises(ValueError, match=r"agents\.policies\.Function makes a policy"):
        built(lambda env: 3, gym.make(ID))


# --- the env of a command ---------------------------------------------------------------------------------------------


def test_env_kwargs_reach_the_env_and_the_others_play_the_same_episodes(tmp_path, capsys):
    out = tmp_path / "r.json"
    own = ["observe=drive_force,tip_speed", "action_mode=rate", "time_limit=2.5", "scenario=hard"]
    magwire(
        [
            "evaluate",
            "ConstantRotation",
            "--task",
            ID,
            "--episodes",
            "2",
            "--no-par",
            "--out",
            str(out),
            "--env-kwargs",
            *own,
        ]
    )
    stored = json.loads(out.read_text())
    steps = [stored[name]["episodes"]["steps"] for name in ("ConstantRotation", "MaxForce")]
    assert all(n <= 25 for row in steps for n in row)
    assert stored["ConstantRotation"]["episodes"]["start"] == stored["MaxForce"]["episodes"]["start"]
    entrant = resolve("MaxForce", env_kwargs=own)
    assert entrant.settings["observe"] == ["drive_force", "tip_speed"]
    assert entrant.same_episodes == {"time_limit": 2.5, "scenario": "hard"}


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        (["observe"], "env-kwargs must be key=value with a key of coupling"),
        (["obsreve=magnet"], "got 'obsreve=magnet'"),
        (["safety=true", "safety=false"], "name each key once, got 'safety' twice"),
        (["observe=nothing"], "observe must name different channels"),
        (["reward={succes=2}"], "reward must weigh success, .*got 'succes'"),
    ],
)
@pytest.mark.parametrize("command", [["evaluate", "MaxForce", "--no-par"], ["train"], ["plot", "MaxForce"]])
def test_bad_env_kwargs_end_in_a_sentence(command, pairs, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=words):
        magwire([*command, "--env-kwargs", *pairs])
    assert not any(tmp_path.iterdir())


def test_training_takes_env_kwargs_and_keeps_them(tmp_path, capsys):
    own = ["observe=drive_force,tip_speed,magnet", "action_mode=rate", "reward={success=20}"]
    arguments = ["--timesteps", "512", "--n-envs", "32", "--evaluations", "1", "--episodes", "2"]
    folder = tmp_path / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("agents.cli.pictures.leave_in", lambda *_, **__: [])
        magwire(["train", "--run", str(folder), *arguments, "--env-kwargs", *own])
    kept = json.loads((folder / "config.json").read_text())["hyperparameters"]["env"]
    assert kept["observe"] == ["drive_force", "tip_speed", "magnet"]
    assert (kept["action_mode"], kept["reward"]) == ("rate", {"success": 20})
    magwire(["evaluate", str(folder), "--episodes", "2", "--no-par"])
    assert "\nrun " in capsys.readouterr().out


def test_registered_controllers_still_take_the_task_s_own_observation():
    assert resolve("MaxForce").policy == MaxForce.from_env
