"""NetForce does what certificates promise: certified wires arrive, refused ones stop where they are said to."""

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce, NetForce
from agents.evaluation.certified import main, ride, ride_certified, ride_refused, sorted_candidates, stops_near
from magwire_env import Scenario
from magwire_env.quasistatic import certificate

STEER = "MagWire/Steer-v0"


@pytest.fixture(scope="module")
def found():
    return sorted_candidates("SteerAny", 24, 12, seed=3)


def test_every_certified_wire_arrives_about_when_the_certificate_says(found):
    result = ride_certified(NetForce.from_env, "SteerAny", found["certified"])
    assert result.success.all()
    ratio = result.time / [c.traverse_time for _, c in found["certified"]]
    assert 0.6 < np.median(ratio) < 1.2


def test_refused_wires_stop_at_the_first_blocked_place(found):
    result = ride_refused(NetForce.from_env, "SteerAny", found["refused"])
    assert stops_near(result, found["refused"]).mean() >= 0.9


@pytest.mark.parametrize("kind", ["Orient", "Chase", "Dual"])
def test_certified_wires_arrive_under_the_other_rigs(kind):
    some = sorted_candidates(kind, 8, 0, seed=3)["certified"]
    assert ride_certified(NetForce.from_env, kind, some).success.all()


def test_single_and_batched_agree():
    env, envs = gym.make(STEER), gym.make_vec(STEER, num_envs=3)
    one, many = NetForce.from_env(env), NetForce.from_env(envs)
    observation, _ = env.reset(seed=5)
    observations, _ = envs.reset(seed=5)
    state = states = None
    for _ in range(30):
        action, state = one.predict(observation, state)
        actions, states = many.predict(observations, states)
        assert action == pytest.approx(actions[0], abs=1e-6)
        observation = env.step(action)[0]
        observations = envs.step(actions)[0]


def test_memory_starts_afresh_with_an_episode():
    envs = gym.make_vec(STEER, num_envs=2)
    controller = NetForce.from_env(envs)
    observations, _ = envs.reset(seed=0)
    first, _ = controller.predict(observations, episode_start=np.ones(2, dtype=bool))
    far = (np.array([300.0, 300.0]), np.array([True, True]))
    again, _ = controller.predict(observations, far, np.array([True, False]))
    assert again[0] == pytest.approx(first[0])
    assert abs(again[1, 0] - first[1, 0]) > 0.05


def test_it_crosses_the_papers_tract_as_fast_as_the_papers_policy_and_backwards_too():
    paper = Scenario.paper()
    net, most = (ride(c.from_env, "Steer", [paper] * 8) for c in (NetForce, MaxForce))
    assert net.success.all()
    assert np.median(net.time) < 1.03 * np.median(most.time)
    env = gym.make_vec(STEER, num_envs=2, scenario=paper)
    back = NetForce.from_env(env, direction=-1)
    observation, _ = env.reset(seed=0, options={"tip_arclength": 0.75, "magnet_angle": 3.0})
    state, sim = None, env.unwrapped.core.sim
    needed = certificate(paper, -1, start=0.75, goal=0.3).traverse_time
    for _ in range(int(1.5 * needed / sim.control_period)):
        action, state = back.predict(observation, state)
        observation = env.step(action)[0]
    assert (sim.tip_arclength < 0.3).all()


def test_the_command_prints_the_promise(capsys):
    main(["--certified", "2", "--refused", "1"])
    printed = capsys.readouterr().out
    assert "NetForce: 2 of 2 certified finish" in printed
    assert "MaxForce" in printed
