"""All that a training's future depends on, taken and put back: it goes on as if it had never been stopped.

Taken between two rollouts, where no half-used buffer is under way: parameters, optimisers, normalisation, counters,
replay buffer, the episodes under way and every random source.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.vec_env import VecFrameStack

from magwire_env.envs.lanes_state import lanes_state, load_lanes

from .sb3 import NativeVecEnv

__all__ = ["put_back", "taken"]

_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")
_LAST = ("_last_obs", "_last_original_obs", "_last_episode_starts")
_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def taken(model: BaseAlgorithm) -> dict[str, Any]:
    """The state of a model and its env between two rollouts, as plain values and arrays."""
    return {
        "parameters": model.get_parameters(),
        "variables": {name: recursive_getattr(model, name).data for name in _variables(model)},
        "counters": {name: getattr(model, name) for name in _COUNTERS},
        "last": {name: getattr(model, name, None) for name in _LAST},
        "episodes": [dict(info) for info in model.ep_info_buffer or ()],
        "successes": [bool(one) for one in model.ep_success_buffer or ()],
        "normalization": _normalization(model),
        "replay": _replay(model),
        "env": _env(model),
        "random": {
            "torch": torch.get_rng_state(),
            "numpy": np.random.get_state(legacy=False),  # noqa: NPY002  (what Stable-Baselines3 draws from)
            "actions": model.action_space.np_random.bit_generator.state,
        },
    }


def put_back(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Bring a new model of the same settings, on a new env of the same, to a state that was `taken`.

    Raises `ValueError` for a state that does not fit.
    """
    try:
        model.set_parameters(state["parameters"], exact_match=True, device="cpu")
        for name in _variables(model):
            recursive_getattr(model, name).data.copy_(state["variables"][name])
        for name in _COUNTERS:
            setattr(model, name, state["counters"][name])
        for name in _LAST:
            setattr(model, name, state["last"][name])
        window = model._stats_window_size
        model.ep_info_buffer = deque(state["episodes"], maxlen=window)
        model.ep_success_buffer = deque(state["successes"], maxlen=window)
        _put_normalization(model, state["normalization"])
        _put_replay(model, state["replay"])
        _put_env(model, state["env"])
        random = state["random"]
        torch.set_rng_state(random["torch"])
        np.random.set_state(random["numpy"])  # noqa: NPY002
        model.action_space.np_random.bit_generator.state = random["actions"]
    except (KeyError, TypeError, AttributeError, IndexError, RuntimeError) as error:
        raise ValueError(f"the state does not fit this training: {type(error).__name__}: {error}") from error


def _variables(model: BaseAlgorithm) -> list[str]:
    """Names of tensors that belong to no module, such as the entropy coefficient."""
    return model._get_torch_save_params()[1]


def _normalization(model: BaseAlgorithm) -> dict[str, Any] | None:
    env: Any = model.get_vec_normalize_env()
    if env is None:
        return None
    means = {name: {"mean": rms.mean, "var": rms.var, "count": rms.count} for name, rms in _means(env).items()}
    return means | {"returns": env.returns, "old_obs": env.old_obs, "old_reward": env.old_reward}


def _means(env: Any) -> dict[str, Any]:
    """The running means of a `VecNormalize` by name; those of an observation in parts one by one."""
    found = {name: rms for name in ("obs_rms", "ret_rms") if (rms := getattr(env, name, None)) is not None}
    parts = found.get("obs_rms")
    if isinstance(parts, dict):
        del found["obs_rms"]
        found |= {f"obs_rms.{name}": rms for name, rms in parts.items()}
    return found


def _put_normalization(model: BaseAlgorithm, state: dict[str, Any] | None) -> None:
    env: Any = model.get_vec_normalize_env()
    if (env is None) != (state is None):
        raise ValueError("the state does not fit this training: one of them is without normalisation")
    if env is None or state is None:
        return
    for name, rms in _means(env).items():
        rms.mean, rms.var = np.array(state[name]["mean"]), np.array(state[name]["var"])
        rms.count = state[name]["count"]
    env.returns, env.old_obs, env.old_reward = state["returns"], state["old_obs"], state["old_reward"]


def _replay(model: BaseAlgorithm) -> dict[str, Any] | None:
    """The part of the replay buffer that is filled."""
    buffer: Any = getattr(model, "replay_buffer", None)
    if buffer is None:
        return None
    filled = buffer.buffer_size if buffer.full else buffer.pos
    return {"pos": buffer.pos, "full": buffer.full} | {
        name: _each(getattr(buffer, name), lambda array: array[:filled]) for name in _REPLAY
    }


def _each(array: Any, do: Callable[[np.ndarray], Any]) -> Any:
    """What `do` makes of an array, or of each part of a dict of arrays."""
    return {name: do(part) for name, part in array.items()} if isinstance(array, dict) else do(array)


def _put(array: Any, stored: Any) -> None:
    """Copy into an array, or each part of a dict of arrays, its first rows."""
    if isinstance(array, dict):
        for name, part in array.items():
            _put(part, stored[name])
    else:
        array[: len(stored)] = stored


def _put_replay(model: BaseAlgorithm, state: dict[str, Any] | None) -> None:
    buffer: Any = getattr(model, "replay_buffer", None)
    if (buffer is None) != (state is None):
        raise ValueError("the state does not fit this training: one of them is without a replay buffer")
    if buffer is None or state is None:
        return
    buffer.pos, buffer.full = state["pos"], state["full"]
    for name in _REPLAY:
        _put(getattr(buffer, name), state[name])


def _batch(model: BaseAlgorithm) -> tuple[NativeVecEnv, Any]:
    """The native batch under a model's wrappers, and the stack of frames, if there is one."""
    env, frames = model.get_env(), None
    while not isinstance(env, NativeVecEnv):
        if isinstance(env, VecFrameStack):
            frames = env.stacked_obs
        env = env.venv  # type: ignore[union-attr]
    return env, frames


def _frames(stack: Any) -> Any:
    """The array in which SB3 stacks frames, or a dict of one a part."""
    parts = getattr(stack, "sub_stacked_observations", None)
    return stack.stacked_obs if parts is None else {name: part.stacked_obs for name, part in parts.items()}


def _env(model: BaseAlgorithm) -> dict[str, Any]:
    batch, frames = _batch(model)
    return {
        "lanes": lanes_state(batch.env),
        "reward": batch._reward,
        "length": batch._length,
        "frames": None if frames is None else _frames(frames),
    }


def _put_env(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    batch, frames = _batch(model)
    load_lanes(batch.env, state["lanes"])
    batch._reward[:], batch._length[:] = state["reward"], state["length"]
    batch._seed = None
    if frames is not None:
        _put(_frames(frames), state["frames"])
