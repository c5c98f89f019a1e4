"""The actuators: every degree of freedom of the rig moves towards its command at its limited speed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled import kernel
from .lanes import absolute, floor, load, maximum, minimum, spread, store

__all__ = ["LIMIT", "Actuators", "Limit", "servo"]


class Limit(NamedTuple):
    """Fields of ``limits[d, field, lane]``.

    speed : rad/s, m/s or A/s at most
    low, high : rad, m or A; a turn's range is the circle about its home and does not limit it
    """

    speed: int
    low: int
    high: int


LIMIT = Limit(*range(len(Limit._fields)))


class Actuators(NamedTuple):
    """The rig's degrees of freedom as kernels read and move them.

    limits : (dof, `Limit`, lanes)
    is_turn : (dof,)
    q, command : (dof, lanes) rad, m or A, where they are and where they shall go
    """

    limits: np.ndarray
    is_turn: np.ndarray
    q: np.ndarray
    command: np.ndarray


@kernel
def servo(actuators, q, lane, mean, h):
    """Move every degree of freedom for `h` s, a turn the short way round.

    actuators : `Actuators`; lane : the block's first
    q, mean : (dof, LANES). `mean` receives where it was on average over `h`, with which the magnet acts: a servo that
        arrives within the step would otherwise make the step first order in h.

    Returns how far they moved, summed.
    """
    travel, limits = spread(0.0), actuators.limits
    for d in range(q.shape[0]):
        at, goal = load(q, d), load(actuators.command, d, lane)
        if actuators.is_turn[d]:
            gap = goal - at
            gap = gap - 2.0 * math.pi * floor(gap * (0.5 / math.pi) + 0.5)
        else:
            gap = minimum(maximum(goal, load(limits, d, LIMIT.low, lane)), load(limits, d, LIMIT.high, lane)) - at
        most = load(limits, d, LIMIT.speed, lane) * h
        moved = minimum(maximum(gap, -most), most)
        store(mean, d, at + moved * (1.0 - 0.5 * minimum(absolute(gap) / most, 1.0)))
        store(q, d, at + moved)
        travel = travel + absolute(moved)
    return travel
