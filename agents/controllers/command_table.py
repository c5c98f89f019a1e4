"""Commands of greatest net force along a tract, and the time that the way takes under them."""

from __future__ import annotations

import numpy as np

from magwire_env.quasistatic.along_tract import AlongTract
from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import greatest
from magwire_env.simulation import Library

__all__ = ["CommandTable"]

_SLOWEST = 2e-3
"""Speed assumed where even the best command leaves no net force, m/s."""


class CommandTable:
    """Best commands along the tracts of scenarios in one direction, and the time the way takes under them.

    library : the scenarios
    spacing : m between tabulated places
    direction : +1 forward, −1 backward

    Attributes
    coast : (scenarios,) s for which a wire left alone keeps its speed: its mass over its drag, at most 0.1 s
    """

    def __init__(self, library: Library, spacing: float, direction: int) -> None:
        self.direction = direction
        self._along = along = AlongTract(library.tract_length, spacing)
        self._commands, force = greatest(library, along.entries, along.places, direction)
        resistance, growth = Tails(library.scenarios).resistance(along.entries, along.places, direction)
        speed = np.maximum((force - resistance) / np.maximum(growth, 1e-9), _SLOWEST)
        turning = np.abs(np.diff(self._commands, axis=0)) / library.limits.speed[along.entries[1:]]
        step = np.maximum(spacing * 0.5 * (1 / speed[1:] + 1 / speed[:-1]), turning.max(axis=1))
        self._clock = np.r_[0.0, step.cumsum()]
        mass = np.array([sc.moving_mass for sc in library.scenarios])
        drag = np.array([sc.wire.length * sc.contact.drag for sc in library.scenarios])
        self.coast = np.minimum(mass / np.maximum(drag, 1e-9), 0.1)

    def command(self, entries: np.ndarray, s: np.ndarray) -> np.ndarray:
        """The best command (…, dof) for scenarios `entries` (…) at places `s` (…) m, interpolated linearly."""
        return self._along.between(self._commands, entries, s)

    def time(self, entries: np.ndarray, s: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Time from `s` to `goal` (m), s; negative once the goal is passed. Before the entrance the speed is lowest."""
        clocks = [np.interp(self._along.row(entries, x), np.arange(len(self._clock)), self._clock) for x in (s, goal)]
        return self.direction * (clocks[1] - clocks[0] + np.maximum(-s, 0.0) / _SLOWEST)
