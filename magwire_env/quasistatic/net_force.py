"""The net force on a wire: what a command's drive leaves after friction and bending, and the command that leaves most.

The net force at a place is the drive along the direction of motion, less the tail's pull (`balance`), less the tip's
own friction: the magnet presses the tip on the wall as it pulls, so the command of greatest net force is not that of
greatest drive. Many places of many scenarios are searched side by side, as lanes of the kernel that moves the wire.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numba import njit

from ..scenario import Scenario
from ..simulation.locked import algorithm1 as a1
from ..simulation.locked.arrays import LaneArrays, Library

__all__ = ["OBJECTIVES", "Places", "greatest"]

OBJECTIVES = ("net", "drive")

_LANES_AT_ONCE = 16384
_GRID = 200
"""About as many commands a place does the coarse search try."""

_NEAR = 0.06
"""Slides are searched this far either side of the tip, m: a magnet farther off pulls with little of its force."""

_SKIP = 4
"""The grid is tried at every so manieth place only."""

_ROUNDS = 9


class Places:
    """Tip positions in the tracts of scenarios, one a lane, and the forces there under any command.

    library : the scenarios
    entries, arclengths : (n,) scenario and tip position of every lane, m
    direction : +1 forward, −1 backward
    objective : ``"net"``, or ``"drive"`` for the force before friction and bending
    """

    def __init__(
        self,
        library: Library,
        entries: np.ndarray,
        arclengths: np.ndarray,
        direction: float = 1.0,
        objective: str = "net",
    ) -> None:
        if objective not in OBJECTIVES:
            raise ValueError(f"objective must be one of {', '.join(OBJECTIVES)}, got {objective!r}")
        self.library, self.entries, self.n = library, entries, len(entries)
        self.direction, self._net = (1.0 if direction >= 0 else -1.0), objective == "net"
        self._all = np.arange(self.n)
        self._lanes = LaneArrays(library, self.n)
        self._lanes.take(self._all, entries)
        s = np.zeros((self.n, library.nodes))
        s[:, -1] = arclengths  # only the tip carries a magnet
        self._lanes.write(self._all, s, None, library.home[entries])
        self._lanes.refresh(self._all)
        self.position = self._lanes.results(a1.TIP_X)
        contacts = [sc.contact for sc in library.scenarios]
        self._mu = np.array([c.friction for c in contacts])[entries]
        self._lever = np.array([float(c.lever_friction) for c in contacts])[entries]
        weight = np.array([np.multiply(sc.tip.mass or 0.0, sc.gravity) for sc in library.scenarios])[entries]
        tangent = self._lanes.results(a1.TAN_X)
        self._along = self.direction * (weight * tangent).sum(axis=1)
        self._across = (weight - self.direction * self._along[:, None] * tangent) if weight.any() else None

    def force(self, commands: np.ndarray) -> np.ndarray:
        """Drive less the tip's friction (or drive alone) along the way: commands (n, dof) rad and m → (n,) N."""
        lanes = self._lanes
        lanes.write(self._all, magnet=commands)
        lanes.refresh(self._all)
        drive = self.direction * lanes.result(a1.DRIVE)
        if not self._net:
            return drive
        lateral = lanes.result(a1.LATERAL)
        load = lateral if self._across is None else self._load()
        if self._lever.any():
            load = load + self._lever * (lanes.result(a1.WALL) - lateral)
        return drive + self._along - self._mu * load

    def _load(self) -> np.ndarray:
        """Size of magnetic force and weight across the tract at the tip, (n,) N."""
        pull, tangent = self._lanes.results(a1.FX), self._lanes.results(a1.TAN_X)
        across = pull - (pull * tangent).sum(axis=1, keepdims=True) * tangent + self._across
        return np.sqrt(np.einsum("ij,ij->i", across, across))


def greatest(
    scenarios: Sequence[Scenario] | Library,
    entries: np.ndarray,
    arclengths: np.ndarray,
    direction: float = 1.0,
    objective: str = "net",
) -> tuple[np.ndarray, np.ndarray]:
    """The command of greatest force at every place.

    entries : (n,) number of the scenario; the places of one scenario stand together, in order along its tract
    arclengths : (n,) m
    direction, objective : see `Places`

    Returns commands (n, dof), rad for turns (continuous along the tract, the first within π of home) and m for slides
    (within their limits), and the force (n,) N after the tip's friction, the tail's pull not yet taken off.

    A coarse grid at every fourth place, slides near the tip only; then each place tries what its neighbours found,
    and a shrinking pattern search refines: to 2 mrad and 0.2 mm in smooth places.
    """
    library = scenarios if isinstance(scenarios, Library) else Library(scenarios)
    n, dof = len(entries), library.dof
    best, force = np.empty((n, dof)), np.empty(n)
    for part in _parts(entries):
        own, at = entries[part], arclengths[part]
        edges = _edges(own)
        rank = np.arange(len(own)) - np.repeat(edges[:-1], np.diff(edges))
        tried = np.flatnonzero(rank % _SKIP == 0)
        start = _coarse(library, own[tried], at[tried], direction, objective)[(rank % _SKIP == 0).cumsum() - 1]
        best[part], force[part] = _refined(Places(library, own, at, direction, objective), start)
    return _joined(library, entries, best), force


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


