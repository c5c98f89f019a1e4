"""Episodes to be planned, and plans tried out on them: from the very kernel, to the very time that the env measures."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from magwire_env.envs import kernels
from magwire_env.envs.core import SteeringCore
from magwire_env.envs.task import Task
from magwire_env.simulation.locked import algorithm1 as a1
from magwire_env.simulation.locked.arrays import LaneArrays, Library

__all__ = ["FAILED", "Outcome", "Starts", "Trials", "actions_of", "commands_of"]

FAILED = 1e4
"""A plan that does not reach the goal is worth this and more, s; a way that is left adds to it, and less is better."""

_LANES_AT_ONCE = 2048

_LEAST_PACE = 1e-3
"""m a period, below which a plan's tip does not tell how far it has got."""

_SLACK = 5e-3
"""Of a target's hold one period shorter than the plan's, the excess (m, summed) at which half a period is counted."""


@dataclass(frozen=True, eq=False)
class Starts:
    """Where n episodes begin and what they are for.

    library, entries : scenarios, and each episode's number in them (n,)
    tip, magnet : (n,) m and (n, dof) rad or m, a wire at rest behind its tip
    goal : (n,) m
    reference : (n, step_limit + 1 or more) m in a tracking task, else (n, 0)
    step_limit : control periods an episode lasts at most
    """

    task: Task
    library: Library
    entries: np.ndarray
    tip: np.ndarray
    magnet: np.ndarray
    goal: np.ndarray
    reference: np.ndarray
    step_limit: int

    @classmethod
    def of(cls, core: SteeringCore, lanes: np.ndarray) -> Starts:
        """The episodes that have just begun in a core's lanes (n,)."""
        sim = core.sim
        return cls(
            core.task, sim.library, sim.lane_scenario[lanes], sim.tip_arclength[lanes], sim.magnet[lanes],
            core.goal[lanes].copy(), core.reference[lanes], core.step_limit,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, rows: np.ndarray) -> Starts:
        own = {k: getattr(self, k)[rows] for k in ("entries", "tip", "magnet", "goal", "reference")}
        return replace(self, **own)

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.library.timing.control_period


