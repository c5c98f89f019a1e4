"""The seam: a wire model of the test's own runs the task, the observation and a picture, and theory refuses it."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce
from magwire_env import Scenario, Simulator
from magwire_env.quasistatic import certificate, force_map
from magwire_env.simulation import register_model
from magwire_env.simulation.model import _MODELS, model_names
from tests.support.bead import Bead


@pytest.fixture(autouse=True)
def _bead():
    register_model("bead", Bead)
    yield
    del _MODELS["bead"]


def bead_scenario() -> Scenario:
    return Scenario.paper().replace(name="beads", model="bead")


def test_a_model_from_outside_steers_is_seen_and_finishes():
    env = gym.make("MagWire/Steer-v0", scenario=bead_scenario())
    observation, _ = env.reset(seed=0, options={"tip_arclength": 0.70, "magnet_angle": 4.0})
    assert env.observation_space.contains(observation)
    assert observation[0] == pytest.approx(0.70 / 0.80, abs=1e-6)
    assert observation[6] == pytest.approx(0.09 / 0.80, abs=1e-6)
    terminated = False
    for _ in range(60):
        sim = env.unwrapped.simulator
        tries = sim.rollout(sim.state(), np.linspace(1.5, 4.7, 12)[:, None, None] * np.ones((12, 3, 1)))
        best = np.linspace(1.5, 4.7, 12)[tries.remaining[:, -1].argmin()]
        action = env.unwrapped.core.actuation.action(np.array([[best]]))[0]
        _, _, terminated, _, info = env.step(action)
        if terminated:
            break
    assert terminated
    assert info["is_success"]
    assert 0 < info["summary"]["time"] < 6.0
    assert info["summary"]["unconverged"] == 0


def test_batch_and_single_env_agree_and_a_state_is_put_back():
    scenario = bead_scenario()
    env, envs = gym.make("MagWire/Steer-v0", scenario=scenario), gym.make_vec("MagWire/Steer-v0", 2, scenario=scenario)
    first, firsts = env.reset(seed=3)[0], envs.reset(seed=3)[0]
    assert np.array_equal(first, firsts[0])
    actions = np.array([[0.3], [-0.2]], dtype=np.float32)
    state = envs.unwrapped.simulator.state()
    then, thens = env.step(actions[0])[0], envs.step(actions)[0]
    assert np.array_equal(then, thens[0])
    envs.unwrapped.simulator.load_state(state)
    assert np.array_equal(envs.step(actions)[0], thens)
    assert state.part("place").shape == (2, 1)
    with pytest.raises(ValueError, match="state must be of a wire model with 'arclengths', got one with place"):
        _ = state.arclengths


def test_a_picture_shows_it():
    env = gym.make("MagWire/Steer-v0", scenario=bead_scenario(), render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.shape == (480, 640, 3)
    assert frame.std() > 5


def test_what_needs_the_locked_wire_refuses_others_by_name():
    env = gym.make("MagWire/Steer-v0", scenario=bead_scenario())
    for build in (
        lambda: MaxForce.from_env(env),
        lambda: force_map(bead_scenario(), np.zeros(2), np.zeros(2)),
        lambda: gym.make("MagWire/Steer-v0", scenario=bead_scenario(), observe=("drive_preview",)),
        lambda: certificate(bead_scenario()),
    ):
        with pytest.raises(ValueError, match=r"Scenario\.model must be one that has it, got 'bead'"):
            build()


def test_a_name_that_is_not_registered_is_refused():
    with pytest.raises(ValueError, match=r"Scenario\.model must be one of 'locked'.*got 'noodle'"):
        Simulator(Scenario.paper().replace(model="noodle"))
    with pytest.raises(ValueError, match="name must be of a model that does not exist yet, got 'locked'"):
        register_model("locked", Bead)
    assert "bead" in model_names()
