"""First plans: of controllers and of dynamic programming."""

from __future__ import annotations

import numpy as np
import pytest

from agents.controllers import MaxForce, NetForce
from agents.evaluation.evaluator import evaluate
from agents.par.seeds import by_controller, by_dynamic_programming
from agents.par.trials import Trials
from magwire_env import Scenario
from magwire_env.scenario import Reading
from tests.support.episodes import begun

STEER, REACH = "MagWire/Steer-v0", "MagWire/Reach-v0"


def test_a_controllers_plan_takes_the_controllers_own_time():
    starts = begun(STEER, 4)
    for policy in (MaxForce, NetForce):
        found = Trials(starts).run(np.arange(4), by_controller(starts, policy.from_env))
        assert np.array_equal(found.time, evaluate(policy.from_env, STEER, 4).time)


def test_a_controllers_plan_is_made_under_true_readings():
    noisy = Scenario.paper().replace(sensing__force=Reading(noise=5e-3), sensing__delay=3)
    plans = [by_controller(begun(STEER, 2, scenario=sc), NetForce.from_env) for sc in (noisy, Scenario.paper())]
    assert np.array_equal(*plans)


@pytest.mark.parametrize(("task", "limit"), [(STEER, 1.02), (REACH, 1.3)])
def test_dynamic_programming_arrives_about_as_fast_as_the_best_controllers(task, limit):
    starts = begun(task, 6)
    found = Trials(starts).run(np.arange(6), by_dynamic_programming(Trials(starts)))
    assert np.isfinite(found.time).all()
    if task == STEER:
        assert (found.time < limit * evaluate(NetForce.from_env, STEER, 6).time).all()
