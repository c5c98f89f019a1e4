"""Algorithm 1 of the paper as one batched kernel, in arc-length coordinates.

The unit of work is a block of `LANES` wires. Every array keeps the lane as its last index, and a quantity of all
wires of a block is one `Lanes` value (see `magwire_env.simulation.lanes`), so the code below reads as if for one wire.
``load(array, node, FIELD.name)`` reads a node's field.

The paper's steps, and where they are here (`control_period` calls them in order):

i.    magnetic force on the tip dipole                      `magnetic_force`
ii.   integrate the tip magnet                              it is the chain's last node: solved with the others in vi
iii.  couple it to the rest of the wire                     by the last segment's spring, in iv
iv.   spring forces between segments                        `spring_force`  } for each node in turn,
v.    bending forces at the joints                          `bending_force` } called by `joint_forces`
vi.   integrate the joints                                  `integrate` (linearly implicit)
vii.  project the forces on the tract's tangent             in i, iv and v, as each force is formed
viii. update the joints' positions                          `update`
ix.   snap the joints onto the spline                       `snap`: exact, since a joint *is* an arc length

Steps ix, iv, v and the solve's elimination run in a single pass from tail to tip: what a node needs of its neighbours
is then still in registers, and the divisions of the elimination hide behind the forces of the next node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import inlined, kernel
from ..centreline import COURSE, snap
from ..lanes import LANES, absolute, anywhere, load, maximum, reciprocal, row, rsqrt, spread, sqrt, store, where
from ..magnetics import Magnetics, rig_pull
from ..readout import OF_STATE, ROW
from ..servo import Actuators, servo
from ..vectors import add, cross, dot, load3, scaled, store3, sub


class Parameter(NamedTuple):
    """Fields of a lane: ``par[block, field, lane]``; its `Course` comes first.

    friction : Coulomb coefficient μ
    stick : m/s, the speed that smooths Coulomb's law
    inv_lever : 1/m, between the contacts that bear the tip's couple
    lever_friction : 1 if those contacts rub
    moment : A·m², of the tip
    wrench : 1 if the tip's couple drives it along a bend
    gravity_x … gravity_z : m/s²
    """

    friction: int
    stick: int
    inv_lever: int
    lever_friction: int
    moment: int
    wrench: int
    gravity_x: int
    gravity_y: int
    gravity_z: int


class WireField(NamedTuple):
    """Fields of a node: ``wire[block, node, field, lane]``; a segment or joint goes with its lower node.

    mass : kg
    drag_new, drag_old : N·s/m, weighing the new and the old speed
    k_axial : N/m
    k_bend : N·m/rad, of a joint between two segments
    k_end : N·m/rad, of the half cell at a wire's end
    rest : m, length of a segment
    """

    mass: int
    drag_new: int
    drag_old: int
    k_axial: int
    k_bend: int
    k_end: int
    rest: int


class SolveField(NamedTuple):
    """Fields of a node's row of the solve, ``w[node, field, lane]``.

    The row is diag v − off v' = force − friction g(v), with v' the next node's speed and g = v/√(v² + ε²), linearised
    as g + g_slope (v' − v).

    force : N, along the tract
    friction : N, Coulomb's limit μ n
    diag, off : N·s/m
    g, g_slope : 1, s/m
    ratio, right : what the elimination leaves of the row
    """

    force: int
    friction: int
    diag: int
    off: int
    g: int
    g_slope: int
    ratio: int
    right: int


FIRST_PARAMETER = len(COURSE)
PAR = Parameter(*range(FIRST_PARAMETER, FIRST_PARAMETER + len(Parameter._fields)))
PAR_ROWS = FIRST_PARAMETER + len(Parameter._fields)
WIRE = WireField(*range(len(WireField._fields)))
WIRE_ROWS = len(WireField._fields)
SOLVE = SolveField(*range(len(SolveField._fields)))
SOLVE_ROWS = len(SolveField._fields)

CURVATURE = len(ROW)
"""Row of a block's results that holds the tip's curvature vector κ n, 1/m; it is not published."""

RESULT_ROWS = CURVATURE + 3

NEWTON_PATIENCE = 15
"""Newton steps before the slower secant takes over."""

MAX_NEWTON = 60
NEWTON_TOLERANCE = 1e-5
"""Largest error of a node's friction after its linearisation, as a share of μ n."""


class Wires(NamedTuple):
    """The wires of a batch as the kernel reads and moves them.

    par : (blocks, `Parameter` and `Course`, LANES)
    wire : (blocks, nodes, `WireField`, LANES)
    s, v : (blocks, nodes, LANES) m, m/s, arc lengths and speeds, tail to tip
    table : flat, all tracts' tables
    goal : (lanes,) m, arc lengths
    """

    par: np.ndarray
    wire: np.ndarray
    s: np.ndarray
    v: np.ndarray
    table: np.ndarray
    goal: np.ndarray


class Work(NamedTuple):
    """One thread's own memory.

    solve : (nodes, `SolveField`, LANES)
    out : (RESULT_ROWS, LANES), the results of the block at work
    q, mean : (dof, LANES), where the rig is, and was on average over the step
    """

    solve: np.ndarray
    out: np.ndarray
    q: np.ndarray
    mean: np.ndarray


# --- the tip ----------------------------------------------------------------------------------------------------------


@inlined
def curvature(t, bend):
    """The vector κ n = dt/ds from the tangent, whose length is 1 to 1e-5 only, and its derivative p''."""
    inv = rsqrt(dot(t, t))
    along = dot(t, bend) * inv * inv
    return scaled(inv, sub(bend, scaled(along, t)))


@kernel
def tip_pose(s, par, table, out):
    """The tip's position, tangent and curvature vector, for the magnetic force and for the observer."""
    p, t, bend = snap(s, par, table)
    store3(out, ROW.tip_x, p)
    store3(out, ROW.tangent_x, t)
    store3(out, CURVATURE, curvature(t, bend))


@kernel
def magnetic_force(block, par, rig, q, out):
    """Step i. Force and field of all magnets and coils at the tip, the drive along the tract, the loads on the wall.

    `force` drives by F·t, the paper's projection; `wrench` by F·t + m κ n·B, the gradient of the energy −m t·B.
    """
    t = load3(out, ROW.tangent_x)
    f, b = rig_pull(block, rig, q, load3(out, ROW.tip_x), t)
    m = load(par, PAR.moment)
    f = scaled(m, f)
    along = dot(f, t)
    across = sub(f, scaled(along, t))
    lateral = sqrt(dot(across, across))
    couple = cross(t, b)
    torque = m * sqrt(dot(couple, couple))
    store3(out, ROW.force_x, f)
    store3(out, ROW.field_x, b)
    store(out, ROW.drive, along + load(par, PAR.wrench) * m * dot(load3(out, CURVATURE), b))
    store(out, ROW.lateral, lateral)
    store(out, ROW.torque, torque)
    store(out, ROW.wall, lateral + 2.0 * torque * load(par, PAR.inv_lever))


# --- steps iv and v ---------------------------------------------------------------------------------------------------


@inlined
def spring_force(d, stiffness, rest):
    """Step iv. A segment from its lower to its upper node: direction, inverse length and tension."""
    d2 = maximum(dot(d, d), 1e-24)
    inv = rsqrt(d2)
    return (d[0] * inv, d[1] * inv, d[2] * inv), inv, stiffness * (d2 * inv - rest)


@inlined
def stiffened(k, cos):
    """k φ/sin φ, the factor of a rotational spring's forces, from the angle's cosine.

    With x = 1 − cos φ it is k (1 + x/3 + 2x²/15 + 2x³/35 + 8x⁴/315 + …), cut after x⁴: relative error 6e-6 at 30°,
    4e-4 at 60°; at the 16° of a 10 mm segment in a 36 mm bend below 1e-8.
    """
    x = 1.0 - cos
    return k * (1.0 + x * (1.0 / 3.0 + x * (2.0 / 15.0 + x * (2.0 / 35.0 + x * (8.0 / 315.0)))))


@inlined
def bending_force(k, cos, inv_lower, inv_upper, before, after, lower_ends, upper_ends):
    """Step v, projected (vii). A joint's energy ½ k φ²: forces on the node below, the joint, and the node above.

    before, after : the lower node's tangent along the upper segment, the upper node's along the lower one
    lower_ends, upper_ends : the tangents at the two ends of the lower and of the upper segment, along that segment
    """
    (a0, b0), (a1, b1) = lower_ends, upper_ends
    g = stiffened(k, cos)
    lower, upper = g * inv_lower, g * inv_upper
    here = lower * (a1 - cos * b0) - upper * (b0 - cos * a1)
    return lower * (cos * a0 - before), here, upper * (after - cos * b1)


@inlined
def end_bending(k, per, t, bend, u, e):
    """Step v at a wire's end: half a cell of bend between the end segment and the tract's tangent it is locked to.

    With k_end = 2 E I/ℓ this is ½ E I κ² over the half segment that no joint stands for; left out, the bending
    resistance would be felt half a segment late, which was nearly all of the mesh's error.

    per : 1/length of the end segment u, negative at the tail; t, bend : the end node's tangent and curvature vector;
    e : the tangent at the segment's other end. Returns the forces on the end node and on the other.
    """
    inv = rsqrt(dot(t, t))
    n = t[0] * inv, t[1] * inv, t[2] * inv
    along = dot(t, u)
    cos = along * inv
    g = stiffened(k, cos)
    here = dot(bend, u) + per * (dot(t, n) - cos * along)
    return g * here, g * per * (cos * dot(e, u) - dot(e, n))


@inlined
def coulomb_limit(mu, pull, along):
    """μ n of a node on which all but the bending pulls with `pull`, `along` of it along the tract."""
    return mu * sqrt(maximum(dot(pull, pull) - along * along, 0.0))


@inlined
def eliminate(w, node, v, entries, off_below, done):
    """One node's row of the tridiagonal solve, friction linearised about speed `v` (Thomas, upwards).

    entries : the row's force, friction, diag and off
    done : ratio and right of the row below; returns those of this one
    """
    force, friction, diag, off = entries
    ratio, right = done
    slope = friction * load(w, node, SOLVE.g_slope)
    inv = reciprocal(diag + slope - off_below * ratio)
    ratio = off * inv
    right = (force - friction * load(w, node, SOLVE.g) + slope * v - off_below * right) * inv
    store(w, node, SOLVE.ratio, ratio)
    store(w, node, SOLVE.right, right)
    return ratio, right


@inlined
def finish_row(w, node, v, entries, off_below, done):
    """Keep a node's row for further Newton steps, and eliminate it."""
    store(w, node, SOLVE.force, entries[0])
    store(w, node, SOLVE.friction, entries[1])
    store(w, node, SOLVE.diag, entries[2])
    store(w, node, SOLVE.off, entries[3])
    return eliminate(w, node, v, entries, off_below, done)


@inlined
def segment(wire, i, here, there, speeds, h):
    """Steps iv and vii of the segment from node `i` up.

    here, there : the two nodes' points and tangents
    speeds : of the two

    Returns the segment's direction, inverse length, the tangents' shares along it, its tension as a vector, its
    stiffness over a step h k, and `back`: half a step's stretch, taken off since the springs act at the stretch that a
    full step at the new speeds would lead to.
    """
    (p, t), (n, e) = here, there
    k = load(wire, i, WIRE.k_axial)
    u, inv, tension = spring_force(sub(n, p), k, load(wire, i, WIRE.rest))
    ends = dot(t, u), dot(e, u)
    back = 0.5 * h * k * (ends[1] * speeds[1] - ends[0] * speeds[0])
    return u, inv, ends, scaled(tension, u), h * k, back


@inlined
def tip_row(wire, tip, par, out, v, h, q, diag, below):
    """The tip's row: as any node's, with the magnets' drive and load. `q`, `diag` : what the segment below added.

    below : direction, inverse length and tension of that segment, and the tangent at its other end
    Returns the row's entries, and what the tip's half cell of bend adds to the node below.
    """
    u, inv, tension, e = below
    mu, mass, speed = load(par, PAR.friction), load(wire, tip, WIRE.mass), load(v, tip)
    inertia = mass * (1.0 / h)
    t, magnetic = load3(out, ROW.tangent_x), load3(out, ROW.force_x)
    pull = add(sub(scaled(mass, load3(par, PAR.gravity_x)), tension), magnetic)
    along = dot(pull, t)
    couple = load(par, PAR.lever_friction) * (load(out, ROW.wall) - load(out, ROW.lateral))
    friction = mu * (sqrt(maximum(dot(pull, pull) - along * along, 0.0)) + couple)
    # Under `wrench` the drive is more than F·t: the tip's couple pushes along the bend too.
    q = q + along + load(out, ROW.drive) - dot(magnetic, t)
    q = q + (inertia - load(wire, tip, WIRE.drag_old)) * speed
    diag = diag + inertia + load(wire, tip, WIRE.drag_new)
    here, far = end_bending(load(wire, tip, WIRE.k_end), inv, t, load3(out, CURVATURE), u, e)
    return (q + here, friction, diag, spread(0.0)), far


@kernel
def joint_forces(w, nodes, spare, wire, par, table, out, s, v, h):
    """Steps ix, iv, v, vii for every node from the tail up, and its row of the solve of step vi, once eliminated.

    The springs act at the stretch a full step at the new speeds would lead to, which damps the stiff axial modes and
    leaves the slow motion second order: they enter the matrix with h k, and `back` takes half a step's stretch off.
    Normal load of a node: the lateral part of weight, tensions and, at the tip, the magnetic force.

    spare : the batch's wires differ by up to so many nodes; a shorter one's first nodes idle
    """
    tip = nodes - 1
    zero, mu, gravity = spread(0.0), load(par, PAR.friction), load3(par, PAR.gravity_x)
    p, t, bend = snap(load(s, 0), par, table)
    none = zero, zero, zero
    # Of the segment below: direction, inverse length, the ends' shares, tension. Of the node below: tangent and row.
    u_below, inv_below, ends_below, pull_below = none, zero, (zero, zero), none
    t_below, row_below, off_last, done = none, (zero, zero, zero, zero), zero, (zero, zero)
    q, diag = zero, zero  # what segments and joints below have already added to this node's row
    for i in range(tip):
        speed, mass = load(v, i), load(wire, i, WIRE.mass)
        inertia = mass * (1.0 / h)
        if i + 1 < tip:
            n, e, bend_up = snap(load(s, i + 1), par, table)
        else:
            n, e, bend_up = load3(out, ROW.tip_x), load3(out, ROW.tangent_x), none
        u, inv, ends, tension, hk, back = segment(wire, i, (p, t), (n, e), (speed, load(v, i + 1)), h)
        pull = sub(add(scaled(mass, gravity), tension), pull_below)
        along = dot(pull, t)
        friction = coulomb_limit(mu, pull, along)
        q = q + along + (inertia - load(wire, i, WIRE.drag_old)) * speed - ends[0] * back
        diag = diag + inertia + load(wire, i, WIRE.drag_new) + hk * ends[0] * ends[0]
        off = -hk * ends[0] * ends[1]
        q_up = ends[1] * back
        if i > 0:
            cos, before, after = dot(u_below, u), dot(t_below, u), dot(e, u_below)
            k = load(wire, i, WIRE.k_bend)
            lower, here, upper = bending_force(k, cos, inv_below, inv, before, after, ends_below, ends)
            q, q_up = q + here, q_up + upper
            row_below = row_below[0] + lower, row_below[1], row_below[2], row_below[3]
            done = finish_row(w, i - 1, load(v, i - 1), row_below, off_last, done)
            off_last = row_below[3]
        if i <= spare:  # a tail
            here, far = end_bending(load(wire, i, WIRE.k_end), -inv, t, curvature(t, bend), u, e)
            q, q_up = q + here, q_up + far
        t_below, row_below = t, (q, friction, diag, off)
        u_below, inv_below, ends_below, pull_below = u, inv, ends, tension
        p, t, bend = n, e, bend_up
        q, diag = q_up, hk * ends[1] * ends[1]
    last, far = tip_row(wire, tip, par, out, v, h, q, diag, (u_below, inv_below, pull_below, t_below))
    row_below = row_below[0] + far, row_below[1], row_below[2], row_below[3]
    done = finish_row(w, tip - 1, load(v, tip - 1), row_below, off_last, done)
    finish_row(w, tip, load(v, tip), last, row_below[3], done)


# --- step vi ----------------------------------------------------------------------------------------------------------


@kernel
def integrate(w, nodes, par, v):
    """Step vi. New speeds from the system `joint_forces` left: springs, drag and friction implicit, tridiagonal.

    Friction −μ n v/√(v² + ε²) is solved by Newton within the solve: its slope lagged by a step would be badly wrong
    near stick–slip. A guess that would change sign restarts from rest, from where Newton is monotone. A lane that
    has converged is left alone, so its result does not depend on the lanes beside it. Sliding wires need one step,
    wires about to stick or to let go three to six. Returns 1 in the lanes that have not converged, else 0.
    """
    still_open = load(par, PAR.stick) > 0.0  # all
    iteration = 1
    while True:
        still_open = back_substitute(w, nodes, par, v, still_open, iteration >= NEWTON_PATIENCE)
        if iteration == MAX_NEWTON or not anywhere(still_open):
            break
        iteration += 1
        done, off_below = (spread(0.0), spread(0.0)), spread(0.0)
        for i in range(nodes):
            entries = (
                load(w, i, SOLVE.force), load(w, i, SOLVE.friction), load(w, i, SOLVE.diag), load(w, i, SOLVE.off),
            )  # fmt: skip
            done = eliminate(w, i, load(v, i), entries, off_below, done)
            off_below = entries[3]
    return where(still_open, 1.0, spread(0.0))


@kernel
def back_substitute(w, nodes, par, v, still_open, secant):
    """Speeds of the linearised system, taken as the next guess in the open lanes; returns which are open still.

    With `secant` the next linearisation is the chord through rest, which converges from anywhere, if slowly.
    """
    stick2 = load(par, PAR.stick) * load(par, PAR.stick)
    worst, above = spread(0.0), spread(0.0)
    for i in range(nodes - 1, -1, -1):
        new = load(w, i, SOLVE.right) - load(w, i, SOLVE.ratio) * above
        above = new
        old, g_old, slope_old = load(v, i), load(w, i, SOLVE.g), load(w, i, SOLVE.g_slope)
        rubs = load(w, i, SOLVE.friction) > 0.0
        if secant:
            guess = new
            inv = rsqrt(guess * guess + stick2)
            g, slope = guess * inv, inv
            error = absolute(g - g_old - slope_old * (guess - old))
        else:
            crossed = rubs & (old * new < 0.0)
            guess = where(crossed, 0.0, new)
            inv = rsqrt(guess * guess + stick2)
            g, slope = guess * inv, stick2 * (inv * inv * inv)
            error = where(crossed, 1.0, absolute(g - g_old - slope_old * (guess - old)))
        worst = maximum(worst, where(rubs, error, 0.0))
        store(v, i, where(still_open, guess, old))
        store(w, i, SOLVE.g, where(still_open, g, g_old))
        store(w, i, SOLVE.g_slope, where(still_open, slope, slope_old))
    return still_open & (worst > NEWTON_TOLERANCE)


@kernel
def friction_of_speed(w, nodes, par, v):
    """g = v/√(v² + ε²), friction being −μ n g, and its slope at the present speeds."""
    stick2 = load(par, PAR.stick) * load(par, PAR.stick)
    for i in range(nodes):
        speed = load(v, i)
        inv = rsqrt(speed * speed + stick2)
        store(w, i, SOLVE.g, speed * inv)
        store(w, i, SOLVE.g_slope, stick2 * (inv * inv * inv))


# --- step viii and the whole ------------------------------------------------------------------------------------------


@kernel
def update(nodes, s, v, half):
    """Step viii. Every joint drifts for half a step at its present speed."""
    for i in range(nodes):
        store(s, i, load(s, i) + half * load(v, i))


@kernel
def crossings(nodes, wire, s):
    """1 in the lanes where a node has passed the next one, which no wire can do, else 0. Idle nodes have no mass."""
    crossed = spread(0.0)
    for i in range(nodes - 1):
        passed = (load(s, i) >= load(s, i + 1)) & (load(wire, i, WIRE.mass) > 0.0)
        crossed = where(passed, 1.0, crossed)
    return crossed


@kernel
def control_period(blocks, substeps, h, spare, rig, actuators, wires, trace, readout, work):
    """Move `blocks` through one control period of `substeps` steps of `h` s, in place.

    A step is a drift of half its length, a kick with the forces found there, and another drift: second order in h,
    and symplectic where no friction or drag takes energy out.

    rig, actuators, wires, work : the fields of `Magnetics`, `Actuators`, `Wires` and `Work`, as plain tuples, which
        Numba takes from Python in half the time of named ones
    trace : (substeps + 1, lanes) m, receives the way left to the goal at the start and after every step
    readout : (rows, lanes), see `magwire_env.simulation.readout`; the loads are those of the final state
    """
    rig, actuators, wires, work = Magnetics(*rig), Actuators(*actuators), Wires(*wires), Work(*work)
    q, nodes, dof = actuators.q, wires.s.shape[1], actuators.q.shape[0]
    tip, w, o, angles = nodes - 1, work.solve, work.out, work.q
    for block in blocks:
        par, wire, lane = row(wires.par, block), row(wires.wire, block), block * LANES
        s, v = row(wires.s, block), row(wires.v, block)
        goal = load(wires.goal, lane)
        for d in range(dof):
            store(angles, d, load(q, d, lane))
        friction_of_speed(w, nodes, par, v)
        store(trace, 0, lane, goal - load(s, tip))
        peak_lateral, peak_wall, sum_wall = spread(0.0), spread(0.0), spread(0.0)
        travel, unconverged = spread(0.0), spread(0.0)
        for step in range(substeps):
            update(nodes, s, v, 0.5 * h)
            travel = travel + servo(actuators, angles, lane, work.mean, h)
            tip_pose(load(s, tip), par, wires.table, o)
            magnetic_force(block, par, rig, work.mean, o)
            joint_forces(w, nodes, spare, wire, par, wires.table, o, s, v, h)
            unconverged = unconverged + integrate(w, nodes, par, v)
            update(nodes, s, v, 0.5 * h)
            store(trace, step + 1, lane, goal - load(s, tip))
            peak_lateral = maximum(peak_lateral, load(o, ROW.lateral))
            peak_wall = maximum(peak_wall, load(o, ROW.wall))
            sum_wall = sum_wall + load(o, ROW.wall)
        tip_pose(load(s, tip), par, wires.table, o)
        magnetic_force(block, par, rig, angles, o)
        store(o, ROW.peak_lateral, peak_lateral)
        store(o, ROW.peak_wall, peak_wall)
        store(o, ROW.mean_wall, sum_wall / substeps)
        store(o, ROW.travel, travel)
        store(o, ROW.unconverged, unconverged + crossings(nodes, wire, s))
        for d in range(dof):
            store(q, d, lane, load(angles, d))
        publish(o, load(s, tip), load(v, tip), goal, len(ROW), readout, lane)


@inlined
def publish(o, s, v, goal, count, readout, lane):
    """The first `count` results of a block to their places among all lanes'."""
    store(o, ROW.speed, v)
    store(o, ROW.travelled, s)
    store(o, ROW.remaining, goal - s)
    for field in range(count):
        store(readout, field, lane, load(o, field))


@kernel
def refresh(blocks, rig, wires, q, readout, work):
    """The loads of the present state: needed once whenever a state was set from outside. Arguments as above."""
    rig, wires, work = Magnetics(*rig), Wires(*wires), Work(*work)
    o, angles, tip = work.out, work.q, wires.s.shape[1] - 1
    for block in blocks:
        par, lane = row(wires.par, block), block * LANES
        s, v = load(row(wires.s, block), tip), load(row(wires.v, block), tip)
        for d in range(q.shape[0]):
            store(angles, d, load(q, d, lane))
        tip_pose(s, par, wires.table, o)
        magnetic_force(block, par, rig, angles, o)
        publish(o, s, v, load(wires.goal, lane), OF_STATE, readout, lane)


@kernel
def settle(blocks, steps, h, spare, rig, q, wires, work):
    """Let the tensions of wires that lie at rest build up: `steps` steps of `h` s, too short to move them far.

    Friction at a node needs the tension beside it. A wire laid without stretch has none, so a stiff wire would slide
    freely through its whole first step. Arguments as above; q : (dof, lanes), the rig stands still.
    """
    rig, wires, work = Magnetics(*rig), Wires(*wires), Work(*work)
    o, w, angles, nodes = work.out, work.solve, work.q, wires.s.shape[1]
    for block in blocks:
        par, wire, lane = row(wires.par, block), row(wires.wire, block), block * LANES
        s, v = row(wires.s, block), row(wires.v, block)
        for d in range(q.shape[0]):
            store(angles, d, load(q, d, lane))
        for _ in range(steps):
            friction_of_speed(w, nodes, par, v)
            tip_pose(load(s, nodes - 1), par, wires.table, o)
            magnetic_force(block, par, rig, angles, o)
            joint_forces(w, nodes, spare, wire, par, wires.table, o, s, v, h)
            integrate(w, nodes, par, v)
            update(nodes, s, v, h)


@kernel
def lay_at_rest(lanes, tip_arclength, wires, par, arcs, rest):
    """Lay wires out behind their tips with every segment's chord at its rest length, at rest.

    lanes : (n,) which; they are packed `LANES` at a time, wherever they stand, since few are reset at once
    tip_arclength : (n,) m
    par, arcs, rest : (PAR_ROWS, LANES), (nodes, LANES) twice, to work in
    """
    wires = Wires(*wires)
    nodes = wires.s.shape[1]
    for first in range(0, len(lanes), LANES):
        count = min(LANES, len(lanes) - first)
        for l in range(LANES):
            lane = lanes[first + min(l, count - 1)]
            block, own = lane // LANES, lane % LANES
            for field in range(PAR_ROWS):
                par[field, l] = wires.par[block, field, own]
            for i in range(nodes):
                rest[i, l] = wires.wire[block, i, WIRE.rest, own]
            arcs[nodes - 1, l] = tip_arclength[first + min(l, count - 1)]
        n, _, _ = snap(load(arcs, nodes - 1), par, wires.table)
        for i in range(nodes - 2, -1, -1):
            length = load(rest, i)
            at = load(arcs, i + 1) - length
            for _ in range(5):  # Newton on chord = rest length; it starts within a few per cent and is quadratic
                p, t, _ = snap(at, par, wires.table)
                d = sub(n, p)
                chord = sqrt(dot(d, d))
                at = at + (chord - length) / maximum(dot(d, t) / chord, 0.2)
            store(arcs, i, at)
            n, _, _ = snap(at, par, wires.table)
        for l in range(count):
            lane = lanes[first + l]
            block, own = lane // LANES, lane % LANES
            for i in range(nodes):
                wires.s[block, i, own] = arcs[i, l]
                wires.v[block, i, own] = 0.0
