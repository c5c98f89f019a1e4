"""First plans: by dynamic programming where the rig has one turn, and by closed-loop controllers everywhere."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from magwire_env.envs.core import SteeringCore
from magwire_env.envs.kernels import FOLLOW, HOLD, PASS
from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.simulation import Places

from ..evaluation.episodes import Policy, episodes
from . import dynamic_programming as dp
from .speed_table import SpeedTable, speed_tables
from .starts import Starts, actions_of
from .trials import Trials

__all__ = ["by_controller", "by_dynamic_programming"]

_FINE = 1e-3
"""Spacing of the rows about a target or a reference, m."""

_BAND = 31
"""Number of rows about a reference."""

_BESIDE = 0.06
"""A way to a target may lead beyond its two ends by this much, m."""

_SWEEPS, _TOLERANCE = 200, 1e-4
"""Most sweeps of the recursion, and the change of the values, s, below which it stops."""

_ASKED = {PASS: dp.TO_THE_END, HOLD: dp.TO_A_TARGET, FOLLOW: dp.ALONG_A_REFERENCE}
"""What dynamic programming is asked for, by the rule of the kind of task."""

_TOGETHER = 32
"""Number of episodes whose value tables are in memory at the same time."""


def by_dynamic_programming(trials: Trials) -> np.ndarray:
    """Plans (n, H, 1), as actions: the policy of dynamic programming, run in closed loop in the simulator."""
    starts = trials.starts
    order = np.argsort(starts.entries, kind="stable")  # so that episodes of one scenario stand together
    plans = np.empty((len(starts), starts.step_limit, 1), dtype=np.float32)
    for first in range(0, len(starts), _TOGETHER):
        rows = order[first : first + _TOGETHER]
        entries, number = np.unique(starts.entries[rows], return_inverse=True)
        models = [_Model(table, starts.period) for table in speed_tables(starts.library, entries)]
        plans[rows] = _closed_loop(trials, rows, [models[i] for i in number])
    return plans


class _Model:
    """A speed table, and the moves of a control period in it."""

    def __init__(self, table: SpeedTable, period: float) -> None:
        self.speed, self.spacing, self.column = table.speed, table.spacing, 2 * np.pi / table.speed.shape[1]
        self.reach = table.servo * period / self.column
        self.carry = table.lag * -np.expm1(-period / table.lag)
        self.moves = dp.moves(table.speed, table.spacing, self.reach, period)


def _solve(starts: Starts, i: int, model: _Model) -> tuple[np.ndarray, np.ndarray]:
    """Value tables of episode i: over the whole way, and those of the hold or along the reference (else empty)."""
    period, goal, moves = starts.period, float(starts.goal[i]), model.moves
    if starts.task.kind.passes:
        return dp.to_the_end(moves, model.spacing, goal, model.reach, period, _SWEEPS, _TOLERANCE), _NONE
    if starts.task.kind.follows:
        reference = np.ascontiguousarray(starts.reference[i, : starts.step_limit + 1])
        return _NONE[0], dp.along_a_reference(moves, model.spacing, reference, _FINE, _BAND, model.reach, period)
    low, high = sorted((float(starts.tip[i]), goal))
    first = max(int((low - _BESIDE) / model.spacing), 0)
    last = min(int((high + _BESIDE) / model.spacing), len(model.speed) - 1)
    hold = starts.task.hold_periods(period)
    return dp.to_a_target(
        moves, model.spacing, goal, starts.task.tolerance, hold, _FINE, first, last, model.reach, period,
        _SWEEPS, _TOLERANCE,
    )  # fmt: skip


def _closed_loop(trials: Trials, rows: np.ndarray, models: list[_Model]) -> np.ndarray:
    """Actions (m, H, 1) of the episodes `rows`: in every step the turn of the best value."""
    starts, period = trials.starts, trials.starts.period
    task, kind = starts.task, _ASKED[starts.task.kind.rule]
    steering, tracking = kind == dp.TO_THE_END, kind == dp.ALONG_A_REFERENCE
    solved: dict[Any, tuple[np.ndarray, np.ndarray]] = {}
    keys = [(id(model), starts.goal[i] if steering else i) for i, model in zip(rows, models, strict=True)]
    for key, i, model in zip(keys, rows, models, strict=True):
        if key not in solved:
            solved[key] = _solve(starts, i, model)
    m, hold, home = len(rows), task.hold_periods(period), starts.library.home[starts.entries[rows], 0]
    sim, goal = trials.lanes(rows), starts.goal[rows]
    left = np.full(m, hold)  # periods of the hold that are still to come
    command, actions = np.zeros((m, 1)), np.zeros((m, starts.step_limit, 1), dtype=np.float32)
    for step in range(starts.step_limit):
        tip, speed, angle = sim.travelled, sim.tip_velocity, sim.magnet[:, 0]
        target = starts.reference[rows, step + 1] if tracking else goal
        for n, model in enumerate(models):
            values, more = solved[keys[n]]
            turn = dp.choose(
                kind, model.speed, model.spacing, more[step + 1] if tracking else values,
                _NONE if steering or tracking else more, left[n], target[n], task.tolerance, _FINE, model.reach, period,
                model.carry, tip[n], speed[n], (angle[n] - home[n] + np.pi) / model.column,
            )  # fmt: skip
            command[n, 0] = angle[n] + turn * model.column
        actions[:, step] = actions_of(starts.library, starts.entries[rows], command)
        trials.act(sim, actions[:, step].astype(np.float64))
        trace = -sim.trace[1:, :m]
        inside = (np.abs(trace - goal) <= task.tolerance).all(axis=0)
        left = np.where(inside, np.maximum(left - 1, 1), hold)
        if steering and (trace.max(axis=0) >= goal).all():
            actions[:, step + 1 :] = actions[:, step : step + 1]
            break
    return actions


_NONE = np.zeros((1, 1, 1))


def by_controller(starts: Starts, policy: Callable[[Any], Policy]) -> np.ndarray:
    """Plans (n, H, dof), as actions: what a controller does that `policy` makes for a batch of the same starts.

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
    actor = policy(env)
    env.reset(seed=0)
    _begin_at(env.core, starts)
    commands = np.empty((n, starts.step_limit, library.dof))
    for step, _ in enumerate(episodes(_WithoutResets(env.core), actor, env.core.observe(), restarts=False)):
        commands[:, step:] = env.core.sim.command.T[:, None]  # the last command is held
    return actions_of(library, starts.entries, commands)


def _begin_at(core: SteeringCore, starts: Starts) -> None:
    """Put the episodes that have just begun in all lanes to `starts`."""
    final = starts.final if starts.task.kind.returns else None
    core.begin_at(
        np.arange(len(starts)), Places(starts.tip), Places(starts.goal), starts.magnet, starts.reference, final
    )


class _WithoutResets:
    """A core's lanes as a batch in which an episode that has ended just goes on."""

    def __init__(self, core: SteeringCore) -> None:
        self._core, self.num_envs = core, core.sim.num_envs

    def step(self, action: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        reward, terminated, truncated, info = self._core.step(action)
        return self._core.observe(), reward, terminated, truncated, info