def actions_of(library: Library, entries: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Commands (n, …, dof) rad and m as single-precision actions of the mode "angle"; turns about home.

    Plans are actions: where a place does not hold the wire, the rounding of a command grows tenfold every few seconds.
    """
    low, high = _limits(library, entries, commands.ndim)
    gap = commands - 0.5 * (low + high)
    gap = np.where(library.is_turn, gap - 2 * np.pi * np.floor(gap / (2 * np.pi) + 0.5), gap)
    return np.clip(gap / (0.5 * (high - low)), -1.0, 1.0).astype(np.float32)


def commands_of(library: Library, entries: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """What `actions_of` undoes, and gives back exactly."""
    low, high = _limits(library, entries, actions.ndim)
    return low + 0.5 * (actions.astype(np.float64) + 1.0) * (high - low)


def _limits(library: Library, entries: np.ndarray, ndim: int) -> tuple[np.ndarray, np.ndarray]:
    shape = (len(entries), *[1] * (ndim - 2), library.dof)
    return library.dofs[entries, :, 1].reshape(shape), library.dofs[entries, :, 2].reshape(shape)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What n plans lead to.

    value : (n,) what is to be small: steering, s to the goal; reaching, s until it has been held, finer than whole
        periods by how far the plan is from a period less; tracking, RMS error in m. `FAILED` and more without success
    time : (n,) s as the env measures it; RMS error in m for tracking; NaN without success
    steps : (n,) control periods used
    magnet : (n, H, dof) where the magnets were after every period
    actions : (n, H, dof) what was done
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
        self._arrays: dict[int, LaneArrays] = {}

    def lanes(self, rows: np.ndarray) -> LaneArrays:
        """A kernel's arrays with the starts `rows` (m,) laid in its first m lanes; kept between calls."""
        starts, m = self.starts, len(rows)
        if m not in self._arrays:
            if len(self._arrays) > 3:
                self._arrays.clear()
            self._arrays[m] = LaneArrays(starts.library, m)
        arrays, lanes = self._arrays[m], np.arange(m)
        arrays.take(lanes, starts.entries[rows])
        arrays.lay_at_rest(lanes, starts.tip[rows])
        arrays.write(lanes, magnet=starts.magnet[rows])
        arrays.refresh(lanes)
        return arrays

    def run(self, rows: np.ndarray, actions: np.ndarray, follow: np.ndarray | None = None) -> Outcome:
        """Plans (m, H, dof) of single-precision actions tried from the starts `rows` (m,).

        follow : (m, H) m, where the tip is to be before every period; a tip that gets ahead of it, or behind, takes
            what the plan does there, by as many periods sooner or later. NaN keeps a plan to the clock. What was done
            is itself a plan
        """
        parts = [
            self._run(rows[part], actions[part], None if follow is None else follow[part]) for part in _parts(len(rows))
        ]
        return Outcome(*(np.concatenate([getattr(p, k) for p in parts]) for k in Outcome.__dataclass_fields__))

    def act(self, arrays: LaneArrays, actions: np.ndarray) -> None:
        """One control period of `arrays` under actions (m, dof), by the env's own way from them to commands."""
        library = self.starts.library
        lane = kernels.command_of(
            kernels.ANGLE, actions, library.is_turn, self.starts.period, arrays.dofs, arrays.q, arrays.command
        )
        if lane >= 0:
            raise ValueError(f"actions[{lane}] must be numbers in [-1, 1], got {actions[lane].tolist()}")
        arrays.step()

    def _run(self, rows: np.ndarray, actions: np.ndarray, follow: np.ndarray | None) -> Outcome:
        starts = self.starts
        m, horizon = actions.shape[:2]
        arrays, goal = self.lanes(rows), starts.goal[rows]
        trace, tip = np.empty((horizon, arrays.trace.shape[0], m)), np.empty((horizon, m))
        magnet = np.empty((horizon, starts.library.dof, m))
        course = None if follow is None else _Course(starts, rows, actions, follow)
        actions = np.ascontiguousarray(actions.transpose(1, 0, 2))
        done, used = np.zeros(m, dtype=np.bool_), 0
        for step in range(horizon):
            tip[step] = arrays.result(a1.TIP_S)
            if course is not None:
                actions[step] = course.next(step, tip[step])
            self.act(arrays, actions[step].astype(np.float64))
            trace[step], magnet[step] = arrays.trace[:, :m], arrays.q[:, :m]
            used = step + 1
            if starts.task.kind == "steer":
                done |= (trace[step, 1:] >= goal).any(axis=0)
                if done.all():
                    break
        for array in (magnet, actions, tip):
            array[used:] = array[used - 1]
        judgement = judged(starts[rows], trace[:used])
        return Outcome(*judgement, magnet.transpose(2, 0, 1), actions.transpose(1, 0, 2), tip.T)


class _Course:
    """Plans followed by the tip's place instead of by the clock."""

    def __init__(self, starts: Starts, rows: np.ndarray, actions: np.ndarray, follow: np.ndarray) -> None:
        self._library, self._entries = starts.library, starts.entries[rows]
        commands = commands_of(self._library, self._entries, actions)
        turns = self._library.is_turn
        commands[:, :, turns] = np.unwrap(commands[:, :, turns], axis=1)
        self._commands, self._actions = commands, actions
        self._clocked = np.isnan(follow[:, 0])
        self._follow = np.where(self._clocked[:, None], 0.0, follow)
        self._pace = np.diff(self._follow, axis=1, append=self._follow[:, -1:])
        self._lead, self._lane = np.zeros(len(rows)), np.arange(len(rows))

    def next(self, step: int, tip: np.ndarray) -> np.ndarray:
        """Actions (m, dof) for a period at whose start the tips are at `tip` (m,) m."""
        last = self._commands.shape[1] - 1
        phase = np.clip(step + self._lead, 0.0, last)
        at = np.minimum(phase.astype(np.int64), last - 1 if last else 0)
        share = phase - at
        pace = self._pace[self._lane, at]
        off = tip - self._follow[self._lane, at] - share * pace
        moving = (pace > _LEAST_PACE) & ~self._clocked
        self._lead += np.where(moving, np.clip(off / np.where(moving, pace, 1.0), -1.0, 1.0), 0.0)
        phase = np.clip(step + self._lead, 0.0, last)
        at = np.minimum(phase.astype(np.int64), last - 1 if last else 0)
        share = (phase - at)[:, None]
        beyond = np.minimum(at + 1, last)
        commands = (1.0 - share) * self._commands[self._lane, at] + share * self._commands[self._lane, beyond]
        actions = actions_of(self._library, self._entries, commands)
        return np.where(share == 0.0, self._actions[self._lane, at], actions)


def _parts(n: int) -> Iterator[slice]:
    edges = [*range(0, n, _LANES_AT_ONCE), n]
    return (slice(a, b) for a, b in itertools.pairwise(edges))


def judged(starts: Starts, trace: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`Outcome.value`, `time` and `steps` of one trace (H, substeps + 1, n) m an episode."""
    thrown = trace[:, -1] < 0.0
    alive = ~np.logical_or.accumulate(thrown, axis=0)
    kind = {"steer": _steered, "reach": _reached, "track": _tracked}[starts.task.kind]
    return kind(starts, trace, alive)


def _steered(starts: Starts, trace: np.ndarray, alive: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """To the crossing, linear within its substep, as `envs.kernels.summarise` has it."""
    horizon, points, n = trace.shape
    last, lane, goal = points - 1, np.arange(n), starts.goal
    before = trace[:, :-1].reshape(-1, n)
    crossed = (trace[:, 1:].reshape(-1, n) >= goal) & np.repeat(np.r_[alive[:1] | True, alive[:-1]], last, axis=0)
    found = crossed.any(axis=0) & (crossed.argmax(axis=0) < last * starts.step_limit)
    step, k = np.divmod(crossed.argmax(axis=0), last)
    a, b = trace[step, k, lane], trace[step, k + 1, lane]
    share = np.clip((goal - a) / np.where(b > a, b - a, 1.0), 0.0, 1.0)
    time = (step + 1 - 1.0 + (k + share) / last) * starts.period
    left = goal - np.where(np.repeat(alive, last, axis=0), before, -np.inf).max(axis=0)
    value = np.where(found, time, FAILED * (1.0 + np.minimum(left, 1e3)))
    return value, np.where(found, time, np.nan), np.where(found, step + 1, horizon)


def _reached(starts: Starts, trace: np.ndarray, alive: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """To the end of the first run of periods within the tolerance at every substep that is as long as the hold."""
    task, (horizon, _, n), lane = starts.task, trace.shape, np.arange(trace.shape[2])
    away = np.abs(trace[:, 1:] - starts.goal) - task.tolerance
    hold = int(np.ceil(task.hold / starts.period - 0.5 - 1e-9))
    excess = np.maximum(away, 0.0).sum(axis=1) + np.where(alive, 0.0, 1.0)  # of every period, m
    sums = np.vstack([np.zeros(n), excess.cumsum(axis=0)])
    window = np.full((horizon + 1, n), np.inf)
    window[hold:] = sums[hold:] - sums[:-hold]
    worst = np.vstack([np.full(n, np.inf), np.where(alive, away.max(axis=1), np.inf)])
    inside = (worst <= 0.0).cumsum(axis=0)
    held = np.zeros((horizon + 1, n), dtype=np.bool_)
    held[hold:] = inside[hold:] - inside[:-hold] == hold
    held[starts.step_limit + 1 :] = False
    found, steps = held.any(axis=0), held.argmax(axis=0)
    short = np.minimum(window[np.maximum(steps - 1, 0), lane], 1e3)
    finer = steps - 1 + short / (short + _SLACK)
    value = np.where(found, finer * starts.period, FAILED * (1.0 + np.minimum(window.min(axis=0), 1e3)))
    return value, np.where(found, steps * starts.period, np.nan), np.where(found, steps, horizon)


def _tracked(starts: Starts, trace: np.ndarray, alive: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """RMS error over the ends of the periods."""
    steps = len(trace)
    error = trace[:, -1] - starts.reference[:, 1 : steps + 1].T
    rms = np.sqrt((error * error).mean(axis=0))
    value = np.where(alive.all(axis=0), rms, FAILED + rms)
    return value, np.where(alive.all(axis=0), rms, np.nan), np.full(trace.shape[2], steps)
