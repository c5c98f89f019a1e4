"""Action modes: from the policy's numbers in [−1, 1] to the rig's command in rad and m."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from ..physics.checks import one_of
from ..simulation import Simulator
from . import kernels

__all__ = ["MODES", "Actuation"]

MODES = ("angle", "rate", "direction")  # in the order of the kernel's numbers for them


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
        self._shape, self._kind, self._period = (sim.num_envs, size), MODES.index(mode), sim.control_period

    def command(self, action: np.ndarray) -> np.ndarray:
        """(n, size) numbers, clipped to [−1, 1] → (n, dof) rad and m. Raises `ValueError` for a wrong shape or NaN."""
        command = np.empty((self._sim.dof, self._sim.num_envs))
        self.write(action, command)
        return command.T

    def write(self, action: np.ndarray, command: np.ndarray) -> None:
        """As `command`, into an array (dof, n)."""
        action = np.asarray(action, dtype=np.float64)
        if action.shape != self._shape:
            raise ValueError(f"action must have shape {self._shape}, got {action.shape}")
        arrays = self._sim.arrays
        lane = kernels.command_of(
            self._kind, np.ascontiguousarray(action), self._turns, self._period, arrays.dofs, arrays.q, command
        )
        if lane >= 0:
            raise ValueError(f"action[{lane}] must be numbers in [-1, 1], got {action[lane].tolist()}")

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

    def turned(self, before: np.ndarray) -> np.ndarray:
        """How far the magnets have come from `before` (n, dof), over what a servo covers in a control period."""
        speed, _, _ = self._dofs()
        return self._short_way(self._sim.magnet - before) / (speed * self._sim.control_period)

    def _dofs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Speed, lowest and highest of every degree of freedom, (n, dof) each."""
        rows = self._sim.library.dofs[self._sim.lane_scenario]
        return rows[:, :, 0], rows[:, :, 1], rows[:, :, 2]

    def _short_way(self, gap: np.ndarray) -> np.ndarray:
        """`gap` (n, dof) with its turns brought to [−π, π)."""
        return np.where(self._turns, gap - 2 * np.pi * np.floor(gap / (2 * np.pi) + 0.5), gap)
