"""The running episodes of a batch: what the env remembers of each lane between control steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..simulation import Places, Simulator
from ..simulation.readout import ROW
from . import kernels
from .kernels import EPISODE
from .observation import REFERENCE_OFFSETS
from .task import Task

if TYPE_CHECKING:
    from .shapes import Shapes

__all__ = ["Episodes"]


class Episodes:
    """Lanes' episodes.

    lanes : (fields, lanes), see `kernels.Episode`
    reference : (n, steps) m, the moving goal of a tracking task at every control step; (n, 0) otherwise
    final : (n,) m, where a task that comes back ends; NaN otherwise
    shapes : what a task of shapes wants; None in others
    turned : (n, dof), how far the rig moved in the last control period, over what its servos cover in one
    """

    def __init__(self, sim: Simulator, task: Task, step_limit: int) -> None:
        self._sim, self.task, self.step_limit = sim, task, step_limit
        self.lanes = np.ones((len(EPISODE), sim.rig.lanes))
        self._wall_limit = np.array([sc.contact.wall_force_limit for sc in sim.library.scenarios])
        ahead = round(max(REFERENCE_OFFSETS) / sim.control_period)
        self.reference = np.zeros((sim.num_envs, step_limit + ahead + 1 if task.kind.follows else 0))
        self.final = np.full(sim.num_envs, np.nan)
        self.turned = np.zeros((sim.num_envs, sim.dof))
        self.shapes: Shapes | None = None

    @property
    def steps(self) -> np.ndarray:
        """(n,) control steps so far."""
        return self.lanes[EPISODE.steps, : self._sim.num_envs].astype(np.int64)

    def begin(self, lanes: np.ndarray, reference: np.ndarray | None, final: np.ndarray | None = None) -> None:
        """New episodes in `lanes` (n,), just laid out.

        reference : (n, steps) m, a tracking task's moving goal
        final : (n,) m, where a task that comes back ends
        """
        sim, task = self._sim, self.task
        entries = sim.lane_scenario[lanes]
        remaining = sim.readout[ROW.remaining, lanes]
        own = np.zeros((len(EPISODE), len(lanes)))
        own[EPISODE.sense] = 1.0
        if final is not None:
            own[EPISODE.after] = np.abs(sim.goals(lanes).s - final)
            self.final[lanes] = final
        own[EPISODE.distance] = (remaining if task.kind.passes else np.abs(remaining)) + own[EPISODE.after]
        own[EPISODE.start_distance] = task.tolerance if task.kind.follows else own[EPISODE.distance]
        own[EPISODE.wall_limit] = self._wall_limit[entries]
        own[EPISODE.route_length] = sim.model.route_length(lanes)
        own[EPISODE.far] = own[EPISODE.route_length] if task.kind.ends_far else np.inf
        self.lanes[:, lanes] = own
        self.turned[lanes] = 0.0
        if reference is not None:
            self.reference[lanes] = reference

    def move_goals(self) -> None:
        """Before a control period: the goals go to where the references are at its end."""
        lanes = np.arange(self._sim.num_envs)
        now = np.minimum(self.steps + 1, self.reference.shape[1] - 1)
        self._sim.set_goal(lanes, Places(self.reference[lanes, now]))

    def turn_back(self, turned: np.ndarray) -> None:
        """After a control period: the lanes in which `turned` (n,) is 1 have passed their goal, and now go back."""
        lanes, sim = turned.nonzero()[0], self._sim
        if len(lanes):
            behind = np.abs(sim.goals(lanes).s - self.final[lanes])
            kernels.turn_back(lanes, sim.trace, sim.control_period, behind, self.lanes)
            sim.set_goal(lanes, Places(self.final[lanes]))
            sim.readout[ROW.remaining, lanes] = self.final[lanes] - sim.readout[ROW.travelled, lanes]

    def reference_ahead(self, offsets: np.ndarray) -> np.ndarray:
        """A tracking task's reference `offsets` s from now, (n, len(offsets)) m; past its end it stands still."""
        if not self.task.kind.follows:
            raise ValueError(f"only a tracking task has a reference, got the task {self.task.id}")
        steps = np.round(np.asarray(offsets) / self._sim.control_period).astype(np.int64)
        at = np.minimum(self.steps[:, None] + steps, self.reference.shape[1] - 1)
        return self.reference[np.arange(self._sim.num_envs)[:, None], at]
