"""Held commands: what is reached by turning the magnets once and then doing nothing. Two floors and an oracle.

A task that they pass does not ask for steering.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.quasistatic.held import held_commands

from ..controllers.base import Controller, Memory
from .starts import Starts, actions_of
from .trials import Trials

__all__ = ["BestConstant", "BestConstantEach", "HoldHome"]


class HoldHome(Controller):
    """Holds every magnet at home: the action 0. Knows: nothing."""

    sees_nothing = True

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        sim = self.core.sim
        return self.core.actuation.action(sim.library.home[sim.lane_scenario]), state


class _Held(Controller):
    """Holds one of `held_commands`, which it chooses when a batch of episodes begins, by trying all of them."""

    sees_nothing = True
    each: bool

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, **settings: Any) -> None:
        super().__init__(env, **settings)
        self._shares = held_commands(self.core.sim.library.is_turn)
        self._chosen: np.ndarray | None = None

    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        sim = self.core.sim
        if self._chosen is None or not self.core.steps.any():
            self._chosen = self._best(Starts.of(self.core, np.arange(sim.num_envs)))
        _, low, high = self.limits
        command = low + self._shares[self._chosen] * (high - low)
        return self.core.actuation.action(command), state

    def _best(self, starts: Starts) -> np.ndarray:
        """The number of the held command for every start, (n,)."""
        if self.core.shapes:
            return self._of_shapes(self.core.shapes.held(self._shares), starts.task.tolerance)
        n, trials = len(starts), Trials(starts)
        low, high = starts.library.limits.low[starts.entries], starts.library.limits.high[starts.entries]
        value, success = np.empty((len(self._shares), n)), np.empty((len(self._shares), n), dtype=np.bool_)
        for k, share in enumerate(self._shares):
            action = actions_of(starts.library, starts.entries, (low + share * (high - low))[:, None])
            found = trials.run(np.arange(n), np.repeat(action, starts.step_limit, axis=1))
            value[k], success[k] = found.value, np.isfinite(found.time)
        if starts.task.kind.follows:  # a tracking task succeeds by its error
            success = value <= starts.task.tolerance
        return self._chosen_by(value, success)

    def _of_shapes(self, value: np.ndarray, tolerance: float) -> np.ndarray:
        """As `_best`, of a task of shapes: values (k, n) m are how far off wires come to rest."""
        return self._chosen_by(value, value <= tolerance)

    def _chosen_by(self, value: np.ndarray, success: np.ndarray) -> np.ndarray:
        if self.each:
            return np.where(success, value, np.inf).argmin(axis=0) if success.any() else value.argmin(axis=0)
        order = np.lexsort((np.median(value, axis=1), -success.sum(axis=1)))
        return np.full(value.shape[1], order[0])


class BestConstant(_Held):
    """Holds one command in all episodes: of `held_commands` the one that succeeds most often in these very episodes.

    Knows: nothing while it holds; the choice is an oracle's.
    """

    each = False


class BestConstantEach(_Held):
    """Holds in each episode the command, of `held_commands`, that is best in this very episode.

    Knows: nothing while it holds; the choice is an oracle's. Its success says how many episodes need no steering.
    """

    each = True
