"""What a task fixes: scenario, start, goal, time limit, reward. One table, one row an id."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..physics.checks import non_negative, one_of, positive
from ..scenario import Scenario
from .observation import DEFAULT

__all__ = ["KINDS", "TASKS", "RewardWeights", "Task"]

KINDS = ("steer", "reach", "track")
"""Drive the tip to the end; to a target either way, and hold it there; along a moving reference."""


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward's terms, every one echoed in `info` as ``reward/…``.

    progress : for the whole way from the start to the goal, paid as it is covered (potential-based); in a tracking
        task for each tolerance by which the distance shrinks
    success : once, on reaching the goal
    time : cost of each control step; in a tracking task of each step and tolerance of distance. An end without success
        before the time limit pays for the steps that were left too, so that giving up never pays
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

    kind : of `KINDS`
    scenario : makes the default scenario; or
    pool : the kind of certified scenarios, see `magwire_env.quasistatic.pool`, that every episode draws one from
    start_spread : m; a steering episode starts with the tip at the wire's length plus or minus this, uniform
    goal_margin : m; no goal lies nearer than this to the end of the tract
    tolerance : m; a target is held within it, and tracking succeeds with an RMS error below it
    hold : s; for so long a target must be held
    reference_speed : m/s at most, of a tracking task's reference
    time_limit : s
    observe : default observation channels
    """

    id: str
    kind: str = "steer"
    scenario: Callable[[], Scenario] | None = None
    pool: str | None = None
    start_spread: float = 0.02
    goal_margin: float = 0.01
    tolerance: float = 5e-3
    hold: float = 1.0
    reference_speed: float = 0.03
    time_limit: float = 30.0
    observe: tuple[str, ...] = DEFAULT

    def __post_init__(self) -> None:
        one_of("Task.kind", self.kind, KINDS)
        positive("Task.time_limit", self.time_limit, "s")
        if (self.scenario is None) == (self.pool is None):
            raise ValueError(f"Task must have either a scenario or a pool, got {self.scenario} and {self.pool}")


_AHEAD = (*DEFAULT, "tract_preview")

TASKS = {
    task.id: task
    for task in (
        Task("MagWire/Steer-v0", "steer", Scenario.paper),
        Task("MagWire/Reach-v0", "reach", Scenario.paper),
        Task("MagWire/Track-v0", "track", Scenario.paper, observe=(*DEFAULT, "reference_preview")),
        Task("MagWire/SteerAny-v0", "steer", pool="SteerAny", time_limit=60.0, observe=_AHEAD),
        Task("MagWire/Orient-v0", "steer", pool="Orient", time_limit=60.0, observe=_AHEAD),
        Task("MagWire/Chase-v0", "steer", pool="Chase", time_limit=60.0, observe=_AHEAD),
        Task("MagWire/Dual-v0", "steer", pool="Dual", time_limit=60.0, observe=_AHEAD),
    )
}
