"""Frames of trees show the route to the target."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.render import paint
from magwire_env.render.snapshot import snapshots


def test_the_route_leads_from_the_inlet_to_the_target_and_is_drawn_along_the_centrelines(monkeypatch):
    env = gym.make("MagWire/Navigate-v0", render_mode="rgb_array")
    env.reset(seed=0, options={"target": "RCCA"})
    now = snapshots(env.unwrapped.core)[0]
    tree = now.scenario.tree
    assert now.route[0] == pytest.approx(tree.position("inlet"))
    assert now.route[-1] == pytest.approx(now.target)
    assert now.goal == pytest.approx(tree.length_of("RCCA") - 5e-3)  # from the inlet, as the tip's way
    shown = env.render().astype(int)
    views = env.unwrapped._frames.picture(now.scenario).views
    monkeypatch.setattr(views, "_route", lambda *_: None)
    y, x = np.nonzero((shown != env.render()).any(axis=2))  # the pixels that only the route paints
    assert len(x) > 100
    assert (np.abs(shown[y, x] - paint.TARGET).max(axis=1) < 12).all()
    line = np.concatenate([views.plan.px(now.route), views.side.px(now.route)])
    assert np.hypot(line[:, 0, None] - x, line[:, 1, None] - y).min(axis=0).max() < 4.0


def test_a_tract_has_no_route_to_draw():
    env = gym.make("MagWire/Steer-v0")
    env.reset(seed=0)
    assert snapshots(env.unwrapped.core)[0].route.shape == (0, 3)
