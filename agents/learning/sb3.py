"""Learning with Stable-Baselines3: the native batch as its vec env, and models under running normalisation."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.envs.shown import of_lane
from magwire_env.envs.task import known_task
from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.physics.checks import one_of, positive

from .config import ALGORITHMS

__all__ = ["NativeVecEnv", "algorithm_class", "make_model", "make_vec_env", "schedule"]

_ACTIVATIONS = ("Tanh", "ReLU", "ELU", "LeakyReLU", "SiLU", "Sigmoid")
"""Names of `torch.nn` that ``activation_fn`` may be."""


_SMALLEST_IMAGE = 36
"""px; SB3's NatureCNN has no patch left in smaller ones."""


class NativeVecEnv(VecEnv):
    """The native batch as SB3 wants it: resets within the step, and a dict for every lane.

    Lanes whose episode goes on share one empty dict, since nothing reads it.
    """

    def __init__(self, env: MagWireVectorEnv, seed: int | None = None) -> None:
        if env.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode must be SAME_STEP for SB3, got {env.autoreset_mode}")
        self.env = env
        self._seed = seed
        self._quiet: dict[str, Any] = {}
        self._reward = np.zeros(env.num_envs)
        self._length = np.zeros(env.num_envs, dtype=np.int64)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        self._reward[:], self._length[:] = 0.0, 0
        observation, _ = self.env.reset(seed=self._seed)
        self._seed = None
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed the next reset: lane i gets seed + i."""
        self._seed = seed
        return [None if seed is None else seed + i for i in range(self.num_envs)]

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observation, reward, terminated, truncated, infos = self.env.step(self._actions)
        self._reward += reward
        self._length += 1
        done = terminated | truncated
        out = [self._quiet] * self.num_envs
        final = self.env.final_observation
        assert final is not None  # there since the first step, in SAME_STEP mode
        for lane in np.flatnonzero(done):
            last = infos["final_info"]
            out[lane] = {
                "terminal_observation": of_lane(final, int(lane)),
                "TimeLimit.truncated": bool(truncated[lane]),
                "is_success": bool(last["is_success"][lane]),
                "episode": {"r": float(self._reward[lane]), "l": int(self._length[lane]), "t": 0.0},
            }
        self._reward[done], self._length[done] = 0.0, 0
        return observation, reward.astype(np.float32), done, out

    def close(self) -> None:
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.env, attr_name)] * len(self._lanes(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        return [getattr(self.env, method_name)(*args, **kwargs)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        return [False] * len(self._lanes(indices))

    def _lanes(self, indices: Any) -> list[int]:
        return list(self._get_indices(indices))


def make_vec_env(
    task: str, n_envs: int, seed: int | None = None, frame_stack: int = 1, **settings: Any
) -> NativeVecEnv | VecFrameStack:
    """The native batch of `task` for SB3.

    frame_stack : an observation is so many frames one after the other, the newest last
    settings : of the env; with ``observe="fluoroscopy"`` the policy is SB3's "MultiInputPolicy"
    """
    env = gym.make_vec(known_task(task), num_envs=n_envs, autoreset_mode="SameStep", **settings).unwrapped
    assert isinstance(env, MagWireVectorEnv)
    venv = NativeVecEnv(env, seed)
    return VecFrameStack(venv, frame_stack) if frame_stack > 1 else venv


def make_model(
    algorithm: str, venv: VecEnv, seed: int, settings: dict[str, Any], tensorboard: Path | None = None
) -> BaseAlgorithm:
    """An untrained SB3 model on `venv` under running normalisation; an image is not normalised, and a CNN looks at it.

    settings : as in the YAML, without those of the batch

    Raises `ValueError` for an image that the algorithm, or SB3's CNN, cannot take.
    """
    settings = dict(settings)
    normalize = settings.pop("normalize", {})
    if "learning_rate" in settings and isinstance(settings["learning_rate"], str):
        settings["learning_rate"] = schedule("learning_rate", settings["learning_rate"])
    policy_kwargs = dict(settings.pop("policy_kwargs", {}))
    if "activation_fn" in policy_kwargs:
        import torch

        name = one_of("policy_kwargs.activation_fn", policy_kwargs["activation_fn"], _ACTIVATIONS)
        policy_kwargs["activation_fn"] = getattr(torch.nn, name)
    kind = "MlpPolicy"
    if isinstance(venv.observation_space, gym.spaces.Dict):
        kind, normalize = "MultiInputPolicy", _without_image(algorithm, venv.observation_space, normalize)
    normalized = VecNormalize(venv, gamma=settings.get("gamma", 0.99), **normalize)
    return algorithm_class(algorithm)(
        kind,
        normalized,
        seed=seed,
        policy_kwargs=policy_kwargs,
        tensorboard_log=None if tensorboard is None else str(tensorboard),
        device="cpu",
        **settings,
    )


def _without_image(algorithm: str, space: gym.spaces.Dict, normalize: dict[str, Any]) -> dict[str, Any]:
    """The normalisation's settings where there is an image beside the numbers, or an image alone."""
    if "MultiInputPolicy" not in algorithm_class(algorithm).policy_aliases:
        able = [name for name in ALGORITHMS if "MultiInputPolicy" in algorithm_class(name).policy_aliases]
        raise ValueError(f"algorithm must be one of {', '.join(able)} to see an image, got {algorithm!r}")
    if (size := space["image"].shape[1]) < _SMALLEST_IMAGE:  # type: ignore[index]
        raise ValueError(f"Fluoroscopy.size must be at least {_SMALLEST_IMAGE} for SB3's NatureCNN, got {size}")
    numbers = [name for name in space.spaces if name != "image"]
    return {**normalize, "norm_obs": normalize.get("norm_obs", True) and bool(numbers), "norm_obs_keys": numbers}


def algorithm_class(algorithm: str) -> type[BaseAlgorithm]:
    """The class of Stable-Baselines3 or its contributions that an algorithm has."""
    package, name = ALGORITHMS[algorithm]
    return getattr(importlib.import_module(package), name)


def schedule(name: str, rate: Any) -> Callable[[float], float]:
    """A learning rate as a function of the share of the training that remains: a number, or rl-zoo's ``lin_3e-4``,
    which falls linearly to 0. Raises `ValueError`, naming it, for anything else."""
    kind, _, value = rate.partition("_") if isinstance(rate, str) else ("", "", rate)
    try:
        initial = positive(name, float(value))
    except (TypeError, ValueError):
        kind = "?"
    if kind not in ("", "lin"):
        raise ValueError(f"{name} must be a number greater than 0 or 'lin_<number>', got {rate!r}")
    return (lambda remaining: remaining * initial) if kind else (lambda _: initial)
