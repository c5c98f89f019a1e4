"""Observation channels of a wire that is fed through a tree: the route ahead, its own shape, contact, base, magnet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..simulation import Simulator
from ..simulation.readout import ROW
from .channel import LENGTH_SCALE, WALL_SCALE, Channel, Number, always, rows_of
from .moment import moments

if TYPE_CHECKING:
    from .episodes import Episodes

__all__ = ["ROUTE_CHANNELS", "ROUTE_OFFSETS", "SHAPE_OFFSETS", "tip_frame"]

ROUTE_OFFSETS = (0.0, 0.01, 0.02, 0.04)
"""m ahead of the tip, along the route, at which the route's channels look."""

WIRE_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Shares of the wire from its clamp to its tip at which `wire_points` and `wanted_points` look."""

SHAPE_OFFSETS = (0.01, 0.02, 0.04)
"""m behind the tip, along the wire, at which `tip_points` looks."""


def tip_frame(sim: Simulator) -> np.ndarray:
    """The tip's frame, (n, 3, 3): rows are the tip's direction, the part of z across it, and their product.

    Where the tip points along z, y takes the place of z.
    """
    t = sim.tip_tangent
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    up = np.where((np.abs(t[:, 2:]) > 0.99), [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    up = up - (up * t).sum(axis=1, keepdims=True) * t
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return np.stack([t, up, np.cross(t, up)], axis=1)


def _numbers(sim: Simulator, count: int, quantity: str = "", free: int = 0) -> Sequence[Number]:
    """`count` numbers that suffer a reading's error, and `free` that do not."""
    return [Number(scale=LENGTH_SCALE, quantity=quantity)] * count + [Number()] * free


def _sized(count: int, quantity: str = "", free: int = 0) -> Callable[[Simulator], Sequence[Number]]:
    return partial(_numbers, count=count, quantity=quantity, free=free)


def _contact(sim: Simulator) -> Sequence[Number]:
    return [number for row in (ROW.mean_wall, ROW.peak_wall) for number in rows_of(row, WALL_SCALE, "force")(sim)]


def _magnet_centre(sim: Simulator) -> np.ndarray:
    """(n, 3) m, of the first magnet; the world's origin where the rig has coils alone."""
    magnets = sim.magnet_positions
    return magnets[:, 0] if magnets.shape[1] else np.zeros((sim.num_envs, 3))


def _route(sim: Simulator, origin: np.ndarray, frame: np.ndarray | None) -> np.ndarray:
    """Points of the route ahead from `origin` (n, 3) over the length scale, then directions, in `frame` (n, 3, 3)."""
    points, ways, _ = sim.ahead(np.array(ROUTE_OFFSETS))
    points = (points - origin[:, None]) / LENGTH_SCALE
    if frame is not None:
        points, ways = (np.einsum("nij,nkj->nki", frame, v) for v in (points, ways))
    return np.concatenate([points.reshape(len(points), -1), ways.reshape(len(points), -1)], axis=1)


def _route_from_tip(sim: Simulator, episodes: Episodes) -> np.ndarray:
    return _route(sim, sim.tip_position, tip_frame(sim))


def _route_from_magnet(sim: Simulator, episodes: Episodes) -> np.ndarray:
    return _route(sim, _magnet_centre(sim), None)


def _tip_points(sim: Simulator, episodes: Episodes) -> np.ndarray:
    """Points of the wire behind the tip, from the tip; where less wire is inside, its node at the inlet."""
    nodes, tip = sim.positions, sim.tip_position
    pieces = np.array([sc.wire.segment_length for sc in sim.library.scenarios])[sim.lane_scenario]
    lanes, last, out = np.arange(len(nodes)), nodes.shape[1] - 1, []
    first = np.isnan(nodes[:, :, 0]).sum(axis=1)
    for offset in SHAPE_OFFSETS:
        at = np.maximum(last - offset / pieces, first)
        below = np.minimum(np.floor(at).astype(np.int64), last - 1)
        share = (at - below)[:, None]
        out.append(((1 - share) * nodes[lanes, below] + share * nodes[lanes, below + 1] - tip) / LENGTH_SCALE)
    return np.concatenate(out, axis=1)


