"""The steering task over a batch of lanes: what both faces, the single env and the native batch, are made of."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.checks import one_of, positive
from ..progress import Progress
from ..quasistatic import certificate
from ..scenario import Scenario
from ..simulation import Places, Simulator
from ..simulation.model import supports
from ..simulation.readout import ROW
from . import kernels
from .action import Actuation
from .episodes import Episodes
from .kernels import VALUE
from .navigation import Navigation
from .observation import CHANNELS
from .options import OPTIONS, check_names, rig_option, tract_options
from .pools import scenarios_of
from .rewards import TERMS, RewardTerm, RewardWeights, checked_terms, info_name
from .shapes import Shapes
from .shown import Observation, Shown
from .task import TASKS, Task

__all__ = ["OPTIONS", "SteeringCore"]

_FIRST_TERM = VALUE.reward + 1

_TOLD = (
    ("cost", VALUE.cost), ("wall_force", VALUE.wall_force), ("path_ratio", VALUE.path_ratio), ("distance", VALUE.left),
    ("unconverged", VALUE.unconverged),
)  # fmt: skip
"""What a step's `info` tells, and the row of `advance` that holds it."""


class SteeringCore:
    """Lanes, goals, rewards and ends; no autoreset and no random source of its own. See `MagWireEnv` for arguments.

    sim, episodes : the simulator, and what is remembered of the running episodes
    shown : the observations; `observer` is the part with the numbers
    action : (n, size), the last one taken
    """

    def __init__(
        self,
        task: str | Task,
        num_envs: int = 1,
        scenario: Scenario | str | Path | Sequence[Scenario] | None = None,
        coupling: str | None = None,
        model: str | None = None,
        action_mode: str | None = None,
        observe: Any = None,
        reward: str | RewardWeights | Mapping[str, float] = "dense",
        reward_terms: Sequence[RewardTerm] = (),
        time_limit: float | None = None,
        safety: bool = False,
        split: str = "train",
        pool_size: int = 64,
        threads: int | None = None,
    ) -> None:
        self.task = task if isinstance(task, Task) else TASKS[one_of("task", task, tuple(TASKS))]
        self._draws_scenario = self.task.pool is not None and scenario is None
        scenarios = scenarios_of(self.task, scenario, coupling, model, split, pool_size)
        _check_ways(self.task, scenarios)
        if len(scenarios) == 1 and (scenario is not None or coupling is not None):
            _warn_uncertified(self.task, scenarios[0])
        with Progress(f"preparing scenarios, {len(scenarios)} in all"):  # a tree's first use makes its wall: seconds
            self.sim = Simulator(
                scenarios if len(scenarios) > 1 else scenarios[0], num_envs, threads,
                np.zeros(num_envs, dtype=np.int64) if self._draws_scenario else None,
            )  # fmt: skip
        self.time_limit = positive("time_limit", self.task.time_limit if time_limit is None else time_limit, "s")
        self._fed = self.sim.library.rigs.feed >= 0
        self.step_limit = max(1, round(self.time_limit / self.sim.control_period))
        self.actuation = Actuation(self.sim, self.task.action_mode if action_mode is None else action_mode)
        self.episodes = Episodes(self.sim, self.task, self.step_limit)
        self.navigation = Navigation(self.sim, self.task) if self.task.kind.navigates else None
        self.shapes = Shapes(self.sim, self.task) if self.task.kind.shapes else None
        self.episodes.shapes = self.shapes
        seen = self.task.observe if observe is None else observe
        self.shown = Shown(self.sim, self.episodes, seen, self.step_limit, threads)
        self.observer = self.shown.observer
        self._watches_rig = any(CHANNELS[name].watches_rig for name in self.observer.names)
        self._rule, self._follows = self.task.kind.rule, self.task.kind.follows
        self._safe = float(safety)
        self.reward_terms = checked_terms(reward_terms)
        self.own_terms: dict[str, np.ndarray] = {}
        self._set_reward(reward)
        self.action = np.zeros((self.sim.num_envs, *self.actuation.space.shape))
        self._varies = any(sc.variation for sc in self.sim.library.scenarios)
        drawn = ("friction", "stiffness", "remanence") if self._varies else ()
        self.varied = {name: np.ones(self.sim.num_envs) for name in drawn}

    def _set_reward(self, reward: str | RewardWeights | Mapping[str, float]) -> None:
        if isinstance(reward, str):
            one_of("reward", reward, ("dense", "sparse"))
        elif isinstance(reward, Mapping):
            names = [term.name for term in TERMS]
            if unknown := sorted(set(reward) - set(names)):
                raise ValueError(f"reward must weigh {', '.join(names)}, got {unknown[0]!r}")
            reward = RewardWeights(**reward)
        elif not isinstance(reward, RewardWeights):
            raise ValueError(f"reward must be 'dense', 'sparse', RewardWeights or a dict of them, got {reward!r}")
        weights = reward if isinstance(reward, RewardWeights) else RewardWeights()
        if reward == "sparse":
            weights = RewardWeights(**{term.name: float(term.name == "success") for term in TERMS})
        self._weights = np.array([getattr(weights, term.name) for term in TERMS])
        shown = [term for term in TERMS if reward != "sparse" or term.name == "success"]
        self._told = _TOLD + tuple((info_name(term.name), _FIRST_TERM + TERMS.index(term)) for term in shown)

    @property
    def goal(self) -> np.ndarray:
        """(n,) m, the goals' arc lengths."""
        return self.sim.goals().s

    @property
    def steps(self) -> np.ndarray:
        """(n,) control steps of the running episodes so far."""
        return self.episodes.steps

    @property
    def cost_unit(self) -> float:
        """N·steps in one of `info["cost"]`: it is in N, and of a task with a `cost_limit` in mN·s."""
        return 1.0 if self.task.kind.cost_limit is None else 1e-3 / self.sim.control_period

    def begin(self, lanes: np.ndarray, rngs: Sequence[np.random.Generator], options: dict[str, Any] | None) -> None:
        """Start episodes in `lanes`, each drawing from its own generator; nothing changes if an option is bad."""
        lanes = np.asarray(lanes, dtype=np.int64)
        sim, kind = self.sim, self.task.kind
        entries = sim.lane_scenario[lanes]
        if self._draws_scenario:
            entries = np.array([rng.integers(len(sim.library.scenarios)) for rng in rngs])
        # One number at a time: a third of the time of asking each generator for an array.
        drawn = np.array([[rng.random() for _ in range(kind.draws + sim.dof)] for rng in rngs])
        start, goal = kind.begin(self.task, sim.library, entries, drawn[:, : kind.draws])
        _, low, high = sim.library.limits.of(entries)
        magnet = low + drawn[:, kind.draws :] * (high - low)
        held = kind.magnets(sim.library, entries, start.s)
        magnet = magnet if held is None else held
        if self.shapes:
            self.shapes.choose(lanes, entries, drawn[:, 0], (options or {}).get("target"))
        if options:
            start, goal, magnet = self._overridden(options, lanes, entries, start, goal, magnet)
        if self.navigation:
            magnet = self.navigation.rig_over(entries, start, magnet)
        if self._draws_scenario or self._varies:
            sim.assign(lanes, entries)
        if self._varies:
            self._vary(lanes, entries, rngs)
        reference = None
        if kind.follows:
            times = sim.control_period * np.arange(self.episodes.reference.shape[1])
            reference = kind.reference(self.task, sim.library, entries, drawn[:, : kind.draws], times)
        final = kind.final(self.task, sim.library, entries) if kind.returns else None
        self.begin_at(lanes, start, goal, magnet, reference, final)
        self.shown.begin(lanes, rngs)

    def begin_at(
        self,
        lanes: np.ndarray,
        start: Places,
        goal: Places,
        magnet: np.ndarray,
        reference: np.ndarray | None = None,
        final: np.ndarray | None = None,
    ) -> None:
        """Start episodes in `lanes` (n,) with the tips at `start`, the rig at `magnet` (n, dof), as they are given.

        reference : (n, steps) m, of a tracking task
        final : (n,) m, of a task that comes back
        """
        self.sim.lay(lanes, start, magnet, goal)
        if self.shapes:
            self.shapes.measure(lanes)
        self.episodes.begin(lanes, reference, final)
        if self.navigation:
            self.navigation.begin(lanes)
        self.action[lanes] = 0.0

    def _vary(self, lanes: np.ndarray, entries: np.ndarray, rngs: Sequence[np.random.Generator]) -> None:
        """Draw this episode's friction, stiffness, remanence and placement about the scenario's own."""
        magnets = self.sim.library.magnet_count
        drawn = np.array([rng.uniform(-1.0, 1.0, 3 + 3 * magnets) for rng in rngs])
        ranges = [self.sim.library.scenarios[i].variation for i in entries]
        factors = 1.0 + drawn[:, :3] * np.array([[v.friction, v.stiffness, v.remanence] for v in ranges])
        placement = drawn[:, 3:] * np.array([v.placement for v in ranges])[:, None]
        factors[:, 0] = np.maximum(factors[:, 0], 0.0)
        friction, stiffness, remanence = factors.T
        self.sim.vary(lanes, friction, stiffness, remanence, placement.reshape(len(lanes), magnets, 3))
        for name, column in zip(self.varied, factors.T, strict=True):
            self.varied[name][lanes] = column

    def _overridden(
        self,
        options: dict[str, Any],
        lanes: np.ndarray,
        entries: np.ndarray,
        start: Places,
        goal: Places,
        magnet: np.ndarray,
    ) -> tuple[Places, Places, np.ndarray]:
        check_names(options, self.task)
        magnet = rig_option(options, self.sim, lanes, magnet)
        if self.shapes:
            return start, goal, magnet
        if self.navigation:
            return *self.navigation.overridden(options, lanes, entries, start, goal), magnet
        return *tract_options(options, self.task, self.sim, lanes, entries, start, goal), magnet

    def reference_ahead(self, offsets: Sequence[float]) -> np.ndarray:
        """A tracking task's reference `offsets` s from now, (n, len(offsets)) m."""
        return self.episodes.reference_ahead(np.asarray(offsets))

    def advance(self, action: np.ndarray) -> np.ndarray:
        """One control period: action (n, size) → what it is worth, rows of `kernels.Value` over n lanes or more.

        Raises `ValueError`, before anything moves, for a bad action, and `RuntimeError` if a wire's motion diverged.
        """
        sim, task, episodes = self.sim, self.task, self.episodes
        self.actuation.write(action, sim.command)
        if self._follows:
            episodes.move_goals()
        before = sim.magnet if self._watches_rig else None
        sim.advance()
        if self.navigation:
            self.navigation.moved()
        if self.shapes:
            self.shapes.measure()
        if before is not None:
            episodes.turned = self.actuation.turned(before)
        values = np.empty((len(VALUE), episodes.lanes.shape[1]))
        diverged = kernels.judge(
            sim.num_envs, self._rule, sim.readout, sim.trace, self.step_limit, sim.control_period,
            task.tolerance, task.hold, self._safe, self._weights, episodes.lanes, values,
        )  # fmt: skip
        if diverged >= 0:
            scenario = sim.library.scenarios[sim.lane_scenario[diverged]]
            raise RuntimeError(
                f"the wire of lane {diverged} (scenario {scenario.name!r}) has diverged: its tip is at "
                f"{sim.travelled[diverged]} m. Its numbers cannot be integrated with "
                f"{sim.library.substeps} steps in a control period of {sim.control_period:g} s"
            )
        if task.kind.returns:
            episodes.turn_back(values[VALUE.turned, : sim.num_envs])
        if self.reward_terms:
            self.action[:] = action
            self._add_terms(values)
        return values

    def _add_terms(self, values: np.ndarray) -> None:
        """Add the user's own terms to the reward."""
        n = self.sim.num_envs
        self.own_terms = {}
        for term in self.reward_terms:
            value = np.asarray(term.of(self), dtype=np.float64)
            if value.shape != (n,) or not np.isfinite(value).all():
                raise ValueError(f"reward term {term.name!r} must give {n} finite numbers, got {value!r}")
            self.own_terms[info_name(term.name)] = term.weight * value
            values[VALUE.reward, :n] += term.weight * value

    def step(self, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """One control period: action (n, size) → reward, terminated, truncated, info, every value an (n,) array."""
        values = self.advance(action)[:, : self.sim.num_envs]
        success, terminated, truncated = (
            values[row] > 0.0 for row in (VALUE.success, VALUE.terminated, VALUE.truncated)
        )
        return values[VALUE.reward], terminated, truncated, self.info(values, success)

    def info(self, values: Any, success: Any, lane: int | None = None) -> dict[str, Any]:
        """A step's `info` from rows of `advance` (rows, n), or from one lane's numbers (rows,)."""
        info = {"is_success": success}
        for name, row in self._told:
            info[name] = values[row]
        if self._fed:
            info.update(self._of_base(lane))
        if self.navigation:
            info.update(self.navigation.info(lane))
        if self.own_terms:
            info.update({k: v if lane is None else v[lane].item() for k, v in self.own_terms.items()})
        if self.varied:
            info.update(self.drawn(lane))
        return info

    def _of_base(self, lane: int | None) -> dict[str, Any]:
        """What a wire's drive feels: force (N), torque (N·m), and the wire inserted (m)."""
        rows = self.sim.readout[:, : self.sim.num_envs]
        if lane is not None:
            rows = rows[:, lane : lane + 1]
        force, torque = (
            np.sqrt((rows[first : first + 3] ** 2).sum(axis=0)) for first in (ROW.base_force_x, ROW.base_torque_x)
        )
        found = {"base_force": force, "base_torque": torque, "inserted_length": rows[ROW.inserted].copy()}
        return found if lane is None else {name: value.item() for name, value in found.items()}

    def drawn(self, lane: int | None = None) -> dict[str, Any]:
        """What `Variation` drew for the running episodes, (n,) arrays or one lane's numbers; empty without it."""
        return {f"variation/{k}": v.copy() if lane is None else v[lane].item() for k, v in self.varied.items()}

    def start_info(self, lane: int | None = None) -> dict[str, Any]:
        """`info` of a reset: the target (m), and what was drawn."""
        if told := self.navigation or self.shapes:
            return {**told.start_info(lane), **self.drawn(lane)}
        return {"target": self.goal if lane is None else self.sim.goal_of(lane), **self.drawn(lane)}

    def summary(self, lanes: np.ndarray) -> dict[str, np.ndarray]:
        """Of the episodes just ended in `lanes`, in arrays (n,): steps, time (s), forces (N), travel (rad and m)."""
        sim, kind = self.sim, self.task.kind
        rows = np.zeros((len(kernels.SUMMARY), sim.num_envs))
        kernels.summarise(lanes, kind.rule, sim.trace, sim.control_period, self.episodes.lanes, rows)
        summary: dict[str, np.ndarray] = dict(zip(kernels.SUMMARY, rows, strict=True))
        for name in ("steps", "unconverged"):
            summary[name] = summary[name].astype(np.int64)
        if not kind.follows:
            del summary["rms_error"]
        if self.navigation:
            summary |= self.navigation.summary(summary)
        if not kind.returns:
            del summary["time_in"], summary["time_back"]
        return summary

    def observe(self) -> Observation:
        """What every lane is shown now."""
        return self.shown.read()

    def beside(self, observe: Sequence[str]) -> SteeringCore:
        """The same lanes for someone who reads other numbers: a copy that shares simulator and episodes.

        observe : names of channels; `beside(…).observer.read()` reads them as they are, without the errors of sensors

        Raises `ValueError` for channels that this env cannot show.
        """
        other = copy.copy(self)
        other.shown = Shown(self.sim, self.episodes, tuple(observe), self.step_limit)
        other.observer = other.shown.observer
        self._watches_rig |= any(CHANNELS[name].watches_rig for name in observe)
        return other


def _check_ways(task: Task, scenarios: Sequence[Scenario]) -> None:
    for i, sc in enumerate(scenarios):
        if sc.rig.feed is not None or sc.rig.clamped:
            continue  # how far it goes is the feed's business, or no one's
        first, last = sc.wire.length - task.start_spread, sc.tract.length - task.goal_margin
        if first < 0 or sc.wire.length + task.start_spread >= last - 0.05:
            raise ValueError(
                f"scenario[{i}].wire.length must leave a way between the start and the goal at {last:.3g} m, "
                f"got {sc.wire.length:g} m of wire"
            )


@lru_cache(maxsize=256)
def _warn_uncertified(task: Task, scenario: Scenario) -> None:
    """Warn, once a scenario and task, where nothing says that the task can be done, in every way it asks for.

    Only the locked wire has a theory that can say so; scenarios of other wire models are not judged.
    """
    if not supports(scenario, "quasistatic"):
        return
    for direction, goal in task.kind.ways(task, scenario):
        found = certificate(scenario, direction, goal=goal, time_limit=task.time_limit)
        if not found.solvable:
            warnings.warn(f"scenario {scenario.name!r} has no certificate for {task.id}: {found}", stacklevel=5)
            return
