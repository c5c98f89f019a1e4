"""What a task fixes: scenario, start, goal, time limit, reward. One table, one row an id."""

from __future__ import annotations

import difflib
import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass

from ..physics.checks import positive
from ..quasistatic.certificate import GOAL_MARGIN, START_SPREAD
from ..scenario import Scenario
from . import arenas
from .kinds import KINDS, Kind
from .navigation import Gentle, Navigate, Recover
from .rewards import RewardWeights
from .shapes import Shape
from .trees import TREES

__all__ = ["DEFAULT_CHANNELS", "TASKS", "RewardWeights", "Task", "known_task", "register_task"]

DEFAULT_CHANNELS = ("tip_arclength", "tip_speed", "drive_force", "lateral_force", "magnet", "distance_left")
"""What a policy sees where a task says nothing else."""


@dataclass(frozen=True)
class Task:
    """A task.

    kind : a `Kind`, or the name of one of `KINDS`
    scenario : makes the default scenario; or
    pool : the kind of certified scenarios, see `magwire_env.envs.pools`, that every episode draws one from
    start_spread : m; a steering episode starts with the tip at the wire's length plus or minus this, uniform
    goal_margin : m; no goal lies nearer than this to the end of the tract
    tolerance : m; a target is held within it, and tracking succeeds with an RMS error below it
    hold : s; for so long a target must be held
    reference_speed : m/s at most, of a tracking task's reference
    time_limit : s
    observe : default observation channels
    action_mode : the default
    """

    id: str
    kind: Kind = KINDS["steer"]
    scenario: Callable[[], Scenario] | None = None
    pool: str | None = None
    start_spread: float = START_SPREAD
    goal_margin: float = GOAL_MARGIN
    tolerance: float = 5e-3
    hold: float = 1.0
    reference_speed: float = 0.03
    time_limit: float = 30.0
    observe: tuple[str, ...] = DEFAULT_CHANNELS
    action_mode: str = "angle"

    def __post_init__(self) -> None:
        if isinstance(self.kind, str) and self.kind in KINDS:
            object.__setattr__(self, "kind", KINDS[self.kind])
        if not isinstance(self.kind, Kind):
            raise ValueError(f"Task.kind must be a Kind or one of {', '.join(map(repr, KINDS))}, got {self.kind!r}")
        positive("Task.time_limit", self.time_limit, "s")
        if (self.scenario is None) == (self.pool is None):
            raise ValueError(f"Task must have either a scenario or a pool, got {self.scenario} and {self.pool}")

    def hold_periods(self, control_period: float) -> int:
        """Whole control periods for which a target must be held: half a period of slack, so that their sum need not be
        exact."""
        return max(1, math.ceil(self.hold / control_period - 0.5 - 1e-9))


_AHEAD = (*DEFAULT_CHANNELS, "tract_preview")
_SIGHT = (*DEFAULT_CHANNELS[1:], "magnet_preview")
"""Where on which tract the tip is, a policy is not told: it would learn its training tracts by heart."""

_STEER, _IN_AND_OUT, _REACH, _TRACK, _REACH_STANDING, _TRACK_STANDING = KINDS.values()

_TURNING_ROOM = 0.09
"""The far goal of Steer-v1 lies this far before the tract's end, m: a tip that arrives at full speed coasts up to 50 mm
while the magnet turns round. With the goal 10 mm before the end it coasts out of the tract, where the magnet's pull is
weak, and `MaxForce`, `NetForce` and `PD` never come back (0 of 20 episodes each)."""

_TREE = (
    "route_from_magnet", "tip_tangent", "magnet_pose", "tip_points", "contact", "base", "astray", "distance_left",
)  # fmt: skip
"""What a policy of a navigating task sees where the task says nothing else."""

