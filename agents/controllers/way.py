"""The way along a tract under the commands of greatest net force: which they are, and how long it takes."""

from __future__ import annotations

import numpy as np

from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import greatest
from magwire_env.simulation.locked.arrays import Library

__all__ = ["Way"]

_SLOWEST = 2e-3
"""Where the best net force leaves nothing, the way is reckoned at this speed, m/s."""


class Way:
    """Best commands along the tracts of scenarios in one direction, and the time the way takes under them.

    library : the scenarios
    spacing : m between tabulated places
    direction : +1 forward, −1 backward
    coast : (scenarios,) s for which a wire left alone runs on at its speed: its mass over its drag, at most 0.1 s
    """

    def __init__(self, library: Library, spacing: float, direction: int) -> None:
        self.spacing, self.direction = spacing, direction
        self._count = np.ceil(library.tract_length / spacing).astype(np.int64) + 1
        self._first = np.r_[0, self._count.cumsum()[:-1]]
        entries = np.repeat(np.arange(len(self._count)), self._count)
        places = spacing * (np.arange(len(entries)) - self._first[entries])
        self._commands, force = greatest(library, entries, places, direction)
        pull, growth = Tails(library.scenarios).pull(entries, places, direction)
        speed = np.maximum((force - pull) / np.maximum(growth, 1e-9), _SLOWEST)
        turning = np.abs(np.diff(self._commands, axis=0)) / library.dofs[entries[1:], :, 0]
        pause = np.maximum(spacing * 0.5 * (1 / speed[1:] + 1 / speed[:-1]), turning.max(axis=1))
        self._clock = np.r_[0.0, pause.cumsum()]
        mass = np.array([sc.wire.mass + (sc.tip.mass or 0.0) for sc in library.scenarios])
        drag = np.array([sc.wire.length * sc.contact.drag for sc in library.scenarios])
        self.coast = np.minimum(mass / np.maximum(drag, 1e-9), 0.1)

    def command(self, entries: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Between the tabulated ones, (…, dof), for scenarios `entries` and places `s` m (…)."""
        row = self._row(entries, s)
        below = np.minimum(row.astype(np.int64), self._first[entries] + self._count[entries] - 2)
        return self._commands[below] + (row - below)[..., None] * (self._commands[below + 1] - self._commands[below])

    def time(self, entries: np.ndarray, s: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """s from `s` to `goal` m, negative past it; before the entrance at the slowest pace."""
        clocks = [np.interp(self._row(entries, x), np.arange(len(self._clock)), self._clock) for x in (s, goal)]
        return self.direction * (clocks[1] - clocks[0] + np.maximum(-s, 0.0) / _SLOWEST)

    def _row(self, entries: np.ndarray, s: np.ndarray) -> np.ndarray:
        return self._first[entries] + np.clip(s / self.spacing, 0, self._count[entries] - 1)
