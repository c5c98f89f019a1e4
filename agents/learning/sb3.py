"""Learning with Stable-Baselines3: the native batch as its vec env, and models that keep their normalisation.

A trained model is a folder with ``model.zip`` (SB3's own), ``normalization.pkl`` (running means of the training) and
``model.json`` (task, algorithm, env settings, number of stacked frames). `load` returns a policy that applies them all.
"""

from __future__ import annotations

import importlib
import json
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import yaml
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.envs.task import TASKS, RewardWeights
from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.physics.checks import one_of

from .config import ALGORITHMS

__all__ = [
    "NativeVecEnv",
    "TrainedPolicy",
    "frozen",
    "hyperparameters",
    "load",
    "load_parts",
    "make_model",
    "make_vec_env",
    "save",
]

_YAML = Path(__file__).parents[1] / "hyperparameters"


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

    def reset(self) -> np.ndarray:
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

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
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
                "terminal_observation": final[lane],
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


def make_vec_env(
    task: str, n_envs: int, seed: int | None = None, frame_stack: int = 1, **settings: Any
) -> NativeVecEnv | VecFrameStack:
    """The native batch of `task` for SB3.

    frame_stack : an observation is so many frames one after the other, the newest last
    settings : of the env; ``reward`` may be a dict of `RewardWeights`, as in a YAML
    """
    if isinstance(settings.get("reward"), dict):
        settings["reward"] = RewardWeights(**settings["reward"])
    env = gym.make_vec(task, num_envs=n_envs, autoreset_mode="SameStep", **settings).unwrapped
    if not isinstance(env, MagWireVectorEnv):
        raise ValueError(f"task must be an id of MagWire/…, got {task!r}")
    venv = NativeVecEnv(env, seed)
    return VecFrameStack(venv, frame_stack) if frame_stack > 1 else venv


def make_model(
    algorithm: str, venv: VecEnv, seed: int, settings: dict[str, Any], tensorboard: Path | None = None
) -> BaseAlgorithm:
    """An untrained SB3 model on `venv` under running normalisation.

    settings : as in the YAML, without those of the batch
    """
    settings = dict(settings)
    normalize = settings.pop("normalize", {})
    if "learning_rate" in settings and isinstance(settings["learning_rate"], str):
        settings["learning_rate"] = _schedule(settings["learning_rate"])
    policy_kwargs = dict(settings.pop("policy_kwargs", {}))
    if "activation_fn" in policy_kwargs:
        import torch

        policy_kwargs["activation_fn"] = getattr(torch.nn, policy_kwargs["activation_fn"])
    normalized = VecNormalize(venv, gamma=settings.get("gamma", 0.99), **normalize)
    return _class_of(algorithm)(
        "MlpPolicy",
        normalized,
        seed=seed,
        policy_kwargs=policy_kwargs,
        tensorboard_log=None if tensorboard is None else str(tensorboard),
        device="cpu",
        **settings,
    )


def _class_of(algorithm: str) -> type[BaseAlgorithm]:
    package, name = ALGORITHMS[algorithm]
    return getattr(importlib.import_module(package), name)


def _schedule(text: str) -> Callable[[float], float]:
    """The schedule of rl-zoo's ``lin_3e-4``, which falls linearly to 0 over the training."""
    kind, _, value = text.partition("_")
    if kind != "lin":
        raise ValueError(f"learning_rate must be a number or 'lin_<number>', got {text!r}")
    initial = float(value)
    return lambda remaining: remaining * initial


