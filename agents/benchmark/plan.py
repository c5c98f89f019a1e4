"""The benchmark's plan: which policies meet in which arenas, and the cells of work that follow from it.

A cell is one file under the output folder. It records the settings that it was made with, and is made again when they
differ. `cells` says what a cell computes, `jobs` runs the cells, `aggregates` sums them up.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import magwire_env
from magwire_env.envs.task import TASKS, Task
from magwire_env.physics.checks import whole

from ..catalogue import CONTROLLERS, FLOORS, NOT_OF_TRACTS, PAR, REFERENCE, controller, has_par, resolve
from ..evaluation.episodes import EVALUATION_SEED
from ..evaluation.robustness import DISTURBANCES
from ..learning.hyperparameters import hyperparameters

__all__ = ["ARENAS", "LEARNERS", "Arena", "Cell", "Learner", "Plan", "plain_name"]

ROBUSTNESS = {
    "Steer": (REFERENCE, "NetForce", "ExtremumSeeking", "ppo"),
    "SteerAny": ("NetForce", "ppo"),
}
"""Arena → policies of the robustness sweep; a trained policy takes part with its first seed.

MPPI, which plans online, is left out: its 29 disturbances would take half an hour of a core.
"""

ROBUSTNESS_EPISODES = 50
"""Number of episodes for each disturbance."""

DECISIONS = 100
"""Number of decisions that are timed, of controllers that plan online."""


@dataclass(frozen=True)
class Arena:
    """Where policies are compared.

    split : of a generated task's tracts; each of the first `episodes` tracts is used once
    scenario : shipped name, in place of the task's
    episodes : number of evaluation seeds
    controllers : names of those that play here; by default all
    models : name of the arena for which the trained policies of this arena were trained; by default this one
    par : name of the arena with the same episodes whose par counts here; by default this one
    reference : of an arena without a par, the controller whose time others' times are given over
    """

    name: str
    task: str
    split: str | None = None
    scenario: str | None = None
    episodes: int = 200
    controllers: tuple[str, ...] | None = None
    models: str | None = None
    par: str | None = None
    reference: str | None = None

    @property
    def env(self) -> dict[str, Any]:
        """Keyword arguments of the evaluation's env."""
        return {k: v for k, v in (("split", self.split), ("scenario", self.scenario)) if v is not None}

    @property
    def tracking(self) -> bool:
        return TASKS[self.task].kind.follows


@dataclass(frozen=True)
class Learner:
    """A learning algorithm, the arenas that it is trained for, and the number of training seeds."""

    algorithm: str
    arenas: tuple[str, ...]
    seeds: int


def plain_name(task: str) -> str:
    """``"MagWire/Steer-v1"`` → ``"Steer"``; with its version, such as ``"Steer-v0"``, if the task has a newer one."""
    stem = task.rpartition("-v")[0]
    versions = [int(other.rpartition("-v")[2]) for other in TASKS if other.rpartition("-v")[0] == stem]
    latest = task == f"{stem}-v{max(versions, default=0)}" or not versions
    return (stem if latest else task).rpartition("/")[2]


def _arena_of(task: Task) -> Arena:
    """The arena of a registered task."""
    name = plain_name(task.id)
    if task.pool is None:
        return Arena(name, task.id)
    return Arena(name, task.id, split="test", episodes=500 if name == "SteerAny" else 200)


_PLAYED = tuple(task for task in TASKS.values() if has_par(task.id) and "-v" not in plain_name(task.id))
"""Tasks of the benchmark, each in its newest version. It scores by the par; those of free wires have none."""

ARENAS: tuple[Arena, ...] = (
    *map(_arena_of, _PLAYED),
    Arena("SteerAny ood", "MagWire/SteerAny-v1", split="ood", models="SteerAny", episodes=100),
    Arena("Chase ood", "MagWire/Chase-v1", split="ood", models="Chase"),
    Arena(
        "SteerAny force only", "MagWire/SteerAny-v1", split="test", episodes=500,
        controllers=("ExtremumSeeking", *FLOORS), par="SteerAny",
    ),
)  # fmt: skip
"""An arena for every task of the benchmark, then variants."""

_FORCE_ONLY = ("SteerAny force only",)

_LEARNED = tuple(a.name for a in ARENAS if a.models is None and a.controllers is None)

_KNOWING = ("SteerAny", "Orient", "Chase", "Dual")
"""Arenas whose tracts a policy that sees a force model can make use of."""

