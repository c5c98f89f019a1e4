"""What a rig can do along a tract: the force map F(s, θ) (Figure 6) and the best command (Figure 7)."""

from __future__ import annotations

import numpy as np

from ..scenario import Scenario
from ..simulation import Library, Places, Simulator
from ..simulation.model import require
from .net_force import FINE, search

__all__ = ["best_command", "drive_at", "force_map"]

_LANES_AT_ONCE = 65536


def drive_at(scenario: Scenario, commands: np.ndarray, arclengths: np.ndarray) -> np.ndarray:
    """Drive on the tip at `arclengths` (n,) m with the rig at `commands` (n, dof) rad and m → (n,) N.

    The generalised force along the tract under the scenario's coupling, from the kernel that also moves the wire.
    """
    require(scenario, "quasistatic", "a force map")
    library = Library([scenario])
    arclengths = np.asarray(arclengths, dtype=np.float64)
    commands = np.asarray(commands, dtype=np.float64)
    drive = np.empty(len(arclengths))
    sim: Simulator | None = None
    for start in range(0, len(drive), _LANES_AT_ONCE):
        part = slice(start, min(start + _LANES_AT_ONCE, len(drive)))
        n = part.stop - part.start
        if sim is None or sim.num_envs != n:
            sim = Simulator(library, n, lane_scenario=np.zeros(n, dtype=np.int64))
        sim.lay(np.arange(n), Places(arclengths[part]), commands[part])
        drive[part] = sim.drive_force
    return drive


def force_map(scenario: Scenario, angles: np.ndarray, arclengths: np.ndarray) -> np.ndarray:
    """Projected force over magnet angle and tract position, the paper's Figure 6.

    angles : (n_angles,) rad, of a rig with a single degree of freedom
    arclengths : (n_arclengths,) m

    Returns (n_angles, n_arclengths) N, under the scenario's coupling.
    """
    if len(scenario.rig.dofs) != 1:
        raise ValueError(f"scenario.rig must have one degree of freedom for a force map, got {len(scenario.rig.dofs)}")
    angles, arclengths = np.asarray(angles, dtype=np.float64), np.asarray(arclengths, dtype=np.float64)
    command, place = np.meshgrid(angles, arclengths, indexing="ij")
    return drive_at(scenario, command.reshape(-1, 1), place.ravel()).reshape(command.shape)


def best_command(scenario: Scenario, arclengths: np.ndarray, direction: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """The command of greatest drive at each place, the paper's Figure 7.

    arclengths : (n,) m, in any order
    direction : +1 for the greatest forward drive, −1 for the greatest backward

    Returns the commands (n, dof), rad for turns (within π of home) and m for slides (within their limits), and the
    drives (n,) N. The search is that of `net_force`, at its finest.
    """
    arclengths = np.asarray(arclengths, dtype=np.float64)
    library = Library([scenario])
    entries = np.zeros(len(arclengths), dtype=np.int64)
    sign = 1.0 if direction >= 0 else -1.0
    commands, force = search(library, entries, arclengths, sign, "drive", FINE)
    off = commands - library.home[0]
    return np.where(library.is_turn, commands - 2 * np.pi * np.round(off / (2 * np.pi)), commands), sign * force


def command_range(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """The command's range, (dof,) lowest and highest: home ± π for turns, the limits for slides."""
    _, low, high = np.array(scenario.rig.limits).T
    return low, high
