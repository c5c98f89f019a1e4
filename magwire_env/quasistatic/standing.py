"""Where a magnet that turns can hold the tip at rest, and at which angle it does so most firmly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..scenario import Scenario
from ..simulation import Library
from .balance import Tails
from .net_force import TipForces

__all__ = ["Standing", "standing"]

_SPACING, _ANGLES = 2e-3, 360

_SPARE = 20e-6
"""N; so much must be left to move on, each way. It is the error that certificates allow the balance."""


@dataclass(frozen=True, eq=False)
class Standing:
    """Places along a tract at which the tip can stand.

    places : (k,) m, from the wire's length to the tract's end
    angles : (k,) rad, the magnet's angle that holds the tip most firmly
    firmness : (k,) N, the force that is missing there to move the wire, forwards or backwards
    good : (k,) the tip can stand there, and other angles move it both ways
    """

    places: np.ndarray
    angles: np.ndarray
    firmness: np.ndarray
    good: np.ndarray

    def nearest_good(self, s: np.ndarray) -> np.ndarray:
        """Places (n,) m: `s` where the nearest row is good, else the nearest good row."""
        rows = np.flatnonzero(self.good)
        nearest = self.places[rows[np.abs(s[:, None] - self.places[rows]).argmin(axis=1)]]
        return np.where(self.good[self._row(s)], s, nearest)

    def angle(self, s: np.ndarray) -> np.ndarray:
        """The angle (n,) rad that holds a tip at `s` (n,) m."""
        return self.angles[self._row(s)]

    def _row(self, s: np.ndarray) -> np.ndarray:
        return np.clip(
            np.rint((s - self.places[0]) / (self.places[1] - self.places[0])), 0, len(self.places) - 1
        ).astype(np.int64)


@lru_cache(maxsize=256)
def standing(scenario: Scenario) -> Standing:
    """Where the tip of a scenario can stand.

    Raises `ValueError` for a rig of anything but one turning magnet, or where the tip can stand nowhere.
    """
    library = Library([scenario])
    if library.is_turn.tolist() != [True]:
        raise ValueError(f"scenario.rig must have one turning magnet to hold the tip, got {library.dof} dofs")
    first, last = scenario.wire.length, scenario.tract.length
    places = np.linspace(first, last, int(np.ceil((last - first) / _SPACING)) + 1)
    entries = np.zeros(len(places), dtype=np.int64)
    angles = float(library.home[0, 0]) + 2 * np.pi / _ANGLES * (np.arange(_ANGLES) - _ANGLES // 2)
    missing = np.full((len(places), _ANGLES), np.inf)
    moves = np.ones(len(places), dtype=np.bool_)
    for direction in (1, -1):
        tips = TipForces(library, entries, places, direction)
        resistance, _ = Tails([scenario]).resistance(entries, places, direction)
        net = np.stack([tips.force(np.full((tips.n, 1), angle)) for angle in angles], axis=1) - resistance[:, None]
        missing = np.minimum(missing, -net)
        moves &= net.max(axis=1) > _SPARE
    best = missing.argmax(axis=1)
    firmness = missing[np.arange(len(places)), best]
    good = moves & (firmness > 0.0)
    if not good.any():
        raise ValueError(f"scenario {scenario.name!r} must have a place where the magnet can hold the tip, got none")
    return Standing(places, angles[best], firmness, good)
