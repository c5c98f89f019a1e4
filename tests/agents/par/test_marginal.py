"""The search for counterexamples to the bound."""

import numpy as np
import pytest

from agents.par.marginal import Marginal, compare, marginal_scenarios
from magwire_env.quasistatic.certificate import certify


def test_marginal_scenarios_have_the_margin_that_was_drawn():
    scenarios, margin = marginal_scenarios(4, seed=2)
    again = [c.weakest[1] for c in certify(scenarios, start=0.1)]
    assert again == pytest.approx(margin, abs=1e-12)
    assert (margin > -460e-6).all()
    assert (margin < 210e-6).all()


def test_rides_of_marginal_scenarios_are_no_faster_than_the_bound():
    scenarios, margin = marginal_scenarios(3, seed=3)
    found = compare(scenarios, margin)
    assert np.isfinite(found.time).any()
    assert np.isfinite(found.bound).all()
    assert not found.below.any()


def test_a_ride_below_its_bound_is_a_counterexample():
    found = Marginal(np.zeros(3), np.zeros(3), np.array([5.0, 5.0, 5.0]), np.array([4.9, 5.1, np.nan]))
    assert found.below.tolist() == [True, False, False]
