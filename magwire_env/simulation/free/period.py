"""A control period of free wires, block by block, and the readout that it leaves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...compiled import inlined, kernel
from ..centreline import curve_at
from ..lanes import LANES, absolute, load, maximum, minimum, row, rsqrt, spread, sqrt, store, where
from ..magnetics import Magnetics, rig_pull
from ..readout import OF_STATE, ROW
from ..servo import LIMIT
from ..vectors import cross, dot, scaled, store3, sub
from . import layout as at
from .stepper import publish, run_block
from .ways import Ways, astray, place_of, remaining

__all__ = ["OUT_ROWS", "Batch", "Bench", "Drive", "control_period", "refresh"]


class Batch(NamedTuple):
    """The wires of a batch as the kernels move them; see `layout` for the numbers of each.

    par, wire, lane, node, foot : (blocks, …)
    magnetic : (nodes,) whether any lane's segment above a node is magnetic
    table, grid : the walls
    goal_branch, goal : (lanes,) number within the lumen; m
    entry : (lanes,)
    first_row : (entries,) of the tubes' tables
    length : (lanes,) m, of the wires
    """

    par: np.ndarray
    wire: np.ndarray
    lane: np.ndarray
    node: np.ndarray
    foot: np.ndarray
    magnetic: np.ndarray
    table: np.ndarray
    grid: np.ndarray
    goal_branch: np.ndarray
    goal: np.ndarray
    entry: np.ndarray
    first_row: np.ndarray
    length: np.ndarray


class Drive(NamedTuple):
    """The rig of a batch: as `Magnetics`, and flat as the free wire's own kernels read it.

    magnets : (blocks, …), clouds : (tables, …)
    limits : (dof, `Limit`, lanes); q, command : (dof, lanes)
    is_turn : of the degrees of freedom outside the base, which come first
    feed, twist : which degree of freedom feeds and turns the base, −1 for none
    """

    magnets: np.ndarray
    clouds: np.ndarray
    limits: np.ndarray
    is_turn: np.ndarray
    q: np.ndarray
    command: np.ndarray
    feed: int
    twist: int


class Bench(NamedTuple):
    """One thread's own memory.

    work, loads, pose, marks : of the stepper
    dofs, q, command : flat, the rig outside the base, of a block
    then : (dof, LANES), where the rig was
    out : (rows, LANES), a block's readout and the tip's velocity
    feet : (2, LANES), rows and ways of the tips' feet in the walls' tables
    point, depth, branch, arc : of `ways.place_of`
    """

    work: np.ndarray
    loads: np.ndarray
    pose: np.ndarray
    marks: np.ndarray
    dofs: np.ndarray
    q: np.ndarray
    command: np.ndarray
    then: np.ndarray
    out: np.ndarray
    feet: np.ndarray
    point: np.ndarray
    depth: np.ndarray
    branch: np.ndarray
    arc: np.ndarray


VELOCITY = len(ROW)
"""Row of `Bench.out` that holds the tip's velocity, m/s; it is not published."""

OUT_ROWS = VELOCITY + 3


@kernel
def take_rig(drive, batch, bench, block):
    """A block's rig into its thread's memory, and the base's commands to the wires."""
    lane = block * LANES
    for d in range(drive.is_turn.shape[0]):
        for field in range(3):
            store(bench.dofs, (d * 3 + field) * LANES, load(drive.limits, d, field, lane))
        store(bench.q, d * LANES, load(drive.q, d, lane))
        store(bench.command, d * LANES, load(drive.command, d, lane))
    own = row(batch.lane, block)
    for d, field in ((drive.feed, at.FEED_WANT), (drive.twist, at.TWIST_WANT)):
        if d >= 0:
            low, high = load(drive.limits, d, LIMIT.low, lane), load(drive.limits, d, LIMIT.high, lane)
            store(own, field, minimum(maximum(load(drive.command, d, lane), low), high))


@kernel
def put_rig(drive, batch, bench, block):
    """Where the rig has come to, from a block's thread; returns how far it has moved, summed."""
    lane, travel = block * LANES, spread(0.0)
    for d in range(drive.is_turn.shape[0]):
        now = load(bench.q, d * LANES)
        travel = travel + absolute(now - load(drive.q, d, lane))
        store(drive.q, d, lane, now)
    own = row(batch.lane, block)
    if drive.feed >= 0:
        now = load(own, at.OUT) + load(own, at.FEED_GOAL)
        travel = travel + absolute(now - load(drive.q, drive.feed, lane))
        store(drive.q, drive.feed, lane, now)
    if drive.twist >= 0:
        now = load(own, at.SPUN)
        travel = travel + absolute(now - load(drive.q, drive.twist, lane))
        store(drive.q, drive.twist, lane, now)
    return travel


