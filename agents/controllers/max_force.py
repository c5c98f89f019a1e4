"""The paper's own policy: turn to the angle of greatest drive force at the tip's place (Figure 7)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.simulation import best_command

from .base import Controller

__all__ = ["MaxForce"]


class MaxForce(Controller):
    """Commands the angle of greatest projected force (under the scenario's coupling) at the observed arc length.

    Knows: the model (tract and rig) and the tip's arc length. Ignores friction, bending and the servo's lag.

    spacing : m between the places where the best command is tabulated
    """

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, spacing: float = 2e-3, **settings: Any) -> None:
        super().__init__(env, **settings)
        self.spacing = spacing
        self._tables: dict[int, np.ndarray] = {}

    def act(self, observation, state, starts, deterministic):
        sim = self.core.sim
        entries = sim.lane_scenario
        tip = self.seen(observation, "tip_arclength")[:, 0] * sim.library.tract_length[entries]
        command = np.empty((len(tip), sim.dof))
        for entry in np.unique(entries):
            lanes = entries == entry
            table = self._table(int(entry))
            at = np.clip(tip[lanes] / self.spacing, 0, len(table) - 1)
            row = np.minimum(at.astype(np.int64), len(table) - 2)
            gap = table[row + 1] - table[row]
            # Between two places the angles are joined, unless the best angle jumps there: then the nearer counts.
            share = np.where(np.abs(gap) < 0.5, (at - row)[:, None], np.round(at - row)[:, None])
            command[lanes] = table[row] + share * gap
        return self.core.actuation.action(command), state

    def _table(self, entry: int) -> np.ndarray:
        if entry not in self._tables:
            scenario = self.core.sim.library.scenarios[entry]
            places = np.arange(0.0, scenario.tract.length + self.spacing, self.spacing)
            self._tables[entry] = best_command(scenario, places)[0]
        return self._tables[entry]
