"""The steering task over a batch of lanes: what both faces, the single env and the native batch, are made of."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.checks import one_of, positive, whole
from ..quasistatic import certificate
from ..scenario import Scenario
from ..simulation import Simulator
from . import kernels
from .action import Actuation
from .episode import DRAWS, beginnings, references
from .observation import REFERENCE_OFFSETS, Observer
from .readings import Readings
from .task import KINDS, TASKS, RewardWeights, Task

__all__ = ["OPTIONS", "SteeringCore"]

OPTIONS = ("tip_arclength", "target", "magnet_angle")
"""What `reset(options=…)` takes: m, m, and rad (for slides m), each one number or one a lane."""


_TERMS = (
    ("reward/success", kernels.FOR_SUCCESS),
    ("reward/progress", kernels.FOR_PROGRESS),
    ("reward/time", kernels.FOR_TIME),
    ("reward/wall", kernels.FOR_WALL),
)


class SteeringCore:
    """Lanes, goals, rewards and ends; no autoreset and no random source of its own. See `MagWireEnv` for arguments."""

    def __init__(
        self,
        task: str | Task,
        num_envs: int = 1,
        scenario: Scenario | str | Path | Sequence[Scenario] | None = None,
        coupling: str | None = None,
        action_mode: str = "angle",
        observe: Sequence[str] | None = None,
        reward: str | RewardWeights = "dense",
        time_limit: float | None = None,
        safety: bool = False,
        split: str = "train",
        pool_size: int = 64,
        threads: int | None = None,
    ) -> None:
        self.task = task if isinstance(task, Task) else TASKS[one_of("task", task, tuple(TASKS))]
        self._draws_scenario = self.task.pool is not None and scenario is None
        scenarios = _scenarios(self.task, scenario, coupling, split, pool_size)
        _check_ways(self.task, scenarios)
        if len(scenarios) == 1 and (scenario is not None or coupling is not None):
            _warn_uncertified(self.task, scenarios[0])
        self.sim = Simulator(
            scenarios if len(scenarios) > 1 else scenarios[0], num_envs, threads,
            np.zeros(num_envs, dtype=np.int64) if self._draws_scenario else None,
        )  # fmt: skip
        self.actuation = Actuation(self.sim, action_mode)
        self.observer = Observer(self, self.task.observe if observe is None else observe)
        self.time_limit = positive("time_limit", self.task.time_limit if time_limit is None else time_limit, "s")
        self.step_limit = max(1, round(self.time_limit / self.sim.control_period))
        self._readings = Readings(self)
        self._kind = KINDS.index(self.task.kind)
        self._safe = float(safety)
        self._limit = np.array([sc.contact.wall_force_limit for sc in self.sim.library.scenarios])
        self._set_reward(reward)
        n = self.sim.num_envs
        self._lanes = np.ones((kernels.LANE_FIELDS, self.sim.arrays.out.shape[1]))
        self.goal, self.steps = self._lanes[kernels.GOAL, :n], self._lanes[kernels.STEPS, :n]
        ahead = round(max(REFERENCE_OFFSETS) / self.sim.control_period)
        self.reference = np.zeros((n, self.step_limit + ahead + 1 if self.task.kind == "track" else 0))
        self.turning: np.ndarray | None = np.zeros((n, self.sim.dof)) if "magnet_speed" in self.observer.names else None
        self._varies = any(sc.variation for sc in self.sim.library.scenarios)
        self.varied = {name: np.ones(n) for name in ("friction", "stiffness", "remanence")} if self._varies else {}

    def _set_reward(self, reward: str | RewardWeights) -> None:
        if isinstance(reward, str):
            one_of("reward", reward, ("dense", "sparse"))
        elif not isinstance(reward, RewardWeights):
            raise ValueError(f"reward must be 'dense', 'sparse' or RewardWeights, got {reward!r}")
        sparse, w = reward == "sparse", reward if isinstance(reward, RewardWeights) else RewardWeights()
        self._weights = np.array([1.0, 0.0, 0.0, 0.0] if sparse else [w.success, w.progress, w.time, w.wall])
        self._terms = _TERMS[:1] if sparse else _TERMS

    def begin(self, lanes: np.ndarray, rngs: Sequence[np.random.Generator], options: dict[str, Any] | None) -> None:
        """Start episodes in `lanes`, each drawing from its own generator; nothing changes if an option is bad."""
        lanes = np.asarray(lanes, dtype=np.int64)
        sim, task = self.sim, self.task
        library, draws = sim.library, DRAWS[task.kind]
        entries = sim.lane_scenario[lanes]
        if self._draws_scenario:
            entries = np.array([rng.integers(len(library.scenarios)) for rng in rngs])
        # One number at a time: a third of the time of asking each generator for an array.
        drawn = np.array([[rng.random() for _ in range(draws + sim.dof)] for rng in rngs])
        wire, tract = library.wire_length[entries], library.tract_length[entries]
        tip, goal = beginnings(task, drawn[:, :draws], wire, tract)
        low, high = library.dofs[entries, :, 1:].transpose(2, 0, 1)
        magnet = low + drawn[:, draws:] * (high - low)
        if options:
            tip, goal, magnet = self._overridden(options, lanes, tract, tip, goal, magnet)
        if self._draws_scenario or self._varies:
            sim.assign(lanes, entries)
        if self._varies:
            self._vary(lanes, entries, rngs)
        sim.lay(lanes, tip, magnet)
        if self.turning is not None:
            self.turning[lanes] = 0.0
        own = np.zeros((kernels.LANE_FIELDS, len(lanes)))
        own[kernels.GOAL] = goal
        own[kernels.DISTANCE] = goal - tip if task.kind == "steer" else np.abs(goal - tip)
        own[kernels.START_DISTANCE] = task.tolerance if task.kind == "track" else own[kernels.DISTANCE]
        own[kernels.WALL_LIMIT], own[kernels.TRACT_LENGTH] = self._limit[entries], tract
        self._lanes[:, lanes] = own
        if task.kind == "track":
            times = sim.control_period * np.arange(self.reference.shape[1])
            self.reference[lanes] = references(task, drawn[:, :draws], wire, tract, times)
        self._readings.begin(lanes, rngs)

    def _vary(self, lanes: np.ndarray, entries: np.ndarray, rngs: Sequence[np.random.Generator]) -> None:
        """Draw this episode's friction, stiffness, remanence and placement about the scenario's own."""
        magnets = self.sim.library.magnet_count
        drawn = np.array([rng.uniform(-1.0, 1.0, 3 + 3 * magnets) for rng in rngs])
        ranges = [self.sim.library.scenarios[i].variation for i in entries]
        factors = 1.0 + drawn[:, :3] * np.array([[v.friction, v.stiffness, v.remanence] for v in ranges])
        placement = drawn[:, 3:] * np.array([v.placement for v in ranges])[:, None]
        factors[:, 0] = np.maximum(factors[:, 0], 0.0)
        friction, stiffness, remanence = factors.T
        self.sim.vary(lanes, friction, stiffness, remanence, placement.reshape(-1, magnets, 3))
        for name, column in zip(self.varied, factors.T, strict=True):
            self.varied[name][lanes] = column

    def _overridden(
        self,
        options: dict[str, Any],
        lanes: np.ndarray,
        tract: np.ndarray,
        tip: np.ndarray,
        goal: np.ndarray,
        magnet: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if unknown := set(options) - set(OPTIONS):
            raise ValueError(f"options must be of {', '.join(OPTIONS)}; got {min(unknown)!r}")
        n = self.sim.num_envs
        if self.task.kind == "track" and ("target" in options or "tip_arclength" in options):
            raise ValueError("options must be of magnet_angle alone in a tracking task, whose reference says the rest")
        if "target" in options:
            goal = _per_lane("target", options["target"], n, (), "m")[lanes]
            if (goal <= 0).any() or (goal > tract).any():
                raise ValueError(
                    f"options['target'] must lie in (0, {tract.min():.4g}] (in m), got {options['target']!r}"
                )
        if "tip_arclength" in options:
            tip = _per_lane("tip_arclength", options["tip_arclength"], n, (), "m")[lanes]
        limit = goal if self.task.kind == "steer" else tract
        if (tip < 0).any() or (tip >= limit).any() or ((tip == goal).any() and self.task.kind != "track"):
            raise ValueError(
                f"options['tip_arclength'] must lie in [0, {'target' if self.task.kind == 'steer' else 'tract end'}) "
                f"with the target at {goal.min():.4g} (in m), got {tip.tolist()}"
            )
        if "magnet_angle" in options:
            magnet = _per_lane(
                "magnet_angle", options["magnet_angle"], n, (self.sim.dof,), "rad for turns, m for slides"
            )[lanes]
        return tip, goal, magnet

    def reference_ahead(self, offsets: Sequence[float]) -> np.ndarray:
        """A tracking task's reference `offsets` s from now, (n, len(offsets)) m."""
        if self.task.kind != "track":
            raise ValueError(f"only a tracking task has a reference, got the task {self.task.id}")
        steps = np.round(np.asarray(offsets) / self.sim.control_period).astype(np.int64)
        return self.reference[np.arange(self.sim.num_envs)[:, None], self.steps[:, None].astype(np.int64) + steps]

    def advance(self, action: np.ndarray) -> np.ndarray:
        """One control period: action (n, size) → what it is worth, `kernels.VALUE_FIELDS` rows over n lanes or more."""
        sim, task = self.sim, self.task
        self.actuation.write(action, sim.command)
        before = None if self.turning is None else sim.magnet
        sim.advance()
        if before is not None:
            self.turning = self.actuation.turned(before)
        if task.kind == "track":
            now = np.minimum(self.steps.astype(np.int64) + 1, self.reference.shape[1] - 1)
            self.goal[:] = self.reference[np.arange(sim.num_envs), now]
        values = np.empty((kernels.VALUE_FIELDS, self._lanes.shape[1]))
        kernels.judge(
            sim.num_envs, self._kind, sim.arrays.out, sim.arrays.trace, self.step_limit, sim.control_period,
            task.tolerance, task.hold, self._safe, self._weights, self._lanes, values,
        )  # fmt: skip
        return values

    def step(self, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """One control period: action (n, size) → reward, terminated, truncated, info, every value an (n,) array."""
        values = self.advance(action)[:, : self.sim.num_envs]
        success, terminated, truncated = values[kernels.SUCCESS :] > 0.0
        return values[kernels.REWARD], terminated, truncated, self.info(values, success)

    def info(self, values: Any, success: Any, lane: int | None = None) -> dict[str, Any]:
        """A step's `info` from rows of `advance`, or from one lane's column of them."""
        return {
            "is_success": success,
            "cost": values[kernels.COST],
            "wall_force": values[kernels.WALL_FORCE],
            "path_ratio": values[kernels.PATH_RATIO],
            "distance": values[kernels.LEFT],
            **{name: values[row] for name, row in self._terms},
            **self.drawn(lane),
        }

    def drawn(self, lane: int | None = None) -> dict[str, Any]:
        """What `Variation` drew for the running episodes, (n,) arrays or one lane's numbers; empty without it."""
        return {f"variation/{k}": v.copy() if lane is None else v[lane].item() for k, v in self.varied.items()}

    def start_info(self, lane: int | None = None) -> dict[str, Any]:
        """`info` of a reset: the target (m), and what was drawn."""
        return {"target": self.goal.copy() if lane is None else self.goal[lane].item(), **self.drawn(lane)}

    def summary(self, lanes: np.ndarray) -> dict[str, np.ndarray]:
        """Of the episodes just ended in `lanes`, in arrays (n,): steps, time (s), forces (N), travel (rad and m)."""
        sim = self.sim
        rows = np.zeros((len(kernels.SUMMARY), sim.num_envs))
        kernels.summarise(lanes, self._kind, sim.arrays.trace, sim.control_period, self._lanes, rows)
        summary = dict(zip(kernels.SUMMARY, rows, strict=True))
        summary["steps"] = rows[0].astype(np.int64)
        if self.task.kind != "track":
            del summary["rms_error"]
        return summary

    def observe(self) -> np.ndarray:
        """(n, size) float32."""
        return self._readings.of(self.observer.read(self._lanes), self.steps)


def _scenarios(task: Task, given: Any, coupling: str | None, split: str, pool_size: int) -> list[Scenario]:
    if given is None and task.pool is not None:
        from ..quasistatic.pool import scenario_pool

        given = list(scenario_pool(task.pool, split, whole("pool_size", pool_size, 1)))
    elif given is None:
        assert task.scenario is not None  # a task has the one or the other
        given = task.scenario()
    elif isinstance(given, (str, Path)):
        given = Scenario.load(given)
    scenarios = list(given) if isinstance(given, (list, tuple)) else [given]
    for sc in scenarios:
        if not isinstance(sc, Scenario):
            raise ValueError(
                f"scenario must be a Scenario, a TOML file, a shipped name, or a sequence of scenarios, got {sc!r}"
            )
    return scenarios if coupling is None else [dataclasses.replace(sc, coupling=coupling) for sc in scenarios]


def _check_ways(task: Task, scenarios: Sequence[Scenario]) -> None:
    for i, sc in enumerate(scenarios):
        first, last = sc.wire.length - task.start_spread, sc.tract.length - task.goal_margin
        if first < 0 or sc.wire.length + task.start_spread >= last - 0.05:
            raise ValueError(
                f"scenario[{i}].wire.length must leave a way between the start and the goal at {last:.3g} m, "
                f"got {sc.wire.length:g} m of wire"
            )


@lru_cache(maxsize=256)
def _warn_uncertified(task: Task, scenario: Scenario) -> None:
    """Warn, once a scenario and task, where nothing says that the task can be done; both ways unless it is steering."""
    for direction in (1, -1)[: 1 if task.kind == "steer" else 2]:
        found = certificate(scenario, direction=direction, time_limit=task.time_limit)
        if not found.solvable:
            warnings.warn(f"scenario {scenario.name!r} has no certificate for {task.id}: {found}", stacklevel=5)
            return


def _per_lane(name: str, value: Any, n: int, shape: tuple[int, ...], unit: str) -> np.ndarray:
    """One value for all lanes or one a lane → (n, *shape)."""
    try:
        array = np.asarray(value, dtype=np.float64)
        if shape and array.shape == (n,) and shape == (1,):
            array = array[:, None]
        array = np.broadcast_to(array, (n, *shape))
    except (TypeError, ValueError):
        raise ValueError(f"options[{name!r}] must be one number or {n} of them (in {unit}), got {value!r}") from None
    if not np.isfinite(array).all():
        raise ValueError(f"options[{name!r}] must be finite (in {unit}), got {value!r}")
    return array
