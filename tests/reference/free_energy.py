"""The energy of free wires, written out in NumPy: an account of its own, that shares no kernel with the simulator.

Only the mesh and the walls' tables are the simulator's: `pieces_of`, `Tube` and `Bricks`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from magwire_env.physics.dipoles import field
from magwire_env.scenario import Scenario, Slide, Turn
from magwire_env.simulation import Simulator
from magwire_env.simulation.free.bricks import CELLS, INSIDE, KEPT, Bricks
from magwire_env.simulation.free.pieces import pieces_of
from magwire_env.simulation.free.tubes import Tube
from magwire_env.simulation.free.walls import _wall_of

__all__ = ["Account", "Wires"]

FEED_STIFFNESS = 1e5
"""N/m, of the drive behind a wire that is fed."""


@dataclass(frozen=True)
class Account:
    """Of n wires, (n,) each.

    kinetic, potential : J; potential is stretch, bend, twist, wall, magnets, weight and the drive of the feed
    parts : J, (parts, n), what the potential is made of
    """

    kinetic: np.ndarray
    parts: np.ndarray

    @property
    def potential(self) -> np.ndarray:
        return self.parts.sum(axis=0)

    @property
    def scale(self) -> np.ndarray:
        """J, the sum of the parts' sizes: what rounding goes by."""
        return self.kinetic + np.abs(self.parts).sum(axis=0)


