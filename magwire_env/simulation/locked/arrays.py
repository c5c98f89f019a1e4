"""From scenarios to the kernel's arrays: a library of scenarios, and the lanes that run them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...physics.dipoles import MU0
from ...physics.magnets import PointDipole
from ...scenario import Current, Scenario, Slide, Turn
from ..threads import cores, share_out
from . import algorithm1 as a1

__all__ = ["LaneArrays", "Library"]


@dataclass(frozen=True)
class _Layout:
    """What every scenario of a batch must share: the kinds of the magnets' degrees of freedom, and the coils' axes."""

    dofs: tuple[tuple[tuple[str, str], ...], ...]
    coils: tuple[str, ...]

    @classmethod
    def of(cls, scenario: Scenario) -> _Layout:
        rig = scenario.rig
        dofs = tuple(tuple((type(d).__name__, d.axis) for d in m.dofs) for m in rig.magnets)
        return cls(dofs, tuple(c.axis for c in rig.coils))


class Library:
    """Scenarios as rows of kernel parameters, one row an entry, sized to the largest of them.

    Raises `ValueError` if the scenarios differ in timing or in the kinds of their degrees of freedom.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        if not scenarios:
            raise ValueError("scenario must be one scenario or a sequence of at least one, got none")
        self.scenarios = tuple(scenarios)
        self.timing, layout = self.scenarios[0].timing, _Layout.of(self.scenarios[0])
        for i, sc in enumerate(self.scenarios):
            if sc.timing != self.timing:
                raise ValueError(f"scenario[{i}].timing must be that of the batch, {self.timing}, got {sc.timing}")
            if _Layout.of(sc) != layout:
                raise ValueError(
                    f"scenario[{i}].rig must have the batch's degrees of freedom {layout}, got {_Layout.of(sc).dofs}"
                )
        rig = self.scenarios[0].rig
        self.dof, self.magnet_count = len(rig.dofs), len(rig.magnets)
        self.nodes = max(sc.wire.segments for sc in self.scenarios) + 1
        self.first_node = self.nodes - 1 - np.array([sc.wire.segments for sc in self.scenarios])
        self.spare = int(self.first_node.max())
        self.is_turn = np.array([isinstance(d, Turn) for d in rig.dofs], dtype=np.bool_)
        self.rig = _slots(self.scenarios[0])
        self.wire_length = np.array([sc.wire.length for sc in self.scenarios])
        self.tract_length = np.array([sc.tract.length for sc in self.scenarios])
        self.home = np.array([[d.home for d in sc.rig.dofs] for sc in self.scenarios]).reshape(-1, self.dof)
        self.table, first_rows = _tables(self.scenarios)
        self.par = np.array([_lane_row(sc, first) for sc, first in zip(self.scenarios, first_rows, strict=True)])
        self.wire = np.array([_wire_rows(sc, self.nodes) for sc in self.scenarios])
        self.dofs = np.array([[_dof_row(d) for d in sc.rig.dofs] for sc in self.scenarios]).reshape(-1, self.dof, 3)
        self.magnets = np.array([_magnet_rows(sc) for sc in self.scenarios])
        self._collect_clouds()

    def _collect_clouds(self) -> None:
        kinds: dict[tuple, int] = {}
        none = (PointDipole(1.0), ("gauss", 1))  # what stands in a coil's place, and is not summed
        mounts = [[(m.magnet, m.dipoles) for m in sc.rig.magnets] + [none] * len(sc.rig.coils) for sc in self.scenarios]
        self.cloud_of = np.array([[kinds.setdefault(mount, len(kinds)) for mount in row] for row in mounts])
        clouds = []
        for magnet, rule in kinds:
            cloud = magnet.dipoles(*rule)
            clouds.append(np.column_stack([cloud.positions, cloud.moments[:, 2] / magnet.moment]))
        counts = np.array([len(c) for c in clouds])
        self.sources = counts[self.cloud_of].max(axis=0)
        self.clouds = np.zeros((len(clouds), counts.max(), 4))
        for padded, cloud in zip(self.clouds, clouds, strict=True):
            padded[: len(cloud)] = cloud

    def centreline(self, entries: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (m) and unit tangents, (n, k, 3) each, at arc lengths `s` (n, k) m of the tracts of `entries` (n,)."""
        par = self.par[entries][:, :, None]
        period = par[:, a1.PERIOD // a1.LANES]
        s = np.where(period > 0, s % np.where(period > 0, period, 1.0), s)
        row = np.clip(np.floor(s * par[:, a1.INV_SPACING // a1.LANES]) + 1, 0, par[:, a1.TABLE_LAST // a1.LANES])
        u = (s - (row - 1) * par[:, a1.SPACING // a1.LANES])[..., None]
        c = self.table.reshape(-1, 12)[(row + par[:, a1.TABLE_ROW // a1.LANES]).astype(np.int64)]
        points = c[..., 0:3] + u * (c[..., 3:6] + u * (c[..., 6:9] + u * c[..., 9:12]))
        tangents = c[..., 3:6] + u * (2 * c[..., 6:9] + 3 * u * c[..., 9:12])
        return points, tangents

    def positions(self, entries: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Points of nodes at arc lengths `s` (n, nodes) m → (n, nodes, 3) m, NaN for a shorter wire's spare nodes."""
        points, _ = self.centreline(entries, s)
        points[np.arange(self.nodes) < self.first_node[entries][:, None]] = np.nan
        return points


class LaneArrays:
    """The kernel's arrays for n lanes, in blocks of `algorithm1.LANES`; what is left of the last block idles."""

    def __init__(self, library: Library, n: int, threads: int | None = None) -> None:
        self.library, self.n, self.threads = library, n, threads
        lanes, blocks = a1.LANES, -(-n // a1.LANES)
        magnets, dof, nodes = len(library.rig), library.dof, library.nodes
        self.par = _zeros(blocks, a1.PAR_SIZE)
        self.wire = _zeros(blocks, nodes * a1.WIRE_STRIDE)
        self.magnets = _zeros(blocks, magnets * a1.MAGNET_STRIDE)
        self.dofs = _zeros(blocks, dof * a1.DOF_STRIDE)
        self.s, self.v = _zeros(blocks, nodes * lanes), _zeros(blocks, nodes * lanes)
        # Read and written from outside, so a row a quantity; one block more, lest rows lie powers of two apart.
        row = (blocks + 1) * lanes
        self.q, self.command = _zeros(dof, row), _zeros(dof, row)
        self.trace = _zeros(library.timing.substeps + 1, row)
        self.out = _zeros(a1.OF_ALL, row)
        self._lane_cloud = np.zeros((blocks, lanes, magnets), dtype=np.int64)
        self._clouds: dict[bytes, int] = {}
        self.clouds = _zeros(0, library.clouds.shape[1] * a1.SOURCE_STRIDE)
        self.cloud_of = np.zeros((blocks, magnets), dtype=np.int64)
        self._all = np.arange(blocks)
        count = min(threads or cores(), blocks)
        self._workspaces = [_zeros(1, a1.workspace_size(nodes, dof))[0] for _ in range(count)]
        self.take(np.arange(n), np.zeros(n, dtype=np.int64))
        self._idle_rest(blocks * lanes - n)

    def _idle_rest(self, spare: int) -> None:
        """Spare lanes are wires no magnet pulls and no wall rubs, so they never hold their block up."""
        if spare:
            parts = (self.par, self.wire, self.magnets, self.dofs, self.s)
            for array in parts:
                rows = array.reshape(len(array), -1, a1.LANES)
                rows[-1, :, -spare:] = rows[-1, :, :1]
            for field in (a1.MU, a1.TIP_MOMENT, a1.GX, a1.GY, a1.GZ):
                self.par[-1, field + a1.LANES - spare : field + a1.LANES] = 0.0
            self._lane_cloud[-1, -spare:] = self._lane_cloud[-1, 0]
            self._stack_clouds(np.array([len(self.par) - 1]))
            self.lay_at_rest(np.arange(self.n, self.n + spare), np.full(spare, self.library.wire_length[0]))

    def take(self, lanes: np.ndarray, entries: np.ndarray) -> None:
        """Give `lanes` the parameters of the library's `entries`."""
        block, lane = np.divmod(lanes, a1.LANES)
        library = self.library
        for array, rows in (
            (self.par, library.par),
            (self.wire, library.wire),
            (self.magnets, library.magnets),
            (self.dofs, library.dofs),
        ):
            array.reshape(len(array), -1, a1.LANES)[block, :, lane] = rows[entries].reshape(len(entries), -1)
        if (self._lane_cloud[block, lane] != library.cloud_of[entries]).any() or not len(self.clouds):
            self._lane_cloud[block, lane] = library.cloud_of[entries]
            self._stack_clouds(np.unique(block))

    def vary(
        self,
        lanes: np.ndarray,
        friction: np.ndarray,
        stiffness: np.ndarray,
        remanence: np.ndarray,
        placement: np.ndarray,
    ) -> None:
        """Scale what `take` gave `lanes` by factors (n,), and shift the magnets' centres, (n, magnets, 3) m."""
        block, lane = np.divmod(lanes, a1.LANES)
        self.par[block, a1.MU + lane] *= friction
        wire = self.wire.reshape(len(self.wire), -1, a1.WIRE_STRIDE // a1.LANES, a1.LANES)
        for field in (a1.K_AXIAL, a1.K_BEND, a1.K_END):
            wire[block, :, field // a1.LANES, lane] *= stiffness[:, None]
        magnets = self.magnets.reshape(len(self.magnets), -1, a1.MAGNET_STRIDE // a1.LANES, a1.LANES)
        count = self.library.magnet_count
        magnets[block, :count, a1.STRENGTH // a1.LANES, lane] *= remanence[:, None]
        for axis in range(3):
            magnets[block, :count, a1.CX // a1.LANES + axis, lane] += placement[:, :, axis]

    def _stack_clouds(self, blocks: np.ndarray) -> None:
        """Blocks whose lanes have the same clouds share one table of sources, lane by lane."""
        for block in blocks:
            for m in range(self.cloud_of.shape[1]):
                mix = self._lane_cloud[block, :, m]
                number = self._clouds.setdefault(mix.tobytes(), len(self._clouds))
                if number == len(self.clouds):
                    stacked = self.library.clouds[mix].transpose(1, 2, 0).reshape(1, -1)
                    clouds = _zeros(number + 1, stacked.shape[1])
                    clouds[:number], clouds[number] = self.clouds, stacked
                    self.clouds = clouds
                self.cloud_of[block, m] = number

    def write(
        self,
        lanes: np.ndarray,
        arclengths: np.ndarray | None = None,
        velocities: np.ndarray | None = None,
        magnet: np.ndarray | None = None,
    ) -> None:
        """Set parts of the state of `lanes`; `refresh` must follow."""
        block, lane = np.divmod(lanes, a1.LANES)
        for array, rows in ((self.s, arclengths), (self.v, velocities)):
            if rows is not None:
                array.reshape(len(array), -1, a1.LANES)[block, :, lane] = rows
        if magnet is not None:
            self.q[:, lanes] = magnet.T

    def read(self, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Copies of arc lengths, velocities (n, nodes) and magnet (n, dof)."""
        block, lane = np.divmod(lanes, a1.LANES)
        s, v = (array.reshape(len(array), -1, a1.LANES)[block, :, lane] for array in (self.s, self.v))
        return s, v, self.q[:, lanes].T.copy()

    def lay_at_rest(self, lanes: np.ndarray, tip_arclength: np.ndarray) -> None:
        """Wires of `lanes` at rest behind tips at `tip_arclength`; `refresh` must follow."""
        a1.lay_at_rest(
            lanes,
            np.ascontiguousarray(tip_arclength),
            self.wire,
            self.par,
            self.library.table,
            self.s,
            self.v,
            self._workspaces[0],
        )

    def refresh(self, lanes: np.ndarray) -> None:
        """Bring the loads in `out` up to date with the state of `lanes`."""

        def run(blocks: np.ndarray, work: np.ndarray) -> None:
            a1.refresh(
                blocks, self.par, self.library.rig, self.magnets, self.clouds, self.cloud_of, self.library.sources,
                self.library.table, self.s, self.v, self.q, self.out, work,
            )  # fmt: skip

        if len(lanes) < a1.LANES:  # a block twice is cheaper than sorting them out
            run(lanes // a1.LANES, self._workspaces[0])
        else:
            share_out(run, np.unique(lanes // a1.LANES), self._workspaces, self.threads)

    def step(self) -> None:
        """One control period of every lane under `command`."""
        timing, library = self.library.timing, self.library

        def run(blocks: np.ndarray, work: np.ndarray) -> None:
            a1.control_period(
                blocks, timing.substeps, timing.control_period / timing.substeps, library.spare, self.par, self.wire,
                library.rig, self.magnets, self.dofs, library.is_turn, self.clouds, self.cloud_of, library.sources,
                library.table, self.s, self.v, self.q, self.command, self.trace, self.out, work,
            )  # fmt: skip

        share_out(run, self._all, self._workspaces, self.threads)

    def arclengths(self) -> np.ndarray:
        """A copy of the nodes' arc lengths, (n, nodes) m."""
        return self.s.reshape(len(self.s), -1, a1.LANES).transpose(0, 2, 1).reshape(-1, self.library.nodes)[: self.n]

    def lanes_first(self, rows: np.ndarray) -> np.ndarray:
        """A copy of an array of rows over the lanes as (n, fields)."""
        return rows[:, : self.n].T.copy()

    def result(self, field: int) -> np.ndarray:
        """A copy of one of the kernel's results, (n,)."""
        return self.out[field // a1.LANES, : self.n].copy()

    def results(self, field: int) -> np.ndarray:
        """A copy of three consecutive results, (n, 3)."""
        first = field // a1.LANES
        return self.lanes_first(self.out[first : first + 3])


def _zeros(rows: int, columns: int) -> np.ndarray:
    """Zeros that start on a cache line, which no vector of 64 bytes then straddles."""
    flat = np.zeros(rows * columns + 8)
    first = -(flat.ctypes.data // 8) % 8
    return flat[first : first + rows * columns].reshape(rows, columns)


def _slots(scenario: Scenario) -> np.ndarray:
    """The kernel's `rig` array: which command entry moves which slot of which magnet."""
    rig = np.full((len(scenario.rig.magnets) + len(scenario.rig.coils), a1.SLOTS), -1, dtype=np.int64)
    number = 0
    for m, mount in enumerate(scenario.rig.magnets):
        turns = 0
        for dof in mount.dofs:
            if isinstance(dof, Turn):
                rig[m, turns], rig[m, 5 + turns] = number, "xyz".index(dof.axis)
                turns += 1
            else:
                rig[m, a1.TURN_SLOTS + "xyz".index(dof.axis)] = number
            number += 1
    for c, coil in enumerate(scenario.rig.coils, start=len(scenario.rig.magnets)):
        rig[c, a1.COIL_DOF], rig[c, a1.COIL_AXIS] = number, "xyz".index(coil.axis)
        number += 1
    return rig


def _tables(scenarios: Sequence[Scenario]) -> tuple[np.ndarray, list[int]]:
    """All tracts' tables one after another, each tract once, and the first row of each scenario's."""
    first: dict = {}
    tables, rows = [], 0
    for sc in scenarios:
        if sc.tract not in first:
            first[sc.tract] = rows
            tables.append(sc.tract.table)
            rows += len(sc.tract.table)
    return np.ascontiguousarray(np.vstack(tables)).reshape(-1), [first[sc.tract] for sc in scenarios]


def _lane_row(sc: Scenario, first_row: int) -> np.ndarray:
    tract, contact = sc.tract, sc.contact
    period = tract.length if tract.closed else 0.0
    values = {
        a1.TABLE_ROW: first_row,
        a1.TABLE_LAST: len(tract.table) - 1,
        a1.INV_SPACING: 1.0 / tract.row_spacing,
        a1.SPACING: tract.row_spacing,
        a1.PERIOD: period,
        a1.INV_PERIOD: 1.0 / period if period else 0.0,
        a1.MU: contact.friction,
        a1.STICK: contact.stick_speed,
        a1.INV_LEVER: 1.0 / contact.lever,
        a1.LEVER_FRICTION: float(contact.lever_friction),
        a1.TIP_MOMENT: sc.tip.moment,
        a1.WRENCH: float(sc.coupling == "wrench"),
        a1.GX: sc.gravity[0],
        a1.GY: sc.gravity[1],
        a1.GZ: sc.gravity[2],
    }
    row = np.zeros(a1.PAR_SIZE // a1.LANES)
    for field, value in values.items():
        row[field // a1.LANES] = value
    return row


def _wire_rows(sc: Scenario, nodes: int) -> np.ndarray:
    """(nodes, 7) mass, drag twice, springs, rest length. End nodes carry half a segment.

    Spare nodes have no weight, so nothing rubs them, and a drag that keeps them at rest.
    """
    wire, first = sc.wire, nodes - 1 - sc.wire.segments
    share = np.ones(nodes)
    share[first] = share[-1] = 0.5
    rows = np.zeros((nodes, 7))
    rows[:, 0] = share * wire.mass / wire.segments
    rows[-1, 0] += sc.tip.mass or 0.0
    drag = share * sc.contact.drag * wire.segment_length
    # Weighting the new against the old speed so that free decay is exact (exponential fitting): a half for small
    # steps, one for drag so strong that the motion is quasi-static.
    decay = np.maximum(sc.timing.control_period / sc.timing.substeps * drag / rows[:, 0], 1e-6)
    weight = np.where(decay < 1e-3, 0.5 + decay / 12, 1 / -np.expm1(-decay) - 1 / decay)
    rows[:, 1], rows[:, 2] = drag * weight, drag * (1 - weight)
    rows[first:-1, 3] = wire.axial_spring
    rows[first + 1 : -1, 4] = wire.bending_spring
    rows[first, 5] = rows[-1, 5] = 2 * wire.bending_spring
    rows[:, 6] = wire.segment_length
    rows[:first, :3] = 0.0, 1.0, 0.0
    return rows


def _dof_row(dof: Turn | Slide | Current) -> tuple[float, float, float]:
    """Speed, lowest, highest: a turn's range is the circle about home, and does not limit it."""
    if isinstance(dof, Turn):
        return dof.speed, dof.home - np.pi, dof.home + np.pi
    return dof.speed, dof.low, dof.high


def _magnet_rows(sc: Scenario) -> list[tuple[float, ...]]:
    """Centre, strength and gradient of every magnet, then of every coil."""
    magnets: list[tuple[float, ...]] = [(*m.position, MU0 / (4 * np.pi) * m.magnet.moment, 0.0) for m in sc.rig.magnets]
    return magnets + [(*c.position, c.uniform, c.gradient) for c in sc.rig.coils]
