"""Wires cut into the kernel's pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...physics.profile import Profile
from ...scenario import Scenario
from ..lanes import LANES
from . import layout as at

__all__ = ["Pieces", "pieces_of", "wire_rows"]


@dataclass
class Pieces:
    """A wire cut into N segments with N + 1 nodes: what the kernels know of it.

    rest : (N,) m; axial E A : (N,) N; radius : (N,) m; moment : (N,) A·m²; where : (N,) the place on its segment, 0 to
        1, where a moment feels the field; spin_inertia : (N,) kg·m²
    bending E I, twisting G J : (N + 1,) N·m² of the joints; curl : (N + 1, 2) 1/m natural curvature
    mass : (N + 1,) kg; drag : (N + 1,) N·s/m
    """

    rest: np.ndarray
    axial: np.ndarray
    bending: np.ndarray
    mass: np.ndarray
    drag: np.ndarray | float = 0.0
    twisting: np.ndarray | float = 0.0
    curl: np.ndarray | tuple[float, float] = (0.0, 0.0)
    radius: np.ndarray | float = 1e-4
    moment: np.ndarray | float = 0.0
    where: np.ndarray | float = 0.5
    spin_inertia: np.ndarray | float = 0.0

    @property
    def segments(self) -> int:
        return len(self.rest)

    @classmethod
    def uniform(
        cls,
        rest: np.ndarray,
        bending: float,
        axial: float,
        mass: float,
        twisting: float = 0.0,
        drag: float = 0.0,
        radius: float = 1e-3,
    ) -> Pieces:
        """A wire of the same properties everywhere, cut into segments of length `rest` (N,) m.

        bending E I, twisting G J : N·m²; axial E A : N; mass : kg/m; drag : N·s/m²; radius : m
        """
        rest = np.asarray(rest, dtype=np.float64)
        share = np.zeros(len(rest) + 1)  # m of wire that a node stands for
        share[:-1] += 0.5 * rest
        share[1:] += 0.5 * rest
        return cls(
            rest=rest, axial=np.full(len(rest), axial), bending=np.full(len(share), bending), mass=mass * share,
            drag=drag * share, twisting=twisting, radius=radius, spin_inertia=0.5 * mass * rest * radius**2,
        )  # fmt: skip

    def with_rigid_tip(self, length: float, moment: float, mass: float = 0.0) -> Pieces:
        """The same wire with a rigid magnet of `length` m, `moment` A·m² and `mass` kg at its end.

        The joint between them bends over half of the wire's last segment alone.
        """

        def more(value: np.ndarray | float, count: int, last: float) -> np.ndarray:
            return np.append(np.broadcast_to(value, count), last)

        def largest(value: np.ndarray | float) -> float:
            return float(np.max(value))

        n, below = self.segments, float(self.rest[-1])
        out = Pieces(
            rest=more(self.rest, n, length),
            axial=more(self.axial, n, largest(self.axial)),
            bending=more(self.bending, n + 1, 0.0),
            mass=more(self.mass, n + 1, 0.5 * mass),
            drag=more(self.drag, n + 1, 0.0),
            twisting=more(self.twisting, n + 1, 0.0),
            curl=np.vstack([np.broadcast_to(self.curl, (n + 1, 2)), [0.0, 0.0]]),
            radius=more(self.radius, n, largest(self.radius)),
            moment=more(self.moment, n, moment),
            where=more(self.where, n, 0.5),
            spin_inertia=more(self.spin_inertia, n, largest(self.spin_inertia)),
        )
        for stiffness in (out.bending, np.asarray(out.twisting)):
            stiffness[n] *= (below + length) / below
        out.mass[n] += 0.5 * mass
        return out


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
