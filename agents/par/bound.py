"""A time that no policy can beat: the wire driven by the greatest net force there is, at every place.

Without servos. A wire that moves as one obeys m v v′ = F(s, θ) − c v, and whatever the magnets do, F is at most its
greatest over all commands. The speed at a place then is at most that of the wire which has the greatest force all
along and sets off at rest, and so no passage from place to place is faster. A policy that first runs back and passes
the start with speed set off at rest further back: so the least over starts up to `_RUN_UP` back counts.

With the servo, one turn. Within t the magnet is at most ω t from where it started, so the force at most G(t, s), the
greatest over the reachable arc and over places from the run-up to s. Let z = s + τ v with τ = m/c. While v ≥ 0,
z′ = F/c ≤ G(t, s)/c; while v < 0, z < s, no further than the tip has been. Hence z ≤ y, and since s′ = (z − s)/τ also
s ≤ x, with y′ = G(t, x)/c, x′ = (y − x)/τ and both the start at first. With A(s) the least time to s without servos,
the goal takes at least t + A(goal) − A(x(t)), for any t; the greatest counts. At t = 0 that is A(goal). If the whole
reachable arc drags the wire back at first, then t and the start are counted from when it no longer does.

The wire is the simulator's: its bending resistance is that of the chain of segments, not of the curve. Its tip may be
ahead of a wire that moves as one by as much as it stretches, and of one that moves continuously by the error h² a/12 of
its drifts, which are trapezoids of the speed: the goal is taken that much nearer. What is left, friction of a chain
against that of a curve and forces at the middle of a step, goes into a margin on the force.
"""

from __future__ import annotations

import numpy as np

from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.certificate import traverse
from magwire_env.quasistatic.net_force import Places, greatest
from magwire_env.scenario import Scenario
from magwire_env.simulation.locked import algorithm1 as a1
from magwire_env.simulation.locked.arrays import LaneArrays, Library

__all__ = ["Fastest", "least_time"]

_SPACING = 2.5e-4
"""m between the places of the quadrature."""

_COARSE = 1e-3
"""m between the places whose forces are tabulated."""

_RUN_UP = 0.03
"""The longest run-up looked at, m, or the way in which drag stops the wire from its greatest speed, if longer."""

_ANGLES = 240
"""Magnet angles tabulated."""

_MARGIN = 1e-3
"""What is added to the net force: this share of the greatest force and of the sharpest bend's ½ E I κ² together.

It comes to the 20 µN to which certificates trust the balance. With half of it one of 500 generated tracts, whose
weakest place leaves 0.1 mN, was crossed 1.1 % faster than its bound.
"""

_TICK = 5e-3
"""Time step of y(t), s; the arc that is reachable at a step's end counts for all of it."""


