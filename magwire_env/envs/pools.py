"""The pools of scenarios that tasks draw from: of tracts, certified by the locked wire's theory, and of trees."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..physics.checks import one_of, whole
from ..quasistatic import pool
from ..scenario import Scenario
from ..simulation.model import model_names
from .trees import FORESTS, TREES, tree_pool

if TYPE_CHECKING:
    from .task import Task

__all__ = ["TREES", "example", "scenario_pool", "scenarios_of"]


def scenario_pool(kind: str, split: str = "train", size: int = 100, seed: int = 0) -> tuple[Scenario, ...]:
    """`size` certified scenarios of a kind, see `magwire_env.quasistatic.pool` and `magwire_env.envs.trees`."""
    one_of("kind", kind, (*pool.RECIPES, *FORESTS))
    return tree_pool(split, size, seed, kind) if kind in FORESTS else pool.scenario_pool(kind, split, size, seed)


def example(kind: str) -> Scenario:
    """A scenario with the rig of a kind's; it need not be certified."""
    return tree_pool("train", 1, 0, kind)[0] if kind in FORESTS else pool.candidates(kind, "train", 1)[0]


def scenarios_of(
    task: Task, given: Any, coupling: str | None, model: str | None, split: str, pool_size: int
) -> list[Scenario]:
    """A task's scenarios: those given, or of its pool, or its own; with `coupling` and `model` if those are given.

    Raises `ValueError` for what is no scenario, and what there is none of.
    """
    if given is None and task.pool is not None:
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
    changes = {name: value for name, value in (("coupling", coupling), ("model", model)) if value is not None}
    if model is not None:
        one_of("model", model, model_names())
    return [dataclasses.replace(sc, **changes) for sc in scenarios] if changes else scenarios
