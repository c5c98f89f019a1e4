"""What `reset(options=…)` sets in place of what is drawn, and its checks; trees and shapes have more of their own."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..simulation import Places, Simulator
from ..simulation.simulator import FARTHEST_SETTING
from .task import Task

__all__ = ["OPTIONS", "check_names", "rig_option", "tract_options"]

OPTIONS = ("tip_arclength", "target", "magnet_angle")
"""What `reset(options=…)` takes: m, m, and rad (for slides m), each one number or one a lane."""


def check_names(options: dict[str, Any], task: Task) -> None:
    """Raise `ValueError` for an option that does not exist, or that the task fixes."""
    kind = task.kind
    known = kind.takes if kind.navigates else OPTIONS
    if unknown := set(options) - set(known):
        raise ValueError(f"options must be of {', '.join(known)}; got {min(unknown)!r}")
    if not set(options) <= set(kind.takes):
        raise ValueError(
            f"options must be of {', '.join(kind.takes)} alone in the task {task.id}, which fixes the rest"
        )


def rig_option(options: dict[str, Any], sim: Simulator, lanes: np.ndarray, magnet: np.ndarray) -> np.ndarray:
    """Settings of the rig at the start of episodes in `lanes` (n,): those of the option, or `magnet` (n, dof).

    Raises `ValueError` for settings that are no numbers of the rig's, or too large.
    """
    if "magnet_angle" not in options:
        return magnet
    given = options["magnet_angle"]
    magnet = _per_lane("magnet_angle", given, sim.num_envs, (sim.dof,), "rad for turns, m for slides")[lanes]
    if np.abs(magnet).max() > FARTHEST_SETTING:
        raise ValueError(
            f"options['magnet_angle'] must lie within ±{FARTHEST_SETTING:g} (rad for turns, m for slides), "
            f"got {given!r}"
        )
    return magnet


def tract_options(
    options: dict[str, Any],
    task: Task,
    sim: Simulator,
    lanes: np.ndarray,
    entries: np.ndarray,
    start: Places,
    goal: Places,
) -> tuple[Places, Places]:
    """Starts and goals on tracts, of episodes in `lanes` (n,) with scenarios `entries` (n,), with those of the options.

    Raises `ValueError` for a target off the tract, and a start off it, at the target, or beyond a target to be passed.
    """
    kind, n = task.kind, sim.num_envs
    end = sim.library.tract_length[entries]
    tip, target = start.s, goal.s
    if "target" in options:
        target = _per_lane("target", options["target"], n, (), "m")[lanes]
        if (target <= 0).any() or (target > end).any():
            raise ValueError(f"options['target'] must lie in (0, {end.min():.4g}] (in m), got {options['target']!r}")
    if "tip_arclength" in options:
        tip = _per_lane("tip_arclength", options["tip_arclength"], n, (), "m")[lanes]
    limit = target if kind.passes else end
    if (tip < 0).any() or (tip >= limit).any() or ((tip == target).any() and not kind.follows):
        raise ValueError(
            f"options['tip_arclength'] must lie in [0, {'target' if kind.passes else 'tract end'}) "
            f"with the target at {target.min():.4g} (in m), got {tip.tolist()}"
        )
    return Places(tip, start.branch), Places(target, goal.branch)


def _per_lane(name: str, value: Any, n: int, shape: tuple[int, ...], unit: str) -> np.ndarray:
    """One value for all lanes or one a lane → (n, *shape)."""
    try:
        array = np.asarray(value, dtype=np.float64)
        if shape and array.shape == (n,) and shape == (1,):
            array = array[:, None]
        array = np.broadcast_to(array, (n, *shape))
    except (TypeError, ValueError):
        raise ValueError(f"options[{name!r}] must be one number or {n} of them (in {unit}), got {value!r}") from None
    if not np.isfinite(array).all():
        raise ValueError(f"options[{name!r}] must be finite (in {unit}), got {value!r}")
    return array
