"""What a plan is worth to the planner: the env's verdict, and beyond it a finer cost that also ranks near misses."""

from __future__ import annotations

import numpy as np

from .env_rules import Verdict, verdict
from .starts import Starts

__all__ = ["FAILED", "judged"]

FAILED = 1e4
"""Cost of a plan that fails, s; the remaining distance is added, so that nearer misses cost less."""

_HALF_PERIOD = 5e-3
"""A hold that is one period too short, by this distance in m, costs half a period less than the next longer time.

The distance is summed over the hold's periods and substeps. So a search can tell which of two plans with the same
number of periods is nearer to one period less.
"""


def judged(starts: Starts, trace: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`Outcome.value`, `time` and `steps` of recorded episodes, from their traces (H, substeps + 1, n) m."""
    task = starts.task
    far = starts.library.tract_length[starts.entries]
    env = verdict(task, trace, starts.goal, starts.reference, starts.step_limit, starts.period, starts.final, far)
    if task.kind.follows:
        held = env.alive.all(axis=0)
        rms = env.rms_error
        return np.where(held, rms, FAILED + rms), np.where(held, rms, np.nan), np.full(trace.shape[2], len(trace))
    cost = _return_cost if task.kind.returns else _steering_cost if task.kind.passes else _reaching_cost
    value, time = cost(starts, trace, env), np.where(env.success, env.time, np.nan)
    return value, time, np.where(env.success, env.steps, len(trace))


def _steering_cost(starts: Starts, trace: np.ndarray, env: Verdict) -> np.ndarray:
    """Time to the goal, or the least remaining distance of a plan that fails."""
    substeps, n = trace.shape[1] - 1, trace.shape[2]
    before = trace[:, :-1].reshape(-1, n)
    farthest = np.where(np.repeat(env.alive, substeps, axis=0), before, -np.inf).max(axis=0)
    return np.where(env.success, env.time, FAILED * (1.0 + np.minimum(starts.goal - farthest, 1e3)))


def _return_cost(starts: Starts, trace: np.ndarray, env: Verdict) -> np.ndarray:
    """Time to the end of the way back, or the least way left, both legs counted, of a plan that fails."""
    return np.where(env.success, env.time, FAILED * (1.0 + np.minimum(env.least, 1e3)))


def _reaching_cost(starts: Starts, trace: np.ndarray, env: Verdict) -> np.ndarray:
    """Time to the end of the hold, finer than whole periods, or the least excess of a plan that fails."""
    task, (horizon, _, n), lane = starts.task, trace.shape, np.arange(trace.shape[2])
    away = np.abs(trace[:, 1:] - starts.goal) - task.tolerance
    hold = task.hold_periods(starts.period)
    excess = np.maximum(away, 0.0).sum(axis=1) + np.where(env.alive, 0.0, 1.0)  # of every period, m
    sums = np.vstack([np.zeros(n), excess.cumsum(axis=0)])
    window = np.full((horizon + 1, n), np.inf)  # excess of the last `hold` periods before each moment
    window[hold:] = sums[hold:] - sums[:-hold]  # NaN behind an episode whose wire then diverged
    steps = np.where(env.success, env.steps, 0)
    short = np.minimum(window[np.maximum(steps - 1, 0), lane], 1e3)
    finer = steps - 1 + short / (short + _HALF_PERIOD)
    return np.where(env.success, finer * starts.period, FAILED * (1.0 + np.minimum(np.fmin.reduce(window), 1e3)))
