"""The quasi-static model of a rig with one turn: the speed of the tip at every place under every magnet angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from magwire_env.quasistatic.along_tract import AlongTract
from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import TipForces
from magwire_env.simulation import Library

__all__ = ["SpeedTable", "speed_tables"]

_LANES_AT_ONCE = 16384


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """Speed of a tip whose net force is balanced by drag alone, over (arc length, magnet angle from home).

    speed : (S, M) m/s at arc lengths 0, spacing, … and angles −π, −π + 2π/M, …; 0 where friction holds the wire
    lag : s, time constant with which the true speed follows: mass over drag
    servo : rad/s
    """

    speed: np.ndarray
    spacing: float
    lag: float
    servo: float


def speed_tables(library: Library, entries: np.ndarray, spacing: float = 2e-3, angles: int = 100) -> list[SpeedTable]:
    """The tables of the library's scenarios `entries` (k,), made side by side. The rig must have one turn."""
    if library.dof != 1 or not library.is_turn[0]:
        raise ValueError(f"library must be of rigs with a single turn, got {library.dof} degrees of freedom")
    along = AlongTract(library.tract_length[entries], spacing)
    owner = entries[along.entries]
    ahead, ahead_growth = _net_force(library, owner, along.places, angles, 1.0)
    back, back_growth = _net_force(library, owner, along.places, angles, -1.0)
    speed = np.where(ahead > 0.0, ahead / ahead_growth, np.where(back > 0.0, -back / back_growth, 0.0))
    tables = []
    for entry, first, count in zip(entries, along.first, along.counts, strict=True):
        rows = slice(first, first + count)
        lag = library.scenarios[entry].moving_mass / float(ahead_growth[rows].mean())
        tables.append(SpeedTable(speed[rows].copy(), spacing, lag, float(library.limits.speed[entry, 0])))
    return tables


def _net_force(
    library: Library, owner: np.ndarray, place: np.ndarray, angles: int, direction: float
) -> tuple[np.ndarray, np.ndarray]:
    """Net force along `direction`, (n, angles) N, and the resistance's growth with speed (n, 1) N·s/m."""
    resistance, growth = Tails(library.scenarios).resistance(owner, place, direction)
    net = np.empty((len(place), angles))
    for first in range(0, len(place), _LANES_AT_ONCE):
        part = slice(first, first + _LANES_AT_ONCE)
        tips = TipForces(library, owner[part], place[part], direction)
        home = library.home[owner[part]]
        for j in range(angles):
            net[part, j] = tips.force(home + (2 * np.pi * j / angles - np.pi))
    return net - resistance[:, None], growth[:, None]
