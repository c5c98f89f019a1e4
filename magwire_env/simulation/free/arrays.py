"""The free wires of a batch: from scenarios to the kernels' arrays, and the face that the simulator sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from ...lumen.tube_kernels import KEPT
from ...scenario import Scenario
from ..lanes import LANES
from ..library import Library
from ..model import Places
from ..readout import ROW
from ..rig_arrays import RigLanes, aligned_zeros
from ..threads import cores, share_out
from . import layout as at
from . import magnetics, period, ways
from .library import FreeLibrary, LayingCurve

__all__ = ["FreeModel"]

_KEPT_OF_LANE = (
    at.FIRST, at.CELL, at.CELL_REST, at.CELL_SPEED, at.OUT, at.FEED_GOAL, at.SPUN, at.BASE_MX, at.BASE_MY, at.BASE_MZ,
)  # fmt: skip
"""Numbers of a lane, beside its nodes, that its future depends on."""


class FreeModel:
    """Rods in space that touch the wall; see `magwire_env.simulation.model.WireModel`.

    Of its readout: `drive` and `lateral` are the magnetic force on the tip along and across the centreline's direction
    there; `wall` is the sum of the wall's normal forces over the whole wire, in N.
    """

    name: ClassVar[str] = "free"
    supports: ClassVar[frozenset[str]] = frozenset({"vary", "base", "profiles", "branches", "contact"})

    def __init__(
        self, library: Library, rig: RigLanes, readout: np.ndarray, trace: np.ndarray, threads: int | None
    ) -> None:
        own: FreeLibrary = library.wires
        self._own, self._rig, self._readout, self._trace = own, rig, readout, trace
        self.nodes, n = own.nodes, rig.n
        blocks = -(-n // LANES)
        self._threads = threads or min(cores(), blocks)
        self._all, self._slots = np.arange(blocks), blocks * LANES
        self._par, self._lane = aligned_zeros(blocks, at.PAR_SIZE), aligned_zeros(blocks, at.LANE_SIZE)
        self._wire = aligned_zeros(blocks, self.nodes * at.WIRE_STRIDE)
        self._node = aligned_zeros(blocks, self.nodes * at.NODE_STRIDE)
        self._spin = aligned_zeros(blocks, self.nodes * at.SPIN_STRIDE) if own.twist else None
        self._foot = aligned_zeros(blocks, self.nodes * own.points * at.FOOT_STRIDE)
        self._entry = np.zeros(self._slots, dtype=np.int64)
        self._goal_branch, self._goal = np.zeros(rig.lanes, dtype=np.int64), np.zeros(rig.lanes)
        self._length = np.zeros(rig.lanes)
        self._magnetic = (own.wire[:, :, at.MOMENT // LANES] != 0.0).any(axis=0)
        self._batch = tuple(
            period.Batch(
                self._par, self._wire, self._lane, self._node, self._foot, self._magnetic, own.walls.table,
                own.walls.grid, self._goal_branch, self._goal, self._entry, own.walls.first_row, self._length,
            )
        )  # fmt: skip
        self._ways = tuple(own.ways)
        rigs = rig.library
        self._feed, self._twist = rigs.feed, rigs.twist
        self._outside = rigs.dof - (self._feed >= 0) - (self._twist >= 0)
        count = min(max(self._threads, 1), blocks)
        self._benches = [self._bench(own.steps, len(rigs.slots)) for _ in range(count)]
        self._look()
        self.columns = self._columns()
        self._fill()

    def _look(self) -> None:
        """Views of the flat arrays, by block and lane."""
        blocks = len(self._all)
        self._views = {
            "node": self._node.reshape(blocks, self.nodes, -1, LANES),
            "foot": self._foot.reshape(blocks, self.nodes * self._own.points, -1, LANES),
            "lane": self._lane.reshape(blocks, -1, LANES),
        }
        if self._spin is not None:
            self._views["spin"] = self._spin.reshape(blocks, self.nodes, -1, LANES)

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_views"}  # copied, they would view nothing

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._look()

    @staticmethod
    def library(scenarios: Sequence[Scenario]) -> FreeLibrary:
        """As `WireModel.library`."""
        return FreeLibrary(scenarios)

    def _bench(self, substeps: int, bodies: int) -> tuple:
        """The fields of `period.Bench`."""
        dof, points = self._outside, self._own.points
        flat = (
            self.nodes * at.WORK_STRIDE, self.nodes * points * at.LOAD_STRIDE, bodies * magnetics.POSE_STRIDE,
            (substeps + 1) * (at.MARKS + dof) * LANES, dof * 3 * LANES, 2 * dof * LANES, dof * LANES,
        )  # fmt: skip
        own = [aligned_zeros(max(size, LANES)) for size in flat]
        own += [aligned_zeros(max(dof, 1), LANES), aligned_zeros(period.OUT_ROWS, LANES), aligned_zeros(2, LANES)]
        own += [np.zeros((1, 3)), np.zeros((1, KEPT)), np.zeros((1, KEPT), dtype=np.int64), np.zeros((1, KEPT))]
        return tuple(period.Bench._make(own))

    def _columns(self) -> Mapping[str, slice]:
        sizes = {"positions": 3 * self.nodes, "velocities": 3 * self.nodes}
        if self._spin is not None:
            sizes |= {"directors": 3 * self.nodes, "spins": self.nodes}
        sizes |= {"feet": 2 * self.nodes * self._own.points, "base": len(_KEPT_OF_LANE)}
        ends = np.cumsum(list(sizes.values())).tolist()
        return {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}

    def _fill(self) -> None:
        """Every lane, the last block's spare ones too, gets a wire at the inlet; the spare ones never move."""
        every = np.arange(self._slots)
        entries = np.concatenate([self._rig.entry, np.full(self._slots - self._rig.n, self._rig.entry[0])])
        self.take(every, entries)
        self.lay(every, self.start(entries))
        spare = self._slots - self._rig.n
        if spare:
            view = self._par.reshape(len(self._all), -1, LANES)
            view[-1, at.STEPS // LANES, -spare:] = 0.0

    def take(self, lanes: np.ndarray, entries: np.ndarray) -> None:
        """As `WireModel.take`."""
        block, lane = np.divmod(lanes, LANES)
        self._entry[lanes], self._length[lanes] = entries, self._own.length[entries]
        self._par.reshape(len(self._all), -1, LANES)[block, :, lane] = self._own.par[entries]
        self._wire.reshape(len(self._all), self.nodes, -1, LANES)[block, :, :, lane] = self._own.wire[entries]

    def vary(self, lanes: np.ndarray, factors: Mapping[str, np.ndarray]) -> None:
        """As `WireModel.vary`."""
        block, lane = np.divmod(lanes, LANES)
        self._par.reshape(len(self._all), -1, LANES)[block, at.FRICTION // LANES, lane] *= factors["friction"]
        wire = self._wire.reshape(len(self._all), self.nodes, -1, LANES)
        for field in (at.AXIAL, at.BENDING, at.TWISTING):
            wire[block, :, field // LANES, lane] *= factors["stiffness"][:, None]

    def start(self, entries: np.ndarray) -> Places:
        """As `WireModel.start`: of a wire that is fed, at its feed's home."""
        return Places(self._own.home[entries])

    def lay(self, lanes: np.ndarray, places: Places) -> None:
        """As `WireModel.lay`. Raises `ValueError` for a place that the feed's limits do not allow."""
        if not len(lanes):
            return
        entries = self._entry[lanes]
        self._check_places(entries, places)
        rest = self._own.wire[entries][:, :, at.REST // LANES]
        n, own = len(lanes), self._own
        positions, along = np.zeros((n, self.nodes, 3)), np.zeros((n, self.nodes))
        cells, fed, spare = np.zeros((n, 3)), own.fed[entries], own.first_node[entries]
        groups: dict[int, tuple[LayingCurve, list[int]]] = {}
        for i, (entry, branch) in enumerate(zip(entries.tolist(), places.branch.tolist(), strict=True)):
            curve = own.laying_curve(entry, branch)
            groups.setdefault(id(curve), (curve, []))[1].append(i)
        for curve, members in groups.values():
            rows = np.array(members)
            x, s, c = positions[rows], along[rows], cells[rows]
            course = np.ascontiguousarray(np.broadcast_to(curve.course, (len(rows), len(curve.course))))
            tips = np.ascontiguousarray(curve.arc(places.s[rows]), dtype=np.float64)
            ways.lay(course, curve.table, tips, rest[rows], spare[rows], fed[rows], x, s, c)
            positions[rows], along[rows], cells[rows] = x, s, c
        self._put(lanes, entries, positions, along, cells)

    def _check_places(self, entries: np.ndarray, places: Places) -> None:
        first = self._own.ways.first[entries]
        inserted = self._own.ways.begin[first + places.branch] + places.s
        low, high = self._own.low[entries], self._own.high[entries]
        bad = self._own.fed[entries] & ((inserted < low - 1e-9) | (inserted > high + 1e-9))
        if bad.any():
            i = int(np.flatnonzero(bad)[0])
            raise ValueError(
                f"tip_arclength must lie where the feed can bring the tip, in [{low[i]:.4g}, {high[i]:.4g}] m along "
                f"the way from the inlet, got {inserted[i]:.4g} m"
            )

    def _put(
        self, lanes: np.ndarray, entries: np.ndarray, positions: np.ndarray, along: np.ndarray, cells: np.ndarray
    ) -> None:
        """Wires at rest into the arrays."""
        block, lane = np.divmod(lanes, LANES)
        own, n = self._own, len(lanes)
        node = np.zeros((n, self.nodes, at.NODE_STRIDE // LANES))
        node[:, :, :3] = positions
        self._views["node"][block, :, :, lane] = node
        self._views["foot"][block, :, :, lane] = self._feet(entries, along)
        rest = own.wire[entries][:, :, at.REST // LANES]
        state = np.zeros((n, at.LANE_SIZE // LANES))
        base = own.par[entries][:, at.BASE_TX // LANES : at.BASE_TX // LANES + 3]
        across = _across(base)
        fed = own.fed[entries]
        first = np.where(fed, cells[:, 0], own.first_node[entries]).astype(np.int64)
        cell = np.where(fed, cells[:, 1], rest[np.arange(n), first])
        for field, value in (
            (at.FIRST, first), (at.CELL, cell), (at.CELL_START, cell), (at.CELL_REST, rest[np.arange(n), first]),
            (at.OUT, cells[:, 2]), (at.FEED_GOAL, cell), (at.BASE_MX, across[:, 0]), (at.BASE_MY, across[:, 1]),
            (at.BASE_MZ, across[:, 2]), (at.TIP_MY, 1.0),
        ):  # fmt: skip
            state[:, field // LANES] = value
        self._views["lane"][block, :, lane] = state
        if self._spin is not None:
            directors = np.zeros((n, self.nodes, 3))
            ways.carry(positions, across, directors)
            spin = np.zeros((n, self.nodes, at.SPIN_STRIDE // LANES))
            spin[:, :, :3] = directors
            self._views["spin"][block, :, :, lane] = spin
        inside = lanes < self._rig.n
        for dof, value in ((self._feed, cells[:, 1] + cells[:, 2]), (self._twist, np.zeros(n))):
            if dof >= 0:
                self._rig.q[dof, lanes[inside]] = value[inside]

    def _feet(self, entries: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Rows of the walls' tables, and ways along them, of all contact points, (n, points, 2)."""
        own = self._own
        above = np.concatenate([along[:, 1:], along[:, -1:]], axis=1)
        share = np.arange(own.points) / own.points
        s = (along[:, :, None] + share * (above - along)[:, :, None]).reshape(len(along), -1)
        spacing, first = own.walls.spacing[entries][:, None], own.walls.first_row[entries][:, None]
        tube = own.par[entries][:, at.GRID_NX // LANES][:, None] == 0.0
        ends = own.walls.last_row[entries][:, None]
        loop = own.walls.loop[entries][:, None]
        s = np.where(loop, s % np.where(loop, spacing * (ends + 1), 1.0), s)
        row = np.clip(np.floor(s / spacing), np.where(loop, 0.0, -1.0), ends)
        feet = np.zeros((*s.shape, at.FOOT_STRIDE // LANES))
        feet[:, :, 0] = np.where(tube, first + row, 0.0)
        feet[:, :, 1] = np.where(tube, s - row * spacing, 0.0)
        return feet

    def set_goal(self, lanes: np.ndarray, places: Places) -> None:
        """As `WireModel.set_goal`."""
        self._goal_branch[lanes], self._goal[lanes] = places.branch, places.s

    @property
    def _drive(self) -> tuple:
        """The fields of `period.Drive`."""
        rig, found = self._rig, self._rig.magnetics
        magnets, clouds = found[1], found[2]
        return tuple(
            period.Drive(
                magnets.reshape(len(magnets), -1), clouds.reshape(len(clouds), -1), rig.limits,
                rig.library.is_turn[: self._outside], rig.q, rig.command, self._feed, self._twist,
            )
        )  # fmt: skip

    def step(self) -> None:
        """As `WireModel.step`."""
        drive, found, substeps, n = self._drive, self._rig.magnetics, self._own.steps, self._rig.n

        def run(blocks: np.ndarray, bench: tuple) -> None:
            period.control_period(
                blocks, substeps, n, found, drive, self._batch, self._spin, self._ways, self._trace,
                self._readout, bench,
            )  # fmt: skip

        share_out(run, self._all, self._benches, self._threads)

    def refresh(self, lanes: np.ndarray) -> None:
        """As `WireModel.refresh`."""
        drive, found, n = self._drive, self._rig.magnetics, self._rig.n

        def run(blocks: np.ndarray, bench: tuple) -> None:
            period.refresh(blocks, n, found, drive, self._batch, self._spin, self._ways, self._readout, bench)

        if len(lanes):
            share_out(run, np.unique(lanes // LANES), self._benches, self._threads)

    def read(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.read`: positions, velocities, directors and spins of a wire that twists, feet, base."""
        block, lane = np.divmod(lanes, LANES)
        n, node = len(lanes), self._views["node"][block, :, :, lane]
        parts = [node[:, :, :3], node[:, :, 3:6]]
        if self._spin is not None:
            spin = self._views["spin"][block, :, :, lane]
            parts += [spin[:, :, :3], spin[:, :, 3]]
        parts.append(self._views["foot"][block, :, :, lane])
        kept = self._views["lane"][block, :, lane][:, [field // LANES for field in _KEPT_OF_LANE]]
        return np.concatenate([part.reshape(n, -1) for part in (*parts, kept)], axis=1)

    def write(self, lanes: np.ndarray, wire: np.ndarray) -> None:
        """As `WireModel.write`."""
        block, lane = np.divmod(lanes, LANES)
        n = len(lanes)

        def part(name: str, size: int) -> Any:
            return wire[:, self.columns[name]].reshape(n, -1, size)

        node = np.concatenate([part("positions", 3), part("velocities", 3)], axis=2)
        self._views["node"][block, :, :, lane] = node
        if self._spin is not None:
            self._views["spin"][block, :, :, lane] = np.concatenate([part("directors", 3), part("spins", 1)], axis=2)
        self._views["foot"][block, :, :, lane] = part("feet", 2)
        fields = [field // LANES for field in _KEPT_OF_LANE]
        for column, field in enumerate(fields):
            self._views["lane"][block, field, lane] = wire[:, self.columns["base"]][:, column]

    def positions(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.positions`; of a wire that is fed, the node at the inlet and those inside the lumen."""
        block, lane = np.divmod(lanes, LANES)
        points = self._views["node"][block, :, :3, lane].copy()
        first = self._views["lane"][block, at.FIRST // LANES, lane]
        points[np.arange(self.nodes) < first[:, None]] = np.nan
        return points

    def node_contact(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.node_contact`: normal force and friction of the contact points, shared by segments' ends."""
        contact = np.zeros((len(lanes), self.nodes, 3))
        drive, found, n, bench = self._drive, self._rig.magnetics, self._rig.n, self._benches[0]
        work = bench[0].reshape(self.nodes, -1, LANES)[:, at.CONTACT // LANES : at.CONTACT // LANES + 3]
        for block in np.unique(lanes // LANES):
            blocks = np.array([block])
            period.refresh(blocks, n, found, drive, self._batch, self._spin, self._ways, self._readout, bench)
            mine = lanes // LANES == block
            contact[mine] = work[:, :, lanes[mine] % LANES].transpose(2, 0, 1)
        return contact

    def route_length(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.route_length`: to the end of the goal's branch."""
        own = self._own.ways
        branch = own.first[self._entry[lanes]] + self._goal_branch[lanes]
        return own.begin[branch] + own.length[branch]

    def ahead(self, offsets: np.ndarray) -> np.ndarray:
        """As `WireModel.ahead`."""
        n = self._rig.n
        found = np.empty((n, len(offsets), 9))
        ways.ahead(self._ways, self._entry, self._goal_branch, self._readout[ROW.travelled], offsets, found)
        return found


def _across(t: np.ndarray) -> np.ndarray:
    """Unit vectors across unit vectors t (n, 3)."""
    axis = np.eye(3)[np.abs(t).argmin(axis=1)]
    m = axis - (axis * t).sum(axis=1, keepdims=True) * t
    return m / np.linalg.norm(m, axis=1, keepdims=True)
