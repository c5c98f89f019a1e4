"""Certificates: whether a rig can pull a wire along a tract at all, where it first cannot, and how long it takes.

At every tip position the quasi-static balance of the whole wire (`balance`) gives the force that the tip must supply,
and the command of greatest net force (`net_force`) gives the force that it can supply. The difference is the margin. A
wire with a positive margin from the start to the goal gets there. Drag and inertia use the margin up, which gives the
wire's speed and the time of the whole way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..compiled import precise
from ..physics.checks import non_negative, positive
from ..scenario import Scenario
from ..simulation import Library, Simulator
from .balance import Tails
from .net_force import greatest

__all__ = ["GOAL_MARGIN", "START_SPREAD", "Certificate", "certificate", "certify", "traverse"]

START_SPREAD = 0.02
"""A steering episode starts with the tip this far or less from where the whole wire lies just inside the tract, m."""

GOAL_MARGIN = 0.01
"""The goal lies this far before the tract's end, m."""

_TRUST, _TRUST_BEND = 20e-6, 0.02
"""Allowed error of the balance: 20 µN, as a controller's command is not quite the best one, and 2 % of the cost of the
tract's sharpest bend, ½ E I κ². A wire of 6 mm segments does not feel a bend quite as the curve says; 98 % of places
are within that share."""

_SWINGS, _MORE_SWINGS, _SWING_TIME = 24, 128, 1.2
"""Number of starts sampled for one degree of freedom and for several, and simulated time of each, s.

Within 1 s a servo turns the magnet half round.
"""

_BETWEEN, _MORE_BETWEEN = 0.005, 0.015
"""Allowance for starts between the sampled ones, which may slide back farther, m (one degree of freedom, several)."""


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """What the quasi-static balance says about one scenario: solvable, blocked, or (rarely) neither.

    solvable : the margin is at least the reserve everywhere, and the way takes no longer than the time limit
    direction : +1 forward, −1 backward
    arclengths : (n,) m, tip positions in the order of travel
    margin : (n,) N, greatest net force along the direction of travel after friction and bending
    commands : (n, dof) rad and m, the commands that give this margin; turns are continuous along the way
    speed : (n,) m/s, of a wire that sets off at rest and whose margin drives its drag and inertia; 0 after it stops
    reserve : N, the allowed error of the margin
    blocked : m, the place where such a wire stops, even if the margin were larger by the reserve; None if it gets
        through, however slowly. (A margin that is negative over a few millimetres does not hold a wire
        that arrives with speed.)
    traverse_time : s, for the whole way at that speed, or at the servos' speed where that is slower; ∞ if it stops
    time_limit : s
    thrown_out : the magnet, which turns to its first command from any angle, can drag the tip out of the entrance
    """

    solvable: bool
    direction: int
    arclengths: np.ndarray
    margin: np.ndarray
    commands: np.ndarray
    speed: np.ndarray
    reserve: float
    blocked: float | None
    traverse_time: float
    time_limit: float
    thrown_out: bool

    @property
    def weakest(self) -> tuple[float, float]:
        """The place of the smallest margin, m, and that margin, N."""
        i = int(self.margin.argmin())
        return float(self.arclengths[i]), float(self.margin[i])

    @property
    def blocked_command(self) -> np.ndarray | None:
        """The best command, (dof,) rad and m, at the first blocked place; None if there is none."""
        if self.blocked is None:
            return None
        return self.commands[int(np.flatnonzero(self.arclengths == self.blocked)[0])]

    def __repr__(self) -> str:
        return f"<Certificate: {self}>"

    def __str__(self) -> str:
        at, margin = self.weakest
        weakest = f"weakest {1e3 * margin:.2f} mN at {at:.3f} m"
        if self.blocked is not None:
            return f"blocked at {self.blocked:.3f} m, {weakest}"
        if self.thrown_out:
            return f"thrown out of the entrance, {weakest}"
        verdict = "solvable" if self.solvable else "doubtful" if margin < self.reserve else "too slow"
        late = f" of {self.time_limit:g} s allowed" if verdict == "too slow" else ""
        return f"{verdict}, {weakest}, {self.traverse_time:.1f} s{late}"


