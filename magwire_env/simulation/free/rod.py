"""One evaluation of the incremental potential of a block of wires, and the Newton direction from it.

A step of h s minimises

    Σ ½ m/h² |x − x₀ − h v|² + ½ c/h |x − x₀|² − f·x  +  stretching + bending + twisting  −  Σ m t·B  +  wall + friction

over the nodes' places x and the segments' spins. `evaluate` walks the wire from tail to tip: it adds up the potential,
its gradient and its Hessian, and takes every node out as soon as its rows are complete. `search.search` walks back.

With `spin` None the wire has no twist: an own, cheaper variant.

**The feed.** A wire that is fed leaves its sleeve inside a segment, the *cell*, whose rest length grows with what is
fed.
The node at the sleeve's mouth does not move; the first of its three unknowns is the cell's rest length instead. Its
gradient is the force on the feed: the thrust less M²/2EI, with which a bent rod leaves a sleeve.
"""

from __future__ import annotations

from ...compiled import inlined, kernel
from ..lanes import absolute, anywhere, load, maximum, minimum, reciprocal, rsqrt, spread, store, where
from . import layout as at
from .contact import touch
from .elements import aligned, bent, natural, precurved, stretched, times6, transported, turned, twisted
from .elimination import eliminate_node, eliminate_spin, node_from_spins
from .layout import HELD
from .magnetics import field_at
from .vectors import (
    add,
    add6,
    add9,
    cross,
    dot,
    full,
    load3,
    outer,
    plus,
    plus6,
    select3,
    square,
    store3,
    sub,
    sub6,
    sub9,
    symmetric,
    times,
    zero3,
    zero6,
    zero9,
)


@inlined
def times9(s, a):
    return s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5], s * a[6], s * a[7], s * a[8]


@inlined
def top_row(mask, r, m):
    """The matrix m with its first row replaced by r where the mask holds."""
    return (
        where(mask, r[0], m[0]), where(mask, r[1], m[1]), where(mask, r[2], m[2]), m[3], m[4], m[5], m[6], m[7], m[8]
    )  # fmt: skip


@inlined
def first_of(mask, value, v):
    return where(mask, value, v[0]), v[1], v[2]


@inlined
def trial(node, work, i, alpha):
    """Where the node is tried; a move of no length counts as none, whatever its direction is."""
    x = load3(node, i * at.NODE_STRIDE + at.X)
    return select3(alpha > 0.0, plus(x, alpha, load3(work, i * at.WORK_STRIDE + at.MOVE)), x)


@inlined
def own_terms(i, x, par, wire, node, work, active, h):
    """A node's inertia, drag and dead load: energy, gradient, Hessian, least of its diagonal."""
    o, w = i * at.WIRE_STRIDE, i * at.WORK_STRIDE
    ih = reciprocal(h)
    on = where(active, spread(1.0), spread(0.0))
    mass, drag = on * load(wire, o + at.MASS), on * load(wire, o + at.DRAG)
    inertia, rub = mass * ih * ih, drag * ih
    moved = sub(x, load3(work, w + at.START))
    ahead = plus(moved, -h * load(par, at.MEMORY), load3(node, i * at.NODE_STRIDE + at.VX))
    dead = plus(times(on, load3(wire, o + at.FORCE_X)), mass, load3(par, at.GX))
    energy = 0.5 * inertia * dot(ahead, ahead) + 0.5 * rub * dot(moved, moved) - dot(dead, moved)
    gradient = sub(plus(times(inertia, ahead), rub, moved), dead)
    stiff = where(active, inertia + rub, HELD)
    hold, zero = load3(wire, o + at.HOLD_X), spread(0.0)
    return energy, gradient, (stiff + hold[0], zero, zero, stiff + hold[1], zero, stiff + hold[2]), stiff


@inlined
def largest(worst, g, hold):
    """The largest component of a gradient so far, those of held coordinates left out."""
    worst = maximum(worst, where(hold[0] > 0.0, 0.0, absolute(g[0])))
    worst = maximum(worst, where(hold[1] > 0.0, 0.0, absolute(g[1])))
    return maximum(worst, where(hold[2] > 0.0, 0.0, absolute(g[2])))


