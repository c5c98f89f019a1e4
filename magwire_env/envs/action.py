"""Action modes: from the policy's numbers in [−1, 1] to the rig's command in rad and m."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from ..physics.checks import one_of
from ..simulation import Simulator

__all__ = ["MODES", "Actuation"]

MODES = ("angle", "rate", "direction")


class Actuation:
    """Turns actions into commands.

    mode : ``"angle"``, ±1 ↔ home ± π for a turn and the two limits for a slide; ``"rate"``, ±1 ↔ as far as the servo
        goes in one control period, from where it is; ``"direction"``, (cos, sin) of a turn's angle from home, a slide
        as in ``"angle"``
    """

    def __init__(self, sim: Simulator, mode: str = "angle") -> None:
        self.mode = one_of("action_mode", mode, MODES)
        self._sim = sim
        self._turns = sim.library.is_turn
        size = sum(2 if turn and mode == "direction" else 1 for turn in self._turns)
        self.space = Box(-1.0, 1.0, (size,), dtype=np.float32)

    def command(self, action: np.ndarray) -> np.ndarray:
        """(n, size) numbers, clipped to [−1, 1] → (n, dof) rad and m. Raises `ValueError` for a wrong shape or NaN."""
        sim = self._sim
        action = np.asarray(action, dtype=np.float64)
        wanted = (sim.num_envs, self.space.shape[0])
        if action.shape != wanted:
            raise ValueError(f"action must have shape {wanted}, got {action.shape}")
        if np.isnan(action).any():
            lane = int(np.flatnonzero(np.isnan(action).any(axis=1))[0])
            raise ValueError(f"action[{lane}] must be numbers in [-1, 1], got {action[lane].tolist()}")
        action = np.clip(action, -1.0, 1.0)
        speed, low, high = self._dofs()
        if self.mode == "rate":
            return sim.magnet + action * speed * sim.control_period
        if self.mode == "angle":
            return low + 0.5 * (action + 1.0) * (high - low)
        command = np.empty((sim.num_envs, sim.dof))
        at = 0
        for i, turn in enumerate(self._turns):
            if turn:
                command[:, i] = 0.5 * (low[:, i] + high[:, i]) + np.arctan2(action[:, at + 1], action[:, at])
            else:
                command[:, i] = low[:, i] + 0.5 * (action[:, at] + 1.0) * (high[:, i] - low[:, i])
            at += 2 if turn else 1
        return command

    def action(self, command: np.ndarray) -> np.ndarray:
        """The action that gives a command: (n, dof) rad and m → (n, size) float32. What model-based controllers use."""
        speed, low, high = self._dofs()
        if self.mode == "rate":
            reach = speed * self._sim.control_period
            return np.clip(self._short_way(command - self._sim.magnet) / reach, -1.0, 1.0).astype(np.float32)
        share = self._short_way(command - 0.5 * (low + high)) / (0.5 * (high - low))
        if self.mode == "angle":
            return np.clip(share, -1.0, 1.0).astype(np.float32)
        columns = []
        for i, turn in enumerate(self._turns):
            columns += [np.cos(np.pi * share[:, i]), np.sin(np.pi * share[:, i])] if turn else [share[:, i]]
        return np.clip(np.stack(columns, axis=1), -1.0, 1.0).astype(np.float32)

    def _dofs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Speed, lowest and highest of every degree of freedom, (n, dof) each."""
        rows = self._sim.library.dofs[self._sim.lane_scenario]
        return rows[:, :, 0], rows[:, :, 1], rows[:, :, 2]

    def _short_way(self, gap: np.ndarray) -> np.ndarray:
        """`gap` (n, dof) with its turns brought to [−π, π)."""
        return np.where(self._turns, gap - 2 * np.pi * np.floor(gap / (2 * np.pi) + 0.5), gap)
