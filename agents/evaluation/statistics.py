"""Aggregates of scores with their uncertainty, after Agarwal et al., "Deep RL at the edge of the statistical
precipice" (NeurIPS 2021): interquartile means, stratified bootstrap intervals, performance profiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from magwire_env.physics.checks import whole

__all__ = ["interquartile_mean", "interval", "mean", "median", "performance_profile", "stratified_bootstrap"]

_AT_ONCE = 4_000_000
"""Most numbers that are resampled at a time."""


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Mean of the middle half, values (…, n) → (…,): the ⌊n/4⌋ smallest and the ⌊n/4⌋ largest are left out.

    Raises `ValueError` if there are no values.
    """
    values = np.asarray(values, dtype=np.float64)
    n = values.shape[-1] if values.ndim else 0
    if n == 0:
        raise ValueError(f"values must be an array (…, n) of at least one number, got shape {values.shape}")
    cut = n // 4
    if cut == 0:
        return values.mean(axis=-1)
    return np.partition(values, (cut, n - cut - 1), axis=-1)[..., cut : n - cut].mean(axis=-1)


def mean(values: np.ndarray) -> np.ndarray:
    """The mean, values (…, n) → (…,)."""
    return np.mean(values, axis=-1)


def median(values: np.ndarray) -> np.ndarray:
    """The median, values (…, n) → (…,)."""
    return np.median(values, axis=-1)


def stratified_bootstrap(
    groups: Sequence[np.ndarray],
    statistic: Callable[[np.ndarray], np.ndarray] = interquartile_mean,
    resamples: int = 2000,
    confidence: float = 0.95,
    seed: int = 0,
    whole_groups: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A statistic of the values of all groups together, and the two ends of its percentile bootstrap interval.

    groups : strata (training seeds, tasks), (n_i,) values each; each is resampled within itself
    statistic : samples (r, n) → (r,) or (r, k)
    resamples : number of resamples
    confidence : share of the resampled statistics between the two ends
    seed : of the resampling
    whole_groups : resample the groups, too, as training seeds: another training would have given other seeds

    Raises `ValueError` for no group, an empty group, NaN, or a confidence outside (0, 1).
    """
    strata = [np.asarray(group, dtype=np.float64) for group in groups]
    if not strata or any(group.ndim != 1 or not len(group) for group in strata):
        raise ValueError(f"groups must be arrays (n,) of at least one number, got shapes {[g.shape for g in strata]}")
    if any(np.isnan(group).any() for group in strata):
        raise ValueError("groups must hold numbers only, got NaN")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie in (0, 1), got {confidence!r}")
    resamples = whole("resamples", resamples, 1)
    rng = np.random.default_rng(seed)
    together = np.concatenate(strata)
    step = max(1, _AT_ONCE // len(together))
    found = []
    for first in range(0, resamples, step):
        rows = min(step, resamples - first)
        if whole_groups and len(strata) > 1:
            found.append(np.concatenate([statistic(row[None]) for row in _groups_drawn(rng, strata, rows)]))
        else:
            found.append(statistic(np.concatenate([rng.choice(g, (rows, len(g))) for g in strata], axis=1)))
    tail = (1.0 - confidence) / 2
    low, high = np.quantile(np.concatenate(found), [tail, 1.0 - tail], axis=0)
    return statistic(together[None])[0], low, high


def _groups_drawn(rng: np.random.Generator, strata: Sequence[np.ndarray], rows: int) -> Iterator[np.ndarray]:
    """Resamples (n,): as many groups as there are, drawn with replacement, and the values of each drawn anew."""
    for _ in range(rows):
        yield np.concatenate(
            [rng.choice(strata[g], len(strata[g])) for g in rng.integers(len(strata), size=len(strata))]
        )


def interval(
    groups: Sequence[np.ndarray],
    statistic: Callable[[np.ndarray], np.ndarray],
    resamples: int = 2000,
    whole_groups: bool = False,
) -> tuple[float, float, float]:
    """`stratified_bootstrap` of a single number, as floats. Empty groups are left out; NaN if there are no values."""
    kept = [group for group in groups if len(group)]
    if not kept:
        return (float("nan"),) * 3
    value, low, high = stratified_bootstrap(kept, statistic, resamples, whole_groups=whole_groups)
    return float(value), float(low), float(high)


def performance_profile(scores: np.ndarray, taus: np.ndarray) -> np.ndarray:
    """Share of the scores that are greater than each of `taus` (k,): scores (…, n) → (…, k)."""
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=-1)
    flat = ordered.reshape(-1, ordered.shape[-1])
    below = np.stack([np.searchsorted(row, taus, side="right") for row in flat])
    return (1.0 - below / flat.shape[1]).reshape(*ordered.shape[:-1], len(taus))
