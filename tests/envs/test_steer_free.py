"""The dragged free wire: who arrives, who does not, and that nothing of the locked wire's theory stands in the way."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.catalogue import CONTROLLERS, PAR, compared_with, has_par
from agents.evaluation import evaluate
from magwire_env.envs.arenas import dragged
from magwire_env.quasistatic.twin import locked_twin
from magwire_env.simulation import Library
from tests.support.free import fed_fork

TASK = "MagWire/SteerFree-v0"


@pytest.mark.parametrize(("name", "longest"), [("MaxForce", 6.7), ("NetForce", 10.0)])
def test_a_magnet_that_follows_drags_the_tip_through(name, longest):
    """MaxForce in about the 5.5 s of docs/physics.md, "What the lock hides", though the magnet starts anywhere."""
    found = evaluate(CONTROLLERS[name].from_env, TASK, episodes=6)
    assert found.success.all()
    assert found.time.min() > 5.0
    assert found.time.max() < longest
    assert not found.unconverged.any()


def test_a_magnet_that_stays_does_not():
    found = evaluate(CONTROLLERS["HoldHome"].from_env, TASK, episodes=4, time_limit=4.0)
    assert not found.success.any()
    assert found.path_ratio.max() < 0.15


def test_the_magnet_moves_at_limited_speed_and_nothing_feeds_the_wire():
    env = gym.make(TASK)
    env.reset(seed=0, options={"magnet_angle": [0.0, 0.0, np.pi]})
    sim = env.unwrapped.core.sim
    assert env.action_space.shape == (3,)
    assert sim.library.scenarios[0].rig.feed is None
    before = sim.magnet[0].copy()
    env.step(np.ones(3, dtype=np.float32))
    assert sim.magnet[0] - before == pytest.approx([0.02, 0.02, 0.1 * np.pi])


def test_it_has_floors_and_a_reference_but_no_par():
    assert not has_par(TASK)
    assert has_par("MagWire/Steer-v1")
    assert has_par("MagWire/Chase-v1")
    assert compared_with(TASK) == ("MaxForce",)
    assert PAR not in compared_with(TASK, floors=True)


def test_the_locked_twin_is_of_wires_that_are_dragged():
    scenario = dragged()
    twin = locked_twin(Library([scenario]))
    assert twin.scenarios == (scenario.replace(model="locked"),)
    assert locked_twin(twin) is twin
    fed = Library([fed_fork()])
    assert locked_twin(fed) is fed
    with pytest.raises(ValueError, match="needs a quasi-static theory along one centreline"):
        CONTROLLERS["MaxForce"].from_env(gym.make("MagWire/Steer-v0", scenario=fed_fork()))


def test_its_page_speaks_of_a_free_wire():
    page = gym.make(TASK).unwrapped.__doc__
    assert "drags it" in page
    assert "locked to the tract's" not in page