@kernel
def pull(block, rig, batch, bench, x, before):
    """Field, force and torque on the tips at x, the nodes behind them at `before`, the rig at `bench.then`."""
    o, nodes = bench.out, batch.magnetic.shape[0]
    e = sub(x, before)
    t = scaled(rsqrt(maximum(dot(e, e), 1e-24)), e)
    f, b = rig_pull(block, rig, bench.then, x, t)
    m = load(row(batch.wire, block), (nodes - 2) * at.WIRE_STRIDE + at.MOMENT)
    couple = cross(t, b)
    store3(o, ROW.tip_x, x)
    store3(o, ROW.tangent_x, t)
    store3(o, ROW.force_x, scaled(m, f))
    store3(o, ROW.field_x, b)
    store(o, ROW.torque, m * sqrt(dot(couple, couple)))


@kernel
def way(block, count, ways, batch, bench):
    """Where the tips in `bench.out` stand on their ways: travelled, remaining; drive, lateral force and speed there.

    count : how many of the block's lanes are of the batch
    """
    o = bench.out
    for l in range(count):
        lane = block * LANES + l
        entry, goal = batch.entry[lane], batch.goal_branch[lane]
        first = ways.first[entry]
        guess = (bench.feet[0, l] - batch.first_row[entry]) * batch.par[block, at.SPACING + l] + bench.feet[1, l]
        b, s = place_of(
            ways, entry, goal, o[ROW.tip_x, l], o[ROW.tip_y, l], o[ROW.tip_z, l], guess,
            bench.point, bench.depth, bench.branch, bench.arc,
        )  # fmt: skip
        left = remaining(ways, entry, b, s, goal, batch.goal[lane])
        o[ROW.remaining, l] = left
        o[ROW.travelled, l] = s
        o[ROW.branch, l], o[ROW.astray, l] = b, astray(ways, entry, b, s, goal)
        if ways.branches[entry] > 1:
            o[ROW.travelled, l] = ways.begin[first + goal] + batch.goal[lane] - left
        _, t, _ = curve_at(s, ways.course[first + b], ways.table)
        size = 1.0 / math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
        along, speed, across = 0.0, 0.0, 0.0
        for k in range(3):
            along += o[ROW.force_x + k, l] * t[k] * size
            speed += o[VELOCITY + k, l] * t[k] * size
        for k in range(3):
            across += (o[ROW.force_x + k, l] - along * t[k] * size) ** 2
        o[ROW.drive, l], o[ROW.speed, l], o[ROW.lateral, l] = along, speed, math.sqrt(across)


