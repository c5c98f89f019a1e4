"""A control period of a block of wires: time steps, each a projected Newton search on the incremental potential.

The lanes of a block are at different steps and at different stages of them: every round evaluates all lanes at once,
and a lane whose step has converged begins its next one while others still search. So a block waits for the lane with
the most evaluations over the *period*, not for the slowest lane of every step; and a lane's course never depends on
its neighbours.

A direction from contacts alone that the iterate has leads far into the wall wherever one more point would meet it. So
the points that were pressed at the evaluation before count as held, at first those that the wire comes with; and where
a trial is refused that met the wall at new points, the direction is sought anew from the same iterate with these points
held, too. A held point that is not in the wall adds the spring between it and the wall to the Newton system, and
nothing to the potential: what is accepted is still judged by the potential alone.

A trial is taken only if it does not raise the potential (Armijo's rule). Where what there is to gain is lost in the
potential's rounding, the forces judge instead: they must have come much nearer to balance (the approximate rule of
Hager and Zhang). A step that has not converged within its patience is begun again at half its length, down to a 64th of
the longest; what still fails is kept and counted.
"""

from __future__ import annotations

import math

from ...compiled import inlined, kernel
from ..lanes import LANES, absolute, anywhere, floor, load, maximum, minimum, reciprocal, rsqrt, spread, store, where
from . import layout as at
from .elements import transported, turned
from .judge import HELD_ON, HUGE, WITHOUT, judge
from .layout import FINEST
from .magnetics import place_magnets
from .rod import evaluate
from .search import search
from .sleeve import JOIN, SPLIT, regrid
from .vectors import dot, load3, plus, select3, store3, sub, times, zero3

SOON = 4.0
"""A correction below so many times the tolerance may be the last one, if by the last two the next would be below it."""

FAR = 1e3
"""A direction that is longer than so many moves, or that rises, is sought anew without contacts that are only held."""

MOST_SHRINK = 0.8
"""Share of its length that the cell may lose in one move: the energy of a cell of negative length has no minimum."""


@inlined
def limited(v, most):
    """The vector, cut to the length `most`."""
    size = rsqrt(maximum(dot(v, v), 1e-36))
    return times(minimum(spread(1.0), most * size), v)


@kernel
def next_step(tail, finish, again, begin, par, wire, lane, node, spin, work, h_old, h_new):
    """End the steps of lanes `finish`, put those of `again` back to their start, begin one in the lanes `begin`.

    Nodes in the sleeve rest: what they have depends on their own wire alone, and not on where the block's tail is.
    """
    tip = node.shape[0] // at.NODE_STRIDE - 1
    most, memory = load(par, at.MOST_MOVE), load(par, at.MEMORY)
    ih = reciprocal(h_old)
    moved = finish | again
    for i in range(tail, tip + 1):
        n, w = i * at.NODE_STRIDE, i * at.WORK_STRIDE
        before, move, start = load3(node, n + at.X), load3(work, w + at.MOVE), load3(work, w + at.START)
        speed, hold = load3(node, n + at.VX), load3(wire, i * at.WIRE_STRIDE + at.HOLD_X)
        x = select3(again, start, select3(finish, plus(before, 1.0, move), before))
        v = times(ih, sub(x, start))
        v = (
            where(hold[0] > 0.0, speed[0], v[0]), where(hold[1] > 0.0, speed[1], v[1]),
            where(hold[2] > 0.0, speed[2], v[2]),
        )  # fmt: skip
        v = select3(finish, v, speed)
        guess = times(h_new, v)
        free = limited(times(memory, guess), most)
        guess = (
            where(hold[0] > 0.0, guess[0], free[0]), where(hold[1] > 0.0, guess[1], free[1]),
            where(hold[2] > 0.0, guess[2], free[2]),
        )  # fmt: skip
        if spin is not None and i < tip:
            o = i * at.SPIN_STRIDE
            m, m0 = load3(spin, o + at.MX), load3(work, w + at.N0)
            turn, turn_move = load(work, w + at.TURN), load(work, w + at.TURN_MOVE)
            next_x = load3(node, n + at.NODE_STRIDE + at.X)
            e0 = sub(next_x, before)
            e1 = plus(e0, 1.0, sub(load3(work, w + at.WORK_STRIDE + at.MOVE), move))
            u0, u1 = times(rsqrt(maximum(dot(e0, e0), 1e-24)), e0), times(rsqrt(maximum(dot(e1, e1), 1e-24)), e1)
            ended = turned(transported(m, u0, u1), u1, turn_move)
            ended = plus(ended, -dot(ended, u1), u1)
            ended = times(rsqrt(maximum(dot(ended, ended), 1e-24)), ended)
            ended = select3(load(lane, at.FIRST) <= 1.0 * i, ended, m)
            m = select3(again, m0, select3(finish, ended, m))
            store3(spin, o + at.MX, m)
            store3(work, w + at.N0, select3(begin, m, m0))
            rate = load(spin, o + at.RATE)
            store(spin, o + at.RATE, where(finish, (turn + turn_move) * ih, rate))
            store(work, w + at.TURN, where(begin, 0.0, turn + where(finish, turn_move, 0.0)))
            store(work, w + at.TURN_MOVE, where(begin | moved, 0.0, turn_move))
        store3(node, n + at.X, x)
        store3(node, n + at.VX, v)
        store3(work, w + at.START, select3(begin, x, start))
        store3(work, w + at.MOVE, select3(begin, guess, select3(moved, zero3(), move)))


