"""Imitation as a warm start: before PPO explores by itself, its policy learns what a controller would do.

In rounds, as DAgger does (Ross, Gordon and Bagnell 2011): the policy acts, the controller says what it would have done
in each of the states that were met, and the policy learns that from all rounds so far. In the first round the
controller acts. Then the critic learns what the policy's own last round was worth, so that PPO does not begin with
advantages that mean nothing.

The controller may see more than the policy: what the class's `env_kwargs` ask for, `drive_preview` for example. The
policy then learns to act by what it sees as if it saw that (learning by cheating: Chen et al. 2019).
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize
from torch.nn.functional import mse_loss

from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.physics.checks import whole

from ..catalogue import CONTROLLERS
from .sb3 import NativeVecEnv, schedule

__all__ = ["imitate"]

_ROUNDS = 4
_EPOCHS = 8
_BATCH = 512
_RATE = 1e-3


def imitate(model: BaseAlgorithm, teacher: str, steps: int, learning_rate: float | str = _RATE) -> float:
    """Teach `model` what a controller does, in `steps` env steps altogether; returns the remaining error.

    teacher : a name of `agents.catalogue.CONTROLLERS`
    steps : at least one a lane and round
    learning_rate : of Adam; "lin_1.0e-3" falls to 0 within every round, which leaves less of an error

    The error is the root mean square difference of the actions in the last round, before it is learnt from. The model's
    normalisation learns the observations' ranges on the way. Raises `ValueError` for an algorithm or observation that
    cannot be taught so.
    """
    venv = model.env
    if not isinstance(model, OnPolicyAlgorithm) or not isinstance(venv, VecNormalize):
        raise ValueError(f"imitate must teach ppo under running normalisation, got {type(model).__name__}")
    if not isinstance(venv.venv, NativeVecEnv):
        raise ValueError("imitate must teach a policy that sees single frames, got frame_stack above 1")
    if not isinstance(venv.observation_space, Box):
        raise ValueError("imitate must teach a policy that sees numbers alone, got an image among its observations")
    if teacher not in CONTROLLERS:
        raise ValueError(f"imitate.teacher must be one of {', '.join(CONTROLLERS)}, got {teacher!r}")
    rate = schedule("imitate.learning_rate", learning_rate)
    length = whole("imitate.steps", steps, _ROUNDS * venv.num_envs) // (_ROUNDS * venv.num_envs)
    guide = _Teacher(teacher, venv.venv.env)
    seen: list[np.ndarray] = []
    told: list[np.ndarray] = []
    for number in range(_ROUNDS):
        observations, own, wanted, rewards, ends = _round(model, venv, guide, length, teacher_acts=number == 0)
        seen.append(observations)
        told.append(wanted)
        _learn_actions(model, _normalized(venv, np.concatenate(seen)), np.concatenate(told), rate)
    _learn_values(model, venv, observations, rewards, ends, rate)
    return float(np.sqrt(np.mean((np.clip(own, -1.0, 1.0) - wanted) ** 2)))


class _Teacher:
    """A controller over the lanes of a pupil's env, with channels of its own where its class asks for them.

    What it sees of its own is free of the readings' errors.
    """

    def __init__(self, name: str, env: MagWireVectorEnv) -> None:
        kind, shown, self._observer = CONTROLLERS[name], env, None
        asked = getattr(kind, "env_kwargs", {})
        mode = env.core.actuation.mode
        if asked.get("action_mode", mode) != mode:
            raise ValueError(
                f"imitate.teacher must act as the policy does, under action_mode {mode!r}, "
                f"got {name!r}, which acts under {asked['action_mode']!r}"
            )
        if "observe" in asked:
            shown = copy.copy(env)
            shown.core = env.core.shown_as(asked["observe"])
            self._observer = shown.core.observer
        self._controller = kind.from_env(shown)

    def predict(self, raw: Any, state: Any, starts: np.ndarray) -> tuple[np.ndarray, Any]:
        """What it does now: raw (n, size), the policy's observations as they were before their normalisation."""
        return self._controller.predict(raw if self._observer is None else self._observer.read(), state, starts)


def _round(
    model: OnPolicyAlgorithm, venv: VecNormalize, guide: _Teacher, length: int, teacher_acts: bool
) -> tuple[np.ndarray, ...]:
    """`length` steps of all lanes: raw observations, the policy's mean actions and the teacher's, (length · n, …), then
    normalised rewards and ends (length, n)."""
    observation: Any = venv.reset()
    raw, state, starts = venv.get_original_obs(), None, np.ones(venv.num_envs, dtype=np.bool_)
    seen, own, told, rewards, ends = [], [], [], [], []
    for _ in range(length):
        wanted, state = guide.predict(raw, state, starts)
        drawn, _ = model.predict(observation, deterministic=False)
        mean, _ = model.predict(observation, deterministic=True)
        seen.append(np.array(raw))
        own.append(mean)
        told.append(np.clip(wanted, -1.0, 1.0))
        observation, reward, starts, _ = venv.step(wanted if teacher_acts else drawn)
        raw = venv.get_original_obs()
        rewards.append(reward)
        ends.append(starts)
    return np.concatenate(seen), np.concatenate(own), np.concatenate(told), np.array(rewards), np.array(ends)


def _learn_actions(
    model: OnPolicyAlgorithm, observations: np.ndarray, actions: np.ndarray, rate: Callable[[float], float]
) -> None:
    """Bring the mean of the policy's actions to the wanted ones, by least squares."""
    _fit(model, lambda seen: model.policy.get_distribution(seen).mode(), observations, actions, rate)


def _learn_values(
    model: OnPolicyAlgorithm,
    venv: VecNormalize,
    observations: np.ndarray,
    rewards: np.ndarray,
    ends: np.ndarray,
    rate: Callable[[float], float],
) -> None:
    """Bring the critic to the discounted rewards that followed; what comes after the round is left out of it."""
    length = len(rewards)
    returns, ahead = np.zeros_like(rewards, dtype=np.float64), np.zeros(rewards.shape[1])
    for step in range(length - 1, -1, -1):
        ahead = rewards[step] + model.gamma * ahead * ~ends[step]
        returns[step] = ahead
    kept = max(1, length - int(2.0 / (1.0 - model.gamma)))
    seen = _normalized(venv, observations[: kept * venv.num_envs])
    _fit(model, lambda part: model.policy.predict_values(part).flatten(), seen, returns[:kept].ravel(), rate)


def _fit(
    model: OnPolicyAlgorithm,
    answer: Callable[[torch.Tensor], torch.Tensor],
    observations: np.ndarray,
    wanted: np.ndarray,
    rate: Callable[[float], float],
) -> None:
    """Bring what the model answers to observations (n, size) to `wanted` (n, …), by least squares in batches.

    rate : the learning rate, of the share of the epochs that remains
    """
    seen, right = (torch.as_tensor(v, dtype=torch.float32) for v in (observations, wanted))
    optimizer = torch.optim.Adam(model.policy.parameters(), lr=rate(1.0))
    for epoch in range(_EPOCHS):
        for group in optimizer.param_groups:
            group["lr"] = rate(1.0 - epoch / _EPOCHS)
        for rows in torch.randperm(len(seen)).split(_BATCH):
            optimizer.zero_grad()
            mse_loss(answer(seen[rows]), right[rows]).backward()
            optimizer.step()


def _normalized(venv: VecNormalize, observations: np.ndarray) -> np.ndarray:
    normalized = venv.normalize_obs(observations)
    assert isinstance(normalized, np.ndarray)  # of a Box
    return normalized
