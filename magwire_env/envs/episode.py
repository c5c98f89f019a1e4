"""How an episode begins: where the tip starts, where the goal is, which reference it follows.

Every function turns numbers drawn uniformly from [0, 1), (n, k), one row an episode, into arc lengths in m; the tract
may differ from episode to episode.
"""

from __future__ import annotations

import numpy as np

from .task import Task

__all__ = ["DRAWS", "beginnings", "references"]

DRAWS = {"steer": 1, "reach": 2, "track": 8}
"""Numbers a beginning is drawn from, by kind of task."""

_LEAST_WAY = 0.05
"""A target is at least this far from the start, m."""

_WAVES = 3


def beginnings(task: Task, drawn: np.ndarray, wire: np.ndarray, tract: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip positions and goals, (n,) m each, given the wires' and tracts' lengths (n,) m."""
    last = tract - task.goal_margin
    if task.kind == "steer":
        return wire + task.start_spread * (2 * drawn[:, 0] - 1), last
    if task.kind == "reach":
        start = wire + drawn[:, 0] * (last - wire)
        below = np.maximum(start - _LEAST_WAY - wire, 0.0)
        above = np.maximum(last - start - _LEAST_WAY, 0.0)
        way = drawn[:, 1] * (below + above)
        return start, np.where(way < below, start - _LEAST_WAY - way, start + _LEAST_WAY + way - below)
    start = references(task, drawn, wire, tract, np.zeros(1))[:, 0]
    return start, start


def references(task: Task, drawn: np.ndarray, wire: np.ndarray, tract: np.ndarray, times: np.ndarray) -> np.ndarray:
    """A tracking task's reference (n, len(times)) m at `times` s: slow waves about a middle, never beyond the tract.

    A sum of three sines with periods of 10 to 40 s; its amplitude is the largest that keeps it within the tract and
    its speed below the task's.
    """
    low, high = wire, tract - 2 * task.goal_margin
    share = 0.5 + np.abs(drawn[:, 1 : 1 + _WAVES])
    share /= share.sum(axis=1, keepdims=True)
    pace = 2 * np.pi / (10.0 + 30.0 * drawn[:, 4 : 4 + _WAVES])
    phase = (
        2
        * np.pi
        * np.stack([drawn[:, 7], (3 * drawn[:, 7] + drawn[:, 1]) % 1, (5 * drawn[:, 7] + drawn[:, 2]) % 1], axis=1)
    )
    size = np.minimum(task.reference_speed / (share * pace).sum(axis=1), 0.45 * (high - low))
    middle = low + size + drawn[:, 0] * (high - low - 2 * size)
    waves = share[:, :, None] * np.sin(pace[:, :, None] * times + phase[:, :, None])
    return middle[:, None] + size[:, None] * waves.sum(axis=1)
