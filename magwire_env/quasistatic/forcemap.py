"""What a rig can do along a tract: the force map F(s, θ) (Figure 6) and the best command (Figure 7)."""

from __future__ import annotations

import itertools

import numpy as np

from ..scenario import Scenario, Turn
from ..simulation.locked import algorithm1 as a1
from ..simulation.locked.arrays import LaneArrays, Library

__all__ = ["best_command", "drive_at", "force_map"]

_GRID_POINTS = 3000
"""Most commands a place that the coarse search of `best_command` tries."""

_LANES_AT_ONCE = 65536


def drive_at(scenario: Scenario, commands: np.ndarray, arclengths: np.ndarray) -> np.ndarray:
    """Drive on the tip at `arclengths` (n,) m with the rig at `commands` (n, dof) rad and m → (n,) N.

    The generalised force along the tract under the scenario's coupling, from the very kernel that moves the wire.
    """
    return drive_over(Library([scenario]), commands, arclengths)


def drive_over(
    library: Library, commands: np.ndarray, arclengths: np.ndarray, entries: np.ndarray | None = None
) -> np.ndarray:
    """`drive_at` for the library's `entries` (n,), all the first by default."""
    arclengths = np.asarray(arclengths, dtype=np.float64)
    commands = np.asarray(commands, dtype=np.float64)
    out = np.empty(len(arclengths))
    entries = np.zeros(len(out), dtype=np.int64) if entries is None else entries
    arrays: LaneArrays | None = None
    for start in range(0, len(out), _LANES_AT_ONCE):
        part = slice(start, min(start + _LANES_AT_ONCE, len(out)))
        lanes = np.arange(part.stop - part.start)
        if arrays is None or arrays.n != len(lanes):
            arrays = LaneArrays(library, len(lanes))
        arrays.take(lanes, entries[part])
        s = np.zeros((len(lanes), library.nodes))
        s[:, -1] = arclengths[part]  # only the tip carries a magnet
        arrays.write(lanes, s, None, commands[part])
        arrays.refresh(lanes)
        out[part] = arrays.result(a1.DRIVE)
    return out


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

    arclengths : (n,) m
    direction : +1 for the greatest forward drive, −1 for the greatest backward

    Returns the commands (n, dof), rad for turns (within π of home) and m for slides, and the drives (n,) N.
    A coarse grid over all degrees of freedom, then a shrinking pattern search: within 1e-4 of the range.
    """
    arclengths = np.asarray(arclengths, dtype=np.float64)
    library = Library([scenario])
    sign = 1.0 if direction >= 0 else -1.0
    low, high = command_range(scenario)
    n, dof = len(arclengths), len(low)
    per_axis = max(3, min(72, int(_GRID_POINTS ** (1 / dof))))
    is_slide = [not isinstance(d, Turn) for d in scenario.rig.dofs]
    axes = [np.linspace(a, b, per_axis, endpoint=slide) for a, b, slide in zip(low, high, is_slide, strict=True)]
    grid = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    best, force = np.empty((n, dof)), np.empty(n)
    for i in range(0, n, max(1, 2_000_000 // len(grid))):
        rows = slice(i, i + max(1, 2_000_000 // len(grid)))
        places = arclengths[rows]
        drive = sign * drive_over(library, np.tile(grid, (len(places), 1)), np.repeat(places, len(grid)))
        drive = drive.reshape(len(places), len(grid))
        best[rows], force[rows] = grid[drive.argmax(axis=1)], drive.max(axis=1)
    step = np.array([a[1] - a[0] for a in axes])
    moves = np.array([m for m in itertools.product((-1.0, 0.0, 1.0), repeat=dof) if any(m)] if dof <= 3 else
                     np.vstack([np.eye(dof), -np.eye(dof)]))  # fmt: skip
    for _ in range(14):
        step = step / 2
        tried = best[:, None, :] + moves * step
        tried = np.where(is_slide, np.clip(tried, low, high), tried)
        drive = sign * drive_over(library, tried.reshape(-1, dof), np.repeat(arclengths, len(moves)))
        drive = drive.reshape(n, len(moves))
        better = drive.max(axis=1) > force
        best[better] = tried[better, drive.argmax(axis=1)[better]]
        force = np.maximum(force, drive.max(axis=1))
    return best, sign * force


def command_range(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """The command's range, (dof,) lowest and highest: home ± π for turns, the limits for slides."""
    dofs = scenario.rig.dofs
    low = [d.home - np.pi if isinstance(d, Turn) else d.low for d in dofs]
    high = [d.home + np.pi if isinstance(d, Turn) else d.high for d in dofs]
    return np.array(low), np.array(high)