class TrainedPolicy:
    """A trained model with its normalisation: SB3's ``predict`` on the env's raw observations.

    A model that was trained on stacked frames keeps the frames in its state.
    """

    def __init__(self, model: BaseAlgorithm, normalization: VecNormalize | None, meta: dict[str, Any]) -> None:
        self.model, self.normalization, self.meta = model, normalization, meta
        self._frames = int(meta.get("frame_stack", 1))

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """SB3's form: observation (size,) or (n, size) → action and state."""
        if self._frames > 1:
            observation = state = self._stacked(observation, state, episode_start)
        if self.normalization is not None:
            normal = self.normalization.normalize_obs(observation)
        else:
            normal = observation
        action, own = self.model.predict(normal, state=state, episode_start=episode_start, deterministic=deterministic)
        return action, state if self._frames > 1 else own

    def _stacked(self, observation: np.ndarray, frames: np.ndarray | None, starts: np.ndarray | None) -> np.ndarray:
        """The last frames, (…, frames · size), the newest last; where an episode starts, the others are 0."""
        size = np.shape(observation)[-1]
        if frames is None:
            frames = np.zeros((*np.shape(observation)[:-1], self._frames * size), dtype=np.float32)
        elif starts is not None:
            frames = np.where(np.reshape(starts, np.shape(observation)[:-1])[..., None], np.float32(0.0), frames)
        return np.concatenate([frames[..., size:], observation], axis=-1)


def frozen(model: BaseAlgorithm, meta: dict[str, Any]) -> TrainedPolicy:
    """The policy of a model as it is now, for an evaluation during the training."""
    return TrainedPolicy(model, model.get_vec_normalize_env(), meta)


def save(model: BaseAlgorithm, folder: Path, meta: dict[str, Any]) -> None:
    """Write a model folder; each file gets its name only when it is complete."""
    folder.mkdir(parents=True, exist_ok=True)
    _atomically(folder / "model.zip", lambda path: model.save(path))
    normalization = model.get_vec_normalize_env()
    if normalization is not None:
        _atomically(folder / "normalization.pkl", lambda path: normalization.save(str(path)))
    _atomically(folder / "model.json", lambda path: path.write_text(json.dumps(meta, indent=2), encoding="utf-8"))


def load(folder: str | Path) -> TrainedPolicy:
    """The policy saved in `folder`: a model folder, or a run folder, of which it takes the best model.

    Raises `FileNotFoundError` for a missing file and `ValueError` for a truncated or foreign one; both name the file.
    """
    model, normalization, meta = load_parts(folder)
    return TrainedPolicy(model, normalization, meta)


def load_parts(
    folder: str | Path, venv: VecEnv | None = None
) -> tuple[BaseAlgorithm, VecNormalize | None, dict[str, Any]]:
    """Model, normalisation and meta of a saved folder; with `venv` they are ready for more training."""
    folder = Path(folder)
    if (folder / "best" / "model.zip").exists():
        folder = folder / "best"
    for name in ("model.zip", "model.json", "normalization.pkl"):
        if not (folder / name).exists():
            raise FileNotFoundError(f"{folder} holds no {name}: not a model folder, or a run that saved nothing yet")
    try:
        meta = json.loads((folder / "model.json").read_text(encoding="utf-8"))
        algorithm, task = _class_of(meta["algorithm"]), meta["task"]
    except (json.JSONDecodeError, KeyError, UnicodeDecodeError) as error:
        raise ValueError(f"{folder / 'model.json'} is damaged or of another program: {error}") from error
    env = meta.get("env", {})
    smallest = {"pool_size": 1} if "pool_size" in env else {}  # only its spaces are used
    try:
        dummy = venv or make_vec_env(task, 1, frame_stack=meta.get("frame_stack", 1), **(env | smallest))
    except (ValueError, TypeError, gym.error.Error) as error:
        raise ValueError(f"{folder / 'model.json'} asks for an env that cannot be made: {error}") from error
    try:
        normalization = VecNormalize.load(str(folder / "normalization.pkl"), dummy)
    except Exception as error:
        raise ValueError(f"{folder / 'normalization.pkl'} is damaged or of another program: {error}") from error
    if venv is None:
        normalization.training = False
    if not zipfile.is_zipfile(folder / "model.zip"):
        raise ValueError(f"{folder / 'model.zip'} is truncated or not a model file")
    try:
        model = algorithm.load(folder / "model.zip", env=normalization, device="cpu")
    except Exception as error:
        raise ValueError(f"{folder / 'model.zip'} is damaged or does not fit its task: {error}") from error
    return model, normalization, meta


def _atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` write a partial file, which then gets its name."""
    partial = path.with_name(path.name + ".part")
    write(partial)
    # SB3 appends .zip to names without it.
    written = partial if partial.exists() else partial.with_name(partial.name + ".zip")
    written.replace(path)
