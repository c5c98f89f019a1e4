"""Gymnasium's `spec` of an env that ends its episodes by itself."""

from __future__ import annotations

import copy

from gymnasium.envs.registration import EnvSpec

from .core import SteeringCore

__all__ = ["SpecWithLimit"]


class SpecWithLimit:
    """For envs with a core: `spec.max_episode_steps` is the number of steps after which the env truncates by itself.

    The ids are registered without such a number. With one, `gym.make` would wrap a `TimeLimit` around every env, which
    knows nothing of `time_limit=` or of the scenario's control period and would cut their episodes short.
    """

    core: SteeringCore
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """As Gymnasium sets it, with the limit filled in."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = copy.copy(spec)
            spec.max_episode_steps = self.max_episode_steps
        self._spec = spec

    @property
    def max_episode_steps(self) -> int:
        """Control steps of an episode at most."""
        return self.core.step_limit
