"""Reaching as a goal env, for hindsight experience replay."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from .env import MagWireEnv
from .spec import SpecWithLimit
from .task import Task

__all__ = ["GoalReward", "MagWireGoalEnv"]


class MagWireGoalEnv(SpecWithLimit, gym.Env[dict[str, np.ndarray], np.ndarray]):  # type: ignore[misc]
    """`MagWire/Reach-v0` with `observation`, `achieved_goal` and `desired_goal` (arc length / tract length, (1,) each).

    The reward is sparse, 0 within the task's tolerance of the target and −1 elsewhere, and `compute_reward` gives it
    for any goals, batched, as Gymnasium-Robotics' goal envs do. Episodes end as Reach's. Arguments as `MagWireEnv`'s,
    but for `reward`.

    ## Version History
    * v0: first
    """

    metadata: dict[str, Any] = MagWireEnv.metadata

    def __init__(self, task: str | Task = "MagWire/Reach-v0", render_mode: str | None = None, **settings: Any) -> None:
        self._env = MagWireEnv(task, render_mode, **settings)
        self.core = self._env.core
        if not self.core.task.kind.holds:
            raise ValueError(f"task must be one whose target is held for a goal env, got {self.core.task.id}")
        if self.core.shown.fluoroscope is not None:
            raise ValueError(
                "observe must name channels of numbers alone for a goal env, whose observation is a dict already; "
                "gym.make('MagWire/Reach-v0', observe='fluoroscopy') shows an image"
            )
        self.render_mode = render_mode
        self.action_space = self._env.action_space
        place = gym.spaces.Box(-2.0, 2.0, (1,), dtype=np.float64)
        spaces = {"observation": self._env.observation_space, "achieved_goal": place, "desired_goal": place}
        self.observation_space = gym.spaces.Dict(spaces)  # type: ignore[assignment]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """As `MagWireEnv.reset`."""
        super().reset(seed=seed)
        observation, info = self._env.reset(seed=seed, options=options)
        return self._goals(observation), info

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """As `MagWireEnv.step`, with the goal env's own reward."""
        observation, _, terminated, truncated, info = self._env.step(action)
        goals = self._goals(observation)
        reward = float(self.compute_reward(goals["achieved_goal"], goals["desired_goal"], info))
        return goals, reward, terminated, truncated, info

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray:
        """Goals (..., 1) → rewards (...): 0 within the tolerance, −1 elsewhere."""
        tolerance = self.core.task.tolerance / self._length
        return -(np.abs(np.asarray(achieved_goal) - desired_goal)[..., 0] > tolerance).astype(np.float64)

    def render(self) -> Any:
        """As `MagWireEnv.render`."""
        return self._env.render()

    def close(self) -> None:
        """As `MagWireEnv.close`."""
        self._env.close()

    @property
    def _length(self) -> float:
        return float(self.core.sim.route_length[0])

    def _goals(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        achieved = self.core.sim.tip_arclength / self._length
        desired = self.core.goal.copy() / self._length
        return {"observation": observation, "achieved_goal": achieved, "desired_goal": desired}


class GoalReward(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """What `gym.make("MagWire/ReachGoal-v0")` wraps around all; `compute_reward` is not passed on by other wrappers."""

    def __init__(self, env: gym.Env) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray:
        """As `MagWireGoalEnv.compute_reward`."""
        return self.unwrapped.compute_reward(achieved_goal, desired_goal, info)  # type: ignore[attr-defined]
