"""Plans tried from their starts, in the simulator's kernel and to the same times that the env measures."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from magwire_env.envs.action import Actuation
from magwire_env.simulation import Places, Simulator

from .cost import judged
from .starts import Starts, actions_of, commands_of

__all__ = ["Outcome", "Trials"]

_LANES_AT_ONCE = 2048

_LEAST_PACE = 1e-3
"""If a plan's tip moves less than this in a period, m, its position does not tell how far the plan has got."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What n plans lead to.

    value : (n,) the cost that is minimised, see `cost`: in a steering task the time to the goal, s; in a reaching task
        the time until the target has been held, s, finer than whole periods; in a tracking task the RMS error, m;
        `cost.FAILED` or more without success
    time : (n,) s as the env measures it, in a tracking task the RMS error, m; NaN without success
    steps : (n,) control periods used
    magnet : (n, H, dof) settings of the magnets after every period
    actions : (n, H, dof) actions that were taken
    tip : (n, H) m, before every period
    """

    value: np.ndarray
    time: np.ndarray
    steps: np.ndarray
    magnet: np.ndarray
    actions: np.ndarray
    tip: np.ndarray


class Trials:
    """Runs plans from starts."""

    def __init__(self, starts: Starts) -> None:
        self.starts = starts
        self._sims: dict[int, Simulator] = {}

    def lanes(self, rows: np.ndarray) -> Simulator:
        """A simulator whose lanes are at the starts `rows` (m,). It is kept between calls.

        Its goals are the inlets, so its trace of the way left is the tip's arc length with the sign turned.
        """
        starts, m = self.starts, len(rows)
        if m not in self._sims:
            if len(self._sims) > 3:
                self._sims.clear()
            self._sims[m] = Simulator(starts.library, m, lane_scenario=starts.entries[rows])
        sim, lanes = self._sims[m], np.arange(m)
        sim.assign(lanes, starts.entries[rows])
        sim.set_goal(lanes, np.zeros(m))
        sim.lay(lanes, Places(starts.tip[rows]), starts.magnet[rows])
        return sim

    def run(self, rows: np.ndarray, actions: np.ndarray, follow: np.ndarray | None = None) -> Outcome:
        """Try plans (m, H, dof) of single-precision actions from the starts `rows` (m,).

        follow : (m, H) m, where the tip is to be before every period. A tip that gets ahead of it, or behind, takes
            the action that the plan has for that place, by as many periods sooner or later. NaN keeps a plan to the
            clock. The actions that were taken are themselves a plan
        """
        parts = [
            self._run(rows[part], actions[part], None if follow is None else follow[part]) for part in _parts(len(rows))
        ]
        return Outcome(*(np.concatenate([getattr(p, k) for p in parts]) for k in Outcome.__dataclass_fields__))

    def act(self, sim: Simulator, actions: np.ndarray) -> None:
        """One control period of every lane under actions (m, dof) of the mode "angle"."""
        Actuation(sim).write(actions, sim.command)
        sim.advance()

    def _run(self, rows: np.ndarray, actions: np.ndarray, follow: np.ndarray | None) -> Outcome:
        starts = self.starts
        m, horizon = actions.shape[:2]
        sim, goal = self.lanes(rows), starts.goal[rows]
        trace, tip = np.empty((horizon, sim.trace.shape[0], m)), np.empty((horizon, m))
        magnet = np.empty((horizon, starts.library.dof, m))
        course = None if follow is None else _PlanByPlace(starts, rows, actions, follow)
        actions = np.ascontiguousarray(actions.transpose(1, 0, 2))
        passed, used, final = np.zeros(m, dtype=np.bool_), 0, starts.final[rows]
        back = np.full(m, not starts.task.kind.returns)  # the way back is under way, or none comes
        for step in range(horizon):
            tip[step] = sim.travelled
            if course is not None:
                actions[step] = course.next(step, tip[step])
            self.act(sim, actions[step].astype(np.float64))
            trace[step], magnet[step] = -sim.trace[:, :m], sim.magnet.T
            used = step + 1
            if starts.task.kind.passes:  # nothing after the goal counts
                if starts.task.kind.returns:
                    passed |= back & (trace[step, 1:] <= final).any(axis=0)
                    back |= (trace[step, 1:] >= goal).any(axis=0)
                else:
                    passed |= (trace[step, 1:] >= goal).any(axis=0)
                if passed.all():
                    break
        for array in (magnet, actions, tip):
            array[used:] = array[used - 1]
        judgement = judged(starts[rows], trace[:used])
        return Outcome(*judgement, magnet.transpose(2, 0, 1), actions.transpose(1, 0, 2), tip.T)


class _PlanByPlace:
    """Plans that are followed by the place of the tip instead of by the clock."""

    def __init__(self, starts: Starts, rows: np.ndarray, actions: np.ndarray, follow: np.ndarray) -> None:
        self._library, self._entries = starts.library, starts.entries[rows]
        commands = commands_of(self._library, self._entries, actions)
        turns = self._library.is_turn
        commands[:, :, turns] = np.unwrap(commands[:, :, turns], axis=1)
        self._commands, self._actions = commands, actions
        self._clocked = np.isnan(follow[:, 0])
        self._back = -1.0 if starts.task.kind.returns else 1.0
        self._follow = np.where(self._clocked[:, None], 0.0, follow)
        self._pace = np.diff(self._follow, axis=1, append=self._follow[:, -1:])
        self._lead, self._lane = np.zeros(len(rows)), np.arange(len(rows))

    def next(self, step: int, tip: np.ndarray) -> np.ndarray:
        """Actions (m, dof) for a period at whose start the tips are at `tip` (m,) m."""
        at, share = self._phase(step)
        pace = self._pace[self._lane, at]
        off = tip - self._follow[self._lane, at] - share * pace
        # On a way back the pace is negative, and so is what the tip is ahead by.
        moving = ((pace > _LEAST_PACE) | (self._back * pace > _LEAST_PACE)) & ~self._clocked
        self._lead += np.where(moving, np.clip(off / np.where(moving, pace, 1.0), -1.0, 1.0), 0.0)
        at, share = self._phase(step)
        share = share[:, None]
        beyond = np.minimum(at + 1, self._commands.shape[1] - 1)
        commands = (1.0 - share) * self._commands[self._lane, at] + share * self._commands[self._lane, beyond]
        actions = actions_of(self._library, self._entries, commands)
        return np.where(share == 0.0, self._actions[self._lane, at], actions)

    def _phase(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """The plan's period that is due in `step`, (m,), and the share of it that is already over (m,)."""
        last = self._commands.shape[1] - 1
        phase = np.clip(step + self._lead, 0.0, last)
        at = np.minimum(phase.astype(np.int64), last - 1 if last else 0)
        return at, phase - at


def _parts(n: int) -> Iterator[slice]:
    """Slices of at most `_LANES_AT_ONCE` of n rows."""
    edges = [*range(0, n, _LANES_AT_ONCE), n]
    return (slice(a, b) for a, b in itertools.pairwise(edges))