@kernel
def next_cell(finish, again, begin, par, lane, h_old, h_new):
    """The same for the cell of wires that are fed; the drive goes on towards its command."""
    cell, start, move = load(lane, at.CELL), load(lane, at.CELL_START), load(lane, at.CELL_MOVE)
    fed = load(par, at.FED) > 0.5
    cell = where(again, start, where(finish, cell + move, cell))
    speed = where(finish, (cell - start) * reciprocal(h_old), load(lane, at.CELL_SPEED))
    store(lane, at.CELL, cell)
    store(lane, at.CELL_SPEED, speed)
    store(lane, at.CELL_START, where(begin, cell, start))
    guess = where(fed, h_new * speed * load(par, at.MEMORY), 0.0)
    guess = maximum(guess, -MOST_SHRINK * cell)
    store(lane, at.CELL_MOVE, where(begin, guess, where(finish | again, 0.0, move)))


@kernel
def actuate(again, begin, par, lane, dofs, is_turn, q, command, h):
    """Servos, feed and base turn of the lanes `begin` go on for h s at their limited speeds, `again` from the start.

    q : (2 dof) rows, the degrees of freedom and what they were at the step's start
    """
    dof = is_turn.shape[0]
    for d in range(dof):
        o, here = d * 3 * LANES, load(q, d * LANES)
        here = where(again, load(q, (dof + d) * LANES), here)
        goal = load(command, d * LANES)
        if is_turn[d]:
            gap = goal - here
            gap = gap - 6.283185307179586 * floor(gap * 0.15915494309189535 + 0.5)
        else:
            gap = minimum(maximum(goal, load(dofs, o + LANES)), load(dofs, o + 2 * LANES)) - here
        most = load(dofs, o) * h
        store(q, (dof + d) * LANES, where(begin, here, load(q, (dof + d) * LANES)))
        store(q, d * LANES, where(begin, here + minimum(maximum(gap, -most), most), here))
    goal, cell = where(again, load(lane, at.FEED_START), load(lane, at.FEED_GOAL)), load(lane, at.CELL)
    most = load(par, at.FEED_SPEED) * h
    slack = load(par, at.FEED_FORCE) / load(par, at.FEED_STIFFNESS)
    start = minimum(maximum(goal, cell - slack), cell + slack)
    gap = load(lane, at.FEED_WANT) - load(lane, at.OUT) - start
    store(lane, at.FEED_START, where(begin, start, load(lane, at.FEED_START)))
    ahead = minimum(maximum(gap, -most), most)
    store(lane, at.FEED_GOAL, where(begin, start + ahead, goal))
    # The first guess: a drive that does not give way takes the cell along.
    holds = begin & (load(par, at.FED) > 0.5) & (absolute(start - cell) < 0.999 * slack)
    guess = maximum(start + ahead - cell, -MOST_SHRINK * cell)
    store(lane, at.CELL_MOVE, where(holds, guess, load(lane, at.CELL_MOVE)))
    spun, before = load(lane, at.SPUN), load(lane, at.SPUN_START)
    start = where(again, before, spun)
    most = load(par, at.TWIST_SPEED) * h
    goal = start + minimum(maximum(load(lane, at.TWIST_WANT) - start, -most), most)
    goal = where(begin, goal, spun)
    store(lane, at.SPUN_START, where(begin, start, before))
    turn = goal - spun
    if anywhere((turn > 0.0) | (turn < 0.0)):
        t, kept = load3(par, at.BASE_TX), load3(lane, at.BASE_MX)
        m = turned(kept, t, turn)
        m = plus(m, -dot(m, t), t)
        m = times(rsqrt(dot(m, m)), m)
        store3(lane, at.BASE_MX, select3((turn > 0.0) | (turn < 0.0), m, kept))  # a base at rest keeps every bit
        store(lane, at.SPUN, goal)


