"""The paper's own policy: turn to the angle of greatest drive force at the tip's place (Figure 7)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.physics.checks import positive
from magwire_env.quasistatic.net_force import greatest

from .base import Controller

__all__ = ["MaxForce"]

_JUMP = 0.5
"""rad or m from one tabulated place to the next, above which the nearer place's command counts."""


class MaxForce(Controller):
    """Commands the angle of greatest projected force (under the scenario's coupling) at the observed arc length.

    Knows: the model (tract and rig) and the tip's arc length. Ignores friction, bending and the servo's lag.

    spacing : m between the places where the best command is tabulated
    """

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, spacing: float = 2e-3, **settings: Any) -> None:
        super().__init__(env, **settings)
        self.spacing = positive("spacing", spacing, "m")
        library = self.core.sim.library
        self._last = np.ceil(library.tract_length / spacing).astype(np.int64)
        self._first = np.full(len(self._last), -1)
        self._table = np.empty((0, library.dof))

    def act(self, observation, state, starts, deterministic):
        sim = self.core.sim
        entries = sim.lane_scenario
        self._tabulate(np.unique(entries[self._first[entries] < 0]))
        tip = self.seen(observation, "tip_arclength")[:, 0] * sim.library.tract_length[entries]
        at = np.clip(tip / self.spacing, 0, self._last[entries])
        row = np.minimum(at.astype(np.int64), self._last[entries] - 1)
        share = (at - row)[:, None]
        row += self._first[entries]
        gap = self._table[row + 1] - self._table[row]
        # Between two places the angles are joined, unless the best angle jumps there: then the nearer counts.
        command = self._table[row] + np.where(np.abs(gap) < _JUMP, share, np.round(share)) * gap
        return self.core.actuation.action(command), state

    def _tabulate(self, fresh: np.ndarray) -> None:
        """Add the scenarios `fresh` (n,) to the table: those that lanes now meet for the first time."""
        if len(fresh):
            counts = self._last[fresh] + 1
            first = np.r_[0, counts.cumsum()[:-1]]
            entries = np.repeat(fresh, counts)
            places = self.spacing * (np.arange(len(entries)) - np.repeat(first, counts))
            commands, _ = greatest(self.core.sim.library, entries, places, objective="drive")
            self._first[fresh] = len(self._table) + first
            self._table = np.concatenate([self._table, commands])
