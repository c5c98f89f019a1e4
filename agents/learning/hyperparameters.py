"""Hyperparameters as they stand in ``agents/hyperparameters``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from magwire_env.envs.task import TASKS
from magwire_env.physics.checks import one_of

from .config import ALGORITHMS

__all__ = ["hyperparameters"]

_YAML = Path(__file__).parents[1] / "hyperparameters"


def hyperparameters(algorithm: str, task: str) -> dict[str, Any]:
    """The task's entry of ``agents/hyperparameters/<algorithm>.yml``, on top of its ``default``.

    The env's settings are in ``tasks.yml`` for all algorithms, and in the algorithm's own file where they differ.
    ``training_env`` has settings for the training only; no evaluation uses them.
    """
    one_of("algorithm", algorithm, tuple(ALGORITHMS))
    # Keys with a leading dot are blocks that tasks share.
    entries, tasks = _entries(algorithm), _entries("tasks")
    found = {**entries["default"], **(entries.get(task) or {})}
    env = {**(tasks.get(task) or {}), **found.get("env", {})}
    if "pool_size" in env and (task not in TASKS or TASKS[task].pool is None):
        del env["pool_size"]  # the default also holds for tasks without a pool
    return {**found, "env": env}


def _entries(name: str) -> dict[str, Any]:
    return yaml.safe_load((_YAML / f"{name}.yml").read_text(encoding="utf-8"))
