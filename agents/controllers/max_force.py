"""The paper's own policy: turn to the angle of greatest drive force at the tip's place (Figure 7)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.quasistatic.along_tract import AlongTract
from magwire_env.quasistatic.net_force import greatest
from magwire_env.quasistatic.twin import locked_twin

from .base import Controller, Memory
from .seen import tip_seen, way_seen

__all__ = ["MaxForce"]

_JUMP = 0.5
"""Where the best command changes by more than this between two tabulated places, rad or m, it is not interpolated."""


class MaxForce(Controller):
    """Commands the angle of greatest projected force (under the scenario's coupling) at the observed arc length.

    Knows: the model (tract and rig) and the tip's arc length. Ignores friction, bending and the servo's lag. In a task
    that comes back, it turns to the angle of greatest force backwards once the goal lies behind the tip. A free wire
    on a tract is taken as locked to it.

    spacing : m between the places where the best command is tabulated
    """

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, spacing: float = 2e-3, **settings: Any) -> None:
        super().__init__(env, **settings)
        library = locked_twin(self.core.sim.library)
        self._along = AlongTract(library.tract_length, spacing)
        directions = (1, -1) if self.core.task.kind.returns else (1,)
        self._commands = [
            greatest(library, self._along.entries, self._along.places, direction, "drive")[0]
            for direction in directions
        ]

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        tip, _ = tip_seen(self, observation)
        below, share = self._along.below(self.core.sim.lane_scenario, tip)
        back = way_seen(self, observation) < 0.0
        first, second = (
            np.where(back[:, None], self._commands[-1][row], self._commands[0][row]) for row in (below, below + 1)
        )
        gap = second - first
        # Where the best angle jumps between two places, take that of the nearer place.
        share = np.where(np.abs(gap) < _JUMP, share[:, None], np.round(share)[:, None])
        return self.core.actuation.action(first + share * gap), state
