"""PD control of the tip's arc length, for reaching and tracking: the force it asks for is looked up in a force map."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.physics.checks import non_negative, positive, whole
from magwire_env.quasistatic.along_tract import AlongTract
from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import TipForces
from magwire_env.scenario import Scenario, Turn

from .base import Controller, Memory
from .seen import aim_seen, magnet_seen, tip_seen, way_seen

__all__ = ["PD"]

_STANDSTILL = 1e-3
"""Below this wanted speed, m/s, friction counts in part only; otherwise it would jump with the sign of the speed."""

_BEYOND = 0.1
"""Distance by which the aim lies beyond a steering task's goal, m: that goal has to be passed, not kept."""


class PD(Controller):
    """Asks for the speed that closes the distance, the force that gives this speed, and the angle of that force.

    Knows: the model (tract, rig, wire, contact), the tip's arc length and speed, where the magnet is, and the remaining
    distance or the reference.

    The wanted speed is v = v_ref + kp (aim − s). The wanted force is the resistance of the wire at that speed (bending,
    friction and drag, `balance`) plus kd m (v − speed) / period, with the moving mass m. Among the angles that give
    this force at the place where the tip will be half a control period later, PD takes the one nearest to the magnet.
    If no angle gives it, PD takes the one that comes nearest to it.

    kp : 1/s
    kd : share of a missing momentum that is made up for within a control period
    spacing : m between the tabulated places
    angles : number of tabulated angles round the circle

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
        self._angles = whole("angles", angles, 8)
        library = self.core.sim.library
        self._along = AlongTract(library.tract_length, spacing)
        self._mass = np.array([sc.moving_mass for sc in library.scenarios])
        self._tabulate()

    @classmethod
    def refusal(cls, scenario: Scenario) -> str:
        dofs = scenario.rig.dofs
        if len(dofs) == 1 and isinstance(dofs[0], Turn):
            return ""
        return f"env must have a rig of one turning magnet for PD, got {len(dofs)} degrees of freedom"

    def _tabulate(self) -> None:
        """Make the tables by place: drive and friction of the tip at every angle from home, and the wire's resistance.

        `_resistance` has three columns: forward and backward at a standstill, N, and the growth with speed, N·s/m.
        """
        library, along = self.core.sim.library, self._along
        turns = 2 * np.pi / self._angles * np.arange(self._angles)
        tips = [TipForces(library, along.entries, along.places, direction) for direction in (1, -1)]
        home = library.home[along.entries]
        forth, back = (np.stack([t.force(home + turn) for turn in turns], axis=1) for t in tips)
        self._drive, self._friction = (forth - back) / 2, -(forth + back) / 2
        wires = Tails(library.scenarios)
        (ahead, ahead_growth), (astern, astern_growth) = (
            wires.resistance(along.entries, along.places, direction) for direction in (1, -1)
        )
        self._resistance = np.stack([ahead, astern, (ahead_growth + astern_growth) / 2], axis=1)

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        sim, period, between = self.core.sim, self.core.sim.control_period, self._along.between
        entries = sim.lane_scenario
        tip, speed = tip_seen(self, observation)
        aims = aim_seen(self, observation, period * np.array([0.5, 1.0, 1.5]))
        if self.core.task.kind.passes:
            aims = aims + _BEYOND * way_seen(self, observation)[:, None]
        wanted = (aims[:, 2] - aims[:, 0]) / period + self.kp * (aims[:, 1] - tip - 0.5 * period * speed)
        at = tip + 0.5 * period * speed
        sense = wanted / np.hypot(wanted, _STANDSTILL)
        forth, back, growth = between(self._resistance, entries, at).T
        force = 0.5 * ((1 + sense) * forth - (1 - sense) * back) + growth * wanted
        force += self.kd * self._mass[entries] * (wanted - speed) / period
        given = between(self._drive, entries, at) - sense[:, None] * between(self._friction, entries, at)
        magnet = magnet_seen(self, observation)[:, 0] - sim.library.home[entries, 0]
        turn = self._nearest(given - force[:, None], magnet)
        return self.core.actuation.action(sim.library.home[entries] + turn[:, None]), state

    def _nearest(self, surplus: np.ndarray, magnet: np.ndarray) -> np.ndarray:
        """The angle from home (n,) rad nearest to `magnet` at which the surplus of force (n, angles) N vanishes.

        Where it vanishes nowhere, the angle at which it is smallest.
        """
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
