"""The env's own judgement, for episodes that were simulated without an env.

Nothing else in `agents` calls the env's kernels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from magwire_env.envs import kernels
from magwire_env.envs.kernels import EPISODE, VALUE
from magwire_env.envs.rewards import TERMS
from magwire_env.envs.task import Task
from magwire_env.simulation.lanes import LANES
from magwire_env.simulation.readout import ROW

__all__ = ["Verdict", "verdict"]


@dataclass(frozen=True, eq=False)
class Verdict:
    """The env's judgement of n episodes of at most H control periods.

    success : (n,); in a tracking task for the whole horizon
    steps : (n,) control periods until the episode ended; H if it did not
    time : (n,) s until it ended, to the crossing of the goal in a steering task; NaN if it did not
    alive : (H, n) the tip was in the tract up to the end of this control period
    rms_error : (n,) m over all H control periods, of a tracking task
    least : (n,) m, the least way left at the end of a control period
    """

    success: np.ndarray
    steps: np.ndarray
    time: np.ndarray
    alive: np.ndarray
    rms_error: np.ndarray
    least: np.ndarray


def verdict(
    task: Task,
    trace: np.ndarray,
    goal: np.ndarray,
    reference: np.ndarray,
    step_limit: int,
    period: float,
    final: np.ndarray | None = None,
    far: np.ndarray | None = None,
) -> Verdict:
    """Judge recorded episodes by the env's kernel.

    trace : (H, substeps + 1, n) m, tip arc lengths through every control period
    goal : (n,) m
    reference : (n, H + 1 or more) m, of a tracking task
    step_limit : control periods that an episode lasts at most
    period : control period, s
    final : (n,) m, of a task that comes back
    far : (n,) m, the tracts' lengths, of a task that ends there

    A trace goes on where its episode has ended, and a tip outside of the tract may then meet a magnet: nothing it does
    there counts. Raises `RuntimeError` for a wire that diverges before.
    """
    horizon, points, n = trace.shape
    width = -(-n // LANES) * LANES  # kernels work on whole blocks of lanes
    left = np.zeros((horizon, points, width))  # ways left to the goals, m
    left[:, :, :n] = (reference[:, 1 : horizon + 1].T[:, None] if task.kind.follows else goal) - trace
    rule = task.kind.rule
    lanes, readout = np.zeros((len(EPISODE), width)), np.zeros((len(ROW), width))
    lanes[EPISODE.start_distance] = lanes[EPISODE.route_length] = 1.0
    lanes[EPISODE.wall_limit] = np.inf
    lanes[EPISODE.sense] = 1.0
    lanes[EPISODE.far] = np.inf
    if task.kind.ends_far:
        assert far is not None  # of every start of such a task
        lanes[EPISODE.far, :n] = far
    if task.kind.returns:
        assert final is not None  # of every start of such a task
        lanes[EPISODE.after, :n] = behind = np.abs(goal - final)
    values, summary = np.empty((len(VALUE), width)), np.zeros((len(kernels.SUMMARY), n))
    unsafe, weights = 0.0, np.zeros(len(TERMS))  # no safety mode, and rewards are not asked for
    running, success, alive = np.ones(n, np.bool_), np.zeros(n, np.bool_), np.ones((horizon, n), np.bool_)
    steps, time, least = np.full(n, horizon), np.full(n, np.nan), np.full(n, np.inf)
    for step in range(horizon):
        tip = trace[step, -1].copy()
        known = (np.abs(tip) < kernels.FARTHEST) & (np.abs(left[step, -1, :n]) < kernels.FARTHEST)
        lost = np.flatnonzero(~running & ~known)
        tip[lost], left[step, :, lost] = 0.0, 0.0
        readout[ROW.travelled, :n], readout[ROW.remaining] = tip, left[step, -1]
        diverged = kernels.judge(
            n, rule, readout, left[step], step_limit, period, task.tolerance, task.hold, unsafe, weights, lanes, values
        )
        if diverged >= 0:
            raise RuntimeError(f"the wire of plan {diverged} has diverged: its tip is at {trace[step, -1, diverged]} m")
        won, terminated, truncated = values[[VALUE.success, VALUE.terminated, VALUE.truncated], :n] > 0.0
        alive[step] = ~(terminated & ~won)
        ended = running & (terminated | truncated)
        kernels.summarise(np.flatnonzero(ended), rule, left[step], period, lanes, summary)
        steps[ended], time[ended], success[ended] = step + 1, summary[1, ended], won[ended]
        least = np.where(running & alive[step], np.minimum(least, values[VALUE.left, :n]), least)
        running &= ~ended
        if task.kind.returns and len(turning := np.flatnonzero(values[VALUE.turned, :n] > 0.0)):
            kernels.turn_back(turning, left[step], period, behind[turning], lanes)
            left[step + 1 :, :, turning] = final[turning] - trace[step + 1 :, :, turning]  # type: ignore[index]
    kernels.summarise(np.arange(n), rule, left[-1], period, lanes, summary)
    rms = summary[kernels.SUMMARY.index("rms_error")]
    return Verdict(success, steps, time, np.logical_and.accumulate(alive, axis=0), rms, least)