@dataclass(frozen=True)
class Wires:
    """The state of n wires of one scenario, from tail to tip.

    x, v : (n, nodes, 3) m, m/s
    director, spin : (n, nodes, 3) and (n, nodes) rad/s, of the segments above the nodes, or None
    first : (n,) the first node outside the sleeve; cell, out : (n,) m, length of the segment above it, and of the wire
        above that; goal : (n,) m of wire that the drive wants outside; clamp : (n, 3), the director of the base
    feet : (n, points, 2), rows of the tube's table and m along them, where the contact points last touched it: a tract
        may pass by itself, and a wire touches the turn that it is in
    rig : (n, dof)
    """

    scenario: Scenario
    x: np.ndarray
    v: np.ndarray
    director: np.ndarray | None
    spin: np.ndarray | None
    first: np.ndarray
    cell: np.ndarray
    out: np.ndarray
    goal: np.ndarray
    clamp: np.ndarray
    feet: np.ndarray
    rig: np.ndarray

    @classmethod
    def of(cls, sim: Simulator, entry: int) -> Wires:
        """Those lanes of a simulator that run its scenario `entry`."""
        state, scenario = sim.state(), sim.scenarios[entry]
        n, mine = scenario.wire.segments + 1, sim.lane_scenario == entry

        def part(name: str, size: int) -> np.ndarray:
            return state.part(name)[mine].reshape(int(mine.sum()), -1, size)

        twists = "directors" in state.columns
        spare = sim.model.nodes - n
        wall, k = wall_of(scenario), scenario.contact.per_segment
        feet = part("feet", 2)[:, spare * k : spare * k + (n - 1) * k + 1].copy()
        if isinstance(wall, Tube):
            feet[..., 0] -= sim.library.wires.walls.first_row[entry] - wall.first_row
            feet = np.where(feet[..., :1] >= 0.0, feet, (wall.first_row, 0.0))  # of a point that has not come out yet
        base = state.part("base")[mine]
        return cls(
            scenario, part("positions", 3)[:, spare:], part("velocities", 3)[:, spare:],
            part("directors", 3)[:, spare:] if twists else None, part("spins", 1)[:, spare:, 0] if twists else None,
            base[:, 0].astype(np.int64) - spare, base[:, 1], base[:, 4], base[:, 4] + base[:, 5], base[:, 7:10],
            feet, state.magnet[mine],
        )  # fmt: skip

    def under(self, other: Wires) -> Wires:
        """These wires with their actuators where the `other` wires have them."""
        return replace(self, rig=other.rig, goal=other.goal, clamp=other.clamp)

    def moved(self, way: Wires, share: float) -> Wires:
        """These wires after a share of the motion to here from the wires `way`, which have the same nodes."""
        director = None
        if self.director is not None and way.director is not None:
            director = self.director + share * (self.director - way.director)
            e = np.diff(self.x + share * (self.x - way.x), axis=1, append=0.0)
            t = e / np.linalg.norm(e, axis=-1, keepdims=True)
            director = director - _dot(director, t)[..., None] * t
            director = director / np.linalg.norm(director, axis=-1, keepdims=True)
        return replace(
            self, x=self.x + share * (self.x - way.x), director=director,
            cell=self.cell + share * (self.cell - way.cell),
        )  # fmt: skip

    def path(self, before: Wires, step: float) -> np.ndarray:
        """(n,) m, the ways of all coordinates since `before`, `step` s ago; a spin's is on its segment's length."""
        ways = np.abs(self.x - before.x).sum(axis=(1, 2)) + np.abs(self.cell - before.cell)
        if self.spin is not None:
            ways += np.abs(self.spin).sum(axis=1) * step * self.scenario.wire.segment_length
        return ways

    @property
    def slack(self) -> np.ndarray:
        """(n,) how far the drive's spring is pressed, over what its force allows; 1 and more where it slips."""
        feed = self.scenario.rig.feed
        if feed is None:
            return np.zeros(len(self.x))
        return np.abs(self.out + self.cell - self.goal) * FEED_STIFFNESS / feed.force

    def account(self) -> Account:
        """Kinetic and potential energy."""
        sc, pieces = self.scenario, pieces_of(self.scenario)
        nodes = self.x.shape[1]
        fed = sc.rig.feed is not None
        number = np.arange(nodes)
        active = number[: nodes - 1] >= self.first[:, None]  # segments
        begins = number[: nodes - 1] == self.first[:, None]
        moves = number >= self.first[:, None] + fed  # nodes: the mouth's own does not
        rest = np.where(begins & fed, self.cell[:, None], pieces.rest)
        e = np.where(active[..., None], np.diff(self.x, axis=1), (1.0, 0.0, 0.0))
        length = np.linalg.norm(e, axis=-1)
        t = e / length[..., None]
        parts = [
            (active * 0.5 * pieces.axial / rest * (length - rest) ** 2).sum(axis=1),
            *self._joints(active, begins, rest, t),
            self._wall(active, begins, rest),
            self._magnetic(active, e, t),
            -(moves * pieces.mass * (self.x @ np.array(sc.gravity))).sum(axis=1),
        ]
        if sc.rig.feed is not None:
            off, most = np.abs(self.out + self.cell - self.goal), sc.rig.feed.force
            slip = most * (off - 0.5 * most / FEED_STIFFNESS)
            parts.append(np.where(FEED_STIFFNESS * off > most, slip, 0.5 * FEED_STIFFNESS * off**2))
        kinetic = 0.5 * (moves * pieces.mass * _dot(self.v, self.v)).sum(axis=1)
        if self.spin is not None:
            kinetic += 0.5 * (active * pieces.spin_inertia * self.spin[:, : nodes - 1] ** 2).sum(axis=1)
        return Account(kinetic, np.array(parts))

    def _joints(self, active: np.ndarray, begins: np.ndarray, rest: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
        """Bend, and twist of wires that have it. The base's clamp, where there is one, bends over half a segment."""
        sc, pieces, nodes = self.scenario, pieces_of(self.scenario), self.x.shape[1]
        span = 0.5 * rest.copy()
        span[:, 1:] += np.where(begins[:, 1:], 0.0, 0.5 * rest[:, :-1])
        inlet = sc.tree.trunk.curve.tangent(0.0)
        below = np.concatenate([np.broadcast_to(inlet, (len(t), 1, 3)), t[:, :-1]], axis=1)
        below = np.where(begins[..., None], inlet, below)
        clamped = sc.rig.feed is not None or sc.rig.clamped
        holds = active & (~begins | clamped)
        kb = 2.0 * np.cross(below, t) / (1.0 + _dot(below, t))[..., None]
        bending = pieces.bending[: nodes - 1] / span
        if self.director is None:
            return [(holds * bending * 0.5 * _dot(kb, kb)).sum(axis=1)]
        m = self.director[:, : nodes - 1]
        m_below = np.concatenate([self.clamp[:, None], m[:, :-1]], axis=1)
        m_below = np.where(begins[..., None], self.clamp[:, None], m_below)
        carried = m_below - (_dot(m_below, t) / (1.0 + _dot(below, t)))[..., None] * (below + t)
        tau = np.arctan2(_dot(np.cross(carried, m), t), _dot(carried, m))
        twisting = np.broadcast_to(pieces.twisting, nodes)[: nodes - 1] / span
        curl = np.broadcast_to(pieces.curl, (nodes, 2))[: nodes - 1]
        k1, k2 = (curl[:, i] * span for i in (0, 1))
        natural = np.zeros_like(kb)
        for u, d in ((below, m_below), (t, m)):
            natural += 0.5 * (k1[..., None] * np.cross(u, d) - k2[..., None] * d)
        bend = 0.5 * _dot(kb, kb) - _dot(kb, natural) + 0.5 * (k1**2 + k2**2)
        return [(holds * bending * bend).sum(axis=1), (holds * 0.5 * twisting * tau**2).sum(axis=1)]

    def _contact_points(self) -> np.ndarray:
        """(n, points, 3) m: those of each segment from its lower node on, then the tip."""
        k = self.scenario.contact.per_segment
        share = (np.arange(k) / k)[:, None]
        inner = self.x[:, :-1, None] + share * (self.x[:, 1:] - self.x[:, :-1])[:, :, None]
        return np.concatenate([inner.reshape(len(self.x), -1, 3), self.x[:, -1:]], axis=1)

    def _wall(self, active: np.ndarray, begins: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Of the wall's springs: each contact point stands for its share of the wire; the tip for its cap, too."""
        sc, pieces = self.scenario, pieces_of(self.scenario)
        k, clamped = sc.contact.per_segment, sc.rig.feed is not None or sc.rig.clamped
        weight = np.repeat(rest, k, axis=1)
        below = np.concatenate([np.zeros((len(rest), 1)), rest[:, :-1]], axis=1)
        weight[:, ::k] = np.where(begins, 0.0 if clamped else 0.5 * rest, 0.5 * (rest + below))
        weight = np.where(np.repeat(active, k, axis=1), weight, 0.0) / k
        weight = np.concatenate([weight, 0.5 * rest[:, -1:] / k + sc.wire.radius], axis=1)
        radius = np.broadcast_to(pieces.radius, rest.shape[1])
        deep = depths(sc, self._contact_points(), self.feet) + np.append(np.repeat(radius, k), radius[-1])
        return (0.5 * sc.contact.stiffness * weight * np.maximum(deep, 0.0) ** 2).sum(axis=1)

    def _magnetic(self, active: np.ndarray, e: np.ndarray, t: np.ndarray) -> np.ndarray:
        """−Σ m t·B."""
        pieces, n = pieces_of(self.scenario), len(self.x)
        moment, where = (np.broadcast_to(v, e.shape[1]) for v in (pieces.moment, pieces.where))
        places = self.x[:, :-1] + where[:, None] * e
        total, dof = np.zeros(n), 0
        for mount in self.scenario.rig.magnets:
            cloud = mount.magnet.dipoles(*mount.dipoles)
            centre, turn = np.broadcast_to(mount.position, (n, 3)).copy(), np.broadcast_to(np.eye(3), (n, 3, 3))
            for degree in mount.dofs:
                axis = "xyz".index(degree.axis)
                if isinstance(degree, Slide):
                    centre[:, axis] += self.rig[:, dof]
                elif isinstance(degree, Turn):
                    turn = _turns(axis, self.rig[:, dof]) @ turn
                dof += 1
            magnetic = np.flatnonzero(moment)
            seen = np.einsum("nji,nkj->nki", turn, places[:, magnetic] - centre[:, None])
            b = field(cloud, seen.reshape(-1, 3)).reshape(seen.shape)
            b = np.einsum("nij,nkj->nki", turn, b)
            total -= (active[:, magnetic] * moment[magnetic] * _dot(t[:, magnetic], b)).sum(axis=1)
        return total


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=-1)


def _turns(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) about a world axis."""
    out = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i], out[:, i, j] = np.sin(angle), -np.sin(angle)
    return out


@lru_cache(maxsize=16)
def wall_of(scenario: Scenario) -> Tube | Bricks:
    """The scenario's wall."""
    return _wall_of(scenario)


def depths(scenario: Scenario, points: np.ndarray, feet: np.ndarray) -> np.ndarray:
    """How far points (..., 3) m lie behind the wall, negative inside, m; feet (..., 2) are near those on a tube."""
    flat, wall = points.reshape(-1, 3), wall_of(scenario)
    if isinstance(wall, Tube):
        return _in_tube(wall, flat, feet.reshape(-1, 2)).reshape(points.shape[:-1])
    trunk = scenario.tree.trunk
    out, inlet = flat - trunk.curve.position(0.0), trunk.curve.tangent(0.0)
    along = out @ inlet
    behind = np.linalg.norm(out - along[:, None] * inlet, axis=1) - trunk.radius(0.0)
    high = wall.origin + CELLS * wall.cell * np.array(wall.shape)
    beyond = (along < 0.0) & ((flat < wall.origin) | (flat >= high)).any(axis=1)
    return np.where(beyond, behind, _in_bricks(wall, flat)).reshape(points.shape[:-1])


def _in_tube(wall: Tube, points: np.ndarray, feet: np.ndarray) -> np.ndarray:
    row, u = feet[:, 0].astype(np.int64), feet[:, 1].copy()
    for _ in range(8):
        c, none, one = wall.table[row], np.zeros_like(u), np.ones_like(u)
        curve = c[:, :12].reshape(-1, 3, 4)
        x, t, bend = (
            np.einsum("nkp,np->nk", curve, np.stack(powers, axis=-1))
            for powers in ((one, u, u**2, u**3), (none, one, 2 * u, 3 * u**2), (none, none, 2 * one, 6 * u))
        )
        ahead = _dot(points - x, t) / np.maximum(_dot(t, t) - _dot(points - x, bend), 0.2)
        u = np.clip(u + ahead, c[:, 16], c[:, 17])
        over = np.clip(np.floor(u / wall.spacing), -1, 1)
        step = np.where(over < 0, c[:, 18], np.where(over > 0, c[:, 19], 0.0))
        u = np.where(step != 0, u - over * wall.spacing, u)
        row = row + step.astype(np.int64)
    c, powers = wall.table[row], np.stack([one, u, u**2, u**3], axis=-1)
    foot = np.einsum("nkp,np->nk", c[:, :12].reshape(-1, 3, 4), powers)
    radius = _dot(c[:, 12:16], powers)
    return np.sign(radius) * np.linalg.norm(points - foot, axis=1) - radius


def _in_bricks(wall: Bricks, points: np.ndarray) -> np.ndarray:
    place = (points - wall.origin) / wall.cell
    cell = np.floor(place).astype(np.int64)
    f, box, shape = place - cell, cell // CELLS, np.array(wall.shape)
    within = ((box >= 0) & (box < shape)).all(axis=1)
    brick = wall.index[np.ravel_multi_index(tuple(np.clip(box, 0, shape - 1).T), wall.shape)]
    here = within & (brick >= 0)
    block = wall.coefficients[np.where(here, brick, 0).astype(np.int64)].reshape(-1, KEPT, KEPT, KEPT)
    i = np.where(here[:, None], cell - CELLS * box, 0)[..., None] + np.arange(3)  # (n, axis, 3)
    near = block[np.arange(len(block))[:, None, None, None], i[:, 0, :, None, None], i[:, 1, None, :, None],
                 i[:, 2, None, None, :]].astype(np.float64)  # fmt: skip
    w = np.stack([0.5 * (1 - f) ** 2, 0.5 + f * (1 - f), 0.5 * f**2], axis=-1)
    phi = np.einsum("nijk,ni,nj,nk->n", near, w[:, 0], w[:, 1], w[:, 2])
    return np.where(here, -phi, np.where(within & (brick == INSIDE), -1e6, 1e6))
