"""The env's share of a control step, over all lanes at once: the command, the judgement, the observation.

One compiled call each, for the batch as for the single env: as a dozen NumPy lines they took 60 µs a step for one lane
and 150 µs for 1024. Numba's cache does not see changes in `simulation.lanes`: after one, touch this file.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..simulation.algorithm1 import (
    DOF_STRIDE,
    HIGH,
    INV_PERIOD,
    INV_SPACING,
    LOW,
    OUT_FIELDS,
    PERIOD,
    SPACING,
    SPEED,
    TABLE_LAST,
    TABLE_ROW,
    TIP_MOMENT,
    WRENCH,
)
from ..simulation.lanes import LANES, absolute, load, maximum, minimum, sin_cos, store, where

_JIT = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}

ANGLE, RATE, DIRECTION = range(3)

# What the core keeps of each lane's episode: lanes[field, lane]
(
    GOAL, START_DISTANCE, DISTANCE, WALL_LIMIT, TRACT_LENGTH, STEPS, PEAK_WALL, PEAK_LATERAL, SUM_WALL, TRAVEL, HELD,
    SUM_SQUARES,
) = range(12)  # fmt: skip
LANE_FIELDS = 12

# What a step is worth: values[field, lane]; the last three are 0 or 1
(
    REWARD, FOR_SUCCESS, FOR_PROGRESS, FOR_TIME, FOR_WALL, COST, WALL_FORCE, PATH_RATIO, LEFT, SUCCESS, TERMINATED,
    TRUNCATED,
) = range(12)  # fmt: skip
VALUE_FIELDS = 12

STEER, REACH, TRACK = range(3)

SUMMARY = ("steps", "time", "peak_wall_force", "mean_wall_force", "peak_lateral_force", "magnet_travel", "rms_error")

# Kinds of observed numbers
RESULT, ARCLENGTH, DISTANCE_LEFT, SINE, COSINE, SLIDE = range(6)

_TIP_S, _PEAK_LATERAL, _PEAK_WALL, _MEAN_WALL, _TRAVEL = (
    OUT_FIELDS.index(name) for name in ("TIP_S", "PEAK_LATERAL", "PEAK_WALL", "MEAN_WALL", "TRAVEL")
)


@njit(**_JIT)
def command_of(mode, action, is_turn, period, dofs, magnet, command):
    """Actions (n, size), clipped to [−1, 1], as commands (dof, n) in rad and m; see `action.Actuation`.

    Returns −1, or the first lane whose action holds NaN; nothing is written then.
    """
    lanes, size = action.shape
    for lane in range(lanes):
        for i in range(size):
            if math.isnan(action[lane, i]):
                return lane
    for lane in range(lanes):
        at = 0
        for d in range(is_turn.shape[0]):
            o = d * DOF_STRIDE + lane % LANES
            row = dofs[lane // LANES]
            speed, low, high = row[o + SPEED], row[o + LOW], row[o + HIGH]
            a = min(max(action[lane, at], -1.0), 1.0)
            at += 1
            if mode == RATE:
                command[d, lane] = magnet[d, lane] + a * speed * period
            elif mode == DIRECTION and is_turn[d]:
                b = min(max(action[lane, at], -1.0), 1.0)
                at += 1
                command[d, lane] = 0.5 * (low + high) + math.atan2(b, a)
            else:
                command[d, lane] = low + 0.5 * (a + 1.0) * (high - low)
    return -1


@njit(**_JIT)
def way_left(kind, lane, out, trace, lanes, tolerance, period):
    """Way left to the goal after a control period (m), whether the task is done, and how long the goal has been held.

    Steering is done when the tip has passed the goal at any substep; reaching, when it has stayed within `tolerance`
    of the target at every substep for long enough (the caller's business); tracking never is before the time limit.
    """
    goal, s = load(lanes[GOAL], lane), load(out[_TIP_S], lane)
    if kind == STEER:
        farthest = load(trace[0], lane)
        for k in range(1, trace.shape[0]):
            farthest = maximum(farthest, load(trace[k], lane))
        return where(farthest >= goal, 0.0, goal - s), where(farthest >= goal, 1.0, 0.0), 0.0 * s
    worst = 0.0 * s
    for k in range(1, trace.shape[0]):
        worst = maximum(worst, absolute(load(trace[k], lane) - goal))
    held = where(worst <= tolerance, load(lanes[HELD], lane) + period, 0.0)
    return absolute(goal - s), 0.0 * s, held


@njit(**_JIT)
def judge(n, kind, out, trace, step_limit, period, tolerance, hold, safe, weights, lanes, values):
    """Reward, its terms, ends and costs of the control period just simulated; the episodes' totals move on.

    kind : `STEER`, `REACH` or `TRACK`
    safe : 1 to end an episode whose wall force exceeds the limit
    weights : (4,) for success, progress, time and wall force above the limit
    """
    last = trace.shape[0] - 1
    for lane in range(0, n, LANES):
        left, success, held = way_left(kind, lane, out, trace, lanes, tolerance, period)
        steps = load(lanes[STEPS], lane) + 1.0
        squares = load(lanes[SUM_SQUARES], lane) + left * left
        start = load(lanes[START_DISTANCE], lane)
        ended = steps >= step_limit
        share = left / start
        for_time = where(steps > 0.0, -weights[2], 0.0)
        if kind == REACH:
            # Half a control period of slack, so that the sum of periods need not be exact.
            success = where(held >= hold - 0.5 * period, 1.0, 0.0)
        elif kind == TRACK:
            good = where(squares <= tolerance * tolerance * steps, 1.0, 0.0)
            success = where(ended, good, 0.0)
            for_time = for_time * share
        wall, peak = load(out[_MEAN_WALL], lane), load(out[_PEAK_WALL], lane)
        cost = maximum(peak - load(lanes[WALL_LIMIT], lane), 0.0)
        terminated = where(load(trace[last], lane) < 0.0, 1.0, success if kind != TRACK else 0.0 * success)
        terminated = where(safe * cost > 0.0, 1.0, terminated)
        success = where(safe * cost > 0.0, 0.0, success)
        # Who leaves early without success pays for the time that was left: else giving up would beat a slow way.
        for_time = where(terminated > success, for_time - weights[2] * (step_limit - steps), for_time)
        for_success = weights[0] * success
        for_progress = weights[1] * (load(lanes[DISTANCE], lane) - left) / start
        for_wall = -weights[3] * cost
        store(values[REWARD], lane, for_success + for_progress + for_time + for_wall)
        store(values[FOR_SUCCESS], lane, for_success)
        store(values[FOR_PROGRESS], lane, for_progress)
        store(values[FOR_TIME], lane, for_time)
        store(values[FOR_WALL], lane, for_wall)
        store(values[COST], lane, cost)
        store(values[WALL_FORCE], lane, wall)
        store(values[PATH_RATIO], lane, 1.0 - share)
        store(values[LEFT], lane, left)
        store(values[SUCCESS], lane, success)
        store(values[TERMINATED], lane, terminated)
        store(values[TRUNCATED], lane, where(ended, 1.0 - terminated, 0.0))
        store(lanes[DISTANCE], lane, left)
        store(lanes[STEPS], lane, steps)
        store(lanes[HELD], lane, held)
        store(lanes[SUM_SQUARES], lane, squares)
        store(lanes[PEAK_WALL], lane, maximum(load(lanes[PEAK_WALL], lane), peak))
        store(lanes[PEAK_LATERAL], lane, maximum(load(lanes[PEAK_LATERAL], lane), load(out[_PEAK_LATERAL], lane)))
        store(lanes[SUM_WALL], lane, load(lanes[SUM_WALL], lane) + wall)
        store(lanes[TRAVEL], lane, load(lanes[TRAVEL], lane) + load(out[_TRAVEL], lane))


@njit(**_JIT)
def summarise(ended, kind, trace, period, lanes, summary):
    """Totals of the episodes that ended in the lanes `ended`, each into its column of `summary`, see `SUMMARY`.

    Steering's time, s, runs to the goal's crossing, linear within the substep in which the tip passed it; other
    tasks' to the end of the last control period.
    """
    last = trace.shape[0] - 1
    for lane in ended:
        goal, steps = lanes[GOAL, lane], lanes[STEPS, lane]
        elapsed = steps
        for k in range(last if kind == STEER else 0):
            before, after = trace[k, lane], trace[k + 1, lane]
            if after >= goal or before >= goal:
                share = min(max((goal - before) / (after - before), 0.0), 1.0) if after > before else 1.0
                elapsed = steps - 1.0 + (k + share) / last
                break
        summary[0, lane] = steps
        summary[1, lane] = elapsed * period
        summary[2, lane] = lanes[PEAK_WALL, lane]
        summary[3, lane] = lanes[SUM_WALL, lane] / steps
        summary[4, lane] = lanes[PEAK_LATERAL, lane]
        summary[5, lane] = lanes[TRAVEL, lane]
        summary[6, lane] = math.sqrt(lanes[SUM_SQUARES, lane] / steps)


@njit(**_JIT)
def observe(n, kinds, rows, scales, bounds, out, magnet, dofs, lanes, work, observation):
    """Every column of `observation` (n, size) that a kernel can fill: see `observation.Channel`.

    kinds : (size,) of the numbers, −1 for a column that is left alone
    rows : (size,) which result, or which degree of freedom
    """
    for j in range(kinds.shape[0]):
        kind, row, scale, bound = kinds[j], rows[j], scales[j], bounds[j]
        if kind < 0:
            continue
        for lane in range(0, n, LANES):
            if kind == RESULT:
                x = load(out[row], lane) / scale
            elif kind == ARCLENGTH:
                x = load(out[_TIP_S], lane) / load(lanes[TRACT_LENGTH], lane)
            elif kind == DISTANCE_LEFT:
                x = (load(lanes[GOAL], lane) - load(out[_TIP_S], lane)) / load(lanes[TRACT_LENGTH], lane)
            else:
                low, high = (
                    load(dofs[lane // LANES], row * DOF_STRIDE + LOW),
                    load(dofs[lane // LANES], row * DOF_STRIDE + HIGH),
                )
                x = (2.0 * load(magnet[row], lane) - low - high) / (high - low)
                if kind != SLIDE:
                    sine, cosine = sin_cos(math.pi * x)
                    x = sine if kind == SINE else cosine
            store(work, 0, minimum(maximum(x, -bound), bound))
            for l in range(min(LANES, n - lane)):
                observation[lane + l, j] = np.float32(work[l])


@njit(**_JIT)
def preview(offsets, par, tip, table, centre, scale, seen):
    """The centreline `offsets` (k,) m ahead of the tips: points from `centre` (n, 3) over `scale`, then tangents.

    tip : (n,) m or more; seen : (n, 6 k). As NumPy over the whole batch it took half of a step.
    """
    count = offsets.shape[0]
    for lane in range(seen.shape[0]):
        row, l = par[lane // LANES], lane % LANES
        for k in range(count):
            s = tip[lane] + offsets[k]
            s -= row[PERIOD + l] * math.floor(s * row[INV_PERIOD + l])
            piece = min(max(math.floor(s * row[INV_SPACING + l]) + 1.0, 0.0), row[TABLE_LAST + l])
            u = s - (piece - 1.0) * row[SPACING + l]
            c = 12 * int(piece + row[TABLE_ROW + l])
            for axis in range(3):
                b, second, third = table[c + 3 + axis], table[c + 6 + axis], table[c + 9 + axis]
                place = table[c + axis] + u * (b + u * (second + u * third))
                seen[lane, 3 * k + axis] = (place - centre[lane, axis]) / scale
                seen[lane, 3 * (count + k) + axis] = b + u * (2.0 * second + 3.0 * u * third)


@njit(**_JIT)
def pull_preview(offsets, par, tip, table, centres, strengths, scale, seen):
    """The drive `offsets` (k,) m ahead of the tips for each magnet's moment along x, y and z, over `scale`.

    centres : (n, m, 3) m, of the magnets, each a point dipole; strengths : (n, m) μ0 m / 4π, T·m³
    tip : (n,) m or more; seen : (n, 3 k m), magnet by magnet, place by place

    With r from magnet to tract, c = t·r/r and κ n the curvature vector, a moment along M̂ drives the tip by M̂·g:
    g = 3 (μ0 m m_tip/4π r⁴) [(1 − 5 c²) r/r + 2 c t], plus under `wrench` (μ0 m m_tip/4π r³) [3 (κ n·r) r/r² − κ n].
    """
    count, magnets = offsets.shape[0], centres.shape[1]
    for lane in range(seen.shape[0]):
        row, l = par[lane // LANES], lane % LANES
        for k in range(count):
            s = tip[lane] + offsets[k]
            s -= row[PERIOD + l] * math.floor(s * row[INV_PERIOD + l])
            piece = min(max(math.floor(s * row[INV_SPACING + l]) + 1.0, 0.0), row[TABLE_LAST + l])
            u = s - (piece - 1.0) * row[SPACING + l]
            at = 12 * int(piece + row[TABLE_ROW + l])
            for m in range(magnets):
                strength = strengths[lane, m] * row[TIP_MOMENT + l] / scale
                r2, c, bend = 0.0, 0.0, 0.0
                for axis in range(3):
                    b, second, third = table[at + 3 + axis], table[at + 6 + axis], table[at + 9 + axis]
                    r = table[at + axis] + u * (b + u * (second + u * third)) - centres[lane, m, axis]
                    t = b + u * (2.0 * second + 3.0 * u * third)
                    r2 += r * r
                    c += t * r
                    bend += (2.0 * second + 6.0 * u * third) * r
                r1 = math.sqrt(r2)
                c /= r1
                for axis in range(3):
                    b, second, third = table[at + 3 + axis], table[at + 6 + axis], table[at + 9 + axis]
                    r = table[at + axis] + u * (b + u * (second + u * third)) - centres[lane, m, axis]
                    t = b + u * (2.0 * second + 3.0 * u * third)
                    kn = 2.0 * second + 6.0 * u * third
                    g = 3.0 * ((1.0 - 5.0 * c * c) * r / r1 + 2.0 * c * t) / r1
                    g += row[WRENCH + l] * (3.0 * bend * r / r2 - kn)
                    seen[lane, 3 * (m * count + k) + axis] = strength * g / (r2 * r1)
