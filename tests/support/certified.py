"""Commands on pages: the scenario that one plays must be one in which its task can be done."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import gymnasium as gym

from magwire_env import Scenario

__all__ = ["check_certified"]

BEGINNERS = "MagWire/Steer-v1"
"""The task of a command that names none."""


def check_certified(arguments: Sequence[str]) -> None:
    """Fail if a command that a page shows plays a scenario of its own in which its task cannot be done."""
    if "--scenario" not in arguments:
        return
    task = arguments[arguments.index("--task") + 1] if "--task" in arguments else BEGINNERS
    scenario = Scenario.load(arguments[arguments.index("--scenario") + 1])
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*has no certificate")
        gym.make(task, scenario=scenario, disable_env_checker=True)
