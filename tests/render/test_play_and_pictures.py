"""Playing in a window, and the videos and plots the command writes."""

from __future__ import annotations

import json
import shutil
import sys

import gymnasium as gym
import numpy as np
import pytest

import train
from agents.cli.main import main as magwire
from agents.cli.pictures import trace
from agents.cli.view import _lazily, _policies, _time_of_max_force
from agents.controllers import MaxForce
from magwire_env.render.frames import Frames
from magwire_env.render.play import SIZE, Game, play, shown

ID = "MagWire/Steer-v0"


@pytest.fixture
def game(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    return Game(gym.make(ID), seed=3, reference=lambda seed: 7.5, name="MaxForce")


def test_a_game_is_won_by_holding_the_best_angle(game):
    policy = MaxForce.from_env(game.env)
    while not game.ended:
        action, _ = policy.predict(game.core.observe()[0])
        game.hold(0, float(game.core.actuation.command(action[None])[0, 0]))
        game.step()
    assert game.success
    assert game.verdict().startswith("goal in ")
    assert game.note().endswith("MaxForce 7.50 s")
    assert game.score > 5
    game.step()  # nothing more happens
    game.restart()
    assert not game.ended
    assert game.score == 0
    assert game.verdict() == ""


def test_keys_turn_the_magnet_at_the_servo_speed(game):
    before = game.command.copy()
    for _ in range(10):
        game.nudge(0, 1.0, 0.1)
    assert game.command[0] - before[0] == pytest.approx(np.pi)
    game.nudge(3, 1.0, 0.1)  # a key for a freedom this rig has not
    for _ in range(12):
        game.step()
    assert game.now.magnet[0] == pytest.approx(game.command[0], abs=1e-6)


def test_the_mouse_turns_the_magnet_towards_itself(game):
    frames = Frames(game.core, SIZE)
    shown(game, frames, game.now)
    view = frames.picture(game.scenario).views.side
    centre = view.px(game.now.magnet_positions[0])
    for angle in (0.5, 2.0, 4.0):
        game.point_at(frames, tuple(centre + 60 * np.array([np.sin(angle), -np.cos(angle)])))
        assert (game.command[0] - angle + np.pi) % (2 * np.pi) - np.pi == pytest.approx(0, abs=0.02)
    panel = frames.picture(game.scenario).map
    game.point_at(frames, tuple(panel.axes.px(0.4, 3.0) + panel.rect.topleft))
    assert game.command[0] == pytest.approx(3.0, abs=0.05)


def test_the_mouse_moves_a_magnet_that_slides(monkeypatch):
    game = Game(gym.make("MagWire/Chase-v0", pool_size=1))
    frames = Frames(game.core, SIZE)
    shown(game, frames, game.now)
    view = frames.picture(game.scenario).views.plan
    wanted = game.now.magnet_positions[0] + np.array([0.004, -0.006, 0.0])
    game.point_at(frames, tuple(view.px(wanted)))
    moved = game.command[:2] - game.now.magnet[:2]
    assert moved == pytest.approx([0.004, -0.006], abs=0.003)


def test_the_window_runs_and_closes(game):
    play(game, frames_limit=8)
    assert game.now.time > 0.1


def test_the_time_to_beat():
    assert _time_of_max_force(ID, 0, {}) == pytest.approx(7.5, abs=0.3)
    assert _time_of_max_force(ID, 0, {"time_limit": 1.0}) is None


def test_a_trace_is_the_episode():
    one = trace(MaxForce.from_env, "MaxForce", ID, seed=0)
    assert one.success
    assert len(one.moments) == round(one.of("time")[-1] / 0.1) + 1
    assert one.of("tip_arclength")[-1] > one.moments[-1].goal > one.of("tip_arclength")[0]
    assert one.of("time")[-1] - 0.1 < one.seconds < one.of("time")[-1]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "small"
    train.main(train.Config(run=folder, timesteps=2048, n_envs=32, evaluations=1, episodes=2, progress=False))
    return folder


def test_training_leaves_pictures(run):
    for name in ("path.png", "arclength.png", "learning_curve.png"):
        assert (run / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert (run / "episode.mp4").read_bytes()[4:8] == b"ftyp"


def test_training_without_the_extra_says_so_in_one_line(run, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pygame", None)
    (run / "episode.mp4").unlink()
    train.main(train.Config(run=run, resume=True, episodes=2, progress=False))
    last = capsys.readouterr().out.strip().splitlines()[-1]
    assert last == "no video: rendering needs pygame-ce: pip install 'magwire-env[view]'"
    assert not (run / "episode.mp4").exists()


def test_plot_and_video_of_a_run(run, tmp_path, capsys):
    out = tmp_path / "plots"
    magwire(["plot", str(run), "--out", str(out)])
    assert {p.name for p in out.iterdir()} == {"path.png", "arclength.png", "learning_curve.png"}
    magwire(["video", str(run), "--out", str(tmp_path / "a.gif"), "--speed", "4"])
    assert (tmp_path / "a.gif").read_bytes()[:6] == b"GIF89a"
    assert str(tmp_path / "a.gif") in capsys.readouterr().out


def test_what_cannot_be_filmed_is_refused(tmp_path):
    for arguments, words in (
        (["nobody"], "policy must be a run folder or one of"),
        (["MaxForce", "--out", str(tmp_path / "a.avi")], "must end in .mp4 or .gif"),
        (["MaxForce", "--out", str(tmp_path / "a.gif"), "--speed", "0"], "speed must be positive"),
    ):
        with pytest.raises(SystemExit, match=words):
            magwire(["video", *arguments])


def test_models_are_offered_and_refused_where_they_do_not_fit(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(run, tmp_path / "runs" / "mine")
    assert "MaxForce" in _policies(())
    assert "runs/mine" in _policies(())
    other = gym.make(ID, observe=("tip_arclength",))
    with pytest.raises(ValueError, match="trained on observations of shape"):
        _lazily(run)(other)
    assert json.loads((run / "best" / "model.json").read_text())["task"] == ID
    assert _lazily(run)(gym.make(ID)).predict(gym.make(ID).reset(seed=0)[0])[0].shape == (1,)
