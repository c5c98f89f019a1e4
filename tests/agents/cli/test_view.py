"""Policies to look at, and the time to beat."""

from __future__ import annotations

import json
import shutil

import gymnasium as gym
import pytest

from agents.cli.view import _lazily, _policies, _time_to_beat

ID = "MagWire/Steer-v0"


def test_the_time_to_beat():
    assert _time_to_beat(ID, 0, {}) == pytest.approx(7.5, abs=0.3)
    assert _time_to_beat(ID, 0, {"time_limit": 1.0}) is None


def test_models_are_offered_and_refused_where_they_do_not_fit(run, tmp_path, monkeypatch):
    folder, _ = run
    monkeypatch.chdir(tmp_path)
    shutil.copytree(folder, tmp_path / "runs" / "mine")
    assert "MaxForce" in _policies(())
    assert "runs/mine" in _policies(())
    other = gym.make(ID, observe=("tip_arclength",))
    with pytest.raises(ValueError, match="trained on observations of shape"):
        _lazily(folder)(other)
    assert json.loads((folder / "best" / "model.json").read_text())["task"] == ID
    assert _lazily(folder)(gym.make(ID)).predict(gym.make(ID).reset(seed=0)[0])[0].shape == (1,)
