"""A time that no policy can beat. docs/par.md has the proof; the equation numbers here are those of that page.

The wire is that of the simulator: a wire that moves as one along its centreline, under the greatest net force that the
rig can give at every place, limited by the servo if the rig has one turn.
"""

from __future__ import annotations

import numpy as np

from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.certificate import traverse
from magwire_env.quasistatic.net_force import TipForces, greatest
from magwire_env.scenario import Scenario
from magwire_env.simulation import Library, Places, Simulator

__all__ = ["Fastest", "least_time"]

_SPACING = 2.5e-4
"""Distance between the places of the quadrature, m."""

_COARSE = 1e-3
"""Distance between the places whose forces are tabulated, m."""

_RUN_UP = 0.03
"""The longest run-up, m, unless drag needs more than this to stop the wire from its greatest speed (3)."""

_ANGLES = 240
"""Number of tabulated magnet angles."""

_MARGIN = 1e-3
"""Margin on the net force, as a share of the greatest force, ½ E I κ² of the sharpest bend and the friction together:
20 to 40 µN."""

_TICK = 5e-3
"""Time step of y(t) (5), s; the arc that is within reach at the end of a step counts for the whole step."""


_CREEP = 2e-3
"""m/s; below this speed, at which friction is not yet whole, the wire counts as moving this fast whatever holds it."""


class Fastest:
    """Least times in one scenario and direction, from any place and magnet angle.

    direction : +1 forward, −1 backward
    """

    def __init__(self, scenario: Scenario, direction: int = 1) -> None:
        if direction not in (1, -1):
            raise ValueError(f"direction must be 1 or -1, got {direction!r}")
        self.scenario, self.direction = scenario, direction
        self.library = Library([scenario])
        self.mass = scenario.moving_mass
        length = scenario.tract.length
        self.places = np.linspace(0.0, length, int(np.ceil(length / _COARSE)) + 1)
        self._entries = np.zeros(len(self.places), dtype=np.int64)
        self._bend = _chain_less_curve(self.library, self.places)
        resistance, self._growth = self._resistance(direction)
        self.commands, force = greatest(self.library, self._entries, self.places, direction)
        bend = 0.5 * scenario.wire.bending_rigidity * float((scenario.tract.curvature(self.places) ** 2).max())
        largest = float(np.abs(force).max())
        friction = self._most_friction(largest)
        self._margin = _MARGIN * (largest + bend + friction) + self._missing_share() * friction
        self.net = force - resistance + self._margin
        stretch = float(np.abs(force).max()) * scenario.wire.length / scenario.wire.axial_rigidity
        step = scenario.timing.control_period / scenario.substeps
        self._slack = stretch + step * step / 12.0 * max(float(self.net.max()), 0.0) / self.mass
        self._run_up = max(_RUN_UP, self.mass * float(self.net.max()) / float(self._growth.min()) ** 2)
        self._tables: dict[int, np.ndarray] = {}

    def _resistance(self, direction: int) -> tuple[np.ndarray, np.ndarray]:
        """The force that moves the wire along `direction`, N, and its growth with speed, N·s/m."""
        force, growth = Tails([self.scenario]).resistance(self._entries, self.places, direction)
        return force + direction * self._bend, growth

    def _most_friction(self, largest: float) -> float:
        """A bound R on the friction of wire and tip, N.

        largest : N, greatest force of the magnets, which also bounds what presses the tip on the wall
        """
        (forth, _), (back, _) = (Tails([self.scenario]).resistance(self._entries, self.places, d) for d in (1, -1))
        return 0.5 * float((forth + back).max()) + 2.0 * self.scenario.contact.friction * largest

    def _missing_share(self) -> float:
        """The share of the friction that smoothing takes away at the speed `_CREEP` (10)."""
        return 1.0 - _CREEP / float(np.hypot(_CREEP, self.scenario.contact.stick_speed))

    def least(self, start: float, goal: float, magnet: float | None = None) -> float:
        """Least time from rest at `start` to `goal` (m), s; ∞ where not even the greatest force gets there.

        magnet : rad, where the magnet is at the start; used for a rig with one turn, by default anywhere
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
        if magnet is None or self.library.is_turn.tolist() != [True]:
            return self._without_servos(start, goal)
        dragged, start = self._dragged_back(start, magnet)
        free = self._without_servos(start, goal)
        places, arrival = self._arrivals(start, goal)
        if not np.isfinite(arrival[-1]):
            return dragged + free
        times, reached = self._farthest(start, goal, magnet, dragged)
        late = times - np.interp(self.direction * reached, self.direction * places, arrival)  # t − A(x(t)) of (6)
        return dragged + free + float(late.max())

    def _without_servos(self, start: float, goal: float) -> float:
        """A(goal) (3), s: the least time under the greatest force, over run-ups."""
        backs = np.linspace(0.0, 1.0, 6) ** 2 * self._run_up
        return float(min(self._arrivals(start - self.direction * back, goal)[1][-1] for back in backs))

    def _arrivals(self, start: float, goal: float) -> tuple[np.ndarray, np.ndarray]:
        """Places (k,) m from start to goal, and when a wire from rest under the greatest force is there, (k,) s."""
        start = min(max(start, 0.0), self.scenario.tract.length)
        places = np.linspace(start, goal, int(np.ceil(abs(goal - start) / _SPACING)) + 1)
        net, growth = np.interp(places, self.places, self.net), np.interp(places, self.places, self._growth)
        _, seconds = traverse(places, net, growth, self.mass, _CREEP)
        return places, np.r_[0.0, seconds.cumsum()]

    def _farthest(self, start: float, goal: float, magnet: float, begin: float) -> tuple[np.ndarray, np.ndarray]:
        """Times t after `begin`, (k,) s, while the servo limits the force, and the farthest places x(t) (5), m."""
        places, force = self._ordered(self.direction)
        first = max(int(np.searchsorted(places, self.direction * start - self._run_up)) - 1, 0)
        places, force = places[first:], np.maximum.accumulate(force[first:], axis=0)
        growth = float(self._growth.min())
        share = -np.expm1(-_TICK * growth / self.mass)
        x = self.direction * start
        y = x + self.mass / growth * _CREEP
        times, reached = [0.0], [x]
        for k in range(round(begin / _TICK) + 1, self._ticks() + 1):
            columns = self._arc(magnet, k)
            row = min(int(np.searchsorted(places, x + (y - x) * share)) + 1, len(places) - 1)
            y += (max(float(force[row, columns].max()), 0.0) / growth + _CREEP) * _TICK
            x += (y - x) * share
            if x >= self.direction * goal:
                break
            times.append(k * _TICK - begin)
            reached.append(x)
        return np.array(times), self.direction * np.array(reached)

    def _dragged_back(self, start: float, magnet: float) -> tuple[float, float]:
        """For how long every angle within the servo's reach drags the wire back, s, and its farthest place then, m.

        `high`, `fast` are place and speed under the arc's least backward force, `low`, `slow` under its greatest. The
        forces count over all places between the two. Friction helps to stop the wire.
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
        """Number of steps until the servo reaches every angle."""
        return int(np.ceil(np.pi / float(self.library.limits.speed[0, 0]) / _TICK))

    def _arc(self, magnet: float, ticks: int) -> np.ndarray:
        """Columns of the angles that the servo reaches within `ticks` steps, rounded outwards."""
        column = 2 * np.pi / _ANGLES
        here = (magnet - float(self.library.home[0, 0]) + np.pi) / column
        arc = float(self.library.limits.speed[0, 0]) * ticks * _TICK / column
        return np.arange(np.floor(here - arc), np.ceil(here + arc) + 1).astype(np.int64) % _ANGLES

    def _ordered(self, motion: int) -> tuple[np.ndarray, np.ndarray]:
        """Places in the order of travel, times the direction, and the net force along the travel, (places, angles) N.

        motion : +1 or −1, the direction in which the wire moves; friction points against it
        """
        if motion not in self._tables:
            tips = TipForces(self.library, self._entries, self.places, motion)
            angles = float(self.library.home[0, 0]) - np.pi + 2 * np.pi / _ANGLES * np.arange(_ANGLES)
            net = np.stack([tips.force(np.full((tips.n, 1), angle)) for angle in angles], axis=1)
            net -= self._resistance(motion)[0][:, None]
            self._tables[motion] = motion * self.direction * net + self._margin
        order = slice(None, None, self.direction)
        return self.direction * self.places[order], self._tables[motion][order]


