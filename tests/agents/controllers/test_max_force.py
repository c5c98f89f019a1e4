"""The paper's own policy."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce
from magwire_env.simulation import best_command

ID = "MagWire/Steer-v0"


def test_max_force_turns_to_the_angle_of_figure_7():
    env = gym.make(ID)
    observation, _ = env.reset(seed=0, options={"tip_arclength": 0.3})
    action, _ = MaxForce.from_env(env).predict(observation)
    sim = env.unwrapped.simulator
    best, _ = best_command(sim.scenarios[0], np.array([0.3]))
    assert env.unwrapped.core.actuation.command(action[None])[0, 0] == pytest.approx(best[0, 0], abs=5e-3)
