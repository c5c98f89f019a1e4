"""Navigation: bring the tip of a fed wire into a named branch. How an episode begins, and what is counted in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..lumen import Lumen
from ..simulation import Library, Places, Simulator
from ..simulation.readout import OF_STATE, ROW
from .kernels import PASS
from .kinds import Kind
from .moment import over

if TYPE_CHECKING:
    from .task import Task

__all__ = ["Gentle", "Navigate", "Navigation", "Recover", "end_of", "inside", "wrong_branches"]

_MN = 1e3
"""mN of a newton."""

_BEFORE = 5e-3
"""m before the end of the trunk, beyond which no tip starts: an end of the trunk may be the middle of a fork."""

_BACK = 5
"""Control periods on the route after which leaving it counts as another wrong entry."""


@dataclass(frozen=True)
class Navigate(Kind):
    """Bring the tip into a branch of a tree that is drawn for every episode, to its end."""

    name: ClassVar[str] = "navigate"
    rule: ClassVar[int] = PASS
    draws: ClassVar[int] = 2
    navigates: ClassVar[bool] = True
    takes: ClassVar[tuple[str, ...]] = ("target", "start", "magnet_angle")

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """As `Kind.begin`: a dead end of each tree is the target, and the wire is inserted a little way."""
        home, (low, high) = library.start_length[entries], library.reach[entries].T
        start = home + task.start_spread * (2 * drawn[:, 0] - 1)
        fork = library.tract_length[entries] - _BEFORE  # of a tree, the trunk's length
        least = np.maximum(home - task.start_spread, low)
        short = fork < home + task.start_spread
        start = np.where(short, least + drawn[:, 0] * np.maximum(fork - least, 0.0), start)
        branch, s = np.zeros(len(entries), dtype=np.int64), np.zeros(len(entries))
        for i, entry in enumerate(entries):
            tree = library.scenarios[entry].tree
            branch[i], s[i] = end_of(task, tree, _one_of(tree.leaves, drawn[i, 1]))
        return Places(np.clip(start, low, high)), Places(s, branch)

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return (
            f"The feed's home ± {1e3 * task.start_spread:g} mm of wire are inserted, in a short trunk no more than it "
            "holds. The target, one of the tree's dead ends, is drawn."
        )

    def ends(self, task: Task) -> str:
        """As `Kind.ends`."""
        return (
            f"Terminated when the tip has come within {1e3 * task.tolerance:g} mm of the end of the target branch, "
            "along its centreline (`is_success`)."
        )


@dataclass(frozen=True)
class Recover(Navigate):
    """Come out of a wrong branch, and bring the tip into the branch that is drawn for every episode, to its end."""

    name: ClassVar[str] = "recover"
    draws: ClassVar[int] = 3

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """As `Kind.begin`: the tip lies inside one of the branches that leave the way to the target."""
        start, goal = super().begin(task, library, entries, drawn)
        s, branch = start.s.copy(), np.zeros(len(entries), dtype=np.int64)
        for i, entry in enumerate(entries):
            tree = library.scenarios[entry].tree
            branch[i] = _one_of(wrong_branches(tree, tree.branches[goal.branch[i]].name), drawn[i, 2])
            s[i] = _SHALLOWEST + drawn[i, 0] * (inside(tree, branch[i]) - _SHALLOWEST)
        return Places(s, branch), goal

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return (
            "The target, one of the tree's dead ends, is drawn, and a branch that leaves the way to it. The tip lies "
            f"{1e3 * _SHALLOWEST:g} to {1e3 * _DEEPEST:g} mm inside that branch, and the wire along the way there."
        )


@dataclass(frozen=True)
class Gentle(Navigate):
    """Bring the tip into a branch of a tree that is drawn for every episode, to its end, with little force on the wall.

    The task is constrained: `cost` is the force above the scenario's limit over time, and an episode's sum of it should
    stay below `cost_limit`. Neither reward nor success knows of that limit.
    """

    name: ClassVar[str] = "gentle"
    cost_limit: ClassVar[float | None] = 2.0

    def ends(self, task: Task) -> str:
        """As `Kind.ends`."""
        return (
            f"{super().ends(task)} `cost` is the peak of the wall's force above the scenario's `wall_force_limit` "
            "times the control period, mN·s; `summary` has its sum over the episode, and `within_limit`, which says "
            f"whether that is at most {self.cost_limit:g} mN·s."
        )


_SHALLOWEST, _DEEPEST = 0.01, 0.03
"""m inside a wrong branch, between which an episode of `Recover` starts."""


def wrong_branches(tree: Lumen, target: str) -> tuple[int, ...]:
    """Numbers of the branches that leave the way from the inlet to a target."""
    way = {leg.branch for leg in tree.route("inlet", target).legs}
    return tuple(i for i, parent in enumerate(tree.parents) if i not in way and parent in way)


def inside(tree: Lumen, branch: int) -> float:
    """How far inside a wrong branch an episode starts at most, m: 30 mm, of a short branch 0.7 of its length."""
    return min(_DEEPEST, 0.7 * tree.branches[branch].length)


def _one_of(names: Sequence[Any], drawn: float) -> Any:
    return names[int(drawn * len(names))]


def end_of(task: Task, tree: Lumen, name: str) -> tuple[int, float]:
    """The number of a target branch, and the arc length on it that a tip must pass."""
    branch = tree.index(name)
    return branch, max(tree.branches[branch].length - task.tolerance, 0.5 * tree.branches[branch].length)


class Navigation:
    """What is counted in the episodes of a navigating task: wrong entries and contact forces, one number a lane.

    wrong_entries : (n,) how often the tip has left the route for another branch
    on_route : (n,) control periods since the tip was last astray
    cost : (n,) mN·s, by which and for how long the wall's force has exceeded the scenario's limit in this episode
    """

    def __init__(self, sim: Simulator, task: Task) -> None:
        self._sim, self._task = sim, task
        n = sim.num_envs
        self.wrong_entries, self.on_route = np.zeros(n, dtype=np.int64), np.full(n, _BACK)
        self._wall_limit = np.array([sc.contact.wall_force_limit for sc in sim.library.scenarios])
        self.cost = np.zeros(n)
        trees = [sc.tree for sc in sim.library.scenarios]
        self._names = [np.array([b.name for b in tree.branches], dtype=object) for tree in trees]
        self._trees = trees

    def begin(self, lanes: np.ndarray) -> None:
        """New episodes in `lanes` (n,), just laid out: a tip that starts astray has not gone astray itself."""
        self.wrong_entries[lanes], self.cost[lanes] = 0, 0.0
        self._sim.readout[OF_STATE:, lanes] = 0.0  # the last control period was another episode's
        self.on_route[lanes] = np.where(self._sim.readout[ROW.astray, lanes] > 0.0, 0, _BACK)

    def moved(self) -> None:
        """After a control period: count the tips that have left the route, and what the wall has borne."""
        self.cost += self._cost_now()
        astray = self._sim.readout[ROW.astray, : self._sim.num_envs] > 0.0
        self.wrong_entries += astray & (self.on_route >= _BACK)
        self.on_route = np.where(astray, 0, self.on_route + 1)

    def _cost_now(self) -> np.ndarray:
        """The last control period's cost, (n,) mN·s."""
        peak, limit = self._sim.readout[ROW.peak_wall, : self._sim.num_envs], self._wall_limit[self._sim.lane_scenario]
        return _MN * self._sim.control_period * np.maximum(peak - limit, 0.0)

    @property
    def within_limit(self) -> np.ndarray:
        """Whether the episodes' costs are below the task's limit so far, (n,); true where it has none."""
        limit = self._task.kind.cost_limit
        return self.cost <= (np.inf if limit is None else limit)

    def targets(self) -> np.ndarray:
        """Names of the lanes' target branches, (n,) of objects."""
        return self._named(self._sim.goals().branch)

    def _named(self, branch: np.ndarray) -> np.ndarray:
        entries = self._sim.lane_scenario
        out = np.empty(len(branch), dtype=object)
        for i, (entry, b) in enumerate(zip(entries, branch, strict=True)):
            out[i] = self._names[entry][b]
        return out

    def start_info(self, lane: int | None) -> dict[str, Any]:
        """`info` of a reset: the target's name, and those of all dead ends it may be."""
        targets, n = self.targets(), self._sim.num_envs
        ends = np.empty(n, dtype=object)
        ends[:] = [self._trees[entry].leaves for entry in self._sim.lane_scenario]
        found = {"target": targets, "targets": ends}
        return found if lane is None else {name: value[lane] for name, value in found.items()}

    def info(self, lane: int | None) -> dict[str, Any]:
        """What a step's `info` tells beside other tasks' (one lane's, or arrays (n,))."""
        rows = self._sim.readout[:, : self._sim.num_envs]
        found = {
            "branch": self._named(rows[ROW.branch].astype(np.int64)),
            "astray": rows[ROW.astray].copy(),
            "wrong_entries": self.wrong_entries.copy(),
            "contact_mean": _MN * rows[ROW.mean_wall],
            "contact_peak": _MN * rows[ROW.peak_wall],
        }
        if self._task.kind.cost_limit is not None:
            found["cost"] = self._cost_now()
        if lane is None:
            return found
        return {k: v[lane] if v.dtype == object else v[lane].item() for k, v in found.items()}

    def summary(self, of: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What the summary of an episode tells beside other tasks', from the summary `of` all tasks."""
        found = {
            "wrong_entries": self.wrong_entries.copy(),
            "contact_mean": _MN * of["mean_wall_force"],
            "contact_peak": _MN * of["peak_wall_force"],
        }
        if self._task.kind.cost_limit is not None:
            found |= {"cost": self.cost.copy(), "within_limit": self.within_limit}
        return found

    def state(self) -> dict[str, np.ndarray]:
        """The counts as values; `load_state` puts them back."""
        return {name: getattr(self, name).copy() for name in ("wrong_entries", "on_route", "cost")}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Put back what `state` gave."""
        for name in ("wrong_entries", "on_route", "cost"):
            getattr(self, name)[:] = state[name]

    def overridden(
        self, options: dict[str, Any], lanes: np.ndarray, entries: np.ndarray, start: Places, goal: Places
    ) -> tuple[Places, Places]:
        """Starts and goals of `lanes` (n,) with those that `reset(options=…)` names; see `MagWireEnv`.

        Raises `ValueError` for a branch that the lane's tree does not have, and a start beyond what the feed can reach.
        """
        n, library = self._sim.num_envs, self._sim.library
        start, goal = Places(start.s.copy(), start.branch.copy()), Places(goal.s.copy(), goal.branch.copy())
        targets = _each("target", options.get("target"), n, lambda v: isinstance(v, str), "a branch's name")
        starts = _each("start", options.get("start"), n, _is_place, "'inlet', a branch's name, or (name, m)")
        for i, (lane, entry) in enumerate(zip(lanes, entries, strict=True)):
            tree = self._trees[entry]
            if targets is not None:
                if targets[lane] not in tree.leaves:
                    raise ValueError(
                        f"options['target'] must be one of {', '.join(tree.leaves)}, got {targets[lane]!r}"
                    )
                goal.branch[i], goal.s[i] = end_of(self._task, tree, targets[lane])
            if starts is not None:
                start.branch[i], start.s[i] = self._start(starts[lane], tree, library.reach[entry])
        return start, goal

    def _start(self, at: Any, tree: Lumen, reach: np.ndarray) -> tuple[int, float]:
        place = tree.place(at)
        way, (low, high) = tree.length_of((place.branch, place.s)), reach
        if at == "inlet":
            return 0, float(low)
        if not low <= way <= high:
            raise ValueError(
                f"options['start'] must lie where the feed can bring the tip, in [{low:.4g}, {high:.4g}] m from the "
                f"inlet, got {at!r} at {way:.4g} m"
            )
        return tree.index(place.branch), place.s

    def rig_over(self, entries: np.ndarray, start: Places, magnet: np.ndarray) -> np.ndarray:
        """Settings (n, dof) like `magnet`, with the slides over the tips at `start`."""
        tips = np.array(
            [
                self._trees[e].branches[b].curve.position(s)
                for e, b, s in zip(entries, start.branch, start.s, strict=True)
            ]
        )
        return over(self._sim, tips, magnet, entries)


def _is_place(value: Any) -> bool:
    return isinstance(value, str) or (isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str))


def _each(name: str, value: Any, n: int, good: Callable[[Any], bool], what: str) -> Sequence[Any] | None:
    """An option's value for each of n lanes: one for all, or a list of n."""
    if value is None:
        return None
    values = list(value) if isinstance(value, (list, np.ndarray)) else [value] * n
    if len(values) != n or not all(map(good, values)):
        raise ValueError(f"options[{name!r}] must be {what}, or a list of {n} of them, got {value!r}")
    return values
