"""Plans are judged by the env's own rules: what the env says of an episode is what the verdict says."""

from __future__ import annotations

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

from agents.controllers import MPPI, PD, ConstantRotation, Controller, MaxForce, Random
from agents.evaluation.episodes import EVALUATION_SEED, episodes
from agents.par.env_rules import verdict
from agents.par.starts import Starts
from agents.par.trials import Trials
from magwire_env.envs.task import TASKS
from magwire_env.quasistatic.certificate import GOAL_MARGIN, START_SPREAD

N = 6


@pytest.mark.parametrize(
    ("task", "policy", "limit"),
    [
        ("Steer", MaxForce, 30.0),
        ("Steer", Random, 4.0),
        ("Reach", PD, 30.0),
        ("Reach", ConstantRotation, 6.0),
        ("Track", MPPI, 3.0),
    ],
)
def test_a_recorded_episode_is_judged_as_the_env_judged_it(task: str, policy: type[Controller], limit: float) -> None:
    env = gym.make_vec(f"MagWire/{task}-v0", num_envs=N, time_limit=limit)
    core = env.unwrapped.core
    observation, _ = env.reset(seed=EVALUATION_SEED)
    starts, traces = Starts.of(core, np.arange(N)), []
    success, found = np.zeros(N, dtype=bool), {key: np.zeros(N) for key in ("steps", "time", "rms_error")}
    for step in episodes(env, policy.from_env(env), observation):
        traces.append(core.goal - core.sim.trace[:, :N])
        for key in found:
            if step.ended.any() and key in step.info["summary"]:
                found[key][step.ended] = step.info["summary"][key][step.ended]
        if step.ended.any():
            success[step.ended] = step.info["is_success"][step.ended]
    said = verdict(starts.task, np.array(traces), starts.goal, starts.reference, starts.step_limit, starts.period)
    assert np.array_equal(said.success, success)
    assert np.array_equal(said.steps, found["steps"])
    assert said.time == pytest.approx(found["time"], rel=1e-12)
    if task == "Track":
        assert said.rms_error == pytest.approx(found["rms_error"], rel=1e-12)


@pytest.mark.parametrize("hold", [0.04, 0.05, 0.06, 0.1, 0.149, 0.151, 0.3, 1.0, 1.04, 1.06])
@pytest.mark.parametrize("period", [0.05, 0.1, 0.07])
def test_a_target_counts_after_as_many_periods_as_the_task_says(hold: float, period: float) -> None:
    task = dataclasses.replace(TASKS["MagWire/Reach-v0"], hold=hold)
    trace = np.full((60, 3, 1), 0.5)
    said = verdict(task, trace, np.array([0.5]), np.zeros((1, 0)), 60, period)
    assert said.success[0]
    assert said.steps[0] == task.hold_periods(period)


def test_leaving_the_tract_backwards_ends_an_episode() -> None:
    task = TASKS["MagWire/Steer-v0"]
    trace = np.linspace(0.1, -0.1, 20 * 3).reshape(20, 3)[:, :, None] * np.ones(2)
    trace[:, :, 1] = 0.4
    said = verdict(task, trace, np.full(2, 0.79), np.zeros((2, 0)), 300, 0.1)
    assert not said.success.any()
    assert said.steps.tolist() == [int(np.argmax(trace[:, -1, 0] < 0.0)) + 1, 20]
    assert said.alive[:, 0].sum() == said.steps[0] - 1
    assert said.alive[:, 1].all()
    assert np.isnan(said.time[1])


@pytest.mark.parametrize("ends", ["in success", "backwards"])
def test_what_a_wire_does_after_its_episode_counts_for_nothing(ends: str) -> None:
    task = TASKS["MagWire/Steer-v0"]
    trace = np.linspace(0.1, 0.9 if ends == "in success" else -0.1, 20 * 3).reshape(20, 3)[:, :, None].copy()
    said = verdict(task, trace, np.array([0.79]), np.zeros((1, 0)), 300, 0.1)
    assert said.steps[0] < 19
    trace[19] = -1690.0
    again = verdict(task, trace, np.array([0.79]), np.zeros((1, 0)), 300, 0.1)
    assert said.success == again.success == (ends == "in success")
    assert np.array_equal(said.time, again.time, equal_nan=True)
    assert (said.steps, said.least) == (again.steps, again.least)
    trace[2] = -1690.0
    with pytest.raises(RuntimeError, match="the wire of plan 0 has diverged: its tip is at -1690"):
        verdict(task, trace, np.array([0.79]), np.zeros((1, 0)), 300, 0.1)


def test_an_action_that_is_no_number_is_refused() -> None:
    env = gym.make_vec("MagWire/Steer-v0", num_envs=2)
    env.reset(seed=0)
    starts = Starts.of(env.unwrapped.core, np.arange(2))
    trials = Trials(starts)
    sim = trials.lanes(np.arange(2))
    with pytest.raises(ValueError, match=r"action\[1\] must be numbers in \[-1, 1\], got \[nan\]"):
        trials.act(sim, np.array([[0.0], [np.nan]]))


def test_tasks_and_certificates_start_and_end_alike() -> None:
    for task in TASKS.values():
        assert task.start_spread == START_SPREAD
        assert task.goal_margin == GOAL_MARGIN or (task.kind.returns and task.goal_margin > GOAL_MARGIN)
