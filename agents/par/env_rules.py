"""The env's own rules, for lanes that are simulated without an env: commands from actions, and the judgement.

Nothing else in `agents` calls the env's kernels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from magwire_env.envs import kernels
from magwire_env.envs.task import KINDS, Task
from magwire_env.simulation.lanes import LANES
from magwire_env.simulation.locked import algorithm1 as a1
from magwire_env.simulation.locked.arrays import LaneArrays

__all__ = ["Verdict", "verdict", "write_command"]


def write_command(arrays: LaneArrays, actions: np.ndarray, period: float) -> None:
    """Write the command of actions (m, dof) in the mode "angle" into the first m lanes of `arrays`."""
    lane = kernels.command_of(
        kernels.ANGLE, actions, arrays.library.is_turn, period, arrays.dofs, arrays.q, arrays.command
    )
    if lane >= 0:
        raise ValueError(f"actions[{lane}] must be numbers in [-1, 1], got {actions[lane].tolist()}")


@dataclass(frozen=True, eq=False)
class Verdict:
    """The env's judgement of n episodes of at most H control periods.

    success : (n,); in a tracking task for the whole horizon
    steps : (n,) control periods until the episode ended; H if it did not
    time : (n,) s until it ended, to the crossing of the goal in a steering task; NaN if it did not
    alive : (H, n) the tip was in the tract up to the end of this control period
    rms_error : (n,) m over all H control periods, of a tracking task
    """

    success: np.ndarray
    steps: np.ndarray
    time: np.ndarray
    alive: np.ndarray
    rms_error: np.ndarray


def verdict(
    task: Task, trace: np.ndarray, goal: np.ndarray, reference: np.ndarray, step_limit: int, period: float
) -> Verdict:
    """Judge recorded episodes by the env's kernel.

    trace : (H, substeps + 1, n) m, tip arc lengths through every control period
    goal : (n,) m
    reference : (n, H + 1 or more) m, of a tracking task
    step_limit : control periods that an episode lasts at most
    period : control period, s
    """
    horizon, points, n = trace.shape
    width = -(-n // LANES) * LANES  # kernels work on whole blocks of lanes
    padded = np.zeros((horizon, points, width))
    padded[:, :, :n] = trace
    kind = KINDS.index(task.kind)
    lanes, out = np.zeros((kernels.LANE_FIELDS, width)), np.zeros((a1.OF_ALL, width))
    lanes[kernels.GOAL, :n] = goal
    lanes[kernels.START_DISTANCE] = lanes[kernels.TRACT_LENGTH] = 1.0
    lanes[kernels.WALL_LIMIT] = np.inf
    values, summary = np.empty((kernels.VALUE_FIELDS, width)), np.zeros((len(kernels.SUMMARY), n))
    unsafe, weights = 0.0, np.zeros(4)  # no safety mode, and rewards are not asked for
    running, success, alive = np.ones(n, np.bool_), np.zeros(n, np.bool_), np.ones((horizon, n), np.bool_)
    steps, time = np.full(n, horizon), np.full(n, np.nan)
    for step in range(horizon):
        if task.kind == "track":
            lanes[kernels.GOAL, :n] = reference[:, step + 1]
        out[a1.TIP_S // LANES] = padded[step, -1]
        kernels.judge(
            n, kind, out, padded[step], step_limit, period, task.tolerance, task.hold, unsafe, weights, lanes, values
        )
        won, terminated, truncated = values[[kernels.SUCCESS, kernels.TERMINATED, kernels.TRUNCATED], :n] > 0.0
        alive[step] = ~(terminated & ~won)
        ended = running & (terminated | truncated)
        kernels.summarise(np.flatnonzero(ended), kind, padded[step], period, lanes, summary)
        steps[ended], time[ended], success[ended] = step + 1, summary[1, ended], won[ended]
        running &= ~ended
    kernels.summarise(np.arange(n), kind, padded[-1], period, lanes, summary)
    return Verdict(success, steps, time, np.logical_and.accumulate(alive, axis=0), summary[-1])
