"""The locked wires of a batch: from scenarios to the kernel's arrays, and the face that the simulator sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ...scenario import Scenario
from ...scenario.steps import common_substeps, is_stiff
from .. import centreline
from ..lanes import LANES
from ..library import Library
from ..model import Places
from ..readout import ROW
from ..rig_arrays import RigLanes, aligned_zeros
from ..threads import cores, share_out
from . import algorithm1 as a1
from .algorithm1 import PAR, WIRE

__all__ = ["LockedLibrary", "LockedWires"]

SETTLING = 20
"""A stiff wire that is laid settles for half a step of motion, in steps of a twentieth."""


class LockedLibrary:
    """Wires and tracts of a batch's scenarios as rows of kernel parameters, one an entry, sized to the longest wire.

    nodes : of the longest wire; the others' spare first nodes idle
    first_node : (entries,), each wire's own first one
    stiff : (entries,), whether bends throw the wire about, so that friction needs its static tensions from the start
    table : flat, all tracts' tables
    par : (entries, `Course` and `Parameter`)
    wire : (entries, nodes, `WireField`)
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self.nodes = max(sc.wire.segments for sc in scenarios) + 1
        self.first_node = self.nodes - 1 - np.array([sc.wire.segments for sc in scenarios])
        self.spare = int(self.first_node.max())
        self.stiff = np.array([is_stiff(sc) for sc in scenarios])
        self.wire_length = np.array([sc.wire.length for sc in scenarios])
        self.tract_length = np.array([sc.tract.length for sc in scenarios])
        self.table, self.course = centreline.tables([sc.tract for sc in scenarios])
        self.par = np.hstack([self.course, [_parameters(sc) for sc in scenarios]])
        substeps = common_substeps(scenarios)
        self.wire = np.array([_wire_rows(sc, self.nodes, sc.timing.control_period / substeps) for sc in scenarios])

    def ahead(self, entries: np.ndarray, tips: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Points, tangents and p'', (n, k, 9), at arc lengths `tips` (n,) + `offsets` (k,) m."""
        found = np.empty((len(entries), len(offsets), 9))
        centreline.ahead(tips, np.asarray(offsets, dtype=np.float64), entries, self.course, self.table, found)
        return found


class LockedWires:
    """Wires locked to their tracts' centrelines under Algorithm 1; see `magwire_env.simulation.model.WireModel`.

    The wall force is |F⊥| of the magnets on the tip plus the tip's couple borne by two contacts, 2 τ/lever.
    """

    name: ClassVar[str] = "locked"
    supports: ClassVar[frozenset[str]] = frozenset({"quasistatic", "arclength", "vary"})

    def __init__(
        self, library: Library, rig: RigLanes, readout: np.ndarray, trace: np.ndarray, threads: int | None
    ) -> None:
        self._own: LockedLibrary = library.wires
        self.nodes = self._own.nodes
        self.columns: Mapping[str, slice] = {
            "arclengths": slice(0, self.nodes), "velocities": slice(self.nodes, 2 * self.nodes),
        }  # fmt: skip
        self._rig, self._threads = rig, threads
        self._substeps, self._h = library.substeps, library.control_period / library.substeps
        self._readout, self._trace = readout, trace
        blocks = -(-rig.n // LANES)
        self._par = aligned_zeros(blocks, a1.PAR_ROWS, LANES)
        self._wire = aligned_zeros(blocks, self.nodes, a1.WIRE_ROWS, LANES)
        self._s, self._v = (aligned_zeros(blocks, self.nodes, LANES) for _ in range(2))
        self._goal = np.zeros(rig.lanes)
        self._wires = tuple(a1.Wires(self._par, self._wire, self._s, self._v, self._own.table, self._goal))
        self._all = np.arange(blocks)
        self._works = [_work(self.nodes, rig.library.dof) for _ in range(min(threads or cores(), blocks))]
        self._laying = (aligned_zeros(a1.PAR_ROWS, LANES), *(aligned_zeros(self.nodes, LANES) for _ in range(2)))
        self.take(np.arange(rig.n), rig.entry)
        self._idle(blocks * LANES - rig.n)

    @staticmethod
    def library(scenarios: Sequence[Scenario]) -> LockedLibrary:
        """As `WireModel.library`."""
        return LockedLibrary(scenarios)

    def _idle(self, spare: int) -> None:
        """Spare lanes are wires no magnet pulls and no wall rubs, so they never hold their block up."""
        if spare:
            for array in (self._par, self._wire, self._s):
                array[-1, ..., -spare:] = array[-1, ..., :1]
            for field in (PAR.friction, PAR.moment, PAR.gravity_x, PAR.gravity_y, PAR.gravity_z):
                self._par[-1, field, -spare:] = 0.0
            lanes = np.arange(self._rig.n, self._rig.n + spare)
            self._unstretched(lanes, np.full(spare, self._own.wire_length[0]))

    def take(self, lanes: np.ndarray, entries: np.ndarray) -> None:
        """As `WireModel.take`."""
        block, lane = np.divmod(lanes, LANES)
        self._par[block, :, lane] = self._own.par[entries]
        self._wire[block, :, :, lane] = self._own.wire[entries]

    def vary(self, lanes: np.ndarray, factors: Mapping[str, np.ndarray]) -> None:
        """As `WireModel.vary`."""
        block, lane = np.divmod(lanes, LANES)
        self._par[block, PAR.friction, lane] *= factors["friction"]
        for field in (WIRE.k_axial, WIRE.k_bend, WIRE.k_end):
            self._wire[block, :, field, lane] *= factors["stiffness"][:, None]

    def start(self, entries: np.ndarray) -> Places:
        """As `WireModel.start`."""
        return Places(self._own.wire_length[entries])

    def lay(self, lanes: np.ndarray, places: Places) -> None:
        """As `WireModel.lay`: every segment's chord at its rest length, of stiff wires at its static tension."""
        self._unstretched(lanes, places.s)
        stiff = lanes[self._own.stiff[self._rig.entry[lanes]]]
        if stiff.size:
            self._settle(stiff)

    def _unstretched(self, lanes: np.ndarray, tips: np.ndarray) -> None:
        a1.lay_at_rest(lanes, np.ascontiguousarray(tips), self._wires, *self._laying)

    def _settle(self, lanes: np.ndarray) -> None:
        """Run `algorithm1.settle` on `lanes`; tips stay where they are, and so do the other lanes of their blocks."""
        block, lane = np.divmod(lanes, LANES)
        tips = self._s[block, -1, lane].copy()
        blocks = np.unique(block)
        others = np.ones((len(blocks), LANES), dtype=bool)
        others[np.searchsorted(blocks, block), lane] = False
        of, at = np.nonzero(others)
        kept = self._s[blocks[of], :, at], self._v[blocks[of], :, at]
        h = self._h / SETTLING
        rig, work = self._rig, self._works[0]
        a1.settle(blocks, SETTLING // 2, h, self._own.spare, rig.magnetics, rig.q, self._wires, work)
        self._s[blocks[of], :, at], self._v[blocks[of], :, at] = kept
        self._s[block, :, lane] += (tips - self._s[block, -1, lane])[:, None]
        self._v[block, :, lane] = 0.0

    def set_goal(self, lanes: np.ndarray, places: Places) -> None:
        """As `WireModel.set_goal`."""
        self._goal[lanes] = places.s

    def step(self) -> None:
        """As `WireModel.step`."""
        rig, substeps, h, spare = self._rig, self._substeps, self._h, self._own.spare

        def run(blocks: np.ndarray, work: tuple) -> None:
            a1.control_period(
                blocks, substeps, h, spare, rig.magnetics, rig.actuators, self._wires, self._trace, self._readout, work
            )

        share_out(run, self._all, self._works, self._threads)

    def refresh(self, lanes: np.ndarray) -> None:
        """As `WireModel.refresh`."""
        rig = self._rig

        def run(blocks: np.ndarray, work: tuple) -> None:
            a1.refresh(blocks, rig.magnetics, self._wires, rig.q, self._readout, work)

        if len(lanes) < LANES:  # a block twice is cheaper than sorting them out
            run(lanes // LANES, self._works[0])
        else:
            share_out(run, np.unique(lanes // LANES), self._works, self._threads)

    def read(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.read`: arc lengths (m), then speeds (m/s), tail to tip."""
        block, lane = np.divmod(lanes, LANES)
        return np.concatenate([self._s[block, :, lane], self._v[block, :, lane]], axis=1)

    def write(self, lanes: np.ndarray, wire: np.ndarray) -> None:
        """As `WireModel.write`."""
        block, lane = np.divmod(lanes, LANES)
        self._s[block, :, lane], self._v[block, :, lane] = wire[:, : self.nodes], wire[:, self.nodes :]

    def positions(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.positions`."""
        block, lane = np.divmod(lanes, LANES)
        s, entries = self._s[block, :, lane], self._rig.entry[lanes]
        found = self._own.ahead(np.repeat(entries, self.nodes), s.reshape(-1), np.zeros(1))
        points = found[:, 0, :3].reshape(len(lanes), self.nodes, 3)
        points[np.arange(self.nodes) < self._own.first_node[entries][:, None]] = np.nan
        return points

    def node_contact(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.node_contact`: only the tip's is known, against the magnets' force across the tract."""
        rows = self._readout[:, lanes]
        force, tangent = rows[ROW.force_x : ROW.force_x + 3], rows[ROW.tangent_x : ROW.tangent_x + 3]
        contact = np.zeros((len(lanes), self.nodes, 3))
        contact[:, -1] = ((force * tangent).sum(axis=0) * tangent - force).T
        return contact

    def route_length(self, lanes: np.ndarray) -> np.ndarray:
        """As `WireModel.route_length`: the tract's length."""
        return self._own.tract_length[self._rig.entry[lanes]]

    def ahead(self, offsets: np.ndarray) -> np.ndarray:
        """As `WireModel.ahead`."""
        return self._own.ahead(self._rig.entry, self._s[:, -1].reshape(-1), offsets)


def _work(nodes: int, dof: int) -> tuple:
    """The fields of `Work`."""
    solve, out = aligned_zeros(nodes, a1.SOLVE_ROWS, LANES), aligned_zeros(a1.RESULT_ROWS, LANES)
    return tuple(a1.Work(solve, out, aligned_zeros(dof, LANES), aligned_zeros(dof, LANES)))


def _parameters(sc: Scenario) -> np.ndarray:
    """The fields of `Parameter`."""
    contact = sc.contact
    row = np.zeros(a1.PAR_ROWS)
    row[PAR.friction], row[PAR.stick] = contact.friction, contact.stick_speed
    row[PAR.inv_lever], row[PAR.lever_friction] = 1.0 / contact.lever, float(contact.lever_friction)
    row[PAR.moment], row[PAR.wrench] = sc.tip.moment, float(sc.coupling == "wrench")
    row[PAR.gravity_x : PAR.gravity_z + 1] = sc.gravity
    return row[a1.FIRST_PARAMETER :]


def _wire_rows(sc: Scenario, nodes: int, h: float) -> np.ndarray:
    """(nodes, `WireField`): mass, drag twice (for steps of `h` s), springs, rest length.

    End nodes carry half a segment.

    Spare nodes have no weight, so nothing rubs them, and a drag that keeps them at rest.
    """
    wire, first = sc.wire, nodes - 1 - sc.wire.segments
    share = np.ones(nodes)
    share[first] = share[-1] = 0.5
    rows = np.zeros((nodes, a1.WIRE_ROWS))
    rows[:, WIRE.mass] = share * wire.mass / wire.segments
    rows[-1, WIRE.mass] += sc.tip.mass or 0.0
    drag = share * sc.contact.drag * wire.segment_length
    # Weighting the new against the old speed so that free decay is exact (exponential fitting): a half for small
    # steps, one for drag so strong that the motion is quasi-static.
    decay = np.maximum(h * drag / rows[:, WIRE.mass], 1e-6)
    weight = np.where(decay < 1e-3, 0.5 + decay / 12, 1 / -np.expm1(-decay) - 1 / decay)
    rows[:, WIRE.drag_new], rows[:, WIRE.drag_old] = drag * weight, drag * (1 - weight)
    rows[first:-1, WIRE.k_axial] = wire.axial_spring
    rows[first + 1 : -1, WIRE.k_bend] = wire.bending_spring
    rows[first, WIRE.k_end] = rows[-1, WIRE.k_end] = 2 * wire.bending_spring
    rows[:, WIRE.rest] = wire.segment_length
    rows[:first, [WIRE.mass, WIRE.drag_new, WIRE.drag_old]] = 0.0, 1.0, 0.0
    return rows
