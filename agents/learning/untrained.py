"""The untrained policy: what ppo does before its first step of training. A floor, not a result."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from .export import about_model, plain
from .hyperparameters import hyperparameters
from .plain_policy import PlainPolicy
from .sb3 import make_model, make_vec_env
from .scenario_copy import text_for

__all__ = ["untrained"]

_NOT_OF_THE_MODEL = ("n_envs", "n_timesteps", "env", "training_env", "frame_stack")


def untrained(env: gym.Env | gym.vector.VectorEnv, algorithm: str = "ppo", seed: int = 0) -> PlainPolicy:
    """The policy of a task's hyperparameters with the weights that `seed` draws, for `env`."""
    task = env.unwrapped.core.task  # type: ignore[union-attr]
    settings: dict[str, Any] = hyperparameters(algorithm, task.id)
    own = {key: value for key, value in settings.items() if key not in _NOT_OF_THE_MODEL}
    own["batch_size"] = own["n_steps"]  # one lane gives no larger batch; nothing is learnt from it
    pool = {"pool_size": 1} if task.pool is not None else {}
    venv = make_vec_env(task.id, 1, **settings["env"], **pool)
    meta = {
        "task": task.id, "algorithm": algorithm, "seed": seed, "env": settings["env"],
        "scenario": text_for(task.id, None), "scenario_given": False,
    }  # fmt: skip
    model = make_model(algorithm, venv, seed, own)
    return plain(model, about_model(model, meta))
