"""The certificate's policy: hold the command of greatest net force, and lead the tip no faster than the servos go."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.quasistatic.net_force import greatest

from .base import Controller
from .seen import magnet_seen, tip_seen

__all__ = ["NetForce"]

_JUMP = 0.05
"""Servo time from one tabulated place to the next, s, above which the magnet does not stop half-way."""

_LOST = 0.02
"""So far behind the place aimed at, m, a tip that does not come on is given up on, and aimed at where it is."""


class NetForce(Controller):
    """Turns to what leaves most force along the tract after friction and bending, under the scenario's coupling.

    Knows: the model (tract, rig, wire, contact), the tip's arc length and speed, and where the magnets are.

    The command is the best one for a place of the way, and that place moves on: to where the tip will be after the
    servos' lag, but no faster than the servos can follow the best command along the way, and not back. A tip thrown
    ahead of it is braked until the magnets have caught up, and a tip at it is always pulled on, since the best command
    there leaves a force: so the tip gets wherever a certificate says it can.

    spacing : m between the places where the best command is tabulated
    ahead : control periods; the lag between a place being seen and the magnet's arriving there
    direction : +1 forward, −1 backward
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
        self.spacing, self.ahead, self.direction = spacing, ahead, direction
        library = self.core.sim.library
        counts = np.ceil(library.tract_length / spacing).astype(np.int64) + 1
        self._first, self._count = np.r_[0, counts.cumsum()[:-1]], counts
        entries = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(counts.sum()) - self._first[entries]
        if direction < 0:
            place = counts[entries] - 1 - place
        # Rows in the order of travel, one scenario after another.
        order = np.argsort(entries * counts.max() + place) if direction < 0 else np.arange(len(place))
        table, _ = greatest(library, entries, spacing * place[order], direction)
        self._table = table[np.argsort(order)]
        gap = np.abs(np.diff(self._table, axis=0)) / library.dofs[entries[1:], :, 0]
        self._pause = np.r_[gap.max(axis=1) + 1e-9, 0.0]
        self._clock = np.r_[0.0, self._pause[:-1].cumsum()]

    def act(self, observation, state, starts, deterministic):
        sim = self.core.sim
        entries, period = sim.lane_scenario, sim.control_period
        tip, speed = tip_seen(self, observation)
        speed = self.direction * speed
        here = self._row(entries, tip)
        aim = self._row(entries, tip + self.direction * np.maximum(speed, 0.0) * self.ahead * period)
        arrived = np.zeros(len(tip), dtype=np.bool_) if state is None else state[1] & ~starts
        led = here if state is None else np.where(arrived, state[0], here)
        behind = self._servo_time(observation, self._command(led))
        arrived = arrived | (behind < period)
        lost = ((led - here) * self.spacing > _LOST) & (speed <= 0.0) & (behind < period)
        led = np.where(lost, here, led)
        led = self._moved_on(led, aim, np.maximum(period - behind, 0.0))
        return self.core.actuation.action(self._command(led)), (led, arrived)

    def _row(self, entries: np.ndarray, arclength: np.ndarray) -> np.ndarray:
        """Row of the table, with its fraction, for places (n,) m of the lanes' scenarios."""
        last = self._count[entries] - 1
        at = np.clip(arclength / self.spacing, 0, last)
        return self._first[entries] + (at if self.direction > 0 else last - at)

    def _moved_on(self, led: np.ndarray, aim: np.ndarray, time: np.ndarray) -> np.ndarray:
        """The row that the servos can have followed the table to within `time` (n,) s, at most `aim`.

        A row is not left half-way to the next if the commands differ much: what lies between need not pull.
        """
        row = led.astype(np.int64)
        clock = self._clock[row] + (led - row) * self._pause[row]
        until = np.where((self._pause[row] > _JUMP) & (led > row), self._clock[row] + self._pause[row], 0.0)
        goal = aim.astype(np.int64)
        until = np.maximum(until, self._clock[goal] + (aim - goal) * self._pause[goal])
        return np.maximum(led, np.interp(np.minimum(clock + time, until), self._clock, np.arange(len(self._clock))))

    def _command(self, row: np.ndarray) -> np.ndarray:
        """The table between its rows, (n, dof)."""
        below = row.astype(np.int64)
        above = np.minimum(below + 1, len(self._table) - 1)
        return self._table[below] + (row - below)[:, None] * (self._table[above] - self._table[below])

    def _servo_time(self, observation: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Time (n,) s that the servos need to `command` (n, dof) from where the magnets are seen to be."""
        library = self.core.sim.library
        speed, low, high = library.dofs[self.core.sim.lane_scenario].transpose(2, 0, 1)
        gap = np.where(library.is_turn, command, np.clip(command, low, high)) - magnet_seen(self, observation)
        gap = np.where(library.is_turn, gap - 2 * np.pi * np.round(gap / (2 * np.pi)), gap)
        return (np.abs(gap) / speed).max(axis=1)
