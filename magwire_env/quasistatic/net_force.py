"""The net force on a wire's tip, and the one search for the best command of a rig.

The net force at a place is the drive along the direction of motion, less the friction of the tip itself, less what the
wire behind the tip takes (`balance`). The magnet also presses the tip on the wall, so the command of greatest net force
is not that of greatest drive. Many places of many scenarios are searched side by side, one lane of the kernel a place.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..compiled import precise
from ..scenario import Scenario
from ..simulation import Library, Places, Simulator
from ..simulation.magnetics import SLOT
from ..simulation.model import require

__all__ = ["COARSE", "FINE", "OBJECTIVES", "Search", "TipForces", "greatest", "search"]

OBJECTIVES = ("net", "drive", "torque")

_SHORT = 10.0
"""What a drive short of its floor weighs against torque, m: more than any rig's torque falls by its drive."""

_LANES_AT_ONCE = 16384

_NEAR = 0.06
"""The grid covers slides this far to either side of the tip, m: a magnet farther off pulls with little of its force."""


@dataclass(frozen=True)
class Search:
    """How finely the best command is searched.

    grid : about so many commands are tried at a place of the grid search
    per_slide : of them, so many values of each slide or current; 3 if there are more than two of these
    skip : only every `skip`-th place gets a grid search; the places between start from the one before
    rounds : of the pattern search that follows; each halves its steps, but
    patient : the first so many rounds keep a step that made things better
    diagonals : the pattern search also moves several degrees of freedom at once, if there are no more than three
    """

    grid: int
    per_slide: int
    skip: int
    rounds: int
    patient: int
    diagonals: bool


COARSE = Search(grid=200, per_slide=5, skip=4, rounds=9, patient=4, diagonals=False)
"""To 2 mrad and 0.2 mm in smooth places: for tables of many places."""

FINE = Search(grid=3000, per_slide=14, skip=1, rounds=44, patient=24, diagonals=True)
"""To a millionth of the range."""


class TipForces:
    """The forces on tips at given places under any command, one lane of the kernel a place.

    library : the scenarios
    entries, arclengths : (n,) scenario and tip position of every place, m
    direction : +1 forward, −1 backward
    objective : ``"net"``, ``"drive"`` for the force before friction, or ``"torque"`` for as little magnetic torque on
        the tip as a drive of at least `floor` (n,) N allows
    """

    def __init__(
        self,
        library: Library,
        entries: np.ndarray,
        arclengths: np.ndarray,
        direction: float = 1.0,
        objective: str = "net",
        floor: np.ndarray | None = None,
    ) -> None:
        if objective not in OBJECTIVES:
            raise ValueError(f"objective must be one of {', '.join(OBJECTIVES)}, got {objective!r}")
        if (floor is not None) != (objective == "torque"):
            raise ValueError(f"floor (in N) must be given with the objective 'torque' and no other, got {floor!r}")
        self._floor = floor
        self.library, self.entries, self.n = library, entries, len(entries)
        self.direction, self._net = (1.0 if direction >= 0 else -1.0), objective == "net"
        require(library.scenarios[0], "quasistatic", "the net force on a tip")
        self._sim = Simulator(library, self.n, lane_scenario=entries)
        self._sim.lay(np.arange(self.n), Places(arclengths), library.home[entries])
        self.position = self._sim.tip_position
        contacts = [sc.contact for sc in library.scenarios]
        self._mu = np.array([c.friction for c in contacts])[entries]
        self._lever = np.array([float(c.lever_friction) for c in contacts])[entries]
        weight = np.array([np.multiply(sc.tip.mass or 0.0, sc.gravity) for sc in library.scenarios])[entries]
        tangent = self._sim.tip_tangent
        self._along = self.direction * (weight * tangent).sum(axis=1)
        self._across = (weight - self.direction * self._along[:, None] * tangent) if weight.any() else None

    def force(self, commands: np.ndarray) -> np.ndarray:
        """What is made greatest: commands (n, dof) rad and m → (n,).

        N, the drive along the motion, less the tip's friction unless the objective is "drive"; or N·m, less than zero,
        the torque and what the drive lacks.
        """
        sim = self._sim
        sim.set_rig(commands)
        drive = self.direction * sim.drive_force
        if self._floor is not None:
            return _SHORT * np.minimum(drive - self._floor, 0.0) - sim.tip_torque
        if not self._net:
            return drive
        lateral = sim.lateral_force
        load = lateral if self._across is None else self._load_with_weight()
        if self._lever.any():
            load = load + self._lever * (sim.wall_force - lateral)
        return drive + self._along - self._mu * load

    def _load_with_weight(self) -> np.ndarray:
        """Size of magnetic force and weight across the tract at the tip, (n,) N."""
        pull, tangent = self._sim.tip_force, self._sim.tip_tangent
        across = pull - (pull * tangent).sum(axis=1, keepdims=True) * tangent + self._across
        return np.sqrt(np.einsum("ij,ij->i", across, across))