@inlined
def cell_room(cell, move):
    """The share of its move that leaves the cell a part of its length: one shorter than nothing has no energy."""
    return where(move < 0.0, MOST_SHRINK * cell * reciprocal(maximum(-move, 1e-12)), 1.0)


@kernel
def run_block(
    block, points, magnetic, par, wire, lane, node, spin, foot, table, grid, dofs, is_turn, rig, magnets, clouds,
    cloud_of, sources, q, command, work, loads, pose, marks, apart,
):  # fmt: skip
    """One control period of a block, in place.

    marks : receives `layout.MARKS` of the tip and the rig after every `apart` of the longest steps; empty for none
    """
    zero, one = spread(0.0), spread(1.0)
    nodes = node.shape[0] // at.NODE_STRIDE
    store(lane, at.LEFT, FINEST * load(par, at.STEPS))
    store(lane, at.LENGTH, spread(1.0 * FINEST))
    for field in (at.FAILED, at.EVALUATED, at.STEPPED, at.RESIDUAL, at.SUM_WALL, at.PEAK_WALL):
        store(lane, field, zero)
    longest = load(par, at.STEP)
    store(lane, at.H, longest)
    finish, again, begin = zero > 0.0, zero > 0.0, one > 0.0
    tail = first_active(lane, nodes)
    starts = True
    while True:
        if anywhere(finish | again | begin):
            h_old = load(lane, at.H)
            h = load(lane, at.LENGTH) * longest * (1.0 / FINEST)
            next_cell(finish, again, begin, par, lane, h_old, h)
            next_step(tail, finish, again, begin, par, wire, lane, node, spin, work, h_old, h)
            if len(marks) > 0:
                mark(finish, points, par, lane, node, foot, q, is_turn.shape[0], marks, apart * FINEST)
            store(lane, at.H, where(begin, h, h_old))
            if regrid_lanes(points, begin, par, wire, lane, node, spin, foot, work):
                old_tail, tail = tail, first_active(lane, nodes)
                rest_in_sleeve(tail, old_tail, lane, node, spin, work)
            actuate(again, begin, par, lane, dofs, is_turn, q, command, h)
            place_magnets(rig, magnets, q, pose)
            for field, value in (
                (at.ALPHA, 1.0), (at.EXACT, 1.0), (at.TRIES, 0.0), (at.ENERGY, HUGE), (at.SLOPE, 0.0),
                (at.FORESEES, HELD_ON), (at.REBUILT, 0.0), (at.BEFORE, HUGE),
            ):  # fmt: skip
                store(lane, field, where(begin, value, load(lane, field)))
            if starts:  # the contacts that the wire comes with
                store(lane, at.ALPHA, zero)
                store(lane, at.TAKEN, one)
                evaluate(
                    block, tail, points, magnetic, par, wire, lane, node, spin, foot, work, loads, table, grid,
                    rig, magnets, clouds, cloud_of, sources, pose,
                )  # fmt: skip
                store(lane, at.ALPHA, one)
                starts = False
        running = load(lane, at.LEFT) > 0.0
        if not anywhere(running):
            break
        old, new, worst, decrement, pressed, fresh = evaluate(
            block, tail, points, magnetic, par, wire, lane, node, spin, foot, work, loads, table, grid,
            rig, magnets, clouds, cloud_of, sources, pose,
        )  # fmt: skip
        alpha = load(lane, at.ALPHA)
        taken, balanced, anew = judge(old, new, worst, decrement, fresh, par, lane, running)
        known = taken | anew
        shorter = load(lane, at.ALPHA)
        store(lane, at.ALPHA, alpha)
        most, cell_move, slope = search(tail, taken, known, balanced, par, wire, lane, node, spin, work, 1e-3)
        store(lane, at.CELL, load(lane, at.CELL) + where(taken, alpha * load(lane, at.CELL_MOVE), 0.0))
        store(lane, at.CELL_MOVE, where(known, where(balanced, 0.0, cell_move), load(lane, at.CELL_MOVE)))
        most = maximum(most, absolute(cell_move))
        store(lane, at.SLOPE, where(known, slope, load(lane, at.SLOPE)))
        sound = (slope <= 0.0) & (most <= FAR * load(par, at.MOST_MOVE))
        rises = where(sound | balanced, 0.0, where(known, 1.0, 0.0)) > 0.5
        store(lane, at.FORESEES, where(rises, WITHOUT, load(lane, at.FORESEES)))
        store(lane, at.EXACT, where(rises, 0.0, load(lane, at.EXACT)))
        cut = minimum(one, load(par, at.MOST_MOVE) * reciprocal(maximum(most, 1e-12)))
        cut = minimum(cut, cell_room(load(lane, at.CELL), cell_move))
        store(lane, at.ALPHA, where(rises, 0.0, where(known, cut, shorter)))
        # What comes next.
        tolerance, before = load(par, at.MOVE_TOLERANCE), load(lane, at.BEFORE)
        soon = (alpha >= 1.0) & (most <= SOON * tolerance) & (most * most <= 0.5 * tolerance * before)
        done = balanced | (taken & ((most <= tolerance) | (soon & (fresh <= 0.0))))
        store(lane, at.BEFORE, where(taken, where(cut >= 1.0, most, HUGE), before))
        length, left = load(lane, at.LENGTH), load(lane, at.LEFT)
        spent = running & (load(lane, at.TRIES) >= load(par, at.PATIENCE))
        spent = where(done, 0.0, where(spent, 1.0, 0.0)) > 0.5
        gives_up = spent & (length <= 1.0)
        again = where(gives_up, 0.0, where(spent, 1.0, 0.0)) > 0.5
        finish = done | gives_up
        # A lane that gives up keeps its last iterate, not the untried move.
        store(lane, at.FAILED, load(lane, at.FAILED) + where(gives_up, 1.0, 0.0))
        store(lane, at.STEPPED, load(lane, at.STEPPED) + where(finish, 1.0, 0.0))
        store(lane, at.RESIDUAL, where(finish, maximum(load(lane, at.RESIDUAL), worst), load(lane, at.RESIDUAL)))
        store(lane, at.SUM_WALL, load(lane, at.SUM_WALL) + where(finish, pressed * length, 0.0))
        store(lane, at.PEAK_WALL, where(finish, maximum(load(lane, at.PEAK_WALL), pressed), load(lane, at.PEAK_WALL)))
        if anywhere(gives_up):
            drop_move(tail, gives_up, lane, work)
            store(lane, at.TAKEN, where(gives_up, 1.0, load(lane, at.TAKEN)))
        left = where(finish, left - length, left)
        store(lane, at.LEFT, left)
        double = 2.0 * length
        aligned = (left - double * floor(left / double)) <= 0.0
        grows = finish & aligned & (double <= 1.0 * FINEST)
        store(lane, at.LENGTH, where(again, 0.5 * length, where(grows, double, length)))
        begin = again | (finish & (left > 0.0))
    return


