"""magwire_env: steering a magnetically actuated guidewire, as a Gymnasium environment.

Importing it registers the environment ids and loads nothing heavy; `Scenario` and `Simulator` load on first use.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import gymnasium as gym
from gymnasium.envs.registration import WrapperSpec

if TYPE_CHECKING:
    from .scenario import Scenario
    from .simulation import Simulator

__all__ = ["Scenario", "Simulator"]

try:
    __version__ = version("magwire-env")
except PackageNotFoundError:  # a source tree on the path, not installed
    __version__ = "0+source"

TASK_IDS = (
    *(f"MagWire/{name}-v0" for name in ("Steer", "Reach", "Track", "SteerAny", "Orient", "Chase", "Dual")),
    *(f"MagWire/{name}-v1" for name in ("Steer", "Reach", "Track", "SteerAny", "Hard", "Orient", "Chase", "Dual")),
    "MagWire/SteerFree-v0",
    "MagWire/Shape-v0",
    *(f"MagWire/{name}-v0" for name in ("Navigate", "NavigateAny", "Recover", "Gentle", "Uniform")),
)
"""The tasks of `envs.task.TASKS`, spelt out here so that importing this package loads nothing heavy."""

for _id in TASK_IDS:
    gym.register(
        id=_id,
        entry_point="magwire_env.envs.pages:make",
        vector_entry_point="magwire_env.envs.vector_env:MagWireVectorEnv",
        kwargs={"task": _id},
    )

gym.register(
    id="MagWire/ReachGoal-v0",
    entry_point="magwire_env.envs.goal_env:MagWireGoalEnv",
    kwargs={"task": "MagWire/Reach-v0"},
    additional_wrappers=(WrapperSpec("GoalReward", "magwire_env.envs.goal_env:GoalReward", kwargs={}),),
)


def __getattr__(name: str) -> Any:
    if name == "Scenario":
        from .scenario import Scenario

        return Scenario
    if name == "Simulator":
        from .simulation import Simulator

        return Simulator
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
