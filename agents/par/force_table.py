"""The quasi-static model of a one-axis rig: how fast the tip moves at every place under every magnet angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import Places
from magwire_env.simulation.locked.arrays import Library

__all__ = ["SpeedTable", "speed_tables"]

_LANES_AT_ONCE = 16384


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """Tip speed where the net force goes into drag alone, over (arc length, magnet angle from home).

    speed : (S, M) m/s at arc lengths 0, spacing, … and angles −π, −π + 2π/M, …; 0 where friction holds the wire
    lag : s, in which a speed comes up to it: mass over drag
    servo : rad/s
    """

    speed: np.ndarray
    spacing: float
    lag: float
    servo: float


def speed_tables(library: Library, entries: np.ndarray, spacing: float = 2e-3, angles: int = 100) -> list[SpeedTable]:
    """The tables of the library's scenarios `entries` (k,), made side by side; the rig has one turn."""
    if library.dof != 1 or not library.is_turn[0]:
        raise ValueError(f"library must be of rigs with a single turn, got {library.dof} degrees of freedom")
    counts = np.ceil(library.tract_length[entries] / spacing).astype(np.int64) + 1
    owner = np.repeat(entries, counts)
    place = np.concatenate([spacing * np.arange(count) for count in counts])
    ahead, ahead_growth = _net(library, owner, place, angles, 1.0)
    back, back_growth = _net(library, owner, place, angles, -1.0)
    speed = np.where(ahead > 0.0, ahead / ahead_growth, np.where(back > 0.0, -back / back_growth, 0.0))
    tables, first = [], 0
    for entry, count in zip(entries, counts, strict=True):
        sc = library.scenarios[entry]
        mass = sc.wire.mass + (sc.tip.mass or 0.0)
        lag = mass / float(ahead_growth[first : first + count].mean())
        tables.append(SpeedTable(speed[first : first + count].copy(), spacing, lag, float(library.dofs[entry, 0, 0])))
        first += count
    return tables


def _net(
    library: Library, owner: np.ndarray, place: np.ndarray, angles: int, direction: float
) -> tuple[np.ndarray, np.ndarray]:
    """Net force along `direction`, (n, angles) N, and the resistance's growth with speed (n, 1) N·s/m."""
    pull, growth = Tails(library.scenarios).pull(owner, place, direction)
    net = np.empty((len(place), angles))
    for first in range(0, len(place), _LANES_AT_ONCE):
        part = slice(first, first + _LANES_AT_ONCE)
        places = Places(library, owner[part], place[part], direction)
        home = library.home[owner[part]]
        for j in range(angles):
            net[part, j] = places.force(home + (2 * np.pi * j / angles - np.pi))
    return net - pull[:, None], growth[:, None]
