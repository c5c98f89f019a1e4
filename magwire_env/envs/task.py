"""What a task fixes: scenario, start, goal, time limit, reward. One table, one row an id."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..physics.checks import non_negative, positive
from ..scenario import Scenario

__all__ = ["TASKS", "RewardWeights", "Task"]


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward's terms, every one echoed in `info` as ``reward/…``.

    progress : for the whole way from the start to the goal, paid as it is covered (potential-based)
    success : once, on reaching the goal
    time : cost of each control step
    wall : cost of each control step for each newton of wall force above the scenario's limit
    """

    progress: float = 10.0
    success: float = 10.0
    time: float = 0.1
    wall: float = 0.5

    def __post_init__(self) -> None:
        for name in ("progress", "success", "time", "wall"):
            object.__setattr__(self, name, non_negative(f"RewardWeights.{name}", getattr(self, name)))


@dataclass(frozen=True)
class Task:
    """A task.

    scenario : makes the default scenario
    start_spread : m; an episode starts with the tip at the wire's length plus or minus this, uniform
    goal_margin : m; the goal lies this far before the end of the tract
    time_limit : s
    """

    id: str
    scenario: Callable[[], Scenario]
    start_spread: float = 0.02
    goal_margin: float = 0.01
    time_limit: float = 30.0

    def __post_init__(self) -> None:
        positive("time_limit", self.time_limit, "s")


TASKS = {
    task.id: task
    for task in (
        Task("MagWire/Steer-v0", Scenario.paper),
    )
}  # fmt: skip
