"""What model-based controllers read from the observation: where the tip is, where the magnets are, where to go."""

from __future__ import annotations

import numpy as np

from magwire_env.envs.observation import LENGTH_SCALE, REFERENCE_OFFSETS, SPEED_SCALE

from .base import Controller

__all__ = ["aim_seen", "magnet_seen", "tip_seen", "way_seen"]


def tip_seen(controller: Controller, observation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The tip's arc length (n,) m and speed (n,) m/s; where the arc length is not observed, from the way left."""
    sim, core = controller.core.sim, controller.core
    length = sim.library.tract_length[sim.lane_scenario]
    if "tip_arclength" in core.observer.names:
        tip = controller.seen(observation, "tip_arclength")[:, 0] * length
    else:
        tip = core.goal - controller.seen(observation, "distance_left")[:, 0] * length
    return tip, controller.seen(observation, "tip_speed")[:, 0].astype(np.float64) * SPEED_SCALE


def way_seen(controller: Controller, observation: np.ndarray) -> np.ndarray:
    """The direction of travel in a steering task, (n,): 1, or −1 where a task that comes back is on its way back.

    There the goal lies behind the tip, so the way left is negative.
    """
    if not controller.core.task.kind.returns:
        return np.ones(len(observation))
    return np.where(controller.seen(observation, "distance_left")[:, 0] < 0.0, -1.0, 1.0)


def magnet_seen(controller: Controller, observation: np.ndarray) -> np.ndarray:
    """Setting of every degree of freedom, (n, dof): rad, within π of home, and m."""
    seen, at = controller.seen(observation, "magnet").astype(np.float64), 0
    _, low, high = controller.limits
    magnet = (low + high) / 2
    for d, turn in enumerate(controller.core.sim.library.is_turn):
        if turn:
            magnet[:, d] += np.arctan2(seen[:, at], seen[:, at + 1])
        else:
            magnet[:, d] += seen[:, at] * (high - low)[:, d] / 2
        at += 2 if turn else 1
    return magnet


def aim_seen(controller: Controller, observation: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Where the tip should be `times` (k,) s from now, (n, k) m: the goal, or a tracking task's reference.

    The reference is the polynomial through the points of `reference_preview`; after the last one it stands still.
    """
    tip, _ = tip_seen(controller, observation)
    if controller.core.task.kind.follows:
        ahead = controller.seen(observation, "reference_preview").astype(np.float64) * LENGTH_SCALE
        offsets = np.array(REFERENCE_OFFSETS)
        return tip[:, None] + ahead @ _lagrange(offsets, np.minimum(times, offsets[-1]))
    sim = controller.core.sim
    left = controller.seen(observation, "distance_left")[:, 0] * sim.library.tract_length[sim.lane_scenario]
    return np.repeat((tip + left)[:, None], len(times), axis=1)


def _lagrange(knots: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Weights (knots, times) of values at `knots` in their interpolating polynomial at `times`."""
    shares = np.ones((len(knots), len(times)))
    for i, a in enumerate(knots):
        for b in np.delete(knots, i):
            shares[i] *= (times - b) / (a - b)
    return shares
