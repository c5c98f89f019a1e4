"""The steering task over a batch of lanes: what both faces, the single env and the native batch, are made of."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.checks import one_of, positive
from ..scenario import Scenario
from ..simulation import Simulator
from . import kernels
from .action import Actuation
from .observation import DEFAULT, Observer
from .task import TASKS, RewardWeights, Task

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
        observe: Sequence[str] = DEFAULT,
        reward: str | RewardWeights = "dense",
        time_limit: float | None = None,
        threads: int | None = None,
    ) -> None:
        self.task = task if isinstance(task, Task) else TASKS[one_of("task", task, tuple(TASKS))]
        scenarios = _scenarios(self.task, scenario, coupling)
        for i, sc in enumerate(scenarios):
            first, last = sc.wire.length - self.task.start_spread, sc.tract.length - self.task.goal_margin
            if first < 0 or sc.wire.length + self.task.start_spread >= last:
                raise ValueError(
                    f"scenario[{i}].wire.length must leave a way between the start and the goal at {last:.3g} m, "
                    f"got {sc.wire.length:g} m of wire"
                )
        if isinstance(reward, str):
            one_of("reward", reward, ("dense", "sparse"))
        elif not isinstance(reward, RewardWeights):
            raise ValueError(f"reward must be 'dense', 'sparse' or RewardWeights, got {reward!r}")
        self.sparse = reward == "sparse"
        self.weights = reward if isinstance(reward, RewardWeights) else RewardWeights()
        self.sim = Simulator(scenarios if len(scenarios) > 1 else scenarios[0], num_envs, threads)
        self.actuation = Actuation(self.sim, action_mode)
        self.observer = Observer(self.sim, observe)
        self.time_limit = positive("time_limit", self.task.time_limit if time_limit is None else time_limit, "s")
        self.step_limit = max(1, round(self.time_limit / self.sim.control_period))
        self._limit = np.array([sc.contact.wall_force_limit for sc in self.sim.library.scenarios])
        w = self.weights
        self._weights = np.array([1.0, 0.0, 0.0, 0.0] if self.sparse else [w.success, w.progress, w.time, w.wall])
        self._terms = _TERMS[:1] if self.sparse else _TERMS
        self._lanes = np.ones((kernels.LANE_FIELDS, self.sim.arrays.out.shape[1]))
        self.goal = self._lanes[kernels.GOAL, : self.sim.num_envs]
        self.steps = self._lanes[kernels.STEPS, : self.sim.num_envs]

    def begin(self, lanes: np.ndarray, rngs: Sequence[np.random.Generator], options: dict[str, Any] | None) -> None:
        """Start episodes in `lanes`, each drawing from its own generator; nothing changes if an option is bad."""
        lanes = np.asarray(lanes, dtype=np.int64)
        sim, count = self.sim, range(1 + self.sim.dof)
        library, entries = sim.library, sim.lane_scenario[lanes]
        # One number at a time: a third of the time of asking each generator for an array.
        drawn = np.array([[rng.random() for _ in count] for rng in rngs])
        tip = library.wire_length[entries] + self.task.start_spread * (2.0 * drawn[:, 0] - 1.0)
        goal = library.tract_length[entries] - self.task.goal_margin
        low, high = library.dofs[entries, :, 1:].transpose(2, 0, 1)
        magnet = low + drawn[:, 1:] * (high - low)
        if options:
            tip, goal, magnet = self._overridden(options, lanes, tip, goal, magnet)
        sim.lay(lanes, tip, magnet)
        own = np.zeros((kernels.LANE_FIELDS, len(lanes)))
        own[kernels.GOAL] = goal
        own[kernels.START_DISTANCE] = own[kernels.DISTANCE] = goal - tip
        own[kernels.WALL_LIMIT], own[kernels.TRACT_LENGTH] = self._limit[entries], library.tract_length[entries]
        self._lanes[:, lanes] = own

    def _overridden(
        self, options: dict[str, Any], lanes: np.ndarray, tip: np.ndarray, goal: np.ndarray, magnet: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if unknown := set(options) - set(OPTIONS):
            raise ValueError(f"options must be of {', '.join(OPTIONS)}; got {min(unknown)!r}")
        length = self.sim.library.tract_length[self.sim.lane_scenario[lanes]]
        n = self.sim.num_envs
        if "target" in options:
            goal = _per_lane("target", options["target"], n, (), "m")[lanes]
            if (goal <= 0).any() or (goal > length).any():
                raise ValueError(
                    f"options['target'] must lie in (0, {length.min():.4g}] (in m), got {options['target']!r}"
                )
        if "tip_arclength" in options:
            tip = _per_lane("tip_arclength", options["tip_arclength"], n, (), "m")[lanes]
        if (tip < 0).any() or (tip >= goal).any():
            raise ValueError(
                f"options['tip_arclength'] must lie in [0, target) with the target at {goal.min():.4g} (in m), "
                f"got {tip.tolist()}"
            )
        if "magnet_angle" in options:
            magnet = _per_lane(
                "magnet_angle", options["magnet_angle"], n, (self.sim.dof,), "rad for turns, m for slides"
            )[lanes]
        return tip, goal, magnet

    def advance(self, action: np.ndarray) -> np.ndarray:
        """One control period: action (n, size) → what it is worth, `kernels.VALUE_FIELDS` rows over n lanes or more."""
        sim = self.sim
        self.actuation.write(action, sim.command)
        sim.advance()
        values = np.empty((kernels.VALUE_FIELDS, self._lanes.shape[1]))
        kernels.judge(
            sim.num_envs, sim.arrays.out, sim.arrays.trace, self.step_limit, self._weights, self._lanes, values
        )
        return values

    def step(self, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """One control period: action (n, size) → reward, terminated, truncated, info, every value an (n,) array."""
        values = self.advance(action)[:, : self.sim.num_envs]
        success, terminated, truncated = values[kernels.SUCCESS :] > 0.0
        return values[kernels.REWARD], terminated, truncated, self.info(values, success)

    def info(self, values: Sequence[Any], success: Any) -> dict[str, Any]:
        """A step's `info` from rows of `advance`, or from one lane's column of them."""
        return {
            "is_success": success,
            "cost": values[kernels.COST],
            "wall_force": values[kernels.WALL_FORCE],
            "path_ratio": values[kernels.PATH_RATIO],
            **{name: values[row] for name, row in self._terms},
        }

    def summary(self, lanes: np.ndarray) -> dict[str, np.ndarray]:
        """Of the episodes just ended in `lanes`, in arrays (n,): steps, time (s), forces (N), travel (rad and m)."""
        sim = self.sim
        rows = np.zeros((len(kernels.SUMMARY), sim.num_envs))
        kernels.summarise(lanes, sim.arrays.trace, sim.control_period, self._lanes, rows)
        summary = dict(zip(kernels.SUMMARY, rows, strict=True))
        summary["steps"] = rows[0].astype(np.int64)
        return summary

    def observe(self) -> np.ndarray:
        """(n, size) float32."""
        return self.observer.read(self._lanes)


def _scenarios(task: Task, given: Any, coupling: str | None) -> list[Scenario]:
    if given is None:
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