LEARNERS: tuple[Learner, ...] = (
    Learner("ppo", _LEARNED, 5),
    Learner("knows_ppo", _KNOWING, 1),
    Learner("sac", ("Steer",), 1),
    Learner("tqc", ("Steer",), 1),
    Learner("crossq", ("Steer",), 1),
    Learner("stacked_ppo", _FORCE_ONLY, 1),
)
"""PPO has five training seeds. The others stand beside it and have one: together they take as long as PPO does, and one
seed says nothing of how much seeds differ."""


@lru_cache
def code_digest(learns: bool = True) -> str:
    """Digest of the source that results stand on: the package and the agents, without pictures, commands and report.

    learns : with the source of learning, which no controller's result depends on
    """
    without = _NO_RESULTS if learns else (*_NO_RESULTS, _LEARNING)
    digest = hashlib.sha256()
    for root in (Path(magwire_env.__file__).parent, Path(__file__).parents[1]):
        for file in sorted(root.rglob("*.py")):
            where = file.relative_to(root.parent).as_posix()
            if not where.startswith(without):
                digest.update(where.encode() + file.read_bytes())
    return digest.hexdigest()[:16]


@lru_cache
def content_of(policy: str) -> str:
    """Digest of the files that a policy from outside the package is made of; of a name, of nothing."""
    place, path = policy.rpartition(":")[0], Path(policy)
    if path.exists():
        files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    elif place.endswith(".py"):
        files = [Path(place)]
    else:
        spec = importlib.util.find_spec(place) if place else None
        files = [Path(spec.origin)] if spec is not None and spec.origin is not None else []
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()[:16]


_NO_RESULTS = (
    "magwire_env/render/", "magwire_env/figures/", "magwire_env/validation/", "agents/cli/", "agents/benchmark/",
)  # fmt: skip
"""Code that no number of the benchmark depends on; what its cells compute follows from the rest."""

_LEARNING = "agents/learning/"


@dataclass(frozen=True)
class Cell:
    """One piece of work, and the file with its result.

    kind : "train", "evaluate", "par", "decide" or "robustness"
    seed : training seed of a trained policy; None for a controller
    """

    kind: str
    arena: str
    policy: str
    seed: int | None = None

    @property
    def name(self) -> str:
        return f"{self.kind} {self.arena} {self.policy}" + ("" if self.seed is None else f" seed {self.seed}")

    @property
    def stem(self) -> str:
        words = [self.arena.replace(" ", "_"), re.sub(r"[^\w.+-]+", ".", self.policy)]
        return "-".join(words if self.seed is None else [*words, f"seed{self.seed}"])

    def file(self, out: Path) -> Path:
        """The record."""
        return out / self.kind / f"{self.stem}.json"

    def run(self, out: Path) -> Path:
        """The run folder of a training cell."""
        return out / "runs" / self.stem

    def log(self, out: Path) -> Path:
        """What the cell printed while it was made, and its traceback if it failed."""
        return out / "logs" / f"{self.kind}-{self.stem}.log"