@inlined
def drive(par, lane, cell):
    """Gradient and second derivative of the feed's drive: a spring to its goal whose force is limited; its energy."""
    stiffness, most = load(par, at.FEED_STIFFNESS), load(par, at.FEED_FORCE)
    off = cell - load(lane, at.FEED_GOAL)
    free = stiffness * off
    force = minimum(maximum(free, -most), most)
    slips = (free > most) | (free < -most)
    energy = where(slips, most * (absolute(off) - 0.5 * most / stiffness), 0.5 * free * off)
    return force, where(slips, 0.0, stiffness), energy


@kernel
def magnet_terms(block, i, active, par, wire, rig, magnets, clouds, cloud_of, sources, pose, xb, e, w, inv, exact):
    """A magnetised segment: energy, gradients of its ends, Hessian blocks; see `elements.aligned`."""
    o = i * at.WIRE_STRIDE
    a, moment = load(wire, o + at.AT), where(active, load(wire, o + at.MOMENT), 0.0)
    field, slope, rise = field_at(
        block, load3(par, at.FIELD_X), rig, magnets, clouds, cloud_of, sources, pose, plus(xb, a, e), w
    )
    energy, ge, gx, mee, mex, mxx = aligned(moment, w, inv, field, slope, rise, exact)
    z, both = 1.0 - a, symmetric(mex)
    hbb = plus6(plus6(mee, -z, both), z * z, mxx)
    hcc = plus6(plus6(mee, a, both), a * a, mxx)
    # by b, then by c: −ee + (1 − a) xe − a ex + a (1 − a) xx
    mxe = (mex[0], mex[3], mex[6], mex[1], mex[4], mex[7], mex[2], mex[5], mex[8])
    hbc = add9(add9(times9(z, mxe), times9(-a, mex)), full(1.0, plus6(times6(-1.0, mee), a * z, mxx)))
    return energy, sub(times(z, gx), ge), add(times(a, gx), ge), hbb, hbc, hcc


