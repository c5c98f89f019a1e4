"""The env's share of a control step, over all lanes at once: the command, the judgement, the observation.

One compiled call each, for the batch as for the single env: as a dozen NumPy lines they took 60 µs a step for one lane
and 150 µs for 1024. They read the simulator's readout and its trace of the way left, and no wire model's own arrays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled import kernel
from ..simulation.lanes import LANES, absolute, load, maximum, minimum, sin_cos, store, where
from ..simulation.readout import ROW
from ..simulation.servo import LIMIT

__all__ = [
    "ANGLE", "COSINE", "DIRECTION", "DISTANCE_LEFT", "EPISODE", "FOLLOW", "HOLD", "PASS", "RATE", "RESULT", "SINE",
    "SLIDE", "SUMMARY", "TRAVELLED", "VALUE", "command_of", "judge", "observe", "passed_at", "previewed",
    "summarise", "turn_back",
]  # fmt: skip

ANGLE, RATE, DIRECTION = range(3)
"""Action modes."""

PASS, HOLD, FOLLOW = range(3)
"""Rules that say when a task is done, see `magwire_env.envs.kinds.Kind`."""

RESULT, TRAVELLED, DISTANCE_LEFT, SINE, COSINE, SLIDE = range(6)
"""Kinds of observed numbers."""

FARTHEST = 1e3
"""m; a tip farther along than this has diverged."""


class Episode(NamedTuple):
    """Fields of a lane's episode, ``lanes[field, lane]``.

    start_distance : m, that the share of the way covered is measured against
    distance : m, way left after the last control period
    wall_limit : N, of the wall force, above which it costs
    route_length : m, that lengths along the route are observed against
    steps : control steps so far
    peak_wall, peak_lateral : N, largest so far
    sum_wall : N, over the steps
    travel : rad and m summed, of the rig
    held : s, for which the goal has been held
    sum_squares : m², of the way left over the steps
    unconverged : substeps so far whose solve did not converge
    sense : 1, or −1 on a way back, where the tip has passed the goal once it is behind it
    after : m, way that comes after the present goal: the way back of a task that comes back, until the tip has turned
    turned : s, when the tip passed the goal at which it turned back; 0 before
    far : m, the episode ends when the tip is farther along than this
    """

    start_distance: int
    distance: int
    wall_limit: int
    route_length: int
    steps: int
    peak_wall: int
    peak_lateral: int
    sum_wall: int
    travel: int
    held: int
    sum_squares: int
    unconverged: int
    sense: int
    after: int
    turned: int
    far: int


class Value(NamedTuple):
    """Fields of what a step is worth, ``values[field, lane]``.

    reward : the sum of the terms, which follow in the order of `magwire_env.envs.rewards.TERMS`
    cost, wall_force : N, peak wall force above the limit, mean wall force
    path_ratio : share of the way covered
    left : m, way left
    unconverged : substeps whose solve did not converge
    success, terminated, truncated : 0 or 1
    turned : 1 where the tip has just passed a goal after which a way back comes
    """

    reward: int
    for_success: int
    for_progress: int
    for_time: int
    for_wall: int
    for_travel: int
    cost: int
    wall_force: int
    path_ratio: int
    left: int
    unconverged: int
    success: int
    terminated: int
    truncated: int
    turned: int


EPISODE, VALUE = Episode(*range(len(Episode._fields))), Value(*range(len(Value._fields)))

SUMMARY = (
    "steps", "time", "peak_wall_force", "mean_wall_force", "peak_lateral_force", "magnet_travel", "unconverged",
    "rms_error", "time_in", "time_back",
)  # fmt: skip


@kernel
def command_of(mode, action, is_turn, period, limits, magnet, command):
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
            speed, low, high = limits[d, LIMIT.speed, lane], limits[d, LIMIT.low, lane], limits[d, LIMIT.high, lane]
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


@kernel
def way_left(rule, lane, trace, lanes, tolerance, period):
    """Way left to the goal after a control period (m), whether the task is done, and how long the goal has been held.

    `PASS` is done when the tip has passed the goal at any substep, in the direction of the episode's `sense`; `HOLD`,
    when it has stayed within `tolerance` of the target at every substep for long enough (the caller's business);
    `FOLLOW` never is before the time limit.
    """
    left = load(trace, trace.shape[0] - 1, lane)
    if rule == PASS:
        sense = load(lanes, EPISODE.sense, lane)
        nearest = sense * load(trace, 0, lane)
        for k in range(1, trace.shape[0]):
            nearest = minimum(nearest, sense * load(trace, k, lane))
        left = where(nearest <= 0.0, 0.0, sense * left)
        return left + load(lanes, EPISODE.after, lane), where(nearest <= 0.0, 1.0, 0.0 * left), 0.0 * left
    worst = 0.0 * left
    for k in range(1, trace.shape[0]):
        worst = maximum(worst, absolute(load(trace, k, lane)))
    held = where(worst <= tolerance, load(lanes, EPISODE.held, lane) + period, 0.0)
    return absolute(left), 0.0 * left, held


@kernel
def judge(n, rule, readout, trace, step_limit, period, tolerance, hold, safe, weights, lanes, values):
    """Reward, its terms, ends and costs of the control period just simulated; the episodes' totals move on.

    rule : `PASS`, `HOLD` or `FOLLOW`
    safe : 1 to end an episode whose wall force exceeds the limit
    weights : of the terms, in the order of `magwire_env.envs.rewards.TERMS`

    Returns −1, or the first lane whose motion has diverged; nothing is written then.
    """
    for lane in range(n):
        if not abs(readout[ROW.travelled, lane]) < FARTHEST or not abs(readout[ROW.remaining, lane]) < FARTHEST:
            return lane
    for lane in range(0, n, LANES):
        left, success, held = way_left(rule, lane, trace, lanes, tolerance, period)
        steps = load(lanes, EPISODE.steps, lane) + 1.0
        squares = load(lanes, EPISODE.sum_squares, lane) + left * left
        start = load(lanes, EPISODE.start_distance, lane)
        ended = steps >= step_limit
        share = left / start
        turned = where(load(lanes, EPISODE.after, lane) > 0.0, success, 0.0 * success)
        success = success - turned  # where a way back comes, the goal is not the end
        for_time = where(steps > 0.0, -weights[2], 0.0)
        if rule == HOLD:
            # Half a control period of slack, so that the sum of periods need not be exact.
            success = where(held >= hold - 0.5 * period, 1.0, 0.0)
        elif rule == FOLLOW:
            good = where(squares <= tolerance * tolerance * steps, 1.0, 0.0)
            success = where(ended, good, 0.0)
            for_time = for_time * share
        wall, peak = load(readout, ROW.mean_wall, lane), load(readout, ROW.peak_wall, lane)
        cost = maximum(peak - load(lanes, EPISODE.wall_limit, lane), 0.0)
        # What a feed has inserted is inside, however far the way back out of a wrong branch is.
        travelled = load(readout, ROW.travelled, lane)
        inside = travelled + load(readout, ROW.inserted, lane)
        outside = where(travelled > load(lanes, EPISODE.far, lane), 1.0, where(inside < 0.0, 1.0, 0.0 * travelled))
        terminated = where(outside > 0.0, 1.0, success if rule != FOLLOW else 0.0 * success)
        terminated = where(safe * cost > 0.0, 1.0, terminated)
        success = where(safe * cost > 0.0, 0.0, success)
        # An early end without success costs the time that was left. Otherwise giving up would beat slow progress.
        for_time = where(terminated > success, for_time - weights[2] * (step_limit - steps), for_time)
        for_success = weights[0] * success
        for_progress = weights[1] * (load(lanes, EPISODE.distance, lane) - left) / start
        for_wall = -weights[3] * cost
        for_travel = -weights[4] * load(readout, ROW.travel, lane)
        rest = for_wall + for_travel
        store(values, VALUE.reward, lane, for_success + for_progress + for_time + rest)
        store(values, VALUE.for_success, lane, for_success)
        store(values, VALUE.for_progress, lane, for_progress)
        store(values, VALUE.for_time, lane, for_time)
        store(values, VALUE.for_wall, lane, for_wall)
        store(values, VALUE.for_travel, lane, for_travel)
        store(values, VALUE.cost, lane, cost)
        store(values, VALUE.wall_force, lane, wall)
        store(values, VALUE.path_ratio, lane, 1.0 - share)
        store(values, VALUE.left, lane, left)
        store(values, VALUE.unconverged, lane, load(readout, ROW.unconverged, lane))
        store(values, VALUE.success, lane, success)
        store(values, VALUE.terminated, lane, terminated)
        store(values, VALUE.truncated, lane, where(ended, 1.0 - terminated, 0.0))
        store(values, VALUE.turned, lane, turned)
        add_up(lane, readout, lanes, (left, steps, held, squares, wall, peak))
    return -1


@kernel
def add_up(lane, readout, lanes, now):
    """Move the episodes' totals on by one control step."""
    left, steps, held, squares, wall, peak = now
    store(lanes, EPISODE.distance, lane, left)
    store(lanes, EPISODE.steps, lane, steps)
    store(lanes, EPISODE.held, lane, held)
    store(lanes, EPISODE.sum_squares, lane, squares)
    store(lanes, EPISODE.peak_wall, lane, maximum(load(lanes, EPISODE.peak_wall, lane), peak))
    lateral = maximum(load(lanes, EPISODE.peak_lateral, lane), load(readout, ROW.peak_lateral, lane))
    store(lanes, EPISODE.peak_lateral, lane, lateral)
    store(lanes, EPISODE.sum_wall, lane, load(lanes, EPISODE.sum_wall, lane) + wall)
    store(lanes, EPISODE.travel, lane, load(lanes, EPISODE.travel, lane) + load(readout, ROW.travel, lane))
    unconverged = load(lanes, EPISODE.unconverged, lane) + load(readout, ROW.unconverged, lane)
    store(lanes, EPISODE.unconverged, lane, unconverged)


@kernel
def passed_at(trace, lane, period, lanes):
    """When the tip passed the goal in the control period just judged, in periods since the episode's start.

    Linear within the substep in which it happened; −1 if it did not pass, or turned back in this very period.
    """
    last, sense = trace.shape[0] - 1, lanes[EPISODE.sense, lane]
    steps = lanes[EPISODE.steps, lane]
    for k in range(last if lanes[EPISODE.turned, lane] <= (steps - 1.0) * period else 0):
        before, after = sense * trace[k, lane], sense * trace[k + 1, lane]
        if after <= 0.0 or before <= 0.0:
            share = min(max(before / (before - after), 0.0), 1.0) if after < before else 1.0
            return steps - 1.0 + (k + share) / last
    return -1.0


@kernel
def turn_back(turning, trace, period, behind, lanes):
    """Begin the way back of the lanes `turning` (m,), whose tips have just passed the goal of the way in.

    behind : (m,) m, ways back
    """
    for i in range(turning.shape[0]):
        lane = turning[i]
        lanes[EPISODE.turned, lane] = passed_at(trace, lane, period, lanes) * period
        lanes[EPISODE.sense, lane], lanes[EPISODE.after, lane] = -1.0, 0.0
        lanes[EPISODE.distance, lane] = behind[i]


@kernel
def summarise(ended, rule, trace, period, lanes, summary):
    """Totals of the episodes that ended in the lanes `ended`, each into its column of `summary`, see `SUMMARY`.

    Under `PASS` the time, s, runs to the goal's crossing, see `passed_at`; under other rules to the end of the last
    control period. The times in and back are of a task that comes back; NaN for a leg that was not finished.
    """
    for lane in ended:
        steps = lanes[EPISODE.steps, lane]
        passed = passed_at(trace, lane, period, lanes) if rule == PASS else -1.0
        elapsed = passed if passed >= 0.0 else steps
        turned = lanes[EPISODE.turned, lane]
        summary[0, lane] = steps
        summary[1, lane] = elapsed * period
        summary[2, lane] = lanes[EPISODE.peak_wall, lane]
        summary[3, lane] = lanes[EPISODE.sum_wall, lane] / steps
        summary[4, lane] = lanes[EPISODE.peak_lateral, lane]
        summary[5, lane] = lanes[EPISODE.travel, lane]
        summary[6, lane] = lanes[EPISODE.unconverged, lane]
        summary[7, lane] = math.sqrt(lanes[EPISODE.sum_squares, lane] / steps)
        summary[8, lane] = turned if turned > 0.0 else math.nan
        summary[9, lane] = elapsed * period - turned if turned > 0.0 and passed >= 0.0 else math.nan


@kernel
def observe(n, kinds, rows, scales, bounds, readout, magnet, limits, lanes, work, observation):
    """Every column of `observation` (n, size) that a kernel can fill: see `observation.Channel`.

    kinds : (size,) of the numbers, −1 for a column that is left alone
    rows : (size,) which row of the readout, or which degree of freedom
    """
    for j in range(kinds.shape[0]):
        kind, row, scale, bound = kinds[j], rows[j], scales[j], bounds[j]
        if kind < 0:
            continue
        for lane in range(0, n, LANES):
            if kind == RESULT:
                x = load(readout, row, lane) / scale
            elif kind == TRAVELLED:
                x = load(readout, ROW.travelled, lane) / load(lanes, EPISODE.route_length, lane)
            elif kind == DISTANCE_LEFT:
                x = load(readout, ROW.remaining, lane) / load(lanes, EPISODE.route_length, lane)
            else:
                low, high = load(limits, row, LIMIT.low, lane), load(limits, row, LIMIT.high, lane)
                x = (2.0 * load(magnet, row, lane) - low - high) / (high - low)
                if kind != SLIDE:
                    sine, cosine = sin_cos(math.pi * x)
                    x = sine if kind == SINE else cosine
            store(work, 0, minimum(maximum(x, -bound), bound))
            for l in range(min(LANES, n - lane)):
                observation[lane + l, j] = np.float32(work[l])


@kernel
def previewed(found, centre, scale, seen):
    """The way ahead as a policy sees it: points from `centre` (n, 3) over `scale`, then tangents.

    found : (n, k, 9), see `Simulator.ahead`; seen : (n, 6 k). As NumPy over the whole batch it took half of a step.
    """
    count = found.shape[1]
    for lane in range(seen.shape[0]):
        for k in range(count):
            for axis in range(3):
                seen[lane, 3 * k + axis] = (found[lane, k, axis] - centre[lane, axis]) / scale
                seen[lane, 3 * (count + k) + axis] = found[lane, k, 3 + axis]
