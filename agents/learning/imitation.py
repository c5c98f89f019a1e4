"""Imitation as a warm start: before PPO explores by itself, its policy learns what a controller would do.

In rounds, as DAgger does (Ross, Gordon and Bagnell 2011): the policy acts, the controller says what it would have done
in each of the states that were met, and the policy learns that from all rounds so far. In the first round the
controller acts. Then the critic learns what the policy's own last round was worth, so that PPO does not begin with
advantages that mean nothing.

The controller reads its own numbers, whatever the policy sees: the channels that its class asks for in `env_kwargs`,
such as `drive_preview`, or those that the task registers. So a policy that looks at an image, or at a few forces over
several frames, learns from one that knows the way (learning by cheating: Chen et al. 2019).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize
from torch.nn.functional import mse_loss

from magwire_env.envs.core import SteeringCore
from magwire_env.physics.checks import whole

from ..catalogue import CONTROLLERS
from .sb3 import schedule

__all__ = ["ROUNDS", "imitate"]

ROUNDS, EPOCHS = 4, 8
"""Rounds of a lesson, and how often each of them goes through all that was seen, unless the lesson says otherwise."""

_BATCH = 512
_RATE = 1e-3


class _Guide:
    """The controller beside the policy: it acts on the same lanes, on what it reads there itself."""

    def __init__(self, teacher: str, core: SteeringCore) -> None:
        asked, mode = getattr(CONTROLLERS[teacher], "env_kwargs", {}), core.actuation.mode
        if asked.get("action_mode", mode) != mode:
            raise ValueError(
                f"imitate.teacher must act as the policy does, under action_mode {mode!r}, "
                f"got {teacher!r}, which acts under {asked['action_mode']!r}"
            )
        own = core.beside(asked.get("observe", core.task.observe))
        self._policy = CONTROLLERS[teacher].from_env(SimpleNamespace(unwrapped=SimpleNamespace(core=own)))
        self._observer = own.observer
        self.state: Any = None

    def wanted(self, starts: np.ndarray) -> np.ndarray:
        """The actions (n, k) for the lanes as they are now; starts (n,) where an episode has just begun."""
        action, self.state = self._policy.predict(self._observer.read(), self.state, starts)
        return np.clip(action, -1.0, 1.0)


class _Seen:
    """Observations, kept as the env gave them: one array, or one for each part of a dict.

    size : how many there is room for
    """

    def __init__(self, size: int) -> None:
        self.size, self.count = size, 0
        self._parts: dict[str, np.ndarray] = {}
        self._alone = True

    def add(self, observation: Any) -> None:
        """Keep the observations of all lanes."""
        self._alone = not isinstance(observation, Mapping)
        parts = {"": observation} if self._alone else observation
        for name, part in parts.items():
            if name not in self._parts:
                self._parts[name] = np.empty((self.size, *part.shape[1:]), dtype=part.dtype)
            self._parts[name][self.count : self.count + len(part)] = part
        self.count += len(part)

    def __getitem__(self, rows: Any) -> Any:
        found = {name: part[: self.count][rows] for name, part in self._parts.items()}
        return found[""] if self._alone else found


def imitate(
    model: BaseAlgorithm,
    teacher: str,
    steps: int,
    rounds: int = ROUNDS,
    epochs: int = EPOCHS,
    learning_rate: float | str = _RATE,
) -> float:
    """Teach `model` what a controller does, in `steps` env steps altogether; returns the remaining error.

    teacher : a name of `agents.catalogue.CONTROLLERS`
    steps : at least one a lane and round
    rounds : in the first of them the teacher acts
    epochs : how often a round goes through all that was seen so far
    learning_rate : of Adam; "lin_1.0e-3" falls to 0 within every round, which leaves less of an error

    The error is the root mean square difference of the actions in the last round, before it is learnt from. The model's
    normalisation learns the observations' ranges on the way. All observations are kept till the end: 65 536 images of
    84 × 84 take 460 MB. Raises `ValueError` for an algorithm that cannot be taught so.
    """
    venv = model.env
    if not isinstance(model, OnPolicyAlgorithm) or not isinstance(venv, VecNormalize):
        raise ValueError(f"imitate must teach ppo under running normalisation, got {type(model).__name__}")
    if teacher not in CONTROLLERS:
        raise ValueError(f"imitate.teacher must be one of {', '.join(CONTROLLERS)}, got {teacher!r}")
    whole("imitate.rounds", rounds, 1), whole("imitate.epochs", epochs, 1)
    rate = schedule("imitate.learning_rate", learning_rate)
    length = whole("imitate.steps", steps, rounds * venv.num_envs) // (rounds * venv.num_envs)
    native: Any = venv.venv.venv if isinstance(venv.venv, VecFrameStack) else venv.venv
    guide = _Guide(teacher, native.env.core)
    seen, told = _Seen(rounds * length * venv.num_envs), []
    learning = _Learning(model, venv, seen, epochs, rate)
    for number in range(rounds):
        own, wanted, rewards, ends = _round(model, venv, guide, length, seen, teacher_acts=number == 0)
        told.append(wanted)
        learning.actions(np.concatenate(told))
    learning.values(rewards, ends)
    return float(np.sqrt(np.mean((np.clip(own, -1.0, 1.0) - wanted) ** 2)))


def _round(
    model: OnPolicyAlgorithm, venv: VecNormalize, guide: _Guide, length: int, seen: _Seen, teacher_acts: bool
) -> tuple[np.ndarray, ...]:
    """`length` steps of all lanes, whose raw observations go into `seen`: the policy's mean actions and the teacher's,
    (length · n, …), then normalised rewards and ends (length, n)."""
    observation: Any = venv.reset()
    starts, guide.state = np.ones(venv.num_envs, dtype=np.bool_), None
    own, told, rewards, ends = [], [], [], []
    for _ in range(length):
        wanted = guide.wanted(starts)
        drawn, _ = model.predict(observation, deterministic=False)
        mean, _ = model.predict(observation, deterministic=True)
        seen.add(venv.get_original_obs())
        own.append(mean)
        told.append(wanted)
        observation, reward, starts, _ = venv.step(wanted if teacher_acts else drawn)
        rewards.append(reward)
        ends.append(starts)
    return np.concatenate(own), np.concatenate(told), np.array(rewards), np.array(ends)


@dataclass(frozen=True, eq=False)
class _Learning:
    """Least squares on what was seen, in batches.

    epochs : how often all of it is gone through
    rate : the learning rate, of the share of the epochs that remains
    """

    model: OnPolicyAlgorithm
    venv: VecNormalize
    seen: _Seen
    epochs: int
    rate: Callable[[float], float]

    def actions(self, wanted: np.ndarray) -> None:
        """Bring the mean of the policy's actions to the wanted ones."""
        policy = self.model.policy
        rows = np.arange(self.seen.count)
        self._fit(policy.parameters(), lambda part: policy.get_distribution(part).mode(), rows, wanted)

    def values(self, rewards: np.ndarray, ends: np.ndarray) -> None:
        """Bring the critic to the discounted rewards that followed in the last round; what comes after it is left out.

        What looks at an image is shared with the actor, and stays as it is.
        """
        length, gamma = len(rewards), self.model.gamma
        returns, ahead = np.zeros_like(rewards, dtype=np.float64), np.zeros(rewards.shape[1])
        for step in range(length - 1, -1, -1):
            ahead = rewards[step] + gamma * ahead * ~ends[step]
            returns[step] = ahead
        kept = max(1, length - int(2.0 / (1.0 - gamma)))
        rows = self.seen.count - rewards.size + np.arange(kept * rewards.shape[1])
        policy: Any = self.model.policy
        own = [*policy.mlp_extractor.value_net.parameters(), *policy.value_net.parameters()]
        self._fit(own, lambda part: policy.predict_values(part).flatten(), rows, returns[:kept].ravel())

    def _fit(
        self, parameters: Iterable[Any], answer: Callable[[Any], torch.Tensor], rows: np.ndarray, wanted: np.ndarray
    ) -> None:
        """Bring what the model answers to the observations `rows` (n,) to `wanted` (n, …)."""
        right = torch.as_tensor(wanted, dtype=torch.float32)
        optimizer = torch.optim.Adam(parameters, lr=self.rate(1.0))
        for epoch in range(self.epochs):
            for group in optimizer.param_groups:
                group["lr"] = self.rate(1.0 - epoch / self.epochs)
            for batch in torch.randperm(len(rows)).split(_BATCH):
                observation = self.venv.normalize_obs(self.seen[rows[batch.numpy()]])
                optimizer.zero_grad()
                mse_loss(answer(self.model.policy.obs_to_tensor(observation)[0]), right[batch]).backward()
                optimizer.step()