def greatest(
    scenarios: Sequence[Scenario] | Library,
    entries: np.ndarray,
    arclengths: np.ndarray,
    direction: float = 1.0,
    objective: str = "net",
) -> tuple[np.ndarray, np.ndarray]:
    """The command of greatest force at every place, with turns that are continuous along the tract.

    entries : (n,) number of the scenario; the places of one scenario stand together, in order along its tract
    arclengths : (n,) m
    direction, objective : see `TipForces`

    Returns commands (n, dof), rad for turns (the first within π of home) and m for slides (within their limits), and
    the force (n,) N after the tip's friction; what the wire behind the tip takes is not yet taken off.
    """
    library = scenarios if isinstance(scenarios, Library) else Library(scenarios)
    best, force = search(library, entries, arclengths, direction, objective)
    return _continuous(library, entries, best), force


def search(
    library: Library,
    entries: np.ndarray,
    arclengths: np.ndarray,
    direction: float,
    objective: str,
    how: Search = COARSE,
    floor: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """As `greatest`, each place for itself: turns are not joined along the tract.

    A grid search at every `how.skip`-th place; then every place tries what its neighbours found, and a shrinking
    pattern search refines it.
    """
    n, dof = len(entries), library.dof
    best, force = np.empty((n, dof)), np.empty(n)
    for part in _parts(entries):
        own, at, least = entries[part], arclengths[part], None if floor is None else floor[part]
        edges = _edges(own)
        rank = np.arange(len(own)) - np.repeat(edges[:-1], np.diff(edges))
        tried = np.flatnonzero(rank % how.skip == 0)
        some = None if least is None else least[tried]
        found = _grid_search(TipForces(library, own[tried], at[tried], direction, objective, some), how)
        start = found[(rank % how.skip == 0).cumsum() - 1]
        best[part], force[part] = _pattern_search(TipForces(library, own, at, direction, objective, least), start, how)
    return best, force


def _parts(entries: np.ndarray) -> Iterator[slice]:
    """Slices of whole scenarios, of at most `_LANES_AT_ONCE` lanes unless one alone is longer."""
    first = 0
    for here, there in itertools.pairwise(_edges(entries)):
        if there - first > _LANES_AT_ONCE and here > first:
            yield slice(int(first), int(here))
            first = here
    yield slice(int(first), len(entries))


def _edges(entries: np.ndarray) -> np.ndarray:
    """Where the places of every scenario begin, and the end of the last."""
    return np.r_[0, np.flatnonzero(np.diff(entries)) + 1, len(entries)]


def _grid_search(tips: TipForces, how: Search) -> np.ndarray:
    """The best command of a grid at every place, (n, dof)."""
    library = tips.library
    _, low, high = library.limits.of(tips.entries)
    middle, half = _searched_range(tips)
    best, force = np.empty(low.shape), np.full(tips.n, -np.inf)
    for shares in _grid(library.is_turn, how):
        tried = np.clip(middle + (2 * shares - 1) * half, low, high)
        found = tips.force(tried)
        better = found > force
        best[better], force[better] = tried[better], found[better]
    return best


def _searched_range(tips: TipForces) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half width of the searched range of every degree of freedom, (n, dof) each.

    Turns and currents are searched over their whole range, a slide where its magnet is within `_NEAR` of the tip.
    """
    library = tips.library
    _, low, high = library.limits.of(tips.entries)
    middle, half = (low + high) / 2, (high - low) / 2
    for m, slots in enumerate(library.rigs.slots):
        for axis in range(3):
            if (d := slots[SLOT.slide_x + axis]) >= 0:
                middle[:, d] = tips.position[:, axis] - library.rigs.magnets[tips.entries, m, axis]
                half[:, d] = _NEAR
    return middle, half


def _grid(is_turn: np.ndarray, how: Search) -> Iterator[np.ndarray]:
    """Shares of the searched range, (dof,) in [0, 1], in a grid that is finer for turns than for the others."""
    turns, others = int(is_turn.sum()), int((~is_turn).sum())
    per_other = how.per_slide if others <= 2 else 3
    per_turn = int(np.clip(round((how.grid / per_other**others) ** (1 / max(turns, 1))), 4, 48))
    axes = [np.arange(per_turn) / per_turn if t else np.linspace(0.0, 1.0, per_other) for t in is_turn]
    return (np.array(shares) for shares in itertools.product(*axes))


def _pattern_search(tips: TipForces, best: np.ndarray, how: Search) -> tuple[np.ndarray, np.ndarray]:
    """Local search from `best` (n, dof), and from what neighbouring places found: commands, and forces (n,) N."""
    library, entries = tips.library, tips.entries
    _, low, high = library.limits.of(entries)
    is_turn = library.is_turn
    best, force = best.copy(), tips.force(best)

    def take(tried: np.ndarray) -> np.ndarray:
        """Keep what is better; returns where it is."""
        tried = np.where(is_turn, tried, np.clip(tried, low, high))
        found = tips.force(tried)
        better = found > force
        best[better], force[better] = tried[better], found[better]
        return better

    step = np.where(is_turn, np.pi / 12, 0.5 * _searched_range(tips)[1])
    moves = np.vstack([np.eye(library.dof), -np.eye(library.dof)])
    if how.diagonals and library.dof <= 3:
        moves = np.array([m for m in itertools.product((-1.0, 0.0, 1.0), repeat=library.dof) if any(m)])
    for k in range(how.rounds):
        moved = np.zeros(tips.n, dtype=np.bool_)
        for move in moves:
            moved |= take(best + move * step)
        if k in (3, 6):
            for shift in (1, -1):
                beside = np.roll(np.arange(tips.n), shift)
                same = entries[beside] == entries
                take(np.where(same[:, None], best[beside], best))
        step *= np.where(moved, 1.0, 0.5)[:, None] if k < how.patient else 0.5
    return best, force


@precise
def _join(
    commands: np.ndarray,
    scenario: np.ndarray,
    home: np.ndarray,
    speed: np.ndarray,
    turns: np.ndarray,
    pairs: np.ndarray,
    offsets: np.ndarray,
) -> None:
    """Choose, in place, the equivalent angles that the servos reach fastest from the previous place.

    commands : (n, dof); scenario : (n,); home, speed : (n, dof) of each place's scenario; turns : (t,) which are turns
    pairs, offsets : magnets with two turns by θ and φ, (p, 2) and (p,): offset − θ and φ + π give the same moment
    """
    for i in range(len(commands)):
        last = commands[i - 1] if i and scenario[i] == scenario[i - 1] else home[i]
        here, v = commands[i], speed[i]
        for p in range(len(pairs)):
            a, b = pairs[p]
            other = offsets[p] - here[a]
            stay = max(_apart(here[a], last[a]) / v[a], _apart(here[b], last[b]) / v[b])
            swap = max(_apart(other, last[a]) / v[a], _apart(here[b] + np.pi, last[b]) / v[b])
            if swap < stay:
                here[a], here[b] = other, here[b] + np.pi
        for d in turns:
            here[d] -= 2 * np.pi * np.round((here[d] - last[d]) / (2 * np.pi))


@precise
def _apart(a: float, b: float) -> float:
    """Angle between two angles, rad."""
    gap = a - b
    return abs(gap - 2 * np.pi * np.round(gap / (2 * np.pi)))


def _continuous(library: Library, entries: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """The same moments by turns that are continuous along every scenario's places; the first place's nearest to home.

    `commands` (n, dof) is changed in place and returned.
    """
    pairs, offsets = [], []
    for slots in library.rigs.slots:
        first, second = slots[SLOT.axis_1], slots[SLOT.axis_2]
        if slots[SLOT.turn_2] >= 0 and "xyz"[first] != "z" and first != second:
            pairs.append(slots[[SLOT.turn_1, SLOT.turn_2]])
            offsets.append(0.0 if "xyz"[second] == "z" else np.pi)
    _join(
        commands, entries, library.home[entries], library.limits.speed[entries], np.flatnonzero(library.is_turn),
        np.array(pairs, dtype=np.int64).reshape(-1, 2), np.array(offsets, dtype=np.float64),
    )  # fmt: skip
    return commands
