"""The action mode "moment": the direction of each magnet's moment, the wire's feed as a rate; slides follow the tip."""

from __future__ import annotations

import numpy as np

from ..scenario.rig import Slide, Turn, wrapped
from ..simulation import Simulator

__all__ = ["MomentActions", "moments", "over"]

_LEAST = 1e-3
"""A direction shorter than this is none: the magnet stays as it is."""


class MomentActions:
    """Actions of a rig whose magnets turn about y, then z: three numbers a magnet, then coils, feed, twist.

    A magnet's three numbers are the direction its moment shall have, in the world's axes; their length does not
    matter, and no direction at all leaves it as it is. Its slides are no action: they follow the tip, as far and as
    fast as they can. ±1 of a coil's current is its range, ±1 of the feed and the twist as far as the drive goes in one
    control period.

    size : numbers of an action

    Raises `ValueError` for magnets that turn otherwise.
    """

    def __init__(self, sim: Simulator) -> None:
        self._sim, rig = sim, sim.library.scenarios[0].rig
        self._turns: list[tuple[int, int]] = []
        at = 0
        for m, mount in enumerate(rig.magnets):
            turns = [i for i, dof in enumerate(mount.dofs) if isinstance(dof, Turn)]
            if [mount.dofs[i].axis for i in turns] != ["y", "z"]:
                raise ValueError(
                    "action_mode 'moment' needs magnets that turn about y, then z; "
                    f"Scenario.rig.magnets[{m}].dofs are {mount.dofs}"
                )
            self._turns.append((at + turns[0], at + turns[1]))
            at += len(mount.dofs)
        self._coils = range(at, at + len(rig.coils))
        self._base = range(at + len(rig.coils), sim.dof)
        self.size = 3 * len(self._turns) + len(self._coils) + len(self._base)

    def command(self, action: np.ndarray) -> np.ndarray:
        """Actions (n, size) in [−1, 1] → commands (n, dof), rad, m and A."""
        sim = self._sim
        speed, low, high = sim.library.limits.of(sim.lane_scenario)
        now = sim.magnet
        command = over(sim, sim.tip_position, now)
        for m, (first, second) in enumerate(self._turns):
            angles = _angles(action[:, 3 * m : 3 * m + 3], now[:, first], now[:, second])
            command[:, first], command[:, second] = angles
        column = 3 * len(self._turns)
        for d in self._coils:
            command[:, d] = low[:, d] + 0.5 * (action[:, column] + 1.0) * (high - low)[:, d]
            column += 1
        for d in self._base:
            command[:, d] = now[:, d] + action[:, column] * speed[:, d] * sim.control_period
            column += 1
        return command

    def action(self, command: np.ndarray) -> np.ndarray:
        """The actions (n, size) that give commands (n, dof), where slides follow the tip."""
        sim = self._sim
        speed, low, high = sim.library.limits.of(sim.lane_scenario)
        columns = []
        for first, second in self._turns:
            tilt, round_z = command[:, first], command[:, second]
            columns += [np.sin(tilt) * np.cos(round_z), np.sin(tilt) * np.sin(round_z), np.cos(tilt)]
        columns += [2.0 * (command[:, d] - low[:, d]) / (high - low)[:, d] - 1.0 for d in self._coils]
        columns += [(command[:, d] - sim.magnet[:, d]) / (speed[:, d] * sim.control_period) for d in self._base]
        return np.clip(np.stack(columns, axis=1), -1.0, 1.0)


def _angles(wanted: np.ndarray, tilt: np.ndarray, round_z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turns about y and z (n,) that bring the moment to directions (n, 3): of two ways the one with less to turn."""
    size = np.linalg.norm(wanted, axis=1)
    d = wanted / np.maximum(size, _LEAST)[:, None]
    across = np.hypot(d[:, 0], d[:, 1])
    first = np.arctan2(across, d[:, 2])
    second = np.where(across > _LEAST, np.arctan2(d[:, 1], d[:, 0]), round_z)
    other = np.where(across > _LEAST, second + np.pi, round_z)
    one_way = np.maximum(np.abs(wrapped(first - tilt)), np.abs(wrapped(second - round_z)))
    other_way = np.maximum(np.abs(wrapped(-first - tilt)), np.abs(wrapped(other - round_z)))
    better, given = other_way < one_way, size >= _LEAST
    first, second = np.where(better, -first, first), np.where(better, other, second)
    return np.where(given, first, tilt), np.where(given, second, round_z)


def over(sim: Simulator, tips: np.ndarray, magnet: np.ndarray, entries: np.ndarray | None = None) -> np.ndarray:
    """Settings (n, dof) like `magnet` with every slide where it brings its magnet over tips (n, 3) m, within limits.

    entries : (n,) scenarios; by default those of all lanes
    """
    entries = sim.lane_scenario if entries is None else entries
    _, low, high = sim.library.limits.of(entries)
    setting, at = magnet.copy(), 0
    for m, mount in enumerate(sim.library.scenarios[0].rig.magnets):
        for dof in mount.dofs:
            if isinstance(dof, Slide):
                axis = "xyz".index(dof.axis)
                home = np.array([sc.rig.magnets[m].position[axis] for sc in sim.library.scenarios])[entries]
                setting[:, at] = np.clip(tips[:, axis] - home, low[:, at], high[:, at])
            at += 1
    return setting


def moments(sim: Simulator) -> np.ndarray:
    """Directions of the magnets' moments, (n, magnets, 3) unit vectors in the world's axes."""
    now, at = sim.magnet, 0
    out = np.zeros((sim.num_envs, sim.library.magnet_count, 3))
    out[:, :, 2] = 1.0
    for m, mount in enumerate(sim.library.scenarios[0].rig.magnets):
        for dof in mount.dofs:
            if isinstance(dof, Turn):
                i = "xyz".index(dof.axis)
                j, k = (i + 1) % 3, (i + 2) % 3
                c, s = np.cos(now[:, at]), np.sin(now[:, at])
                a, b = out[:, m, j].copy(), out[:, m, k].copy()
                out[:, m, j], out[:, m, k] = c * a - s * b, s * a + c * b
            at += 1
    return out
