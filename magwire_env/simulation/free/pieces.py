"""A scenario's wire cut into the kernel's pieces."""

from __future__ import annotations

import numpy as np

from ...physics.profile import Profile
from ...scenario import Scenario
from ..lanes import LANES
from . import layout as at
from .wires import Pieces

__all__ = ["pieces_of", "wire_rows"]


def pieces_of(sc: Scenario) -> Pieces:
    """Segments of equal length with the scenario's profiles: springs in series, masses and moments as integrals.

    The tip magnet is rigid and points along the last segment: its moment feels the field at the last node, and half a
    cell of bend lies between it and the joint behind it, in series, as in `magwire_env.physics.rod`.
    """
    wire, n = sc.wire, sc.wire.segments
    length = wire.segment_length
    ends = length * np.arange(n + 1)
    low, high = np.maximum(ends - 0.5 * length, 0.0), np.minimum(ends + 0.5 * length, wire.length)
    bending = _along(wire.bending, wire.bending_rigidity, low, high, inverse=True)
    bending[n - 1] *= 2.0 / 3.0
    line = _along(wire.mass_per_length, wire.density * wire.area, low, high)
    mass = line * (high - low)
    mass[-1] += sc.tip.mass or 0.0
    radius = _along(wire.outer_radius, wire.radius, ends[:-1], ends[1:])
    line = _along(wire.mass_per_length, wire.density * wire.area, ends[:-1], ends[1:])
    moment = length * _along(wire.magnetisation, 0.0, ends[:-1], ends[1:])
    where = np.full(n, 0.5)
    tip, own = sc.tip.moment, abs(moment[-1])
    where[-1] = (tip + 0.5 * own) / (tip + own)
    moment[-1] += tip
    twisting = _along(wire.twisting, 0.0, low, high, inverse=True) if wire.twisting else np.zeros(n + 1)
    curl = np.stack([_along(p, 0.0, low, high) for p in (wire.curl, wire.curl_across)], axis=1)
    return Pieces(
        rest=np.full(n, length),
        axial=_along(wire.axial, wire.axial_rigidity, ends[:-1], ends[1:], inverse=True),
        bending=bending,
        mass=mass,
        drag=sc.contact.drag * (high - low),
        twisting=twisting,
        curl=curl,
        radius=radius,
        moment=moment,
        where=where,
        spin_inertia=0.5 * line * length * radius**2,
    )


def wire_rows(pieces: Pieces, nodes: int) -> np.ndarray:
    """What `layout` keeps of a wire's nodes, (nodes, fields); a shorter wire's spare nodes come first."""
    n = pieces.segments
    spare = nodes - 1 - n
    rows = np.zeros((nodes, at.WIRE_STRIDE // LANES))
    curl = np.broadcast_to(pieces.curl, (n + 1, 2))
    for field, value, count in (
        (at.REST, pieces.rest, n), (at.AXIAL, pieces.axial, n), (at.RADIUS, pieces.radius, n),
        (at.MOMENT, pieces.moment, n), (at.AT, pieces.where, n), (at.SPIN_INERTIA, pieces.spin_inertia, n),
        (at.BENDING, pieces.bending, n + 1), (at.TWISTING, pieces.twisting, n + 1), (at.CURL_1, curl[:, 0], n + 1),
        (at.CURL_2, curl[:, 1], n + 1), (at.MASS, pieces.mass, n + 1), (at.DRAG, pieces.drag, n + 1),
    ):  # fmt: skip
        rows[spare : spare + count, field // LANES] = value
    rows[:spare, at.REST // LANES] = pieces.rest[0]
    rows[-1, at.REST // LANES] = pieces.rest[-1]
    bare = rows[:, at.RADIUS // LANES] == 0.0
    rows[bare, at.RADIUS // LANES] = np.ravel(pieces.radius)[0]
    return rows


def _along(
    profile: Profile | None, constant: float, low: np.ndarray, high: np.ndarray, inverse: bool = False
) -> np.ndarray:
    """Means over intervals, of a profile or of a constant."""
    return np.full(low.shape, constant) if profile is None else profile.mean(low, high, inverse)
