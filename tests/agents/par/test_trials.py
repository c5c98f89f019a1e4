"""Plans tried in the simulator."""

from __future__ import annotations

import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from agents.par.planner import best_plans
from agents.par.refinement import Refinement
from agents.par.trials import Trials
from tests.support.episodes import begun


def test_a_followed_plan_is_the_plan_itself_when_nothing_is_changed():
    starts = begun(n=4)
    trials, rows = Trials(starts), np.arange(4)
    plan = best_plans(starts, Refinement(rounds=0)).actions
    clocked = trials.run(rows, plan)
    followed = trials.run(rows, plan, clocked.tip)
    used = int(clocked.steps.min())
    assert np.array_equal(followed.actions[:, :used], plan[:, :used])
    assert np.array_equal(followed.value, clocked.value)
