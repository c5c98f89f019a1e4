"""Playing in a window."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

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
    game.begin()
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
    game.begin()
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
    """The game waits for its player: time stands still until a key is pressed or a button is."""
    play(game, frames_limit=8)
    assert game.now.time == 0.0
    assert game.waiting
    game.begin()
    play(game, frames_limit=8)
    assert game.now.time > 0.1
    game.restart()
    assert game.waiting