@kernel
def publish(
    block, points, magnetic, par, wire, lane, node, spin, foot, table, grid, rig, magnets, clouds, cloud_of, sources, q,
    work, loads, pose,
):  # fmt: skip
    """Forces of the present state: a function of places, velocities and directors alone.

    Friction is what a step that has just brought the wire here at its velocity would have left. Returns the sum of the
    wall's normal forces, N.
    """
    zero = spread(0.0)
    nodes = node.shape[0] // at.NODE_STRIDE
    h = load(par, at.STEP)
    for field, value in (
        (at.LEFT, 0.0), (at.ALPHA, 0.0), (at.EXACT, 1.0), (at.TAKEN, 1.0), (at.CELL_MOVE, 0.0), (at.FORESEES, 0.0)
    ):  # fmt: skip
        store(lane, field, spread(value))
    store(lane, at.H, h)
    for i in range(nodes):
        n, o = i * at.NODE_STRIDE, i * at.WORK_STRIDE
        store3(work, o + at.START, plus(load3(node, n + at.X), -h, load3(node, n + at.VX)))
        store3(work, o + at.MOVE, zero3())
        if spin is not None:
            store(work, o + at.TURN, h * load(spin, i * at.SPIN_STRIDE + at.RATE))
            store(work, o + at.TURN_MOVE, zero)
    for i in range(len(loads) // LANES):
        store(loads, i * LANES, zero)
    place_magnets(rig, magnets, q, pose)
    _, _, _, _, pressed, _ = evaluate(
        block, 0, points, magnetic, par, wire, lane, node, spin, foot, work, loads, table, grid,
        rig, magnets, clouds, cloud_of, sources, pose,
    )  # fmt: skip
    return pressed


@kernel
def mark(finish, points, par, lane, node, foot, q, dof, marks, apart):
    """Note the tip and the rig of lanes whose step ended on a mark."""
    tip = node.shape[0] // at.NODE_STRIDE - 1
    store(lane, at.ENDED, where(finish, 1.0, 0.0))
    for l in range(LANES):
        left = lane[at.LEFT + l]
        if lane[at.ENDED + l] > 0.5 and math.floor(left / apart) * apart == left:
            number = int((FINEST * par[at.STEPS + l] - left) / apart)
            o = number * (at.MARKS + dof) * LANES + l
            for k in range(3):
                marks[o + k * LANES] = node[tip * at.NODE_STRIDE + at.X + k * LANES + l]
                marks[o + (3 + k) * LANES] = node[(tip - 1) * at.NODE_STRIDE + at.X + k * LANES + l]
            marks[o + 6 * LANES] = foot[tip * points * at.FOOT_STRIDE + at.ROW + l]
            marks[o + 7 * LANES] = foot[tip * points * at.FOOT_STRIDE + at.ALONG + l]
            for d in range(dof):
                marks[o + (at.MARKS + d) * LANES] = q[d * LANES + l]


@kernel
def publish_alone(
    block, points, magnetic, par, wire, lane, node, spin, foot, table, grid, rig, magnets, clouds, cloud_of, sources, q,
    work, loads, pose,
):  # fmt: skip
    """`publish`, to be called from Python, which knows no lanes."""
    publish(
        block, points, magnetic, par, wire, lane, node, spin, foot, table, grid, rig, magnets, clouds, cloud_of,
        sources, q, work, loads, pose,
    )  # fmt: skip


@kernel
def regrid_lanes(points, begin, par, wire, lane, node, spin, foot, work):
    """Let nodes out of the sleeve or back into it where a step begins; returns whether any did."""
    cell, fed = load(lane, at.CELL), (load(par, at.FED) > 0.5) & begin
    rest = load(lane, at.CELL_REST)
    if not anywhere(fed & ((cell > SPLIT * rest) | (cell < JOIN * rest))):
        return False
    store(work, at.GRADIENT, where(fed, 1.0, 0.0))
    did = False
    for l in range(LANES):
        if work[at.GRADIENT + l] > 0.5:
            did = regrid(l, points, par, wire, lane, node, spin, foot, work, lane[at.H + l]) or did
    return did


@kernel
def rest_in_sleeve(low, high, lane, node, spin, work):
    """Nodes from `low` to `high` that a neighbour has brought into the block's loops do not move while in the sleeve.

    The workspace is a thread's: it still has what another block, or an earlier step, has left there.
    """
    for i in range(low, high):
        n, w = i * at.NODE_STRIDE, i * at.WORK_STRIDE
        inside = load(lane, at.FIRST) > 1.0 * i
        store3(work, w + at.START, select3(inside, load3(node, n + at.X), load3(work, w + at.START)))
        store3(work, w + at.MOVE, select3(inside, zero3(), load3(work, w + at.MOVE)))
        if spin is not None:
            director = load3(spin, i * at.SPIN_STRIDE + at.MX)
            store3(work, w + at.N0, select3(inside, director, load3(work, w + at.N0)))
            store(work, w + at.TURN, where(inside, 0.0, load(work, w + at.TURN)))
            store(work, w + at.TURN_MOVE, where(inside, 0.0, load(work, w + at.TURN_MOVE)))


@kernel
def drop_move(tail, lanes, lane, work):
    """Lanes that give up keep their last iterate."""
    for i in range(tail, len(work) // at.WORK_STRIDE):
        o = i * at.WORK_STRIDE
        store3(work, o + at.MOVE, select3(lanes, zero3(), load3(work, o + at.MOVE)))
        store(work, o + at.TURN_MOVE, where(lanes, 0.0, load(work, o + at.TURN_MOVE)))
    store(lane, at.CELL_MOVE, where(lanes, 0.0, load(lane, at.CELL_MOVE)))


@inlined
def first_active(lane, nodes):
    """The first node that moves in any lane of the block."""
    least = nodes - 2
    for l in range(LANES):
        least = min(least, int(lane[at.FIRST + l]))
    return least
