"""The par as a controller: it plans an episode before it begins, and replays the plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from ..controllers.base import Controller, Memory
from .cache import Cache
from .planner import Plans, best_plans
from .refinement import Refinement
from .starts import Starts, commands_of

__all__ = ["Optimal"]


class Optimal(Controller):
    """Plans whole episodes from their starts, in the simulator, and replays the plans. Its time is the par.

    Knows: everything: the model as the scenario has it, the true state, the whole reference of a tracking task. It does
    not know what `Variation` draws, nor the limit that ends an episode under `safety`.

    settings : of the refinement, see `Refinement`
    cache : folder of plans made before; by default ``$MAGWIRE_CACHE/par`` or ``~/.cache/magwire/par``, False for none
    again : also plan the episodes that a batch begins by itself after a lane's first one (next-step autoreset). By
        default the magnets rest in these episodes, because each would be planned alone while the other lanes still run
    """

    env_kwargs: ClassVar[dict[str, Any]] = {"action_mode": "angle"}
    """Evaluations play it so: its plans are angles and places, which replay to the last bit. As rates they are rounded,
    and a tip that balances where no angle holds it falls off a long plan."""

    def __init__(
        self,
        env: gym.Env | gym.vector.VectorEnv,
        settings: Refinement | None = None,
        cache: str | Path | bool | None = None,
        again: bool = False,
        **others: Any,
    ) -> None:
        super().__init__(env, **others)
        if settings is not None and not isinstance(settings, Refinement):
            raise ValueError(f"settings must be a Refinement or None, got {settings!r}")
        if cache is True or not (cache is None or isinstance(cache, (str, Path, bool))):
            raise ValueError(f"cache must be a folder, None for the user's, or False for none, got {cache!r}")
        self.settings = Refinement() if settings is None else settings
        self._cache = None if cache is False else Cache(cache)  # type: ignore[arg-type]
        self.again = again
        n, core = self.core.sim.num_envs, self.core
        self._actions = np.zeros((n, core.step_limit, core.sim.dof), dtype=np.float32)
        self._start = np.full((n, 2 + core.sim.dof + core.episodes.reference.shape[1]), np.nan)
        self._entry, self._ended = np.full(n, -1), np.zeros(n, dtype=np.bool_)
        self.time = np.full(n, np.nan)
        """(n,) s, duration of the lanes' plans, in a tracking task their RMS error in m; NaN without success."""

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        core, sim = self.core, self.core.sim
        steps, lanes = core.steps.astype(np.int64), np.arange(core.sim.num_envs)
        self._ended |= starts & (steps > 0)
        if not steps.any():
            self._ended[:] = False
        self._plan(lanes[(steps == 0) & (self.again | ~self._ended)])
        resting = self._ended & ~(self.again & (steps == 0))
        if self.again:
            self._ended &= steps > 0
        planned = self._actions[lanes, np.minimum(steps, core.step_limit - 1)]
        rest = core.actuation.action(sim.magnet)
        if core.actuation.mode != "angle":
            planned = core.actuation.action(commands_of(sim.library, sim.lane_scenario, planned))
        return np.where(resting[:, None], rest, planned), state

    def _plan(self, lanes: np.ndarray) -> None:
        """Plan the episodes that begin in `lanes`, except those that already have a plan."""
        if not len(lanes):
            return
        new = Starts.of(self.core, lanes)
        key = np.column_stack([new.tip, new.magnet, new.goal, new.reference])
        other = (key != self._start[lanes]).any(axis=1) | (new.entries != self._entry[lanes])
        if not other.any():
            return
        lanes, new = lanes[other], new[other]
        plans: Plans = best_plans(new, self.settings, self._cache)
        self._actions[lanes], self.time[lanes] = plans.actions, plans.time
        self._start[lanes], self._entry[lanes] = key[other], new.entries
