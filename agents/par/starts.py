"""Episodes to be planned: where they begin and what they are for; plans as actions and as commands."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from magwire_env.envs.core import SteeringCore
from magwire_env.envs.task import Task
from magwire_env.scenario.rig import wrapped
from magwire_env.simulation import Library

__all__ = ["Starts", "actions_of", "commands_of"]


@dataclass(frozen=True, eq=False)
class Starts:
    """Where n episodes begin and what they are for.

    library, entries : scenarios, and each episode's number in them (n,)
    tip, magnet : (n,) m and (n, dof) rad or m, of a wire at rest behind its tip
    goal : (n,) m
    final : (n,) m, where a task that comes back ends; NaN in any other
    reference : (n, step_limit + 1 or more) m in a tracking task, else (n, 0)
    step_limit : control periods that an episode lasts at most
    """

    task: Task
    library: Library
    entries: np.ndarray
    tip: np.ndarray
    magnet: np.ndarray
    goal: np.ndarray
    final: np.ndarray
    reference: np.ndarray
    step_limit: int

    @classmethod
    def of(cls, core: SteeringCore, lanes: np.ndarray) -> Starts:
        """The episodes that have just begun in a core's lanes (n,)."""
        sim = core.sim
        return cls(
            core.task, sim.library, sim.lane_scenario[lanes], sim.tip_arclength[lanes], sim.magnet[lanes],
            core.goal[lanes], core.episodes.final[lanes], core.episodes.reference[lanes], core.step_limit,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, rows: np.ndarray) -> Starts:
        own = {k: getattr(self, k)[rows] for k in ("entries", "tip", "magnet", "goal", "final", "reference")}
        return replace(self, **own)

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.library.control_period

    @property
    def one_turn(self) -> bool:
        """The rig has a single degree of freedom, a turn."""
        return self.library.is_turn.tolist() == [True]


def actions_of(library: Library, entries: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Commands (n, …, dof) rad and m as single-precision actions of the mode "angle"; turns about home.

    A plan is kept as actions because these are what the env gets. Where a place does not hold the wire, a rounding
    error of a command grows tenfold every few seconds.
    """
    low, high = _limits(library, entries, commands.ndim)
    gap = commands - 0.5 * (low + high)
    gap = wrapped(gap, library.is_turn)
    return np.clip(gap / (0.5 * (high - low)), -1.0, 1.0).astype(np.float32)


def commands_of(library: Library, entries: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """The commands (n, …, dof) of actions; `actions_of` gives back exactly the same actions."""
    low, high = _limits(library, entries, actions.ndim)
    return low + 0.5 * (actions.astype(np.float64) + 1.0) * (high - low)


def _limits(library: Library, entries: np.ndarray, ndim: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest setting of every degree of freedom, shaped to broadcast over arrays of `ndim` axes."""
    shape = (len(entries), *[1] * (ndim - 2), library.dof)
    return library.limits.low[entries].reshape(shape), library.limits.high[entries].reshape(shape)
