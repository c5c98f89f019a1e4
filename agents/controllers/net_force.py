"""The policy behind certificates: hold the command of greatest net force, no faster than the servos can follow."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.quasistatic.along_tract import AlongTract
from magwire_env.quasistatic.net_force import greatest
from magwire_env.quasistatic.twin import locked_twin
from magwire_env.scenario.rig import wrapped

from .base import Controller, Memory
from .seen import magnet_seen, tip_seen, way_seen

__all__ = ["NetForce"]

_JUMP = 0.05
"""If the servos need more than this from one tabulated place to the next, s, the magnet does not stop half-way."""

_LOST = 0.02
"""If the tip stands still this far behind the place that the command is for, m, the command goes back to the tip."""


class NetForce(Controller):
    """Turns to the command that leaves the greatest force along the tract after friction and bending.

    Knows: the model (tract, rig, wire, contact), the tip's arc length and speed, and where the magnets are; in a task
    that comes back, also whether the tip is on its way back.

    The command is the best one for a place on the way, the *led place*. It moves on to where the tip will be after the
    servos' lag, but no faster than the servos can follow the best commands, and never back. So a tip that is thrown
    ahead of the led place is braked until the magnets have caught up. A tip at the led place is pulled on, as the best
    command there leaves a force. So the tip gets wherever a certificate says that it can. On a way back the led place
    starts anew. A free wire on a tract is taken as one locked to it.

    spacing : m between the places where the best command is tabulated
    ahead : control periods from when a place is seen until the magnet has arrived at its command
    direction : +1 forward, −1 backward; a task that comes back has both
    """

    def __init__(
        self,
        env: gym.Env | gym.vector.VectorEnv,
        spacing: float = 2e-3,
        ahead: float = 1.0,
        direction: int = 1,
        **settings: Any,
    ) -> None:
        super().__init__(env, **settings)
        self.direction = direction
        directions = (1, -1) if self.core.task.kind.returns else (direction,)
        self._ways = [_Way(self, spacing, ahead, one) for one in directions]

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        tip, speed = tip_seen(self, observation)
        back = way_seen(self, observation) < 0.0
        if state is not None and len(self._ways) > 1:
            starts = starts | (back != state[2])
        command, led, arrived = self._ways[0].command(observation, tip, speed, state, starts)
        if back.any():
            other = self._ways[1].command(observation, tip, speed, state, starts)
            command = np.where(back[:, None], other[0], command)
            led, arrived = np.where(back, other[1], led), np.where(back, other[2], arrived)
        return self.core.actuation.action(command), (led, arrived, back)


class _Way:
    """The best commands in one direction, in the order of travel, and the led place on that way."""

    def __init__(self, owner: NetForce, spacing: float, ahead: float, direction: int) -> None:
        self._owner, self.ahead, self.direction = owner, ahead, direction
        self._sim = owner.core.sim
        library = locked_twin(self._sim.library)
        self._along = along = AlongTract(library.tract_length, spacing)
        commands, _ = greatest(library, along.entries, along.places, direction)
        # Rows in the order of travel, one scenario after another.
        self._commands = commands if direction > 0 else commands[along.mirrored]
        gap = np.abs(np.diff(self._commands, axis=0)) / library.limits.speed[along.entries[1:]]
        self._pause = np.r_[gap.max(axis=1) + 1e-9, 0.0]
        self._clock = np.r_[0.0, self._pause[:-1].cumsum()]

    def command(
        self, observation: np.ndarray, tip: np.ndarray, speed: np.ndarray, state: Memory, starts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The command (n, dof), the led row (n,), and whether the magnets have been at its command since the start."""
        entries, period = self._sim.lane_scenario, self._sim.control_period
        speed = self.direction * speed
        here = self._row(entries, tip)
        aim = self._row(entries, tip + self.direction * np.maximum(speed, 0.0) * self.ahead * period)
        arrived = np.zeros(len(tip), dtype=np.bool_) if state is None else state[1] & ~starts
        led = here if state is None else np.where(arrived, state[0], here)
        behind = self._servo_time(observation, self._command(led))
        arrived = arrived | (behind < period)
        lost = ((led - here) * self._along.spacing > _LOST) & (speed <= 0.0) & (behind < period)
        led = np.where(lost, here, led)
        led = self._moved_on(led, aim, np.maximum(period - behind, 0.0))
        return self._command(led), led, arrived

    def _row(self, entries: np.ndarray, arclength: np.ndarray) -> np.ndarray:
        """Row in the order of travel, with its fraction, of places (n,) m in the lanes' scenarios."""
        if self.direction > 0:
            return self._along.row(entries, arclength)
        last = self._along.counts[entries] - 1
        return self._along.first[entries] + (last - np.clip(arclength / self._along.spacing, 0, last))

    def _moved_on(self, led: np.ndarray, aim: np.ndarray, time: np.ndarray) -> np.ndarray:
        """The row to which the servos can follow the table from `led` within `time` (n,) s, at most `aim`.

        Where the commands of two rows differ much, the led place does not stop between them: a command between two
        good ones need not pull.
        """
        row = led.astype(np.int64)
        clock = self._clock[row] + (led - row) * self._pause[row]
        until = np.where((self._pause[row] > _JUMP) & (led > row), self._clock[row] + self._pause[row], 0.0)
        goal = aim.astype(np.int64)
        until = np.maximum(until, self._clock[goal] + (aim - goal) * self._pause[goal])
        return np.maximum(led, np.interp(np.minimum(clock + time, until), self._clock, np.arange(len(self._clock))))

    def _command(self, row: np.ndarray) -> np.ndarray:
        """The command at fractional rows (n,), (n, dof)."""
        below = row.astype(np.int64)
        above = np.minimum(below + 1, len(self._commands) - 1)
        return self._commands[below] + (row - below)[:, None] * (self._commands[above] - self._commands[below])

    def _servo_time(self, observation: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Time (n,) s that the servos need to `command` (n, dof) from where the magnets are seen to be."""
        is_turn = self._sim.library.is_turn
        speed, low, high = self._owner.limits
        gap = np.where(is_turn, command, np.clip(command, low, high)) - magnet_seen(self._owner, observation)
        return (np.abs(wrapped(gap, is_turn)) / speed).max(axis=1)
