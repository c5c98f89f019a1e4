"""The way back along the wire after an evaluation: the next direction, and the nodes of the lanes that move."""

from __future__ import annotations

from ...compiled import kernel
from ..lanes import absolute, load, maximum, spread, store, where
from . import layout as at
from .magnetics import load9
from .vectors import apply9, dot, load3, plus, select3, store3, sub, times, zero3


@kernel
def search(tail, taken, known, still, par, wire, lane, node, spin, work, unit):
    """Move the lanes `taken` to their trial and leave the next direction of the lanes `known`.

    Returns its largest part, the cell's, and the slope of the potential along it.

    still : where the trial is an end, so that the direction is zero
    unit : m that a spin of a radian counts as
    """
    tip = node.shape[0] // at.NODE_STRIDE - 1
    alpha, first, zero = load(lane, at.ALPHA), load(lane, at.FIRST), spread(0.0)
    fed = load(par, at.FED) > 0.5
    b, c, bs, most, slope = zero3(), zero3(), zero, zero, zero
    new_cell = load(lane, at.CELL_MOVE)
    for i in range(tip, tail - 1, -1):
        o, n = i * at.WORK_STRIDE, i * at.NODE_STRIDE
        new_spin = zero
        p = sub(times(-1.0, load3(work, o + at.RIGHT)), apply9(load9(work, o + at.W1), b))
        p = sub(p, apply9(load9(work, o + at.W2), c))
        if spin is not None and i < tip:
            new_spin = -load(work, o + at.SPIN_RIGHT) - dot(load3(work, o + at.S1), b) - dot(load3(work, o + at.S2), c)
            new_spin = new_spin - load(work, o + at.S3) * bs
            p = plus(plus(p, -new_spin, load3(work, o + at.U1)), -bs, load3(work, o + at.U2))
            before, move = load(work, o + at.TURN), load(work, o + at.TURN_MOVE)
            m, k = load3(spin, i * at.SPIN_STRIDE + at.MX), load3(work, o + at.M1)
            store3(spin, i * at.SPIN_STRIDE + at.MX, select3(taken & (first <= 1.0 * i), k, m))
            store(work, o + at.TURN, where(taken, before + alpha * move, before))
            store(work, o + at.TURN_MOVE, where(known, where(still, 0.0, new_spin), move))
            most = maximum(most, absolute(new_spin) * unit)
            slope = slope + load(work, o + at.SPIN_GRADIENT) * new_spin
        b, c, bs = p, b, new_spin
        slope = slope + dot(load3(work, o + at.GRADIENT), p)
        x, move = load3(node, n + at.X), load3(work, o + at.MOVE)
        leaves = fed & (first <= 1.0 * i) & (first >= 1.0 * i)
        new_cell = where(leaves, p[0], new_cell)
        hold = load3(wire, i * at.WIRE_STRIDE + at.HOLD_X)
        p = select3(leaves, zero3(), p)
        p = (where(hold[0] > 0.0, 0.0, p[0]), where(hold[1] > 0.0, 0.0, p[1]), where(hold[2] > 0.0, 0.0, p[2]))
        store3(node, n + at.X, select3(taken, plus(x, alpha, move), x))
        goes = select3(still, zero3(), p)
        store3(work, o + at.MOVE, select3(known, goes, move))
        most = maximum(maximum(most, absolute(p[0])), maximum(absolute(p[1]), absolute(p[2])))
    return most, new_cell, slope