@kernel
def publish_present(block, count, rig, drive, batch, ways, bench, pressed):
    """A block's present state into `bench.out`; `pressed` is the sum of the wall's normal forces, N."""
    o, nodes = bench.out, batch.magnetic.shape[0]
    node, lane, par = row(batch.node, block), row(batch.lane, block), row(batch.par, block)
    tip = (nodes - 1) * at.NODE_STRIDE
    for d in range(drive.is_turn.shape[0]):
        store(bench.then, d, load(drive.q, d, block * LANES))
    pull(block, rig, batch, bench, flat3(node, tip + at.X), flat3(node, tip - at.NODE_STRIDE + at.X))
    store3(o, VELOCITY, flat3(node, tip + at.VX))
    foot = (nodes - 1) * (batch.foot.shape[1] // nodes)
    store(bench.feet, 0, load(row(batch.foot, block), foot + at.ROW))
    store(bench.feet, 1, load(row(batch.foot, block), foot + at.ALONG))
    way(block, count, ways, batch, bench)
    store(o, ROW.wall, pressed)
    clamped = load(par, at.BASE_CLAMPED)
    store3(o, ROW.base_force_x, scaled(clamped, flat3(lane, at.BASE_FX)))
    store3(o, ROW.base_torque_x, scaled(clamped, flat3(lane, at.BASE_TQX)))
    within = minimum(maximum(load(o, ROW.travelled), 0.0), load(batch.length, block * LANES))
    store(o, ROW.inserted, where(load(par, at.FED) > 0.5, load(lane, at.OUT) + load(lane, at.CELL), within))


@inlined
def flat3(array, i):
    """A vector of a flat array of a block."""
    return load(array, i), load(array, i + LANES), load(array, i + 2 * LANES)


@kernel
def at_mark(block, count, number, rig, drive, batch, ways, bench):
    """What the readout needs of a mark: travelled, remaining and the lateral force."""
    dof = drive.is_turn.shape[0]
    o = number * (at.MARKS + dof) * LANES
    for d in range(dof):
        store(bench.then, d, load(bench.marks, o + (at.MARKS + d) * LANES))
    pull(block, rig, batch, bench, flat3(bench.marks, o), flat3(bench.marks, o + 3 * LANES))
    store(bench.feet, 0, load(bench.marks, o + 6 * LANES))
    store(bench.feet, 1, load(bench.marks, o + 7 * LANES))
    way(block, count, ways, batch, bench)


@kernel
def control_period(blocks, substeps, n, magnetics, drive, batch, spin, ways, trace, readout, bench):
    """One control period of some blocks.

    n : lanes of the batch
    magnetics, drive, batch, ways, bench : fields of `Magnetics`, `Drive`, `Batch`, `Ways`, `Bench`
    spin : directors, or None
    trace, readout : as `WireModel` has them
    """
    rig, drive, batch = Magnetics(*magnetics), Drive(*drive), Batch(*batch)
    ways, bench = Ways(*ways), Bench(*bench)
    points = batch.foot.shape[1] // (batch.magnetic.shape[0] * at.FOOT_STRIDE)
    o = bench.out
    for block in blocks:
        first = block * LANES
        count = min(LANES, n - first)
        take_rig(drive, batch, bench, block)
        bench.loads[:] = 0.0
        lane = row(batch.lane, block)
        note_start(block, points, batch, bench, drive.is_turn.shape[0])
        if spin is None:
            run_block(
                block, points, batch.magnetic, row(batch.par, block), row(batch.wire, block), lane,
                row(batch.node, block), None, row(batch.foot, block), batch.table, batch.grid, bench.dofs,
                drive.is_turn, rig.slots, row(drive.magnets, block), drive.clouds, rig.cloud_of, rig.sources, bench.q,
                bench.command, bench.work, bench.loads, bench.pose, bench.marks, 1.0,
            )  # fmt: skip
        else:
            run_block(
                block, points, batch.magnetic, row(batch.par, block), row(batch.wire, block), lane,
                row(batch.node, block), row(spin, block), row(batch.foot, block), batch.table, batch.grid, bench.dofs,
                drive.is_turn, rig.slots, row(drive.magnets, block), drive.clouds, rig.cloud_of, rig.sources, bench.q,
                bench.command, bench.work, bench.loads, bench.pose, bench.marks, 1.0,
            )  # fmt: skip
        peak = spread(0.0)
        for number in range(substeps):
            at_mark(block, count, number, rig, drive, batch, ways, bench)
            store(trace, number, first, load(o, ROW.remaining))
            if number > 0:
                peak = maximum(peak, load(o, ROW.lateral))
        store(o, ROW.travel, put_rig(drive, batch, bench, block))
        store(o, ROW.peak_wall, load(lane, at.PEAK_WALL))
        whole = maximum(at.FINEST * load(row(batch.par, block), at.STEPS), 1.0)
        store(o, ROW.mean_wall, load(lane, at.SUM_WALL) / whole)
        store(o, ROW.unconverged, load(lane, at.FAILED))
        refresh_block(block, points, count, rig, drive, batch, spin, ways, bench)
        store(trace, substeps, first, load(o, ROW.remaining))
        store(o, ROW.peak_lateral, maximum(peak, load(o, ROW.lateral)))
        for field in range(len(ROW)):
            store(readout, field, first, load(o, field))


@kernel
def note_start(block, points, batch, bench, dof):
    """The first mark: the period's start."""
    nodes = batch.magnetic.shape[0]
    node, foot = row(batch.node, block), row(batch.foot, block)
    tip, own = (nodes - 1) * at.NODE_STRIDE, (nodes - 1) * points * at.FOOT_STRIDE
    for k in range(3):
        store(bench.marks, k * LANES, load(node, tip + at.X + k * LANES))
        store(bench.marks, (3 + k) * LANES, load(node, tip - at.NODE_STRIDE + at.X + k * LANES))
    store(bench.marks, 6 * LANES, load(foot, own + at.ROW))
    store(bench.marks, 7 * LANES, load(foot, own + at.ALONG))
    for d in range(dof):
        store(bench.marks, (at.MARKS + d) * LANES, load(bench.q, d * LANES))


@kernel
def refresh_block(block, points, count, rig, drive, batch, spin, ways, bench):
    """A block's present state into `bench.out`, its forces into the thread's workspace."""
    lane = block * LANES
    for d in range(drive.is_turn.shape[0]):
        store(bench.q, d * LANES, load(drive.q, d, lane))
    if spin is None:
        pressed = publish(
            block, points, batch.magnetic, row(batch.par, block), row(batch.wire, block), row(batch.lane, block),
            row(batch.node, block), None, row(batch.foot, block), batch.table, batch.grid, rig.slots,
            row(drive.magnets, block), drive.clouds, rig.cloud_of, rig.sources, bench.q, bench.work, bench.loads,
            bench.pose,
        )  # fmt: skip
    else:
        pressed = publish(
            block, points, batch.magnetic, row(batch.par, block), row(batch.wire, block), row(batch.lane, block),
            row(batch.node, block), row(spin, block), row(batch.foot, block), batch.table, batch.grid, rig.slots,
            row(drive.magnets, block), drive.clouds, rig.cloud_of, rig.sources, bench.q, bench.work, bench.loads,
            bench.pose,
        )  # fmt: skip
    publish_present(block, count, rig, drive, batch, ways, bench, pressed)


@kernel
def refresh(blocks, n, magnetics, drive, batch, spin, ways, readout, bench):
    """The readout of the present state: arguments as `control_period`'s."""
    rig, drive, batch = Magnetics(*magnetics), Drive(*drive), Batch(*batch)
    ways, bench = Ways(*ways), Bench(*bench)
    points = batch.foot.shape[1] // (batch.magnetic.shape[0] * at.FOOT_STRIDE)
    for block in blocks:
        first = block * LANES
        refresh_block(block, points, min(LANES, n - first), rig, drive, batch, spin, ways, bench)
        for field in range(OF_STATE):
            store(readout, field, first, load(bench.out, field))
