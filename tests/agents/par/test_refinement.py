"""Refinement improves plans, and gives the same twice."""

from __future__ import annotations

import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import NetForce
from agents.par.refinement import Refinement, refine
from agents.par.seeds import by_controller
from agents.par.trials import Trials
from magwire_env.quasistatic.pool import scenario_pool
from tests.support.episodes import begun


def test_refinement_never_worsens_and_repeats_itself():
    starts = begun("MagWire/Chase-v0", 3, scenario=list(scenario_pool("Chase", "test", 3)))
    plans, trials = by_controller(starts, NetForce.from_env), Trials(starts)
    plain = trials.run(np.arange(3), plans).value
    (better, value), again = (refine(trials, plans, Refinement(samples=8, rounds=12)) for _ in range(2))
    assert (value <= plain).all()
    assert value.mean() < 0.95 * plain.mean()
    assert np.array_equal(better, again[0])
    assert np.array_equal(trials.run(np.arange(3), better).value, value)
