"""What every controller is: built from an env, asked like an SB3 policy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from magwire_env.envs.core import SteeringCore
from magwire_env.scenario import Scenario

from ..observations import numbers, rows

__all__ = ["Controller", "Memory"]

Memory = tuple[np.ndarray, ...] | None
"""What a controller remembers from step to step: arrays with one row a lane."""


class Controller(ABC):
    """A policy for one env or batch. It takes its model, action mode and observation layout from this env.

    A subclass implements `act`; `agents.catalogue.register_controller` then gives it a name for the commands.
    """

    sees_nothing: ClassVar[bool] = False
    """It does not use the observation: a floor to compare with."""

    plans_online: ClassVar[bool] = False
    """It runs the simulator for every decision, so that the time of a decision matters."""

    def __init__(self, env: gym.Env | gym.vector.VectorEnv, **settings: Any) -> None:
        core = getattr(env.unwrapped, "core", None)
        if not isinstance(core, SteeringCore):
            raise ValueError(f"env must be a MagWire env or batch, got {env!r}")
        if reason := self.refusal(core.sim.scenarios[0]):
            raise ValueError(reason)
        self.core = core

    @classmethod
    def refusal(cls, scenario: Scenario) -> str:
        """Why the controller cannot serve an env with such a scenario, as the text of a `ValueError`; "" if it can."""
        return ""

    @classmethod
    def from_env(cls, env: gym.Env | gym.vector.VectorEnv, **settings: Any) -> Controller:
        """The controller for `env`; `settings` are the arguments of its constructor."""
        return cls(env, **settings)

    def predict(
        self,
        observation: Any,
        state: Memory = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Memory]:
        """SB3's form: observation (size,) or (n, size) → action (k,) or (n, k), and the controller's memory.

        An image in the observation is not looked at.

        episode_start : (n,) true where an episode has just begun; the memory starts afresh there
        """
        batch, many = rows(observation)
        seen = numbers(batch)
        starts = np.zeros(len(seen), dtype=np.bool_) if episode_start is None else np.atleast_1d(episode_start)
        action, state = self.act(seen, state, starts, deterministic)
        return (action if many else action[0]), state

    @abstractmethod
    def act(
        self, observation: np.ndarray, state: Memory, starts: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Memory]:
        """`predict` for a batch (n, size), with `starts` (n,)."""

    def seen(self, observation: np.ndarray, channel: str) -> np.ndarray:
        """One channel of the observation, (n, its size), as scaled by the env; `ValueError` if it is not observed."""
        return observation[:, self.core.observer.part(channel)]

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Speed, lowest and highest setting of every degree of freedom, (n, dof) each; a turn's are home ± π."""
        sim = self.core.sim
        return sim.library.limits.of(sim.lane_scenario)