@kernel
def evaluate(
    block, tail, points, magnetic, par, wire, lane, node, spin, foot, work, loads, table, grid,
    rig, magnets, clouds, cloud_of, sources, pose,
):  # fmt: skip
    """The potential at the trial x + α move, and the elimination of its Newton system.

    Returns the energies with the lagged and the new friction loads, the largest gradient of a coordinate that is free
    (of a spin, over its segment's length), the Newton decrement gᵀH⁻¹g, the sum of the wall's normal forces, and the
    part of it that is of contacts which the iterate has not.
    """
    tip = node.shape[0] // at.NODE_STRIDE - 1
    zero, one = spread(0.0), spread(1.0)
    alpha, h, exact = load(lane, at.ALPHA), load(lane, at.H), load(lane, at.EXACT)
    first, taken, moves = load(lane, at.FIRST), load(lane, at.TAKEN) > 0.5, load(lane, at.LEFT) > 0.0
    foresees = (load(lane, at.FORESEES) > 0.5) & (load(lane, at.FORESEES) < 2.5)
    fed, slow = load(par, at.FED) > 0.5, load(par, at.STICK) * h
    friction, spacing = load(par, at.FRICTION), load(par, at.SPACING)
    wall = load(par, at.WALL) * (1.0 / points)
    loose = where(fed | (load(par, at.BASE_CLAMPED) > 0.0), 0.0, 0.5)  # a base that nothing holds touches the wall
    cell = load(lane, at.CELL) + where(alpha > 0.0, alpha * load(lane, at.CELL_MOVE), 0.0)
    old, new, worst, decrement, pressed, fresh = zero, zero, zero, zero, zero, zero

    base_force, base_torque = zero3(), zero3()
    # The window; r… the gradient itself, f… the wall's force.
    aa, ab, ac, bc = zero6(), zero9(), zero9(), zero9()
    ga, ra, rb, fa, fb = zero3(), zero3(), zero3(), zero3(), zero3()
    floor_a, floor_s = one, one
    ss, st, tt, gs, gt, qs, qt = one, zero, one, zero, zero, zero, zero
    sa, sb, sc, ta, tb, tc = zero3(), zero3(), zero3(), zero3(), zero3(), zero3()

    xb = trial(node, work, tail, alpha)
    energy, gb, bb, floor_b = own_terms(tail, xb, par, wire, node, work, first <= 1.0 * tail, h)
    old, new, rb = old + energy, new + energy, gb
    u, p, rest_below, spun = load3(par, at.BASE_TX), zero, zero, zero
    m_below = load3(lane, at.BASE_MX)

    for i in range(tail, tip):
        o, ob, oc = i * at.WIRE_STRIDE, i * at.WORK_STRIDE, (i + 1) * at.WORK_STRIDE
        active = first <= 1.0 * i
        begins = active & (first >= 1.0 * i)
        leaves = begins & fed
        xc = trial(node, work, i + 1, alpha)
        energy, gc, cc, floor_c = own_terms(i + 1, xc, par, wire, node, work, first <= 1.0 * (i + 1), h)

        # --- the segment's stretch ---
        e = sub(xc, xb)
        d2 = maximum(dot(e, e), 1e-24)
        inv = rsqrt(d2)
        length, w = d2 * inv, times(inv, e)
        rest = where(leaves, cell, load(wire, o + at.REST))
        inv_rest = reciprocal(rest)
        axial = where(active, load(wire, o + at.AXIAL), 0.0)
        part, tension, hcc = stretched(axial * inv_rest, rest, length, w, inv, exact)
        energy = energy + part
        dc = times(tension, w)
        db, hbb, hbc = times(-1.0, dc), hcc, full(-1.0, hcc)

        # --- the joint at b ---
        u, p = select3(begins, load3(par, at.BASE_TX), u), where(begins, 0.0, p)
        span = where(begins, 0.5 * rest, 0.5 * (rest_below + rest))
        inv_span = reciprocal(span)
        clamped = where(begins, load(par, at.BASE_CLAMPED), 1.0)
        bending = where(active, load(wire, o + at.BENDING), 0.0) * clamped
        joint, ge, gf, jee, jef, jff = bent(bending * inv_span, u, p, w, inv, exact)
        curl_energy, js, jt, twist_torque = zero, zero, zero, zero
        if spin is not None:
            base = sub(load3(node, (i + 1) * at.NODE_STRIDE + at.X), load3(node, i * at.NODE_STRIDE + at.X))
            base = times(rsqrt(maximum(dot(base, base), 1e-24)), base)
            turn_move = where(alpha > 0.0, alpha * load(work, ob + at.TURN_MOVE), 0.0)
            m = turned(transported(load3(spin, i * at.SPIN_STRIDE + at.MX), base, w), w, turn_move)
            store3(work, ob + at.M1, m)
            turn = load(work, ob + at.TURN) + turn_move
            m_below = select3(begins, load3(lane, at.BASE_MX), m_below)
            twisting = where(active, load(wire, o + at.TWISTING), 0.0) * clamped * inv_span
            part, torque, half, tee, tef, tff = twisted(twisting, u, p, m_below, w, inv, m, exact)
            joint, twist_torque = joint + part, torque
            se, sf = times(p, half), times(inv, half)
            ge, gf = plus(ge, torque, se), plus(gf, torque, sf)
            jee = add6(jee, add6(tee, square(twisting, se)))
            jff = add6(jff, add6(tff, square(twisting, sf)))
            jef = add9(add9(jef, tef), outer(twisting, se, sf))
            ses, sfs = times(-twisting, se), times(-twisting, sf)
            set_, sft = times(twisting, se), times(twisting, sf)
            js, jt, jss, jtt, jst = -torque, torque, twisting, twisting, -twisting
            curl_1, curl_2 = load(wire, o + at.CURL_1), load(wire, o + at.CURL_2)
            if anywhere((curl_1 > 0.0) | (curl_1 < 0.0) | (curl_2 > 0.0) | (curl_2 < 0.0)):
                na, na1 = natural(curl_1 * span, curl_2 * span, u, m_below)
                nb, nb1 = natural(curl_1 * span, curl_2 * span, w, m)
                part, ne, nf, ns, nt, nee, nef, nff, nes, net, nfs, nft, nss, ntt = precurved(
                    bending * inv_span, u, p, w, inv, na, nb, na1, nb1, exact
                )
                curl_energy = 0.5 * bending * (curl_1 * curl_1 + curl_2 * curl_2)
                energy = energy + part + curl_energy * span
                ge, gf = add(ge, ne), add(gf, nf)
                jee, jef, jff = add6(jee, nee), add9(jef, nef), add6(jff, nff)
                ses, set_, sfs, sft = add(ses, nes), add(set_, net), add(sfs, nfs), add(sft, nft)
                js, jt, jss, jtt = js + ns, jt + nt, jss + nss, jtt + ntt
            # The director of a clamp is no unknown.
            live = where(active, 1.0, 0.0)
            live = where(begins, 0.0, live)
            js, jss, jst, ses, sfs = live * js, live * jss, live * jst, times(live, ses), times(live, sfs)
            inertia = where(active, load(wire, o + at.SPIN_INERTIA), 1.0) * reciprocal(h * h)
            energy = energy + 0.5 * inertia * turn * turn
            gs, qs, gt = gs + js, qs + js, jt + inertia * turn
            qt, floor_t = gt, inertia
            ss, tt, st = ss + jss, jtt + inertia, jst
            sa, sb, sc = sub(sa, ses), add(sb, sub(ses, sfs)), sfs
            ta, tb, tc = times(-1.0, set_), sub(set_, sft), sft
        energy = energy + joint
        da, db, dc = times(-1.0, ge), add(db, sub(ge, gf)), add(dc, gf)
        haa, hab, hac = jee, sub9(jef, full(1.0, jee)), times9(-1.0, jef)
        hbb = add6(hbb, sub6(add6(jee, jff), symmetric(jef)))
        hbc, hcc = add9(hbc, sub9(jef, full(1.0, jff))), add6(hcc, jff)

        # --- the wall at the segment's points ---
        if spin is not None:
            spun = turn
        away, radius = where(active, wall, 0.0), load(wire, o + at.RADIUS)
        fc, pull_b, pull_c = zero3(), zero3(), zero3()
        start_b = load3(work, ob + at.START)
        start_e = sub(load3(work, oc + at.START), start_b)
        for k in range(points):
            a = k / points
            weight = rest
            if k == 0:
                weight = where(begins, loose * rest, 0.5 * (rest_below + rest))
            t_old, t_new, force, g, hx, g_spin, h_spin, x_spin, unknown, pull = touch(
                table, grid, par, foot, (i * points + k) * at.FOOT_STRIDE, (i * points + k) * at.LOAD_STRIDE, loads,
                plus(xb, a, e), plus(start_b, a, start_e), w, radius, spun, away * weight, friction, slow, spacing,
                exact, taken, moves & active, foresees,
            )  # fmt: skip
            old, new, pressed, fresh = old + t_old, new + t_new, pressed + force, fresh + unknown
            pull_b, pull_c = plus(pull_b, 1.0 - a, pull), plus(pull_c, a, pull)
            db, dc = plus(db, 1.0 - a, g), plus(dc, a, g)
            fb, fc = plus(fb, a - 1.0, g), plus(fc, -a, g)
            hbb, hcc = plus6(hbb, (1.0 - a) * (1.0 - a), hx), plus6(hcc, a * a, hx)
            hbc = add9(hbc, full(a * (1.0 - a), hx))
            if spin is not None:
                gt, qt, tt = gt + g_spin, qt + g_spin, tt + h_spin
                tb, tc = plus(tb, 1.0 - a, x_spin), plus(tc, a, x_spin)

        # --- its magnet ---
        if magnetic[i]:
            part, mb, mc, mbb, mbc, mcc = magnet_terms(
                block, i, active, par, wire, rig, magnets, clouds, cloud_of, sources, pose, xb, e, w, inv, exact
            )
            energy = energy + part
            db, dc = add(db, mb), add(dc, mc)
            hbb, hbc, hcc = add6(hbb, mbb), add9(hbc, mbc), add6(hcc, mcc)

        if anywhere(begins):
            base_force = select3(begins, db, base_force)
            r = reciprocal(maximum(1.0 + dot(u, w), 1e-6))
            bend = times(-4.0 * bending * inv_span * r * r, cross(u, w))
            base_torque = select3(begins, plus(bend, -twist_torque, u), base_torque)

        # --- the feed ---
        second = (first <= 1.0 * (i - 1)) & (first >= 1.0 * (i - 1))  # a is the base
        if anywhere(second):
            base_force = select3(second, add(base_force, da), base_force)
        above = fed & second
        if anywhere(above):  # a stands for the cell, half of the joint's span
            by = -0.5 * inv_span
            da = select3(above, (by * joint + 0.5 * curl_energy, zero, zero), da)
            haa = (where(above, 2.0 * by * by * joint, haa[0]), where(above, 0.0, haa[1]), where(above, 0.0, haa[2]),
                   haa[3], haa[4], haa[5])  # fmt: skip
            hab, hac = top_row(above, times(by, sub(ge, gf)), hab), top_row(above, times(by, gf), hac)
            if spin is not None:
                sa, ta = first_of(above, by * js, sa), first_of(above, by * jt, ta)
        if anywhere(leaves):  # b stands for the cell; all of its joint's span and all of its segment
            ratio = length * inv_rest
            by = -0.5 * inv_span
            push, stiff, energy_of_drive = drive(par, lane, cell)
            energy = energy + where(leaves, energy_of_drive, 0.0)
            force = 0.5 * axial * (1.0 - ratio * ratio) + by * joint + 0.5 * curl_energy + push
            stiff = stiff + axial * ratio * ratio * inv_rest + 2.0 * by * by * joint
            db = select3(leaves, (force, zero, zero), db)
            gb, rb = select3(leaves, zero3(), gb), select3(leaves, zero3(), rb)
            bb = (
                where(leaves, 0.0, bb[0]),
                bb[1],
                bb[2],
                where(leaves, HELD, bb[3]),
                bb[4],
                where(leaves, HELD, bb[5]),
            )
            hbb = (where(leaves, stiff, hbb[0]), where(leaves, 0.0, hbb[1]), where(leaves, 0.0, hbb[2]),
                   hbb[3], hbb[4], hbb[5])  # fmt: skip
            floor_b = where(leaves, 1e-3 * axial * inv_rest, floor_b)
            hbc = top_row(leaves, plus(times(-axial * ratio * inv_rest, w), by, gf), hbc)
            if spin is not None:
                tb = first_of(leaves, by * jt, tb)

        old, new = old + energy, new + energy
        ga, gb = add(ga, da), add(gb, add(db, select3(leaves, zero3(), pull_b)))
        ra, rb, rc = add(ra, da), add(rb, db), add(gc, dc)
        gc = add(rc, pull_c)
        aa, ab, ac = add6(aa, haa), add9(ab, hab), hac
        bb, bc, cc = add6(bb, hbb), hbc, add6(cc, hcc)

        # --- a and s are complete ---
        if i > tail:
            oa = (i - 1) * at.WORK_STRIDE
            worst = largest(worst, ra, load3(wire, (i - 1) * at.WIRE_STRIDE + at.HOLD_X))
            store3(work, oa + at.GRADIENT, ra)
            store3(work, oa + at.CONTACT, fa)
            inv_a, y, bb, bc, cc, gb, gc, part = eliminate_node(work, oa, floor_a, aa, ab, ac, ga, bb, bc, cc, gb, gc)
            decrement = decrement + part
            if spin is not None:
                store(work, oa + at.SPIN_GRADIENT, qs)
                worst = maximum(worst, absolute(qs) * reciprocal(load(wire, (i - 1) * at.WIRE_STRIDE + at.REST)))
                ss, st, tt, sb, sc, tb, tc, gs, gt = node_from_spins(
                    work, oa, inv_a, y, ab, ac, sa, ta, ss, st, tt, sb, sc, tb, tc, gs, gt
                )
                tt, tb, tc, gt, bb, bc, cc, gb, gc, part = eliminate_spin(
                    work, oa, floor_s, ss, st, tt, sb, sc, tb, tc, gs, gt, bb, bc, cc, gb, gc
                )
                decrement = decrement + part

        aa, ab, bb, ga, gb, ra, rb, fa, fb = bb, bc, cc, gb, gc, rb, rc, fb, fc
        floor_a, floor_b = floor_b, floor_c
        u, p, rest_below, xb = w, inv, rest, xc
        if spin is not None:
            m_below, ss, gs, qs, sa, sb, floor_s = m, tt, gt, qt, tb, tc, floor_t

    # --- the tip: its joint with a clamp, if there is one, and its own contact point ---
    o, oa, ob = tip * at.WIRE_STRIDE, (tip - 1) * at.WORK_STRIDE, tip * at.WORK_STRIDE
    inv_span = 2.0 * reciprocal(rest_below)
    clamped = load(par, at.TIP_CLAMPED)
    bending = load(wire, o + at.BENDING) * clamped * inv_span
    end = load3(par, at.TIP_TX)
    energy, ge, gf, jee, jef, jff = bent(bending, u, p, end, zero, exact)
    if spin is not None:
        twisting = load(wire, o + at.TWISTING) * clamped * inv_span
        part, torque, half, tee, tef, tff = twisted(twisting, u, p, m_below, end, zero, load3(lane, at.TIP_MX), exact)
        se = times(p, half)
        energy, ge = energy + part, plus(ge, torque, se)
        jee = add6(jee, add6(tee, square(twisting, se)))
        ses = times(-twisting, se)
        gs, qs, ss = gs - torque, qs - torque, ss + twisting
        sa, sb = sub(sa, ses), add(sb, ses)
    start = load3(work, ob + at.START)
    t_old, t_new, force, g, hx, g_spin, h_spin, x_spin, unknown, pull = touch(
        table, grid, par, foot, tip * points * at.FOOT_STRIDE, tip * points * at.LOAD_STRIDE, loads, xb, start, u,
        load(wire, (tip - 1) * at.WIRE_STRIDE + at.RADIUS), spun,
        wall * (0.5 * rest_below) + load(par, at.WALL) * load(par, at.TIP_CAP), friction, slow, spacing, exact,
        taken, moves, foresees,
    )  # fmt: skip
    old, new, pressed, fresh = old + energy + t_old, new + energy + t_new, pressed + force, fresh + unknown
    if spin is not None:
        gs, qs, ss, sb = gs + g_spin, qs + g_spin, ss + h_spin, add(sb, x_spin)
    ga, ra = sub(ga, ge), sub(ra, ge)
    gb, rb = add(gb, add(ge, add(g, pull))), add(rb, add(ge, g))
    fb = sub(fb, g)
    aa, ab, bb = add6(aa, jee), sub9(ab, full(1.0, jee)), add6(bb, add6(jee, hx))
    worst = largest(worst, ra, load3(wire, (tip - 1) * at.WIRE_STRIDE + at.HOLD_X))
    worst = largest(worst, rb, load3(wire, o + at.HOLD_X))
    store3(work, oa + at.GRADIENT, ra)
    store3(work, oa + at.CONTACT, fa)
    store3(work, ob + at.GRADIENT, rb)
    store3(work, ob + at.CONTACT, fb)
    inv_a, y, bb, bc, cc, gb, gc, part = eliminate_node(
        work, oa, floor_a, aa, ab, zero9(), ga, bb, zero9(), zero6(), gb, zero3()
    )
    decrement = decrement + part
    if spin is not None:
        store(work, oa + at.SPIN_GRADIENT, qs)
        worst = maximum(worst, absolute(qs) * inv_span * 0.5)
        ss, st, tt, sb, sc, tb, tc, gs, gt = node_from_spins(
            work, oa, inv_a, y, ab, zero9(), sa, zero3(), ss, zero, one, sb, zero3(), zero3(), zero3(), gs, zero
        )
        tt, tb, tc, gt, bb, bc, cc, gb, gc, part = eliminate_spin(
            work, oa, floor_s, ss, zero, one, sb, zero3(), zero3(), zero3(), gs, zero, bb, zero9(), zero6(), gb, zero3()
        )
        decrement = decrement + part
    _, y, bb, bc, cc, gb, gc, part = eliminate_node(
        work, ob, floor_b, bb, zero9(), zero9(), gb, zero6(), zero9(), zero6(), zero3(), zero3()
    )
    store3(lane, at.BASE_FX, base_force)
    store3(lane, at.BASE_TQX, base_torque)
    return old, new, worst, decrement + part, pressed, fresh
