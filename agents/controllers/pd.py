"""PD on arc length, the force it asks for looked up in the force map: for reaching and tracking."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.physics.checks import non_negative, positive, whole
from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import Places

from .base import Controller
from .seen import aim_seen, magnet_seen, tip_seen

__all__ = ["PD"]

_STANDSTILL = 1e-3
"""Speed, m/s, below which friction is reckoned in part: the wanted speed's sign would make it jump."""

_BEYOND = 0.1
"""A steering task's goal is to be passed, not kept, so the aim lies so far beyond it, m."""


class PD(Controller):
    """Asks for the speed that closes the distance, the force that gives this speed, and the angle of that force.

    Knows: the model (tract, rig, wire, contact), the tip's arc length and speed, where the magnet is, and the way left
    or the reference.

    The wanted speed is v = v_ref + kp (aim − s), the wanted force what the wire behind the tip takes at that speed
    (bending, friction and drag, `balance`) plus kd (v − speed). Of the angles that give this force after the tip's own
    friction, at the place where the tip will be half a control period on, it takes the one nearest to where the magnet
    is; where none does, the one that comes nearest to it.

    kp : 1/s
    kd : share of the wire's momentum by the wanted change of speed that is made up for within a control period
    spacing : m between the places, and `angles` the number of angles round the circle, at which forces are tabulated

    Raises `ValueError` for a rig of anything but one turning magnet.
    """

    def __init__(
        self,
        env: gym.Env | gym.vector.VectorEnv,
        kp: float = 4.0,
        kd: float = 0.5,
        spacing: float = 2e-3,
        angles: int = 96,
        **settings: Any,
    ) -> None:
        super().__init__(env, **settings)
        self.kp, self.kd = positive("kp", kp, "1/s"), non_negative("kd", kd)
        self.spacing, self._angles = positive("spacing", spacing, "m"), whole("angles", angles, 8)
        library = self.core.sim.library
        if library.is_turn.tolist() != [True]:
            raise ValueError(f"env must have a rig of one turning magnet for PD, got {library.dof} degrees of freedom")
        count = np.ceil(library.tract_length / spacing).astype(np.int64) + 1
        self._first, self._last = np.r_[0, count.cumsum()[:-1]], count - 1
        self._mass = np.array([sc.wire.mass + (sc.tip.mass or 0.0) for sc in library.scenarios])
        entries = np.repeat(np.arange(len(count)), count)
        self._tabulate(entries, spacing * (np.arange(len(entries)) - self._first[entries]))

    def _tabulate(self, entries: np.ndarray, places: np.ndarray) -> None:
        """Drive and friction of the tip by place and angle from home; the tail's pull and its growth, by place."""
        library = self.core.sim.library
        turns = 2 * np.pi / self._angles * np.arange(self._angles)
        forth, back = (Places(library, entries, places, way) for way in (1, -1))
        home = library.home[entries]
        forces = [np.stack([p.force(home + turn) for turn in turns], axis=1) for p in (forth, back)]
        self._drive, self._rub = (forces[0] - forces[1]) / 2, -(forces[0] + forces[1]) / 2
        pulls = [Tails(library.scenarios).pull(entries, places, way) for way in (1, -1)]
        self._pull = np.stack([pulls[0][0], pulls[1][0], (pulls[0][1] + pulls[1][1]) / 2], axis=1)

    def act(self, observation, state, starts, deterministic):
        sim, period = self.core.sim, self.core.sim.control_period
        entries = sim.lane_scenario
        tip, speed = tip_seen(self, observation)
        aims = aim_seen(self, observation, period * np.array([0.5, 1.0, 1.5]))
        if self.core.task.kind == "steer":
            aims = aims + _BEYOND
        wanted = (aims[:, 2] - aims[:, 0]) / period + self.kp * (aims[:, 1] - tip - 0.5 * period * speed)
        at = tip + 0.5 * period * speed
        sense = wanted / np.hypot(wanted, _STANDSTILL)
        forth, back, growth = self._at(self._pull, entries, at).T
        force = 0.5 * ((1 + sense) * forth - (1 - sense) * back) + growth * wanted
        force += self.kd * self._mass[entries] * (wanted - speed) / period
        given = self._at(self._drive, entries, at) - sense[:, None] * self._at(self._rub, entries, at)
        magnet = magnet_seen(self, observation)[:, 0] - sim.library.home[entries, 0]
        turn = self._nearest(given - force[:, None], magnet)
        return self.core.actuation.action(sim.library.home[entries] + turn[:, None]), state

    def _at(self, table: np.ndarray, entries: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Rows of a table at places `s` (n,) m, straight between them."""
        row = self._first[entries] + np.clip(s / self.spacing, 0, self._last[entries])
        below = np.minimum(row.astype(np.int64), self._first[entries] + self._last[entries] - 1)
        return table[below] + (row - below)[:, None] * (table[below + 1] - table[below])

    def _nearest(self, surplus: np.ndarray, magnet: np.ndarray) -> np.ndarray:
        """Angle from home (n,) rad nearest to `magnet` at which the surplus (n, angles) N vanishes, or is smallest."""
        step = 2 * np.pi / self._angles
        after = np.roll(surplus, -1, axis=1)
        crosses = (surplus >= 0) != (after >= 0)
        share = np.where(crosses, surplus / np.where(crosses, surplus - after, 1.0), 0.0)
        turns = step * (np.arange(self._angles) + share)
        gap = np.abs((turns - magnet[:, None] + np.pi) % (2 * np.pi) - np.pi)
        best = np.where(
            crosses.any(axis=1), np.where(crosses, gap, np.inf).argmin(axis=1), np.abs(surplus).argmin(axis=1)
        )
        return turns[np.arange(len(magnet)), best]
