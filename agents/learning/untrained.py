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

_NOT_OF_THE_MODEL = ("n_envs", "n_timesteps", "env", "training_env", "frame_stack", "imitate")


def untrained(env: gym.Env | gym.vector.VectorEnv, algorithm: str = "ppo", seed: int = 0) -> PlainPolicy:
    """The policy of a task's hyperparameters with the weights that `seed` draws, for `env`."""
    core = env.unwrapped.core  # type: ignore[union-attr]
    settings: dict[str, Any] = hyperparameters(algorithm, core.task.id)
    own = {key: value for key, value in settings.items() if key not in _NOT_OF_THE_MODEL}
    own["batch_size"] = own["n_steps"]  # one lane gives no larger batch; nothing is learnt from it
    seen = {"action_mode": core.actuation.mode, "observe": core.shown.plain}
    venv = make_vec_env(core.task.id, 1, scenario=core.sim.scenarios[0], **seen)
    model = make_model(algorithm, venv, seed, own)
    meta = {
        "task": core.task.id, "algorithm": algorithm, "seed": seed, "env": seen,
        "scenario": text_for(core.task.id, None), "scenario_given": False,
    }  # fmt: skip
    return plain(model, about_model(model, meta))
