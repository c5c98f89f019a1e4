"""Hyperparameters as they stand in ``agents/hyperparameters``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from magwire_env.envs.task import TASKS
from magwire_env.physics.checks import one_of

from .config import ALGORITHMS

__all__ = ["LESSON", "hyperparameters"]

LESSON = ("teacher", "steps", "rounds", "epochs", "learning_rate")
"""What a block ``imitate`` sets, see `agents.learning.imitation`; the last three have defaults."""

_YAML = Path(__file__).parents[1] / "hyperparameters"


def hyperparameters(algorithm: str, task: str) -> dict[str, Any]:
    """The task's entry of ``agents/hyperparameters/<algorithm>.yml``, on top of its ``default``.

    ``imitate`` has the settings of `LESSON`: what the policy learns from a controller before it learns by itself.
    A policy sees and does what its task registers, unless ``env`` in its algorithm's file says otherwise.
    ``training_env`` has settings for the training only; no evaluation uses them. A task's own stand in ``tasks.yml``.
    """
    one_of("algorithm", algorithm, tuple(ALGORITHMS))
    # Keys with a leading dot are blocks that tasks share.
    entries, tasks = _entries(algorithm), _entries("tasks")
    found = {**entries["default"], **(entries.get(task) or {})}
    env, training = dict(found.get("env", {})), {**(tasks.get(task) or {}), **found.get("training_env", {})}
    for settings in (env, training):
        if task not in TASKS or TASKS[task].pool is None:
            settings.pop("pool_size", None)  # the default also holds for tasks without a pool
    return {**found, "env": env, "training_env": training}


def _entries(name: str) -> dict[str, Any]:
    return yaml.safe_load((_YAML / f"{name}.yml").read_text(encoding="utf-8"))
