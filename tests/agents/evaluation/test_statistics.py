"""Statistics against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import trim_mean

from agents.evaluation.statistics import (
    interquartile_mean,
    interval,
    mean,
    median,
    performance_profile,
    stratified_bootstrap,
)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 11, 40])
def test_the_interquartile_mean_is_scipys_trimmed_mean(n):
    values = np.random.default_rng(n).standard_normal((3, n))
    assert interquartile_mean(values) == pytest.approx(trim_mean(values, 0.25, axis=1), abs=1e-12)


def test_the_interquartile_mean_of_known_numbers():
    assert interquartile_mean(np.array([100.0, 3.0, 1.0, 2.0, -50.0, 4.0, 0.0, 5.0])) == 2.5


def test_the_bootstrap_interval_covers_the_true_value_as_often_as_it_says():
    rng = np.random.default_rng(0)
    hits = 0
    for i in range(300):
        groups = [rng.normal(centre, 1.0, 30) for centre in (0.0, 3.0)]
        _, low, high = stratified_bootstrap(groups, lambda x: x.mean(axis=-1), resamples=300, seed=i)
        hits += low <= 1.5 <= high
    # 95 % less the bootstrap's known shortfall of √(29/30) in width; three standard errors of 300 trials to each side.
    assert 0.90 < hits / 300 < 0.985


def test_strata_are_resampled_within_themselves():
    groups = [np.zeros(5), np.ones(15)]
    assert stratified_bootstrap(groups, lambda x: x.mean(axis=-1)) == (0.75, 0.75, 0.75)
    value, low, high = stratified_bootstrap([np.concatenate(groups)], lambda x: x.mean(axis=-1))
    assert low < value < high


def test_the_bootstraps_width_is_that_of_the_mean():
    values = np.random.default_rng(3).standard_normal(400)
    _, low, high = stratified_bootstrap([values], lambda x: x.mean(axis=-1), resamples=4000)
    assert high - low == pytest.approx(2 * 1.96 * values.std() / 20, rel=0.05)


def test_intervals_of_nothing_are_not_numbers():
    assert all(np.isnan(interval([], median)))
    assert all(np.isnan(interval([np.empty(0)], median)))
    assert interval([np.empty(0), np.ones(3)], median) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([],), "groups must be arrays"),
        (([np.empty(0)],), "groups must be arrays"),
        (([np.array([1.0, np.nan])],), "got NaN"),
        (([np.ones(3)], median, 100, 1.0), "confidence must lie in"),
        (([np.ones(3)], median, 0), "resamples must be"),
    ],
)
def test_the_bootstrap_refuses_bad_input(arguments, words):
    with pytest.raises(ValueError, match=words):
        stratified_bootstrap(*arguments)


def test_the_performance_profile_is_one_less_the_distribution():
    scores = np.array([0.0, 0.5, 1.0, 1.0])
    assert performance_profile(scores, np.array([-0.1, 0.0, 0.4, 0.5, 1.0])).tolist() == [1.0, 0.75, 0.75, 0.5, 0.0]
    both = performance_profile(np.stack([scores, scores + 1.0]), np.array([0.5]))
    assert both.tolist() == [[0.5], [1.0]]


def test_an_interval_over_training_seeds_is_as_wide_as_the_seeds_differ():
    seeds = [np.full(200, level) for level in (0.6, 0.7, 0.8, 0.9, 1.0)]
    assert interval(seeds, mean) == pytest.approx((0.8, 0.8, 0.8))  # episodes alone: no spread within a seed
    value, low, high = interval(seeds, mean, whole_groups=True)
    assert value == pytest.approx(0.8)
    assert low == pytest.approx(0.8 - 1.96 * np.std([0.6, 0.7, 0.8, 0.9, 1.0]) / np.sqrt(5), abs=0.02)
    assert high == pytest.approx(1.6 - low, abs=0.02)
