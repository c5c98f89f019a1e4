"""First plans: by dynamic programming where the rig has one turn, and by closed-loop controllers everywhere."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.simulation.locked import algorithm1 as a1

from . import dynamic_programming as dp
from .force_table import SpeedTable, speed_tables
from .starts import Starts, Trials, actions_of

__all__ = ["by_controller", "by_dynamic_programming"]

_FINE = 1e-3
"""m between the rows about a target or a reference."""

_BAND = 31
"""Rows about a reference."""

_BESIDE = 0.06
"""A way to a target is looked for so far beyond its ends, m."""

_SWEEPS, _TOLERANCE = 200, 1e-4

_TOGETHER = 32
"""Episodes whose values are kept at the same time."""


def by_dynamic_programming(trials: Trials) -> np.ndarray:
    """Plans (n, H, 1), as actions, of what dynamic programming finds, ridden closed loop in the simulator."""
    starts = trials.starts
    order = np.argsort(starts.entries, kind="stable")  # so that episodes of one scenario stand together
    plans = np.empty((len(starts), starts.step_limit, 1), dtype=np.float32)
    for first in range(0, len(starts), _TOGETHER):
        rows = order[first : first + _TOGETHER]
        entries, number = np.unique(starts.entries[rows], return_inverse=True)
        models = [_Model(table, starts.period) for table in speed_tables(starts.library, entries)]
        plans[rows] = _ridden(trials, rows, [models[i] for i in number])
    return plans


class _Model:
    """A speed table, and the moves of a control period in it."""

    def __init__(self, table: SpeedTable, period: float) -> None:
        self.speed, self.spacing, self.column = table.speed, table.spacing, 2 * np.pi / table.speed.shape[1]
        self.reach = table.servo * period / self.column
        self.carry = table.lag * -np.expm1(-period / table.lag)
        self.way = dp.moves(table.speed, table.spacing, self.reach, period)


def _solve(starts: Starts, i: int, model: _Model) -> tuple[np.ndarray, np.ndarray]:
    """Values of episode i: of the way, and those of the hold or along the reference (else of no size)."""
    period, goal, way = starts.period, float(starts.goal[i]), model.way
    if starts.task.kind == "steer":
        return dp.to_the_end(way, model.spacing, goal, model.reach, period, _SWEEPS, _TOLERANCE), _NONE
    if starts.task.kind == "track":
        reference = np.ascontiguousarray(starts.reference[i, : starts.step_limit + 1])
        return _NONE[0], dp.along_a_reference(way, model.spacing, reference, _FINE, _BAND, model.reach, period)
    low, high = sorted((float(starts.tip[i]), goal))
    first = max(int((low - _BESIDE) / model.spacing), 0)
    last = min(int((high + _BESIDE) / model.spacing), len(model.speed) - 1)
    return dp.to_a_target(
        way, model.spacing, goal, starts.task.tolerance, hold_of(starts), _FINE, first, last, model.reach, period,
        _SWEEPS, _TOLERANCE,
    )  # fmt: skip


def hold_of(starts: Starts) -> int:
    """Control periods that a target must be held for."""
    return int(np.ceil(starts.task.hold / starts.period - 0.5 - 1e-9))


def _ridden(trials: Trials, rows: np.ndarray, models: list[_Model]) -> np.ndarray:
    """Actions (m, H, 1) of the episodes `rows`, each step the turn of the best value."""
    starts, period = trials.starts, trials.starts.period
    kind = ("steer", "reach", "track").index(starts.task.kind)
    solved: dict[Any, tuple[np.ndarray, np.ndarray]] = {}
    keys = [(id(model), starts.goal[i] if kind == 0 else i) for i, model in zip(rows, models, strict=True)]
    for key, i, model in zip(keys, rows, models, strict=True):
        if key not in solved:
            solved[key] = _solve(starts, i, model)
    m, hold, home = len(rows), hold_of(starts), starts.library.home[starts.entries[rows], 0]
    arrays, goal, width = trials.lanes(rows), starts.goal[rows], starts.task.tolerance
    left = np.full(m, hold)
    command, actions = np.zeros((m, 1)), np.zeros((m, starts.step_limit, 1), dtype=np.float32)
    for step in range(starts.step_limit):
        tip, speed, angle = arrays.result(a1.TIP_S), arrays.result(a1.TIP_V), arrays.q[0, :m].copy()
        target = starts.reference[rows, step + 1] if kind == 2 else goal
        for n, model in enumerate(models):
            values, more = solved[keys[n]]
            turn = dp.choose(
                kind, model.speed, model.spacing, more[step + 1] if kind == 2 else values,
                more if kind == 1 else _NONE, left[n], target[n], width, _FINE, model.reach, period, model.carry,
                tip[n], speed[n], (angle[n] - home[n] + np.pi) / model.column,
            )  # fmt: skip
            command[n, 0] = angle[n] + turn * model.column
        actions[:, step] = actions_of(starts.library, starts.entries[rows], command)
        trials.act(arrays, actions[:, step].astype(np.float64))
        trace = arrays.trace[1:, :m]
        inside = (np.abs(trace - goal) <= width).all(axis=0)
        left = np.where(inside, np.maximum(left - 1, 1), hold)
        if kind == 0 and (trace.max(axis=0) >= goal).all():
            actions[:, step + 1 :] = actions[:, step : step + 1]
            break
    return actions


_NONE = np.zeros((1, 1, 1))


def by_controller(starts: Starts, policy: Callable[[Any], Any]) -> np.ndarray:
    """Plans (n, H, dof), as actions: what a controller does that is made from a batch of the same starts.

    Its readings are true, and nothing varies.
    """
    n, library = len(starts), starts.library
    plain = [sc.replace(sensing=type(sc.sensing)(), variation=type(sc.variation)()) for sc in library.scenarios]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "scenario .* has no certificate")
        env = MagWireVectorEnv(
            n, starts.task, scenario=[plain[e] for e in starts.entries],
            time_limit=starts.step_limit * starts.period,
        )  # fmt: skip
    core = env.core
    actor = policy(env)
    env.reset(seed=0)
    lanes = np.arange(n)
    core.sim.lay(lanes, starts.tip, starts.magnet)
    core.goal[:] = starts.goal
    core.reference[:] = starts.reference
    commands = np.empty((n, starts.step_limit, library.dof))
    state, first = None, np.ones(n, dtype=np.bool_)
    running = first.copy()
    for step in range(starts.step_limit):
        action, state = actor.predict(core.observe(), state=state, episode_start=first)
        _, terminated, _, _ = core.step(action)
        commands[:, step] = core.sim.command.T
        running &= ~terminated
        first = np.zeros(n, dtype=np.bool_)
        if not running.any():
            commands[:, step + 1 :] = commands[:, step : step + 1]
            break
    return actions_of(library, starts.entries, commands)
