"""Steer-v1: the tip goes in, turns, and comes back out; nothing passes it by holding still."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from agents.controllers import MaxForce, NetForce
from agents.evaluation.evaluator import evaluate
from agents.par.bracket import least_times
from agents.par.env_rules import verdict
from agents.par.held import BestConstantEach, HoldHome
from agents.par.starts import Starts
from magwire_env.envs.kernels import EPISODE
from magwire_env.envs.task import TASKS
from magwire_env.quasistatic import certificate
from magwire_env.quasistatic.held import held_commands

ID = "MagWire/Steer-v1"
N = 4


@pytest.fixture(scope="module")
def ridden():
    """One batch of MaxForce, step by step: infos, tips, goals, observed ways left, traces; and the starts."""
    env = gym.make_vec(ID, num_envs=N, autoreset_mode="Disabled")
    core, policy = env.unwrapped.core, MaxForce.from_env(env)
    observation, _ = env.reset(seed=5)
    starts, rows, over = Starts.of(core, np.arange(N)), [], np.zeros(N, dtype=bool)
    summary = {key: np.full(N, np.nan) for key in ("time", "time_in", "time_back", "steps")}
    reward = np.zeros(N)
    while not over.all():
        action, _ = policy.predict(observation)
        before = core.goal.copy()
        values = core.step(action)
        observation = core.observe()
        rows.append((core.sim.tip_arclength, before, core.goal.copy(), observation[:, core.observer.part("distance_left")][:, 0], before - core.sim.trace[:, :N], values[3]["distance"].copy()))  # fmt: skip # noqa: E501
        ended = (values[1] | values[2]) & ~over
        reward += np.where(over, 0.0, values[3]["reward/progress"])
        if ended.any():
            lanes = np.flatnonzero(ended)
            found = core.summary(lanes)
            for key, array in summary.items():
                array[lanes] = found[key][lanes]
            assert values[3]["is_success"][lanes].all()
        over |= ended
    return rows, starts, summary, reward


def test_the_goal_turns_when_the_tip_has_passed_it(ridden):
    rows, starts, _, _ = ridden
    tip, before, after, left, trace, _ = (np.array(part) for part in zip(*rows, strict=True))
    assert np.allclose(starts.goal, 0.71)
    assert np.allclose(starts.final, 0.15)
    turned = (before != after).argmax(axis=0)
    for lane in range(N):
        k = turned[lane]
        assert before[: k + 1, lane] == pytest.approx(0.71)
        assert after[k:, lane] == pytest.approx(0.15)
        assert trace[k, :, lane].max() >= 0.71
        assert trace[:k, :, lane].max() < 0.71
    assert left == pytest.approx((after - tip) / 0.8, abs=1e-6)  # negative on the way back


def test_both_legs_stand_in_the_summary(ridden):
    rows, _, summary, reward = ridden
    assert summary["time"] == pytest.approx(summary["time_in"] + summary["time_back"])
    assert (summary["time_in"] > 5.0).all()
    assert (summary["time_back"] > 3.0).all()
    assert (np.ceil(summary["time"] / 0.1) == summary["steps"]).all()
    assert reward == pytest.approx(np.full(N, 10.0))  # the whole way, in and back
    left = np.array([row[5] for row in rows])
    assert left[0] == pytest.approx(0.71 - 0.1 + 0.56, abs=0.03)


def test_plans_are_judged_as_the_env_judges_them(ridden):
    rows, starts, summary, _ = ridden
    trace = np.array([row[4] for row in rows])
    said = verdict(starts.task, trace, starts.goal, starts.reference, starts.step_limit, starts.period, starts.final)
    assert said.success.all()
    assert said.time == pytest.approx(summary["time"], rel=1e-9)
    assert (least_times(starts) < summary["time"]).all()


def test_a_leg_that_was_not_finished_has_no_time():
    env = gym.make(ID, time_limit=0.3)
    env.reset(seed=0)
    for _ in range(3):
        *_, truncated, info = env.step(np.float32([1.0, 0.0]))
    assert truncated
    assert np.isnan([info["summary"]["time_in"], info["summary"]["time_back"]]).all()


def test_a_tip_that_turns_in_the_last_period_has_finished_one_leg():
    env = gym.make(ID)
    core = env.unwrapped.core
    env.reset(seed=0, options={"tip_arclength": 0.69, "magnet_angle": 3.2})
    core.step_limit = 1000
    action = np.float32([1.0, 0.0])  # home
    for _ in range(100):
        env.step(action)
        if core.episodes.lanes[EPISODE.sense, 0] < 0:
            break
    found = core.summary(np.array([0]))
    assert found["time_in"][0] > 0
    assert np.isnan(found["time_back"][0])
    assert found["time"][0] == pytest.approx(0.1 * core.steps[0])


def test_the_way_is_certified_both_ways_and_controllers_ride_it():
    task = TASKS[ID]
    scenario = task.scenario()
    for direction, goal in task.kind.ways(task, scenario):
        assert certificate(scenario, direction, goal=goal, time_limit=task.time_limit).solvable
    for policy in (MaxForce, NetForce):
        assert evaluate(policy.from_env, ID, 8).success.all()


def test_no_held_command_comes_back():
    env = gym.make_vec(ID, num_envs=3)
    assert held_commands(env.unwrapped.core.sim.library.is_turn).shape == (32, 1)
    assert not evaluate(BestConstantEach.from_env, ID, 3).success.any()
    assert not evaluate(HoldHome.from_env, ID, 3).success.any()
    with pytest.raises(ValueError, match="alone in the task MagWire/Steer-v1, which fixes the rest"):
        env.reset(options={"target": 0.5})


def test_held_commands_do_pass_the_first_version():
    found = evaluate(HoldHome.from_env, "MagWire/Steer-v0", 8)
    assert found.success.all()
    assert (evaluate(BestConstantEach.from_env, "MagWire/Steer-v0", 8).time <= found.time + 1e-9).all()
