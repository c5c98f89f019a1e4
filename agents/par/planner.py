"""The best plan found for every episode: first plans, refinement, and plans kept from earlier."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from magwire_env.envs.kernels import FOLLOW, HOLD, PASS
from magwire_env.progress import Progress
from magwire_env.words import counted

from ..controllers import MPPI, PD, Controller, MaxForce, NetForce
from .cache import Cache
from .refinement import Refinement, refine
from .seeds import by_controller, by_dynamic_programming
from .starts import Starts
from .trials import Trials

__all__ = ["Plans", "best_plans"]

_FIRST: dict[int, tuple[type[Controller], ...]] = {
    PASS: (NetForce, MaxForce, MPPI),
    HOLD: (PD, MPPI),
    FOLLOW: (PD, MPPI),
}
"""Controllers that give first plans, by the rule of the kind of task, for the rigs that they serve."""

_TOGETHER = 64
"""Number of episodes refined side by side."""

_SAME = 1e-9
"""If a kept plan's value has changed by more than this, s or m, the plan was made under another simulator."""


@dataclass(frozen=True, eq=False)
class Plans:
    """The best plans found, one an episode.

    actions : (n, step_limit, dof) in the action mode "angle", single precision
    time : (n,) s to the goal as the env measures it, in a tracking task the RMS error in m; NaN without success
    """

    actions: np.ndarray
    time: np.ndarray


def best_plans(starts: Starts, settings: Refinement, cache: Cache | None = None) -> Plans:
    """Plans for all the starts: those in the cache are taken from there, the others are made and stored."""
    n, dof = len(starts), starts.library.dof
    actions, known = np.empty((n, starts.step_limit, dof), dtype=np.float32), np.zeros(n, dtype=np.bool_)
    keys = cache.keys(starts, settings) if cache is not None else []
    trials = Trials(starts)
    values = np.full(n, np.nan)
    for number, key in enumerate(keys):
        kept = cache.load(key) if cache is not None else None
        if kept is not None and kept[0].shape[1] == dof:
            actions[number], values[number], known[number] = _prolonged(kept[0], starts.step_limit), kept[1], True
    if known.any() and cache is not None:
        rows = np.flatnonzero(known)
        now = trials.run(rows, actions[rows]).value
        for stale in rows[~(np.abs(now - values[rows]) <= _SAME)]:
            warnings.warn(
                f"{cache.path(keys[stale])} was made under another simulator, so its plan is made again", stacklevel=2
            )
            known[stale] = False
    missing = np.flatnonzero(~known)
    with Progress(f"planning the par of {counted(len(missing), 'new episode')}", len(missing)) as progress:
        for first in range(0, len(missing), _TOGETHER):
            rows = missing[first : first + _TOGETHER]
            for i, plan, value in zip(rows, *_new_plans(starts[rows], settings, progress), strict=True):
                actions[i] = plan
                if cache is not None:
                    cache.store(keys[i], plan, value)
            progress.done += len(rows)
    return Plans(actions, trials.run(np.arange(n), actions).time)


def _prolonged(plan: np.ndarray, steps: int) -> np.ndarray:
    """A plan (H, dof) made `steps` periods long: its last action is held."""
    return plan[np.minimum(np.arange(steps), len(plan) - 1)]


def _new_plans(starts: Starts, settings: Refinement, progress: Progress) -> tuple[np.ndarray, np.ndarray]:
    """The best first plan of every episode, refined: plans (n, step_limit, dof) and their values (n,)."""
    trials, rows = Trials(starts), np.arange(len(starts))
    best, value = None, np.full(len(starts), np.inf)
    for actions in _first_plans(trials, progress):
        found = trials.run(rows, actions).value
        best = actions.copy() if best is None else best
        best[found < value] = actions[found < value]
        value = np.minimum(found, value)
    assert best is not None  # MPPI serves every task and rig
    progress.stage = "refining"
    return refine(trials, best, settings)


def _first_plans(trials: Trials, progress: Progress) -> Iterator[np.ndarray]:
    """Plans (n, step_limit, dof) of every method that serves this task and rig."""
    starts = trials.starts
    if starts.one_turn and not starts.task.kind.returns:  # dynamic programming knows one goal alone
        progress.stage = "dynamic programming"
        yield by_dynamic_programming(trials)
    for controller in _FIRST[starts.task.kind.rule]:
        if not controller.refusal(starts.library.scenarios[0]):
            progress.stage = f"first plans of {controller.__name__}"
            yield by_controller(starts, controller.from_env)