def least_time(scenario: Scenario, start: float, goal: float, direction: int = 1, magnet: float | None = None) -> float:
    """A time in s from `start` to `goal` (m) that no policy can beat; see `Fastest.least`, which is for many starts."""
    return Fastest(scenario, direction).least(start, goal, magnet)


def _chain_less_curve(library: Library, tips: np.ndarray) -> np.ndarray:
    """Force that bends the chain of segments as its tip moves on, less that for a continuous wire, (n,) N."""
    scenario, step = library.scenarios[0], 1e-4
    before, after = (_bending_energy(library, tips + shift) for shift in (-step, step))
    tract, rigidity = scenario.tract, scenario.wire.bending_rigidity
    kappa, tail = tract.curvature(tips), tract.curvature(tips - scenario.wire.length)
    return (after - before) / (2 * step) - 0.5 * rigidity * (kappa * kappa - tail * tail)


def _bending_energy(library: Library, tips: np.ndarray) -> np.ndarray:
    """Bending energy of wires laid at rest behind `tips`, (n,) J: the joints, and the half cells at the two ends."""
    n = len(tips)
    sim, scenario = Simulator(library, n, lane_scenario=np.zeros(n, dtype=np.int64)), library.scenarios[0]
    sim.lay(np.arange(n), Places(tips), np.broadcast_to(library.home[0], (n, library.dof)))
    s, wire = sim.state().arclengths, scenario.wire
    points, tangents = scenario.tract.position(s), scenario.tract.tangent(s[:, [0, -1]])
    segments = np.diff(points, axis=1)
    units = segments / np.linalg.norm(segments, axis=2, keepdims=True)
    joints = _angle(units[:, :-1], units[:, 1:])
    halves = _angle(tangents, units[:, [0, -1]])
    # The half cells at the two ends are twice as stiff as a joint.
    return 0.5 * wire.bending_spring * ((joints * joints).sum(axis=1) + 2 * (halves * halves).sum(axis=1))


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between unit vectors, rad, accurate when it is small."""
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
