"""Controllers of fed wires: what they answer, whom they refuse, and that steering decides the task."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.catalogue import CONTROLLERS, IN_TREES, compared_with
from agents.controllers import FollowRoute, Forward, Hold, RecoverRoute

TASK = "MagWire/Navigate-v0"


@pytest.fixture(scope="module")
def envs():
    return gym.make_vec(TASK, num_envs=4, autoreset_mode="Disabled")


def test_the_field_of_the_moment_asked_for_points_along_the_way_seen(envs):
    observation, _ = envs.reset(seed=0, options={"target": "RCCA", "start": ("BCT", 0.04)})
    controller = FollowRoute(envs, gain=0.0, look=0.02)
    moment = controller.directions(observation)
    sim = envs.unwrapped.simulator
    r = sim.tip_position - sim.magnet_positions[:, 0]
    r /= np.linalg.norm(r, axis=1, keepdims=True)
    field = 3 * (moment * r).sum(axis=1, keepdims=True) * r - moment
    way = sim.ahead(np.array([0.02]))[0][:, 0] - sim.tip_position
    cosine = (field * way).sum(axis=1) / np.linalg.norm(field, axis=1) / np.linalg.norm(way, axis=1)
    assert cosine == pytest.approx(np.ones(4), abs=1e-4)


def test_it_feeds_less_the_harder_the_wire_presses(envs):
    observation, _ = envs.reset(seed=0)
    controller = FollowRoute(envs, press=0.2)
    contact = controller.core.observer.part("contact")
    pressed = np.repeat(observation[:1], 4, axis=0)
    pressed[:, contact] = np.array([[0.0, 0.0], [1.0, 1.5], [1.0, 2.0], [1.0, 4.0]])  # 0.1 N
    assert controller.feed(pressed) == pytest.approx([1.0, 0.5, 0.0, -1.0])


def test_it_feeds_slowly_while_the_tip_points_neither_to_the_route_nor_along_it(envs):
    observation, _ = envs.reset(seed=0, options={"target": "aorta"})
    controller = FollowRoute(envs, slowest=0.2)
    tangent, route = (controller.core.observer.part(name) for name in ("tip_tangent", "route_from_magnet"))
    seen = np.repeat(observation[:1], 4, axis=0)
    along = seen[0, route][-3:]  # of the route where it steers for
    across = np.cross(along, [0.0, 0.0, 1.0])
    away = seen[:, controller.core.observer.part("magnet_pose")][:, 3:]
    point = seen[:, route].copy()
    point[:, 9:12] = -away + 0.1 * across / np.linalg.norm(across)  # the point lies abeam
    seen[:, route] = point
    seen[:, tangent] = np.array([along, across / np.linalg.norm(across), -along, -across])
    assert controller.feed(seen) == pytest.approx([1.0, 1.0, 0.2, 0.2], abs=1e-5)


def test_following_the_route_enters_the_branch_that_is_asked_for_and_no_other(envs):
    ways = ["LSA", "LCCA", "RSA", "RCCA"]
    observation, _ = envs.reset(seed=1, options={"target": ways})
    controller, core = FollowRoute(envs), envs.unwrapped.core
    entered: list[set[str]] = [set() for _ in ways]
    for _ in range(80):
        _, _, _, info = core.step(controller.predict(observation)[0])
        observation = core.observe()
        for lane, name in enumerate(info["branch"]):
            entered[lane].add(name)
    assert entered == [{"aorta", "LSA"}, {"aorta", "LCCA"}, {"aorta", "BCT", "RSA"}, {"aorta", "BCT", "RCCA"}]


def test_recovery_pulls_back_from_a_wrong_branch_and_a_little_longer(envs):
    observation, _ = envs.reset(seed=0)
    controller = RecoverRoute(envs, back=2)
    astray = controller.core.observer.part("astray")
    state, pulled = None, []
    for where in (0.0, 0.3, 0.0, 0.0, 0.0):
        seen = observation.copy()
        seen[:, astray] = where
        action, state = controller.predict(seen, state)
        pulled.append(bool((action[:, 3] == -1.0).all()))
    assert pulled == [False, True, True, False, False]


def test_floors_see_nothing(envs):
    observation, _ = envs.reset(seed=0)
    assert (Hold(envs).predict(observation)[0] == 0.0).all()
    assert (Forward(envs).predict(observation)[0] == [0.0, 0.0, 0.0, 1.0]).all()
    assert (Forward(envs, moment=(0, 1, 0)).predict(observation)[0] == [0.0, 1.0, 0.0, 1.0]).all()


def test_they_refuse_a_wire_that_is_dragged():
    steer = gym.make("MagWire/Steer-v0")
    for controller in (FollowRoute, Hold):
        with pytest.raises(ValueError, match=r"needs a wire that is fed|action_mode"):
            controller(steer)


def test_policies_are_compared_with_controllers_of_their_own_task():
    assert compared_with(TASK) == IN_TREES
    assert set(IN_TREES) <= set(CONTROLLERS)
    assert compared_with("MagWire/Steer-v0") == ("MaxForce", "Optimal")
    assert compared_with("MagWire/Steer-v0", par=False) == ("MaxForce",)