def certificate(
    scenario: Scenario,
    direction: int = 1,
    start: float | None = None,
    goal: float | None = None,
    time_limit: float = 60.0,
    reserve: float | None = None,
) -> Certificate:
    """The certificate of one scenario.

    direction : +1 forward, the tip pulls the wire; −1 backward, the tip pushes it
    start, goal : m, tip positions. Forward, the default goal is `GOAL_MARGIN` before the tract's end. The default start
        is the place farthest back that a tip reaches when an episode starts as in the tasks: the tip within
        `START_SPREAD` of the wire's length and the magnets anywhere. Until the magnets have turned, they may drag the
        wire back. Backward, the default way goes from `GOAL_MARGIN` before the end to `START_SPREAD` short of the
        wire's length.
    time_limit : s, for the whole way
    reserve : N, allowed error of the margin; by default 20 µN and 2 % of ½ E I κ² in the sharpest bend
    """
    return certify([scenario], direction, start, goal, time_limit, reserve)[0]


def certify(
    scenarios: Sequence[Scenario],
    direction: int = 1,
    start: float | None = None,
    goal: float | None = None,
    time_limit: float = 60.0,
    reserve: float | None = None,
) -> list[Certificate]:
    """Certificates of many scenarios, with the arguments of `certificate`; those of one rig layout run side by side."""
    if direction not in (1, -1):
        raise ValueError(f"direction must be 1 or -1, got {direction!r}")
    positive("time_limit", time_limit, "s")
    if reserve is not None:
        non_negative("reserve", reserve, "N")
    ways = [_places(sc, direction, start, goal) for sc in scenarios]
    certificates: dict[int, Certificate] = {}
    groups: dict[tuple, list[int]] = {}
    for i, sc in enumerate(scenarios):
        dofs = tuple(tuple((type(d), d.axis) for d in m.dofs) for m in sc.rig.magnets)
        groups.setdefault((sc.timing, dofs, tuple(c.axis for c in sc.rig.coils)), []).append(i)
    for numbers in groups.values():
        own, way = [scenarios[i] for i in numbers], [ways[i] for i in numbers]
        found = _margins(own, way, direction)
        back = _farthest_back(own, [commands for _, commands, _ in found]) if direction > 0 and start is None else None
        for k, i in enumerate(numbers):
            lowest = -np.inf if back is None else back[k]
            certificates[i] = _verdict(own[k], direction, way[k], found[k], lowest, time_limit, reserve)
    return [certificates[i] for i in range(len(scenarios))]


def _places(sc: Scenario, direction: int, start: float | None, goal: float | None) -> np.ndarray:
    """Tip positions (n,) m from start to goal in the order of travel; forward without a start, from the entrance on."""
    end = sc.tract.length - GOAL_MARGIN
    first, last = (0.0, end) if direction > 0 else (end, max(sc.wire.length - START_SPREAD, 0.0))
    first, last = first if start is None else float(start), last if goal is None else float(goal)
    for name, value in (("start", first), ("goal", last)):
        if not 0.0 <= value <= sc.tract.length:
            raise ValueError(f"{name} must lie in [0, {sc.tract.length:.4g}] (in m), got {value!r}")
    if direction * (last - first) <= 0:
        raise ValueError(f"goal must lie ahead of start ({first:.4g} m) in direction {direction}, got {last:.4g} m")
    # The table's cubic pieces join where the curvature has its kinks, so there the balance has its extremes.
    low, high = min(first, last), max(first, last)
    rows = sc.tract.row_spacing * np.arange(1, len(sc.tract.table) - 2)
    inner = rows[(rows > low + 1e-6) & (rows < high - 1e-6)]
    return np.r_[low, inner, high][::direction]