class Fastest:
    """Least times in one scenario and direction, from any place and magnet angle.

    direction : +1 forward, −1 backward
    """

    def __init__(self, scenario: Scenario, direction: int = 1) -> None:
        if direction not in (1, -1):
            raise ValueError(f"direction must be 1 or -1, got {direction!r}")
        self.scenario, self.direction = scenario, direction
        self.library = Library([scenario])
        self.mass = scenario.wire.mass + (scenario.tip.mass or 0.0)
        length = scenario.tract.length
        self.places = np.linspace(0.0, length, int(np.ceil(length / _COARSE)) + 1)
        self._entries = np.zeros(len(self.places), dtype=np.int64)
        self._bend = _chain_less_curve(self.library, self.places)
        pull, self._growth = self._resistance(direction)
        self.commands, force = greatest(self.library, self._entries, self.places, direction)
        bend = 0.5 * scenario.wire.bending_rigidity * float((scenario.tract.curvature(self.places) ** 2).max())
        self._margin = _MARGIN * (float(np.abs(force).max()) + bend)
        self.net = force - pull + self._margin
        stretch = float(np.abs(force).max()) * scenario.wire.length / scenario.wire.axial_rigidity
        step = scenario.timing.control_period / scenario.timing.substeps
        self._slack = stretch + step * step / 12.0 * max(float(self.net.max()), 0.0) / self.mass
        self._run_up = max(_RUN_UP, self.mass * float(self.net.max()) / float(self._growth.min()) ** 2)
        self._tables: dict[int, np.ndarray] = {}

    def _resistance(self, direction: int) -> tuple[np.ndarray, np.ndarray]:
        """What the tip must supply to move the wire along `direction`, N, and its growth with speed, N·s/m."""
        pull, growth = Tails([self.scenario]).pull(self._entries, self.places, direction)
        return pull + direction * self._bend, growth

    def least(self, start: float, goal: float, magnet: float | None = None) -> float:
        """Least time from `start` to `goal` (m), at rest and the magnet anywhere, or, of one turn, at `magnet` (rad).

        ∞ where not even the greatest force gets there.
        """
        length = self.scenario.tract.length
        for name, value in (("start", start), ("goal", goal)):
            if not 0.0 <= value <= length:
                raise ValueError(f"{name} must lie in [0, {length:.4g}] (in m), got {value!r}")
        if self.direction * (goal - start) <= 0.0:
            raise ValueError(
                f"goal must lie ahead of start ({start:.4g} m) in direction {self.direction}, got {goal!r}"
            )
        goal = self.direction * max(self.direction * goal - self._slack, self.direction * start)
        if goal == start:
            return 0.0
        if magnet is None or self.library.dof != 1 or not self.library.is_turn[0]:
            return self._free(start, goal)
        held, start = self._held_back(start, magnet)
        free = self._free(start, goal)
        way, arrival = self._arrivals(start, goal)
        if not np.isfinite(arrival[-1]):
            return held + free
        times, reached = self._ahead(start, goal, magnet, held)
        late = times - np.interp(self.direction * reached, self.direction * way, arrival)
        return held + free + float(late.max())

    def _free(self, start: float, goal: float) -> float:
        """Least time without servos, over run-ups."""
        backs = np.linspace(0.0, 1.0, 6) ** 2 * self._run_up
        return float(min(self._arrivals(start - self.direction * back, goal)[1][-1] for back in backs))

    def _arrivals(self, start: float, goal: float) -> tuple[np.ndarray, np.ndarray]:
        """Places from start to goal, and when the wire that sets off at rest under the greatest force is there."""
        start = min(max(start, 0.0), self.scenario.tract.length)
        way = np.linspace(start, goal, int(np.ceil(abs(goal - start) / _SPACING)) + 1)
        net, growth = np.interp(way, self.places, self.net), np.interp(way, self.places, self._growth)
        _, seconds = traverse(way, net, growth, self.mass)
        return way, np.r_[0.0, seconds.cumsum()]

    def _ahead(self, start: float, goal: float, magnet: float, held: float) -> tuple[np.ndarray, np.ndarray]:
        """Times (k,) s since `held` while the servo's reach still counts, and x (k,) m: how far the tip can be then."""
        places, force = self._ordered(self.direction)
        first = max(int(np.searchsorted(places, self.direction * start - self._run_up)) - 1, 0)
        places, force = places[first:], np.maximum.accumulate(force[first:], axis=0)
        growth = float(self._growth.min())
        share = -np.expm1(-_TICK * growth / self.mass)
        x = y = self.direction * start
        times, reached = [0.0], [x]
        for k in range(round(held / _TICK) + 1, self._ticks() + 1):
            columns = self._arc(magnet, k)
            row = min(int(np.searchsorted(places, x + (y - x) * share)) + 1, len(places) - 1)
            y += max(float(force[row, columns].max()), 0.0) / growth * _TICK
            x += (y - x) * share
            if x >= self.direction * goal:
                break
            times.append(k * _TICK - held)
            reached.append(x)
        return np.array(times), self.direction * np.array(reached)

    def _held_back(self, start: float, magnet: float) -> tuple[float, float]:
        """For how long the whole arc within the servo's reach drags the wire back, s, and the furthest it then is, m.

        Its speed is at most that under the arc's least backward force, over all places that the least and the greatest
        take it to; friction helps to stop it.
        """
        places, force = self._ordered(-self.direction)
        _, growth = self._resistance(-self.direction)
        strong, weak = float(growth.max()), float(growth.min())
        high = low = self.direction * start
        fast = slow = 0.0
        for k in range(1, self._ticks() + 1):
            first = int(np.searchsorted(places, low - 1e-3 + 2.0 * slow * _TICK)) - 1
            near = force[max(first, 0) : int(np.searchsorted(places, high)) + 1, self._arc(magnet, k)]
            if near.max() >= 0.0 or first < 0:
                return (k - 1) * _TICK, self.direction * high
            later = fast + (float(near.max()) / strong - fast) * -np.expm1(-_TICK * strong / self.mass)
            high, fast = high + _TICK * max(fast, later), later
            later = slow + (float(near.min()) / weak - slow) * -np.expm1(-_TICK * weak / self.mass)
            low, slow = low + _TICK * min(slow, later), later
        return self._ticks() * _TICK, self.direction * high

    def _ticks(self) -> int:
        """Steps until the servo reaches every angle."""
        return int(np.ceil(np.pi / float(self.library.dofs[0, 0, 0]) / _TICK))

    def _arc(self, magnet: float, ticks: int) -> np.ndarray:
        """Columns of the angles that the servo reaches within so many steps, rounded outwards."""
        column = 2 * np.pi / _ANGLES
        here = (magnet - float(self.library.home[0, 0]) + np.pi) / column
        arc = float(self.library.dofs[0, 0, 0]) * ticks * _TICK / column
        return np.arange(np.floor(here - arc), np.ceil(here + arc) + 1).astype(np.int64) % _ANGLES

    def _ordered(self, motion: int) -> tuple[np.ndarray, np.ndarray]:
        """Places in the order of travel, signed by it, and the net force along the travel there, (places, angles) N.

        motion : which way the wire moves, and so which way friction points
        """
        if motion not in self._tables:
            places = Places(self.library, self._entries, self.places, motion)
            angles = float(self.library.home[0, 0]) - np.pi + 2 * np.pi / _ANGLES * np.arange(_ANGLES)
            net = np.stack([places.force(np.full((places.n, 1), angle)) for angle in angles], axis=1)
            net -= self._resistance(motion)[0][:, None]
            self._tables[motion] = motion * self.direction * net + self._margin
        order = slice(None, None, self.direction)
        return self.direction * self.places[order], self._tables[motion][order]