def _coarse(
    library: Library, entries: np.ndarray, arclengths: np.ndarray, direction: float, objective: str
) -> np.ndarray:
    """The best of a grid of commands at every place, (n, dof)."""
    places = Places(library, entries, arclengths, direction, objective)
    low, high = library.dofs[entries, :, 1], library.dofs[entries, :, 2]
    middle, half = _searched(library, places)
    best, force = np.empty(low.shape), np.full(places.n, -np.inf)
    for shares in _grid(library.is_turn):
        tried = np.clip(middle + (2 * shares - 1) * half, low, high)
        found = places.force(tried)
        better = found > force
        best[better], force[better] = tried[better], found[better]
    return best


def _searched(library: Library, places: Places) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half width of what is searched of every degree of freedom, (n, dof) each: of a slide what brings its
    magnet within `_NEAR` of the tip along its axis, of turns and currents all."""
    low, high = library.dofs[places.entries, :, 1], library.dofs[places.entries, :, 2]
    middle, half = (low + high) / 2, (high - low) / 2
    for m, slots in enumerate(library.rig):
        for axis in range(3):
            if (d := slots[a1.TURN_SLOTS + axis]) >= 0:
                middle[:, d] = places.position[:, axis] - library.magnets[places.entries, m, axis]
                half[:, d] = _NEAR
    return middle, half


def _grid(is_turn: np.ndarray) -> Iterator[np.ndarray]:
    """Shares of what is searched of each degree of freedom, (dof,) in [0, 1]: finer for turns than for the others."""
    turns, others = int(is_turn.sum()), int((~is_turn).sum())
    per_other = 5 if others <= 2 else 3
    per_turn = int(np.clip(round((_GRID / per_other**others) ** (1 / max(turns, 1))), 4, 48))
    axes = [np.arange(per_turn) / per_turn if t else np.linspace(0.0, 1.0, per_other) for t in is_turn]
    return (np.array(shares) for shares in itertools.product(*axes))


def _refined(places: Places, best: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Local search from `best` (n, dof), and from what the places beside found: commands and forces (n,) N."""
    library, entries = places.library, places.entries
    low, high = library.dofs[entries, :, 1], library.dofs[entries, :, 2]
    is_turn = library.is_turn
    best, force = best.copy(), places.force(best)

    def take(tried: np.ndarray) -> np.ndarray:
        tried = np.where(is_turn, tried, np.clip(tried, low, high))
        found = places.force(tried)
        better = found > force
        best[better], force[better] = tried[better], found[better]
        return better

    step = np.where(is_turn, np.pi / 12, 0.5 * _searched(library, places)[1])
    moves = np.vstack([np.eye(library.dof), -np.eye(library.dof)])
    for k in range(_ROUNDS):
        moved = np.zeros(places.n, dtype=np.bool_)
        for move in moves:
            moved |= take(best + move * step)
        if k in (3, 6):
            for shift in (1, -1):
                beside = np.roll(np.arange(places.n), shift)
                same = entries[beside] == entries
                take(np.where(same[:, None], best[beside], best))
        step *= np.where(moved, 1.0, 0.5)[:, None] if k < 4 else 0.5
    return best, force


@njit(cache=True, nogil=True, error_model="numpy")
def _join(commands, scenario, home, speed, turns, pairs, offsets):
    """Give turns the form nearest in servo time to the place before, in place.

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


@njit(cache=True, nogil=True, error_model="numpy")
def _apart(a, b):
    """Angle between two angles, rad."""
    gap = a - b
    return abs(gap - 2 * np.pi * np.round(gap / (2 * np.pi)))


def _joined(library: Library, entries: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """The same moments by turns that are continuous along every scenario's places; the first nearest to home."""
    pairs, offsets = [], []
    for slots in library.rig:
        first, second = slots[5:7]
        if slots[1] >= 0 and "xyz"[first] != "z" and first != second:
            pairs.append(slots[:2])
            offsets.append(0.0 if "xyz"[second] == "z" else np.pi)
    _join(
        commands, entries, library.home[entries], library.dofs[entries, :, 0], np.flatnonzero(library.is_turn),
        np.array(pairs, dtype=np.int64).reshape(-1, 2), np.array(offsets, dtype=np.float64),
    )  # fmt: skip
    return commands
