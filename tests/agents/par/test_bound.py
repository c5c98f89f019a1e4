"""The bound: nothing beats it, on the whole way and at every place of it."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce, NetForce
from agents.evaluation.evaluator import evaluate
from agents.par.bound import Fastest, least_time
from agents.par.bracket import least_times
from agents.par.planner import best_plans
from agents.par.starts import Starts
from agents.par.trials import Trials
from magwire_env import Scenario
from magwire_env.quasistatic.pool import scenario_pool
from tests.support.episodes import QUICK, begun


@pytest.mark.parametrize("scenario", ["paper", "soft", "any"])
def test_the_bound_is_below_every_policy_random_and_good(scenario):
    made = {
        "paper": [Scenario.paper()] * 12,
        "soft": [Scenario.paper().replace(wire__bending_modulus=55e3, contact__friction=0.0)] * 12,
        "any": list(scenario_pool("SteerAny", "test", 12)),
    }[scenario]
    starts = begun(n=12, scenario=made)
    least = least_times(starts)
    assert (least > 0.5).all()
    rng, trials, rows = np.random.default_rng(0), Trials(starts), np.arange(12)
    plans = best_plans(starts, QUICK).actions
    for size in (0.0, 0.01, 0.02, 0.04, 0.06, 0.1, 0.2, 0.3):
        noise = np.repeat(rng.normal(size=(12, starts.step_limit // 10, 1)), 10, axis=1)
        tried = plans.copy()
        tried[:, : noise.shape[1]] += (size * noise).astype(np.float32)
        assert (trials.run(rows, np.clip(tried, -1.0, 1.0)).value > least).all()


def test_on_the_way_the_tip_is_never_ahead_of_the_bound():
    """Every place passed is a goal of its own, from random angles under random commands and good ones."""
    scenario = Scenario.paper()
    starts = begun(n=12, scenario=scenario)
    fastest, trials, rows = Fastest(scenario), Trials(starts), np.arange(12)
    hold = np.random.default_rng(1).uniform(-1, 1, (12, 8, 1)).astype(np.float32).repeat(10, axis=1)
    for actions in (hold, best_plans(starts, QUICK).actions[:, :80]):
        tip = np.column_stack([trials.run(rows, actions[:, : k + 1]).tip[:, -1] for k in range(0, 80, 8)])
        for i in rows:
            ahead = np.maximum.accumulate(tip[i])
            for k in np.flatnonzero((np.diff(ahead) > 1e-3) & (ahead[1:] < 0.79)) + 1:
                time = 8 * k * starts.period
                assert fastest.least(float(starts.tip[i]), float(ahead[k]), float(starts.magnet[i, 0])) < time


def test_the_bound_grows_with_the_way_and_knows_the_magnets_angle():
    fastest = Fastest(Scenario.paper())
    times = [fastest.least(0.1, goal) for goal in (0.2, 0.4, 0.6, 0.79)]
    assert (np.diff(times) > 0.5).all()
    best = float(fastest.commands[100, 0])
    assert fastest.least(0.1, 0.79, best) == pytest.approx(times[-1], abs=0.02)
    assert fastest.least(0.1, 0.79, best + math.pi) > times[-1] + 0.3
    assert least_time(Scenario.paper(), 0.7, 0.3, direction=-1) > 1.0


def test_bad_ways_are_named():
    for arguments, name in (
        ((0.1, 0.05), "goal"),
        ((-0.1, 0.5), "start"),
        ((0.1, 5.0), "goal"),
        ((0.1, 0.7, 2), "direc"),
    ):
        with pytest.raises(ValueError, match=name):
            least_time(Scenario.paper(), *arguments)


def test_no_ride_is_faster_than_the_bound_on_random_marginal_scenarios():
    """Friction up to where the certificate says "blocked": smoothed friction still lets the tip creep on."""
    rng = np.random.default_rng(4)
    scenarios = [Scenario.paper().replace(contact__friction=mu) for mu in rng.uniform(0.12, 0.2, 8)]
    envs = gym.make_vec("MagWire/Steer-v0", num_envs=8, scenario=scenarios, time_limit=120.0)
    envs.reset(seed=3)
    starts = Starts.of(envs.unwrapped.core, np.arange(8))
    least = least_times(starts)
    assert np.isfinite(least).all()
    for policy in (NetForce, MaxForce):
        found = evaluate(policy.from_env, "MagWire/Steer-v0", 8, seed=3, env=envs)
        assert (found.time[found.success] >= least[found.success]).all()
