"""The one loop that plays episodes: in every lane of a batch, or in a single env, until all have ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .fitting import check_action, check_fit

__all__ = ["EVALUATION_SEED", "Policy", "Step", "built", "episodes"]

EVALUATION_SEED = 1_000_000
"""First of the evaluation's episode seeds; training uses seeds far below."""


class Policy(Protocol):
    """Anything with SB3's ``predict``."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]: ...


class World(Protocol):
    """What `episodes` needs of an env or batch; `num_envs` only of a batch."""

    def step(self, action: Any, /) -> tuple[Any, Any, Any, Any, dict[str, Any]]: ...


@dataclass(frozen=True, eq=False)
class Step:
    """One control period of n lanes.

    running : (n,) lanes whose episode was still going on in this period
    ended : (n,) lanes whose episode ended with this period
    reward, info : what the env returned; arrays over the lanes for a batch
    """

    running: np.ndarray
    ended: np.ndarray
    reward: Any
    info: dict[str, Any]


def built(policy: Any, env: Any) -> Policy:
    """The policy itself, or, of a callable that makes policies (such as ``MaxForce.from_env``), the one for `env`.

    Raises `ValueError`, naming both, for a policy that does not fit the env.
    """
    made = policy if hasattr(policy, "predict") else policy(env)
    if not hasattr(made, "predict"):
        raise ValueError(
            f"policy must have predict(observation, …), or make such a policy from an env, got {type(made).__name__}; "
            "agents.policies.Function makes a policy of a function of observations"
        )
    check_fit(made, env)
    return made


def episodes(env: World, policy: Policy, observation: Any, restarts: bool = True) -> Iterator[Step]:
    """Play the episodes that have just begun in `env`, each lane's to its end; yields after every control period.

    observation : of the reset
    restarts : a lane whose episode has ended begins another one by itself, which is not counted
    """
    n = getattr(env, "num_envs", 1)
    state, starts, running = None, np.ones(n, dtype=np.bool_), np.ones(n, dtype=np.bool_)
    while running.any():
        action, state = policy.predict(observation, state=state, episode_start=starts, deterministic=True)
        check_action(policy, env, observation, action)
        observation, reward, terminated, truncated, info = env.step(action)
        over = np.atleast_1d(np.logical_or(terminated, truncated))
        yield Step(running, running & over, reward, info)
        running = running & ~over
        starts = over if restarts else np.zeros(n, dtype=np.bool_)
