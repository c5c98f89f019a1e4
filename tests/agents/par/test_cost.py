"""The planner's cost of a plan."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.par.cost import FAILED, judged
from tests.support.episodes import begun


def test_a_target_held_too_short_or_beyond_the_time_does_not_count():
    starts = begun("MagWire/Reach-v0", 1)
    goal, width = float(starts.goal[0]), starts.task.tolerance
    trace = np.full((60, 3, 1), goal + 4 * width)
    trace[20:29] = goal
    value, time, _ = judged(starts, trace)
    assert value[0] >= FAILED
    assert np.isnan(time[0])
    trace[29] = goal
    value, time, steps = judged(starts, trace)
    assert (time[0], steps[0]) == (pytest.approx(3.0), 30)
    assert 2.9 <= value[0] <= 3.0
    short = dataclasses.replace(starts, step_limit=29)
    assert judged(short, trace)[0][0] >= FAILED


def test_a_wire_that_diverges_after_its_episode_costs_what_the_episode_did():
    starts = begun("MagWire/Reach-v0", 1)
    trace = np.full((60, 3, 1), float(starts.goal[0]) + 4 * starts.task.tolerance)
    trace[30:] = -0.01  # outside of the tract, which ends the episode
    value, time, steps = judged(starts, trace)
    trace[40:] = np.nan
    again, later, same = judged(starts, trace)
    assert FAILED <= value[0] == again[0]
    assert np.isnan(time[0])
    assert np.isnan(later[0])
    assert steps == same