def _margins(
    scenarios: Sequence[Scenario], ways: Sequence[np.ndarray], direction: int
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Margin (n,) N, commands (n, dof) and the resistance's growth with speed (n,) N·s/m along every way."""
    counts = np.array([len(w) for w in ways])
    entries, tips = np.repeat(np.arange(len(ways)), counts), np.concatenate(ways)
    commands, force = greatest(Library(scenarios), entries, tips, direction)
    resistance, growth = Tails(scenarios).resistance(entries, tips, direction)
    edges = counts.cumsum()[:-1]
    return list(
        zip(np.split(force - resistance, edges), np.split(commands, edges), np.split(growth, edges), strict=True)
    )


def _farthest_back(scenarios: Sequence[Scenario], commands: Sequence[np.ndarray]) -> np.ndarray:
    """The lowest arc length that the tip reaches, (n,) m, while the magnets turn to the best command.

    commands : the best commands at the entrance and at every row of the tract's table after it

    The simulator runs from sampled starts: the tip `START_SPREAD` short of the wire's length or beyond it, the magnets
    evenly scattered (a Kronecker sequence).
    """
    n, dof = len(scenarios), commands[0].shape[1]
    swings, between = (_SWINGS, _BETWEEN) if dof == 1 else (_MORE_SWINGS, _MORE_BETWEEN)
    lane = np.repeat(np.arange(n), swings)
    sim = Simulator(scenarios, len(lane), lane_scenario=lane)
    k = np.arange(swings)[:, None]
    scatter = np.tile((k + 0.5) / swings if dof == 1 else k * np.sqrt(_PRIMES[:dof]) % 1.0, (n, 1))
    _, low, high = sim.library.limits.of(lane)
    length = sim.library.wire_length[lane]
    sim.reset(
        np.maximum(length + np.where(np.arange(len(lane)) % 2, START_SPREAD, -START_SPREAD), 0.0),
        low + scatter * (high - low),
    )
    table = np.concatenate(commands)
    counts = np.array([len(c) for c in commands])
    first, last = np.r_[0, counts.cumsum()[:-1]][lane], counts[lane] - 1
    spacing = np.array([sc.tract.row_spacing for sc in scenarios])[lane]
    lowest = sim.tip_arclength
    for _ in range(round(_SWING_TIME / sim.control_period)):
        row = np.clip(np.rint(sim.tip_arclength / spacing), 0, last).astype(np.int64)
        sim.step(table[first + row])
        lowest = np.minimum(lowest, (sim.goals().s[:, None] - sim.remaining_trace).min(axis=1))
    return lowest.reshape(n, swings).min(axis=1) - between


_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89)


def _verdict(
    sc: Scenario,
    direction: int,
    way: np.ndarray,
    found: tuple[np.ndarray, np.ndarray, np.ndarray],
    lowest: float,
    time_limit: float,
    reserve: float | None,
) -> Certificate:
    """The certificate of the way that begins at the last place at or before `lowest` (m)."""
    first = min(max(0, int(np.searchsorted(way, lowest, side="right")) - 1), len(way) - 2)
    way, margin, commands, growth = (array[first:] for array in (way, *found))
    thrown_out = bool(-np.inf < lowest < 0.0)
    if reserve is None:
        reserve = _TRUST + _TRUST_BEND * 0.5 * sc.wire.bending_rigidity * float((sc.tract.curvature(way) ** 2).max())
    turning = (np.abs(np.diff(commands, axis=0)) / [d.speed for d in sc.rig.dofs]).max(axis=1)
    speed, seconds = traverse(way, margin, growth, sc.moving_mass, 0.0)
    time = float(np.maximum(seconds, turning).sum())
    _, seconds = traverse(way, margin + reserve, growth, sc.moving_mass, 0.0)
    late = np.flatnonzero(~np.isfinite(seconds))
    for array in (arrays := (way, margin, commands, speed)):
        array.flags.writeable = False
    return Certificate(
        bool(margin.min() >= reserve and time <= time_limit and not thrown_out), direction, *arrays, reserve,
        float(way[late[0]]) if late.size else None, time, time_limit, thrown_out,
    )  # fmt: skip


@precise
def traverse(
    way: np.ndarray, margin: np.ndarray, growth: np.ndarray, mass: float, creep: float
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (n,) m/s of a wire that sets off at the speed `creep`, and times (n − 1,) s between places.

    d(½ m v²)/ds = margin − growth·v, with the drag at the end of every step. Where the margin would stop the wire, it
    goes on at `creep`, m/s; if that is 0 it stops, and then its speed is 0 and its time ∞.
    """
    speed, seconds = np.zeros(len(way)), np.full(len(way) - 1, np.inf)
    speed[0] = v = creep
    for i in range(len(way) - 1):
        ds = abs(way[i + 1] - way[i])
        energy = 0.5 * mass * v * v + 0.5 * ds * (margin[i] + margin[i + 1])
        if energy <= 0.0 and creep == 0.0:
            break
        energy = max(energy, 0.0)
        drag = ds * 0.5 * (growth[i] + growth[i + 1])
        new = max((math.sqrt(drag * drag + 2.0 * mass * energy) - drag) / mass, creep)
        seconds[i] = 2.0 * ds / (v + new)
        speed[i + 1] = v = new
    return speed, seconds
