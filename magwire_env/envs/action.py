"""Action modes: from the policy's numbers in [−1, 1] to the rig's command in rad and m."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

from ..physics.checks import one_of
from ..scenario.rig import wrapped
from ..simulation import Simulator
from . import kernels
from .moment import MomentActions

__all__ = ["MODES", "Actuation"]

MODES = ("angle", "rate", "direction", "moment")  # the first three in the order of the kernel's numbers for them


class Actuation:
    """Turns actions into commands.

    mode : ``"angle"``, ±1 ↔ home ± π for a turn and the two limits for a slide; ``"rate"``, ±1 ↔ as far as the servo
        goes in one control period, from where it is; ``"direction"``, (cos, sin) of a turn's angle from home, a slide
        as in ``"angle"``; ``"moment"``, the direction of a magnet's moment, see `MomentActions`
    """

    def __init__(self, sim: Simulator, mode: str = "angle") -> None:
        self.mode = one_of("action_mode", mode, MODES)
        self._sim = sim
        self._turns = sim.library.is_turn
        self._moment = MomentActions(sim) if mode == "moment" else None
        size = sum(2 if turn and mode == "direction" else 1 for turn in self._turns)
        size = self._moment.size if self._moment else size
        self.space = Box(-1.0, 1.0, (size,), dtype=np.float32)
        self._shape, self._number, self._period = (sim.num_envs, size), MODES.index(mode), sim.control_period

    def command(self, action: np.ndarray) -> np.ndarray:
        """(n, size) numbers, clipped to [−1, 1] → (n, dof) rad and m. Raises `ValueError` for a wrong shape or NaN."""
        command = np.empty((self._sim.dof, self._sim.num_envs))
        self.write(action, command)
        return command.T

    def write(self, action: np.ndarray, command: np.ndarray) -> None:
        """As `command`, into an array (dof, n)."""
        action = _numbers(action, self._shape)
        rig = self._sim.rig
        if self._moment:
            wrong = np.isnan(action).any(axis=1)
            lane = int(wrong.argmax()) if wrong.any() else -1
            if lane < 0:
                command[:] = self._moment.command(np.clip(action, -1.0, 1.0)).T
        else:
            lane = kernels.command_of(
                self._number, np.ascontiguousarray(action), self._turns, self._period, rig.limits, rig.q, command
            )
        if lane >= 0:
            raise ValueError(f"action[{lane}] must be numbers in [-1, 1], got {action[lane].tolist()}")

    def alone(self, action: np.ndarray) -> np.ndarray:
        """A single env's action (size,) → (1, size). Raises `ValueError` for another shape, which it names."""
        return _numbers(action, self._shape[1:])[None]

    def action(self, command: np.ndarray) -> np.ndarray:
        """The action that gives a command: (n, dof) rad and m → (n, size) float32. What model-based controllers use."""
        sim = self._sim
        if self._moment:
            return self._moment.action(command).astype(np.float32)
        speed, low, high = sim.library.limits.of(sim.lane_scenario)
        if self.mode == "rate":
            reach = speed * sim.control_period
            return np.clip(wrapped(command - sim.magnet, self._turns) / reach, -1.0, 1.0).astype(np.float32)
        share = wrapped(command - 0.5 * (low + high), self._turns) / (0.5 * (high - low))
        if self.mode == "angle":
            return np.clip(share, -1.0, 1.0).astype(np.float32)
        columns = []
        for i, turn in enumerate(self._turns):
            columns += [np.cos(np.pi * share[:, i]), np.sin(np.pi * share[:, i])] if turn else [share[:, i]]
        return np.clip(np.stack(columns, axis=1), -1.0, 1.0).astype(np.float32)

    def turned(self, before: np.ndarray) -> np.ndarray:
        """How far the rig has come from `before` (n, dof), over what a servo covers in a control period."""
        sim = self._sim
        speed = sim.library.limits.speed[sim.lane_scenario]
        return wrapped(sim.magnet - before, self._turns) / (speed * sim.control_period)


def _numbers(action: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The action as float64, or a `ValueError` that names the shape it must have and the one it has."""
    try:
        array = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"action must be an array of shape {shape}, got {action!r:.80}") from None
    if array.shape != shape:
        got = array.shape if array.ndim else f"a number by itself, {action!r}"
        raise ValueError(f"action must have shape {shape}, got {got}")
    return array