def _contact_points(sim: Simulator, episodes: Episodes) -> np.ndarray:
    """The wall's force on the last three nodes of the wire."""
    forces = sim.contact_forces[:, -3:] / WALL_SCALE
    return forces.reshape(sim.num_envs, -1)


def _base(sim: Simulator, episodes: Episodes) -> np.ndarray:
    """The push at the base along the inlet's direction, and the wire inserted over the route's length."""
    into = np.array([sc.tree.trunk.curve.tangent(0.0) for sc in sim.library.scenarios])[sim.lane_scenario]
    push = (sim.base_force * into).sum(axis=1) / WALL_SCALE
    return np.stack([push, sim.inserted_length / sim.route_length], axis=1)


def _pose(sim: Simulator, episodes: Episodes) -> np.ndarray:
    """The first magnet's moment, and its centre from the tip."""
    away = (_magnet_centre(sim) - sim.tip_position) / LENGTH_SCALE
    moment = moments(sim)[:, 0] if sim.library.magnet_count else sim.tip_field / 10e-3
    return np.concatenate([moment, away], axis=1)


def _at_shares(nodes: np.ndarray) -> np.ndarray:
    """Points of wires with nodes (n, nodes, 3) m at `WIRE_SHARES`, from the first node, as the channels show them."""
    place = np.array(WIRE_SHARES) * (nodes.shape[1] - 1)
    below = np.minimum(place.astype(np.int64), nodes.shape[1] - 2)
    share = (place - below)[:, None]
    points = nodes[:, below] + share * (nodes[:, below + 1] - nodes[:, below]) - nodes[:, :1]
    return points.reshape(len(nodes), -1) / LENGTH_SCALE


def _wire_points(sim: Simulator, episodes: Episodes) -> np.ndarray:
    return _at_shares(sim.positions)


def _wanted_points(sim: Simulator, episodes: Episodes) -> np.ndarray:
    assert episodes.shapes is not None  # see `Channel.check`
    return _at_shares(episodes.shapes.wanted)


_ROUTE_SIZE = 3 * len(ROUTE_OFFSETS)

ROUTE_CHANNELS: dict[str, Channel] = {
    "route_from_tip": Channel(
        10, "route 0, 10, 20, 40 mm ahead, in the tip's frame (along it, across it towards z, across both): points "
        "from the tip / 0.1 m, then directions",
        _sized(_ROUTE_SIZE, "length", _ROUTE_SIZE), always(_route_from_tip),
    ),
    "route_from_magnet": Channel(
        10, "route 0, 10, 20, 40 mm ahead, in the world's axes: points from the first magnet's centre (from the origin "
        "where the rig has coils alone) / 0.1 m, then directions",
        _sized(_ROUTE_SIZE, "length", _ROUTE_SIZE), always(_route_from_magnet),
    ),
    "tip_points": Channel(
        10, "points of the wire 10, 20, 40 mm behind the tip, from the tip / 0.1 m",
        _sized(3 * len(SHAPE_OFFSETS), "length"), always(_tip_points),
    ),
    "wire_points": Channel(
        10, "the wire at a quarter, half and three quarters of its length, and its tip, from the base / 0.1 m",
        _sized(3 * len(WIRE_SHARES), "length"), always(_wire_points),
    ),
    "wanted_points": Channel(
        10, "the same of the wanted shape", _sized(0, free=3 * len(WIRE_SHARES)), always(_wanted_points),
        shapes=True,
    ),
    "contact": Channel(
        10, "the wall's normal forces summed over the wire: mean and largest of the last control period / 0.1 N",
        _contact,
    ),
    "tip_contact": Channel(
        10, "force of the wall on the wire's last three nodes, x y z each / 0.1 N", _sized(0, free=9),
        always(_contact_points),
    ),
    "astray": Channel(10, "way back from a wrong branch to the route / 0.1 m", rows_of(ROW.astray, LENGTH_SCALE, "")),
    "base": Channel(
        10, "push of the feed / 0.1 N, and the wire inserted / route's length", _sized(0, free=2), always(_base),
        needs="base",
    ),
    "magnet_pose": Channel(
        10, "direction of the first magnet's moment, and its centre from the tip / 0.1 m; where the rig has coils "
        "alone the field at the tip / 10 mT, and the origin from the tip / 0.1 m",
        _sized(0, free=6), always(_pose),
    ),
}  # fmt: skip
