"""Demonstrations as Minari data sets: written, opened by Minari, replayed to the last bit; and what is refused."""

from __future__ import annotations

import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from agents.cli.main import main as magwire
from magwire_env.envs.trees import demonstrations

minari = pytest.importorskip("minari", reason="Minari, an extra for tests, is not installed")

from agents.learning.demonstrations import replayed  # noqa: E402


def recorded(folder, *arguments):
    """The data set that `magwire record` leaves, opened by its name."""
    magwire(["record", str(folder), *arguments])
    return minari.load_dataset(folder.name)


def same(one, other):
    """Two parts of an episode are the same numbers, in every part of a dict."""
    if isinstance(one, dict):
        return set(one) == set(other) and all(np.array_equal(one[name], other[name]) for name in one)
    return np.array_equal(one, other)


def assert_replays(dataset, steps):
    found = list(replayed(dataset))
    assert len(found) == dataset.total_episodes
    assert sum(len(kept) for kept, _ in found) == dataset.total_steps >= steps
    for kept, again in found:
        assert same(kept.observations, again.observations)
        assert np.array_equal(kept.actions, again.actions)
        assert np.array_equal(kept.rewards, again.rewards)
        assert np.array_equal(kept.terminations, again.terminations)
        assert np.array_equal(kept.truncations, again.truncations)
    return found


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


def test_a_controller_s_episodes_replay(tmp_path, capsys):
    dataset = recorded(
        tmp_path / "steering-v0", "--policy", "MaxForce", "--task", "MagWire/SteerAny-v0", "--episodes", "2", "--seed",
        "7", "--env-kwargs", "pool_size=3", "split=test",
    )  # fmt: skip
    assert "2 episodes, 2 of which reached the goal" in capsys.readouterr().out
    assert dataset.env_spec.kwargs == {"task": "MagWire/SteerAny-v0", "pool_size": 3, "split": "test"}
    assert_replays(dataset, 50)
    about = list(dataset.storage.get_episode_metadata([0, 1]))
    assert [one["seed"] for one in about] == [7, 8]
    assert all(one["success"] for one in about)
    observation, _ = gym.make("MagWire/SteerAny-v0", pool_size=3, split="test").reset(seed=7)
    assert np.array_equal(dataset[0].observations[0], observation)


def test_images_and_numbers_replay(tmp_path):
    dataset = recorded(
        tmp_path / "seen-v0", "--policy", "MaxForce", "--task", "MagWire/Steer-v1",
        "--env-kwargs", 'observe=[{size = 48, noise = 0.02}, "tip_arclength", "tip_speed", "magnet", "distance_left"]',
        "time_limit=1.0",
    )  # fmt: skip
    ((kept, _),) = assert_replays(dataset, 10)
    assert kept.observations["image"].shape == (11, 1, 48, 48)
    assert kept.observations["image"].dtype == np.uint8
    assert kept.truncations.tolist() == [False] * 9 + [True]


@pytest.mark.parametrize(("task", "astray"), [("MagWire/NavigateAny-v0", False), ("MagWire/Recover-v0", True)])
def test_the_runs_that_certify_trees_reach_their_goals(task, astray, tmp_path):
    """All runs of the first tree and the first one of the second, each in its own tree."""
    first, second = ([run for run in demonstrations("test", i) if (run.start != "inlet") == astray] for i in (0, 1))
    many = len(first) + 1
    dataset = recorded(
        tmp_path / "certified-v0", "--policy", "certified", "--task", task, "--episodes", str(many), "--env-kwargs",
        "pool_size=2", "split=test",
    )  # fmt: skip
    found = assert_replays(dataset, 20)
    assert all(again.success for _, again in found)
    for (kept, _), run in zip(found, [*first, second[0]], strict=True):
        assert np.array_equal(kept.actions, run.actions[: len(kept)])
    assert len(found) == many


def test_actions_that_do_not_end_their_episode_leave_no_data_set(tmp_path, monkeypatch):
    cut = [replace(run, actions=run.actions[:5]) for run in demonstrations("test", 0)]
    monkeypatch.setattr("agents.learning.demonstrations.demonstrations", lambda *_: cut)
    with pytest.raises(SystemExit, match="an episode must end with its 5 actions, and goes on"):
        magwire(["record", str(tmp_path / "mine-v0"), "--policy", "certified", "--env-kwargs", "pool_size=1",
                 "split=test"])  # fmt: skip
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["mine", "--policy", "MaxForce"], "out must end in a data set's name such as mine-v0"),
        (["mine-v0"], "policy must be given for a data set"),
        (["mine-v0", "--policy", "MaxForce", "--seconds", "3"], "seconds, columns and noise are of logs"),
        (["mine-v0", "--policy", "certified", "--task", "MagWire/Steer-v1"], "task must draw certified trees"),
        (["mine-v0", "--policy", "certified", "--scenario", "paper"], "scenario must be left to the certified runs"),
        (["mine-v0", "--policy", "MaxForce", "--episodes", "0"], "episodes must be a whole number of at least 1"),
    ],
)
def test_bad_input_ends_in_one_line(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        magwire(["record", *arguments])
    assert words in str(stopped.value)
    assert not any(tmp_path.iterdir())


def test_a_data_set_that_exists_is_left_alone(tmp_path):
    (tmp_path / "mine-v0").mkdir()
    with pytest.raises(SystemExit, match="exists"):
        magwire(["record", str(tmp_path / "mine-v0"), "--policy", "MaxForce", "--env-kwargs", "time_limit=0.2"])


def test_without_minari_a_sentence_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(SystemExit, match=r"needs minari: pip install 'magwire-env\[demonstrations\]'"):
        magwire(["record", str(tmp_path / "mine-v0"), "--policy", "MaxForce"])
