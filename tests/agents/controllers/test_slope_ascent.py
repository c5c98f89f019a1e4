"""Gradient ascent on the drive ahead: where it turns the magnets, how far it gets, and which envs it refuses."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import SlopeAscent
from agents.evaluation.evaluator import evaluate
from magwire_env.quasistatic.pool import scenario_pool

SETTINGS = SlopeAscent.env_kwargs


@pytest.mark.parametrize("kind", ["Orient", "Dual"])
def test_it_crosses_nine_tracts_in_ten_that_it_turns_two_axes_on(kind):
    some = list(scenario_pool(kind, "test", 10))
    played = evaluate(SlopeAscent.from_env, f"MagWire/{kind}-v1", 10, scenario=some, **SETTINGS)
    assert played.success.mean() >= 0.9


def test_it_turns_the_way_in_which_the_drive_grows():
    envs = gym.make_vec("MagWire/Orient-v1", num_envs=8, scenario=scenario_pool("Orient", "test", 10)[0], **SETTINGS)
    controller, core = SlopeAscent.from_env(envs), envs.unwrapped.core
    observation, _ = envs.reset(seed=0)  # the tips are at rest
    action, _ = controller.predict(observation)
    here = controller.seen(observation, "drive_preview").reshape(8, 6, 3)[:, 0]
    wanted = 2.5 * here[:, 1:] / (np.linalg.norm(here, axis=1, keepdims=True) + 0.05)
    assert np.allclose(action, np.clip(wanted, -1.0, 1.0), atol=1e-6)
    state = core.sim.state()
    core.sim.load_state(state.replaced(magnet=state.magnet + 1e-3 * action))
    assert (controller.seen(core.observer.read(), "drive_preview")[:, 0] > here[:, 0]).all()


def test_it_looks_where_the_tip_will_be():
    env = gym.make("MagWire/Steer-v0", **SETTINGS)
    controller = SlopeAscent.from_env(env, lead=0.25)
    here, ahead = [0.2, 0.1], [0.4, -0.1]
    still = np.array([here, ahead, ahead, ahead, ahead, ahead, [0.0, 0.0]], dtype=np.float32).ravel()[:13]
    moving = still.copy()
    moving[12] = 0.2  # 20 mm/s, so 5 mm on, half way to the second place
    for seen, there in ((still, here), (moving, [0.3, 0.0])):
        wanted = 2.5 * there[1] / (np.linalg.norm(there) + 0.05)
        assert controller.predict(seen)[0] == pytest.approx([wanted], abs=1e-6)


@pytest.mark.parametrize("task", ["MagWire/Reach-v1", "MagWire/Track-v1", "MagWire/Steer-v1"])
def test_it_needs_a_goal_that_is_passed_once(task):
    env = gym.make(task, **SETTINGS)
    with pytest.raises(ValueError, match=rf"SlopeAscent needs a goal ahead that is to be passed, which {task} has not"):
        SlopeAscent.from_env(env)


def test_bad_arguments_are_named():
    env = gym.make("MagWire/Steer-v0", **SETTINGS)
    for name, value, words in (("gain", 0.0, "greater than 0"), ("lead", -1.0, "at least 0")):
        with pytest.raises(ValueError, match=f"{name} must be {words}"):
            SlopeAscent.from_env(env, **{name: value})
    with pytest.raises(ValueError, match="action_mode must be one of 'rate', got 'angle'"):
        SlopeAscent.from_env(gym.make("MagWire/Steer-v0", observe=["drive_preview"]))
    with pytest.raises(ValueError, match="observe must include 'drive_preview' here"):
        SlopeAscent.from_env(gym.make("MagWire/Steer-v0", action_mode="rate")).predict(np.zeros(7, dtype=np.float32))
