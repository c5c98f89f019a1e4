"""What holds for every controller: SB3's predict, single or batched."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.catalogue import CONTROLLERS, IN_TREES, NOT_OF_TRACTS, OF_SHAPES
from agents.controllers import MaxForce, NetForce
from agents.evaluation.evaluator import evaluate

ID = "MagWire/Steer-v0"


def shown(name):
    """What a controller asks to be shown, with the one action mode that it knows; nothing of most."""
    asked = getattr(CONTROLLERS[name], "env_kwargs", {})
    return asked if "observe" in asked else {}


def modes(name):
    return (shown(name)["action_mode"],) if shown(name) else ("angle", "rate", "direction")


@pytest.mark.parametrize(
    ("name", "task", "mode"),
    [(name, ID, mode) for name in CONTROLLERS if name not in NOT_OF_TRACTS for mode in modes(name)]
    + [(name, "MagWire/Navigate-v0", "moment") for name in IN_TREES]
    + [(name, "MagWire/Shape-v0", mode) for name in OF_SHAPES for mode in ("angle", "rate")],
)
def test_predict_single_and_batched(name, task, mode):
    settings = shown(name) | {"action_mode": mode}
    env = gym.make(task, **settings)
    observation, _ = env.reset(seed=0)
    action, state = CONTROLLERS[name].from_env(env).predict(observation)
    assert env.action_space.contains(action)
    envs = gym.make_vec(task, num_envs=3, **settings)
    observations, _ = envs.reset(seed=0)
    controller = CONTROLLERS[name].from_env(envs)
    actions, state = controller.predict(observations, episode_start=np.ones(3, dtype=bool))
    assert envs.action_space.contains(actions)
    if name != "Random":
        assert np.allclose(actions[0], action)
    actions, _ = controller.predict(observations, state=state, episode_start=np.zeros(3, dtype=bool))
    assert envs.action_space.contains(actions)


def test_a_controller_refuses_a_foreign_env():
    with pytest.raises(ValueError, match="env must be a MagWire env or batch"):
        MaxForce.from_env(gym.make("Pendulum-v1"))


def test_a_controller_says_which_channel_it_misses():
    env = gym.make(ID, observe=("tip_speed",))
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match="observe must include 'distance_left'"):
        MaxForce.from_env(env).predict(observation)


@pytest.mark.parametrize("policy", [MaxForce, NetForce])
def test_without_the_arc_length_a_controller_reads_the_tip_from_the_way_left(policy):
    seen = ("tip_speed", "magnet", "distance_left")
    usual, other = (
        evaluate(policy.from_env, "MagWire/Steer-v0", 2, observe=names) for names in ((*seen, "tip_arclength"), seen)
    )
    assert usual.success.all()
    assert np.allclose(usual.time, other.time, atol=0.05)