@dataclass(frozen=True)
class Plan:
    """All cells, and what they are made with.

    extra : further policies, as every command takes them (`agents.catalogue.resolve`), that play in every arena open to
        all
    trust : also open those of them that can carry a program
    episodes, timesteps, seeds : upper limits on the arenas' and learners' own numbers, to try things out
    """

    arenas: tuple[Arena, ...] = ARENAS
    learners: tuple[Learner, ...] = LEARNERS
    robustness: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: ROBUSTNESS)
    extra: tuple[str, ...] = ()
    trust: bool = False
    episodes: int | None = None
    timesteps: int | None = None
    seeds: int | None = None

    def __post_init__(self) -> None:
        for name in ("episodes", "timesteps", "seeds"):
            if getattr(self, name) is not None:
                whole(name, getattr(self, name), 1)
        for name in self.extra:
            resolve(name, trust=self.trust)

    def arena(self, name: str) -> Arena:
        """The arena of this name."""
        return next(arena for arena in self.arenas if arena.name == name)

    def episodes_of(self, arena: Arena) -> int:
        return min(arena.episodes, self.episodes or arena.episodes)

    def controllers(self, arena: Arena) -> list[str]:
        """Names of the controllers that play in an arena, without the par."""
        if arena.controllers is not None:
            return [name for name in CONTROLLERS if name in arena.controllers]
        return [name for name in dict.fromkeys((*CONTROLLERS, *self.extra)) if name not in (PAR, *NOT_OF_TRACTS)]

    def plans_online(self, policy: str) -> bool:
        """The policy is a controller that runs the simulator for every decision."""
        return bool(getattr(controller(policy), "plans_online", False))

    def is_floor(self, policy: str) -> bool:
        """The policy is a controller that sees nothing, or an untrained one."""
        kind = controller(policy)
        return bool(getattr(kind, "sees_nothing", False) or getattr(kind, "floor", False))

    def trained(self, arena: Arena) -> dict[str, list[Cell]]:
        """Algorithm → the training cells, one for each seed, whose models play in an arena."""
        home = arena.models or arena.name
        return {
            learner.algorithm: [
                Cell("train", home, learner.algorithm, seed)
                for seed in range(min(learner.seeds, self.seeds or learner.seeds))
            ]
            for learner in self.learners
            if home in learner.arenas
        }

    def par(self, arena: Arena) -> Cell | None:
        """The cell whose par counts in an arena; None in one that has a reference in its place."""
        return None if arena.reference is not None else Cell("par", arena.par or arena.name, PAR)

    def cells(self) -> list[Cell]:
        """All cells; a cell comes after those that it needs."""
        cells: list[Cell] = []
        for arena in self.arenas:
            cells += [cell for seeds in self.trained(arena).values() for cell in seeds]
        for arena in self.arenas:
            par = self.par(arena)
            cells += [] if par is None else [par]
            cells += [Cell("evaluate", arena.name, name) for name in self.controllers(arena)]
            for algorithm, seeds in self.trained(arena).items():
                cells += [Cell("evaluate", arena.name, algorithm, cell.seed) for cell in seeds]
            for name in self.robustness.get(arena.name, ()):
                if name in CONTROLLERS or name in self.trained(arena):
                    cells.append(Cell("robustness", arena.name, name, None if name in CONTROLLERS else 0))
        for arena in map(_arena_of, _PLAYED):
            if any(a.name == arena.name for a in self.arenas):
                cells += [
                    Cell("decide", arena.name, name) for name in self.controllers(arena) if self.plans_online(name)
                ]
        return list(dict.fromkeys(cells))

    def training_of(self, cell: Cell) -> Cell | None:
        """The cell that trains this cell's policy; None for a controller's cell and for a training cell."""
        if cell.kind == "train" or cell.seed is None:
            return None
        return Cell("train", self.arena(cell.arena).models or cell.arena, cell.policy, cell.seed)

    def settings(self, cell: Cell) -> dict[str, Any]:
        """Everything that a cell's result depends on, the code among it."""
        return self._numbers(cell) | {"code": code_digest(self._learns(cell))}

    def _learns(self, cell: Cell) -> bool:
        """The cell's policy is a network, or may hold one."""
        return cell.kind == "train" or cell.seed is not None or cell.policy in ("untrained", *self.extra)

    def _numbers(self, cell: Cell) -> dict[str, Any]:
        """The settings without the code."""
        arena = self.arena(cell.arena)
        if cell.kind == "train":
            found = hyperparameters(cell.policy, arena.task)
            if self.timesteps is not None:
                found["n_timesteps"] = min(self.timesteps, found["n_timesteps"])
            return {"task": arena.task, "scenario": arena.scenario, "algorithm": cell.policy, "seed": cell.seed,
                    "hyperparameters": found}  # fmt: skip
        settings: dict[str, Any] = {"task": arena.task, "env": arena.env, "policy": cell.policy}
        if cell.policy in self.extra:
            settings["content"] = content_of(cell.policy)
        if cell.kind == "decide":
            return settings | {"decisions": DECISIONS}
        settings |= {"episodes": self.episodes_of(arena), "first_seed": EVALUATION_SEED}
        training = self.training_of(cell)
        if training is not None:
            settings["trained"] = self._numbers(training)
        if cell.kind == "robustness":
            settings["episodes"] = min(settings["episodes"], ROBUSTNESS_EPISODES)
            settings["disturbances"] = [one.name for one in DISTURBANCES]
        return settings

    def record(self, cell: Cell, out: Path) -> dict[str, Any] | None:
        """The record of a finished cell; None if there is none, or one that was made with other settings."""
        file = cell.file(out)
        if not file.exists():
            return None
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
        except json.JSONDecodeError as error:
            raise ValueError(f"{file} is damaged, delete it: {error}") from error
        return record if record.get("settings") == json.loads(json.dumps(self.settings(cell))) else None

    def state(self, cell: Cell, out: Path) -> str:
        """ "finished", "missing", or "outdated" for a record of other settings."""
        if self.record(cell, out) is not None:
            return "finished"
        return "outdated" if cell.file(out).exists() else "missing"