def least_time(scenario: Scenario, start: float, goal: float, direction: int = 1, magnet: float | None = None) -> float:
    """A time in s from `start` to `goal` (m) that no policy can beat, see this module; many starts: `Fastest`."""
    return Fastest(scenario, direction).least(start, goal, magnet)


def _chain_less_curve(library: Library, tips: np.ndarray) -> np.ndarray:
    """Force that bends the chain of segments as its tip moves on, less that of a continuous wire, (n,) N."""
    scenario, step = library.scenarios[0], 1e-4
    before, after = (_bending_energy(library, tips + shift) for shift in (-step, step))
    tract, rigidity = scenario.tract, scenario.wire.bending_rigidity
    kappa, tail = tract.curvature(tips), tract.curvature(tips - scenario.wire.length)
    return (after - before) / (2 * step) - 0.5 * rigidity * (kappa * kappa - tail * tail)


def _bending_energy(library: Library, tips: np.ndarray) -> np.ndarray:
    """Energy of the joints and of the two half cells at the ends, of wires laid at rest behind `tips`, (n,) J."""
    n = len(tips)
    arrays, lanes = LaneArrays(library, n), np.arange(n)
    arrays.lay_at_rest(lanes, tips)
    points, tangents = library.centreline(np.zeros(n, dtype=np.int64), arrays.arclengths())
    segments = np.diff(points, axis=1)
    units = segments / np.linalg.norm(segments, axis=2, keepdims=True)
    ends = tangents[:, [0, -1]] / np.linalg.norm(tangents[:, [0, -1]], axis=2, keepdims=True)
    joints = _angle(units[:, :-1], units[:, 1:])
    halves = _angle(ends, units[:, [0, -1]])
    wire = library.wire[0].reshape(library.nodes, -1)
    bend, end = wire[1, a1.K_BEND // a1.LANES], wire[0, a1.K_END // a1.LANES]
    return 0.5 * bend * (joints * joints).sum(axis=1) + 0.5 * end * (halves * halves).sum(axis=1)


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between unit vectors, rad, accurate when it is small."""
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
