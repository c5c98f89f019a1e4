"""Shapes: what is wanted can be had, by the command that is told and by the static rod's inverse."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.catalogue import CONTROLLERS, compared_with, has_par
from agents.evaluation import evaluate
from magwire_env import Scenario, Simulator
from magwire_env.envs.arenas import clamped
from magwire_env.envs.lanes_state import lanes_state, load_lanes
from magwire_env.envs.shapes import off, reachable
from magwire_env.physics import FreeRod
from magwire_env.scenario import Coil, Current, Feed, Rig
from tests.support.free import fed_fork

TASK = "MagWire/Shape-v0"
LENGTH = 0.1


def played(envs, command, steps):
    """Hold commands (n, dof) until every lane has ended once: whether by success, and the last distances, m."""
    core, n = envs.unwrapped.core, envs.num_envs
    over, success, distance = np.zeros(n, bool), np.zeros(n, bool), np.full(n, np.nan)
    for _ in range(steps):
        *_, terminated, truncated, info = envs.step(core.actuation.action(command))
        now = (terminated | truncated) & ~over
        success[now], distance[now] = info["is_success"][now], info["distance"][now]
        over |= now
    assert over.all()
    return success, distance


def test_the_demonstration_makes_the_wanted_shape():
    envs = gym.make_vec(TASK, num_envs=16)
    _, info = envs.reset(seed=0)
    success, distance = played(envs, info["demonstration"], 40)
    assert success.all()
    assert distance.max() < 1e-3 * LENGTH


def test_wanted_shapes_are_those_of_the_static_rod():
    scenario = clamped()
    found = reachable(scenario, 1024)
    assert len(found.commands) > 900
    rod = FreeRod(scenario.wire, scenario.tip)
    for command, nodes in zip(found.commands[:12], found.nodes[:12], strict=True):
        assert off(rod.equilibrium(uniform_field=1e-3 * command), nodes) < 1e-3 * LENGTH


def test_the_inverse_is_within_a_hundredth_of_the_length_and_arrives():
    envs = gym.make_vec(TASK, num_envs=12)
    observation, _ = envs.reset(seed=5)
    solver = CONTROLLERS["InverseShape"].from_env(envs)
    _, (command,) = solver.predict(observation)
    assert solver.residual.max() < 1e-2 * LENGTH
    success, distance = played(envs, command, 40)
    assert success.all()
    assert distance.max() < 1e-2 * LENGTH


@pytest.mark.parametrize(("name", "most"), [("HoldHome", 0.05), ("BestConstant", 0.10), ("Random", 0.10)])
def test_floors_are_low(name, most):
    assert evaluate(CONTROLLERS[name].from_env, TASK, episodes=50).success.mean() <= most


def test_it_is_compared_with_the_inverse_and_has_no_par():
    assert not has_par(TASK)
    assert compared_with(TASK) == ("InverseShape",)


def test_the_way_left_is_the_nodes_distance_and_must_be_held():
    envs = gym.make_vec(TASK, num_envs=3)
    _, info = envs.reset(seed=1)
    core, wanted = envs.unwrapped.core, info["target"]
    steps, over = 0, np.zeros(3, dtype=bool)
    while not over.any():
        *_, over, _, told = envs.step(core.actuation.action(info["demonstration"]))
        distance = np.sqrt(((core.sim.positions - wanted) ** 2).sum(axis=2).mean(axis=1))
        assert told["distance"] == pytest.approx(distance, abs=1e-15)
        steps += 1
    assert steps > 10  # a second within 3 mm, and the way there


def test_a_command_as_target_gives_its_shape():
    env = gym.make(TASK)
    _, info = env.reset(options={"target": [0.0, 20.0, 0.0]})
    rod = FreeRod(clamped().wire, clamped().tip)
    assert off(info["target"], rod.equilibrium(uniform_field=(0.0, 20e-3, 0.0))) < 1e-3 * LENGTH
    assert info["demonstration"].tolist() == [0.0, 20.0, 0.0]
    with pytest.raises(ValueError, match=r"options\['target'\] must lie within the rig's limits"):
        env.reset(options={"target": [0.0, 30.0, 0.0]})
    with pytest.raises(ValueError, match=r"options\['target'\] must be a command of 3 numbers"):
        env.reset(options={"target": [0.0, 1.0]})
    with pytest.raises(ValueError, match="options must be of target, magnet_angle alone"):
        env.reset(options={"tip_arclength": 0.1})


def test_a_batch_goes_on_from_its_state():
    envs, again = (gym.make_vec(TASK, num_envs=3) for _ in range(2))
    envs.reset(seed=2)
    action = np.full((3, 3), 0.3, dtype=np.float32)
    for _ in range(5):
        envs.step(action)
    again.reset(seed=9)
    load_lanes(again.unwrapped, lanes_state(envs.unwrapped))
    assert np.array_equal(again.unwrapped.core.shapes.wanted, envs.unwrapped.core.shapes.wanted)
    for one, other in zip(envs.step(action)[:4], again.step(action)[:4], strict=True):
        assert np.array_equal(one, other)


def test_a_clamp_bears_the_couple_and_no_force_of_a_uniform_field():
    sim, command = Simulator(clamped(), 1), np.array([[0.0, 10.0, 20.0]])
    sim.reset(tip_arclength=LENGTH, magnet=command)
    for _ in range(60):
        sim.step(command)
    couple = np.cross(sim.tip_tangent[0], clamped().tip.moment * 1e-3 * command[0])
    assert sim.base_torque[0] == pytest.approx(-couple, abs=1e-8)
    assert np.linalg.norm(sim.base_force[0]) < 1e-6
    assert np.abs(sim.positions[0, 0]).max() < 1e-12


def test_what_cannot_be_is_refused():
    scenario = clamped()
    assert Scenario.loads(scenario.dumps()) == scenario
    with pytest.raises(ValueError, match=r"Rig\.clamped must be True or False, and False with a Rig\.feed"):
        scenario.replace(rig__feed=Feed(0.03))
    with pytest.raises(ValueError, match=r"Scenario\.rig\.clamped needs a base that can be fed and turned"):
        Simulator(scenario.replace(model="locked"))
    with pytest.raises(ValueError, match=r"scenario\[0\]\.rig\.clamped must be True in the task MagWire/Shape-v0"):
        gym.make(TASK, scenario=fed_fork())
    with pytest.raises(ValueError, match="InverseShape needs a wire that is clamped at the origin along x"):
        CONTROLLERS["InverseShape"].from_env(gym.make("MagWire/Steer-v0"))
    with pytest.raises(
        ValueError, match="observe: 'wanted_points' needs a task that wants a shape, got MagWire/SteerFree-v0"
    ):
        gym.make("MagWire/SteerFree-v0", observe=("wanted_points",))


def test_a_tip_that_comes_behind_the_clamp_ends_the_episode():
    """The task's own coils are too weak for that; these turn the tip right round."""
    coils = tuple(Coil(axis, 1e-3, current=Current(-120.0, 120.0, speed=600.0)) for axis in "xyz")
    scenario = clamped().replace(rig=Rig(coils=coils, clamped=True))
    env = gym.make(TASK, scenario=scenario, action_mode="angle")
    env.reset(seed=0, options={"magnet_angle": [0.0, 0.0, 0.0], "target": [0.0, 20.0, 0.0]})
    sim, ends = env.unwrapped.core.sim, []
    for field in [(0, 1, 0)] * 5 + [(-1, 1, 0)] * 5 + [(-1, 0, 0)] * 5 + [(-1, -1, 0)] * 5:
        _, _, terminated, truncated, info = env.step(np.array(field, dtype=np.float32))
        ends.append(terminated)
        assert terminated == (sim.tip_position[0, 0] < 0.0)
        if terminated:
            break
    assert ends[-1]
    assert not info["is_success"]
    assert not truncated