TASKS = {
    task.id: task
    for task in (
        Task("MagWire/Steer-v0", _STEER, Scenario.paper),
        Task("MagWire/Reach-v0", _REACH, Scenario.paper),
        Task("MagWire/Track-v0", _TRACK, Scenario.paper, observe=(*DEFAULT_CHANNELS, "reference_preview")),
        Task("MagWire/SteerAny-v0", _STEER, pool="SteerAny", time_limit=60.0, observe=_AHEAD),
        Task("MagWire/Orient-v0", _STEER, pool="Orient", time_limit=60.0, observe=_AHEAD),
        Task("MagWire/Chase-v0", _STEER, pool="Chase", time_limit=60.0, observe=_AHEAD),
        Task("MagWire/Dual-v0", _STEER, pool="Dual", time_limit=60.0, observe=_AHEAD),
        Task(
            "MagWire/Steer-v1",
            _IN_AND_OUT,
            Scenario.paper,
            goal_margin=_TURNING_ROOM,
            action_mode="direction",
        ),
        Task(
            "MagWire/Reach-v1",
            _REACH_STANDING,
            Scenario.paper,
            hold=2.0,
            observe=(*DEFAULT_CHANNELS, "goal_close"),
            action_mode="rate",
        ),
        Task(
            "MagWire/Track-v1",
            _TRACK_STANDING,
            Scenario.paper,
            observe=(*DEFAULT_CHANNELS, "reference_preview"),
            action_mode="rate",
        ),
        *(
            Task(f"MagWire/{name}-v1", _STEER, pool=pool, time_limit=limit, observe=_SIGHT, action_mode="rate")
            for name, pool, limit in (
                ("SteerAny", "SteerAny-v1", 20.0),  # in 25 s random commands cross 11 % of its tracts, in 60 s 18 %
                ("Hard", "Hard-v1", 30.0),
                ("Orient", "Orient", 60.0),
                ("Chase", "Chase", 60.0),
                ("Dual", "Dual", 60.0),
            )
        ),
        Task("MagWire/SteerFree-v0", _STEER, arenas.dragged, action_mode="rate"),
        Task(
            "MagWire/Shape-v0",
            Shape(),
            arenas.clamped,
            tolerance=3e-3,
            time_limit=10.0,
            observe=("wire_points", "wanted_points", "magnet"),
            action_mode="rate",
        ),
        Task("MagWire/Navigate-v0", Navigate(), arenas.arch, time_limit=20.0, observe=_TREE, action_mode="moment"),
        *(
            Task(f"MagWire/{name}-v0", kind, pool=pool, time_limit=12.0, observe=_TREE, action_mode="moment")
            for name, kind, pool in (
                ("NavigateAny", Navigate(), TREES),
                ("Recover", Recover(), TREES),
                ("Gentle", Gentle(), "NarrowTrees"),
                ("Uniform", Navigate(), "TreesInField"),
            )
        ),
    )
}


def known_task(task: str) -> str:
    """The id itself, or a `ValueError` that says which ids there are. ``module:id`` imports the module first.

    >>> known_task("MagWire/Steer-v0")
    'MagWire/Steer-v0'
    """
    module, colon, name = task.rpartition(":")
    if colon:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise ValueError(
                f"task must be an id, or module:id with a module to import, got {task!r}: {error}"
            ) from error
    if name in TASKS:
        return name
    why = ""
    if name == "MagWire/ReachGoal-v0":
        why = (
            ", a goal env with dicts for observations, which only gym.make takes (docs/guide/learning.md trains it "
            "with hindsight replay); MagWire/Reach-v0 is the same task"
        )
    elif close := difflib.get_close_matches(name, TASKS, 1):
        why = f"; did you mean {close[0]!r}?"
    raise ValueError(f"task must be one of {', '.join(TASKS)}, or of register_task's, got {task!r}{why}")


def register_task(task: Task) -> None:
    """Make a task of your own known to `gym.make`, `gym.make_vec` and every command that takes a task's id.

    Raises `ValueError` for an id that exists.

    >>> import gymnasium as gym, magwire_env
    >>> from magwire_env.envs.task import Task, register_task
    >>> register_task(Task("Mine/Far-v0", "steer", magwire_env.Scenario.paper, goal_margin=0.2, time_limit=20.0))
    >>> round(float(gym.make("Mine/Far-v0").reset(seed=0)[1]["target"]), 3)
    0.6
    """
    import gymnasium as gym

    if task.id in TASKS or task.id in gym.registry:
        raise ValueError(f"task.id must be new, got {task.id!r}, which is registered already")
    TASKS[task.id] = task
    gym.register(
        id=task.id,
        entry_point="magwire_env.envs.pages:make",
        vector_entry_point="magwire_env.envs.vector_env:MagWireVectorEnv",
        kwargs={"task": task.id},
    )
