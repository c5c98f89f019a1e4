"""Hyperparameters as they stand in ``agents/hyperparameters``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from magwire_env.envs.task import TASKS

__all__ = ["ALGORITHM_NAMES", "hyperparameters"]

ALGORITHM_NAMES = ("ppo", "sac", "tqc", "crossq", "stacked_ppo")

_YAML = Path(__file__).parents[1] / "hyperparameters"


def hyperparameters(algorithm: str, task: str) -> dict[str, Any]:
    """The task's entry of ``agents/hyperparameters/<algorithm>.yml``, on top of its ``default``.

    The env's settings stand in ``tasks.yml`` for all algorithms, and in the algorithm's own where it departs;
    ``training_env`` holds those of training alone, that no evaluation sees.
    """
    if algorithm not in ALGORITHM_NAMES:
        raise ValueError(f"algorithm must be one of {', '.join(map(repr, ALGORITHM_NAMES))}, got {algorithm!r}")
    # Keys with a leading dot are blocks that tasks share.
    entries, tasks = _entries(algorithm), _entries("tasks")
    found = {**entries["default"], **(entries.get(task) or {})}
    env = {**(tasks.get(task) or {}), **found.get("env", {})}
    if "pool_size" in env and (task not in TASKS or TASKS[task].pool is None):
        del env["pool_size"]  # one default serves tasks with a pool and without
    return {**found, "env": env}


def _entries(name: str) -> dict[str, Any]:
    return yaml.safe_load((_YAML / f"{name}.yml").read_text(encoding="utf-8"))
