"""The best plan that is found for every episode: seeds, refinement, and what is kept from earlier."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .cache import Cache
from .refinement import Refinement, refine
from .seeds import by_controller, by_dynamic_programming
from .starts import Starts, Trials

__all__ = ["Plans", "best_plans"]

_TOGETHER = 64
"""Episodes refined side by side."""

_SAME = 1e-9
"""A kept plan whose value has changed by more, s or m, was made under another simulator."""


@dataclass(frozen=True, eq=False)
class Plans:
    """The best plans found, one an episode.

    actions : (n, step_limit, dof) in the action mode "angle", single precision
    time : (n,) s to the goal as the env measures it, in a tracking task the RMS error in m; NaN without success
    """

    actions: np.ndarray
    time: np.ndarray


def best_plans(starts: Starts, settings: Refinement, cache: Cache | None = None) -> Plans:
    """Plans for all the starts; those in the cache are taken from there, the others made together and stored."""
    n, dof = len(starts), starts.library.dof
    actions, known = np.empty((n, starts.step_limit, dof), dtype=np.float32), np.zeros(n, dtype=np.bool_)
    keys = cache.keys(starts, settings) if cache is not None else []
    trials = Trials(starts)
    values = np.full(n, np.nan)
    for number, key in enumerate(keys):
        kept = cache.load(key) if cache is not None else None
        if kept is not None and kept[0].shape[1] == dof:
            actions[number], values[number], known[number] = _held(kept[0], starts.step_limit), kept[1], True
    if known.any() and cache is not None:
        rows = np.flatnonzero(known)
        now = trials.run(rows, actions[rows]).value
        for stale in rows[~(np.abs(now - values[rows]) <= _SAME)]:
            warnings.warn(f"{cache.path(keys[stale])} is of another simulator and its plan is made again", stacklevel=2)
            known[stale] = False
    missing = np.flatnonzero(~known)
    for first in range(0, len(missing), _TOGETHER):
        rows = missing[first : first + _TOGETHER]
        for i, plan, value in zip(rows, *_made(starts[rows], settings), strict=True):
            actions[i] = plan
            if cache is not None:
                cache.store(keys[i], plan, value)
    return Plans(actions, trials.run(np.arange(n), actions).time)


def _held(plan: np.ndarray, steps: int) -> np.ndarray:
    """A plan (H, dof) of `steps` periods, its last command held."""
    return plan[np.minimum(np.arange(steps), len(plan) - 1)]


def _made(starts: Starts, settings: Refinement) -> tuple[np.ndarray, np.ndarray]:
    """New plans (n, step_limit, dof) and their values (n,)."""
    trials, rows = Trials(starts), np.arange(len(starts))
    best, value = None, np.full(len(starts), np.inf)
    for actions in _seeds(trials):
        found = trials.run(rows, actions).value
        best = actions.copy() if best is None else best
        best[found < value] = actions[found < value]
        value = np.minimum(found, value)
    assert best is not None  # there is a seed for every task
    return refine(trials, best, settings)


def _seeds(trials: Trials) -> Iterator[np.ndarray]:
    """Plans to begin with, of what can be asked for this task and rig."""
    from ..controllers import (  # which stand beside `Optimal`, and that imports this module
        MPPI,
        PD,
        Controller,
        MaxForce,
        NetForce,
    )

    starts = trials.starts
    policies: tuple[type[Controller], ...] = (NetForce, MaxForce, MPPI) if starts.task.kind == "steer" else (MPPI,)
    if starts.library.dof == 1 and starts.library.is_turn[0]:
        yield by_dynamic_programming(trials)
        policies = policies if starts.task.kind == "steer" else (PD, *policies)
    for policy in policies:
        yield by_controller(starts, policy.from_env)
