"""Demonstrations as Minari data sets, to learn from elsewhere: a policy's episodes, or the runs that certify trees.

A data set is a folder. Minari opens it by its path, ``minari.MinariDataset(folder / "data")``, or by its name where
``MINARI_DATASETS_PATH`` is the folder above. Beside observations, actions, rewards and ends every episode keeps the
seed and the options of its reset: `replayed` plays the actions again.

https://minari.farama.org
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils.seeding import np_random

from magwire_env.envs.navigation import Recover
from magwire_env.envs.pools import TREES
from magwire_env.envs.trees import demonstrations
from magwire_env.render.extra import need

from ..evaluation.episodes import Policy
from .run_folder import made_whole

__all__ = ["CERTIFIED", "Take", "certified", "played", "replayed", "write"]

CERTIFIED = "certified"
"""What stands for a policy's name where the runs that certify trees are meant."""

_NAME = re.compile(r"[-_\w]+-v\d+")
"""Of a data set, as Minari wants it."""

_OPTIONS = "reset_options"
"""Of an episode's metadata: the options of its reset as JSON."""


@dataclass(frozen=True, eq=False)
class Take:
    """An episode as it was played.

    seed, options : of its reset
    observations : (steps + 1, …), or, with an image, a dict of such arrays
    actions : (steps, k)
    rewards, terminations, truncations : (steps,)
    success : the goal was reached
    """

    seed: int
    options: dict[str, Any] | None
    observations: Any
    actions: np.ndarray
    rewards: np.ndarray
    terminations: np.ndarray
    truncations: np.ndarray
    success: bool


def played(env: gym.Env, policy: Policy, seed: int, options: dict[str, Any] | None = None) -> Take:
    """One episode of a policy in a single env, from ``reset(seed=seed, options=options)``."""
    state, first = None, np.ones(1, dtype=np.bool_)

    def act(observation: Any) -> np.ndarray:
        nonlocal state, first
        action, state = policy.predict(observation, state=state, episode_start=first, deterministic=True)
        first = np.zeros(1, dtype=np.bool_)
        return action

    return _take(env, act, seed, options)


def certified(env: gym.Env, split: str, most: int | None = None) -> Iterator[Take]:
    """The runs that certify the trees of `env`, tree by tree: of a task that starts astray those out of wrong branches,
    of others those from the inlet.

    env : of a task of generated trees, whose pool is of `split`
    most : how many at most; by default all

    The seed of each is one that draws its tree. Raises `ValueError` for an env of another task.
    """
    core = env.unwrapped.core  # type: ignore[attr-defined]
    if core.task.pool != TREES:
        raise ValueError(f"task must draw certified trees to have certified runs, got {core.task.id}")
    scenarios, astray = core.sim.library.scenarios, isinstance(core.task.kind, Recover)
    seeds, done = count(), 0
    for tree, scenario in enumerate(scenarios):
        for run in demonstrations(split, tree):
            if (run.start != "inlet") != astray:
                continue
            if done == most:
                return
            seed = next(s for s in seeds if np_random(s)[0].integers(len(scenarios)) == tree)
            yield _take(env, _given(run.actions), seed, run.options(scenario))
            if core.sim.lane_scenario[0] != tree:
                raise RuntimeError(f"seed {seed} must draw tree {tree}, and drew {core.sim.lane_scenario[0]}")
            done += 1


def write(folder: Path, env: gym.Env, takes: Iterator[Take], source: str) -> tuple[int, int]:
    """Write a data set into a new folder; how many episodes it has, and how many of them reached their goal.

    source : what played them, for the data set's description

    Raises `FileExistsError` for a folder that exists, `ValueError` for one whose name is none for a data set or an env
    that cannot be made again from what JSON can hold, `gymnasium.error.DependencyNotInstalled` without Minari.
    """
    minari = need("minari", "a data set of demonstrations", "demonstrations")
    need("h5py", "a data set of demonstrations", "demonstrations")
    if not _NAME.fullmatch(folder.name):
        raise ValueError(f"out must end in a data set's name such as mine-v0, or in .csv (a log), got {folder.name!r}")
    spec: Any = env.spec
    try:
        spec.to_json()
    except (TypeError, ValueError) as error:
        raise ValueError(f"a data set needs an env of plain settings, got {spec.kwargs}") from error
    from minari.dataset.minari_storage import MinariStorage

    told: list[dict[str, Any]] = []

    def fill(unfinished: Path) -> None:
        storage = MinariStorage.new(unfinished / "data", env.observation_space, env.action_space, spec)
        storage.update_episodes(_buffer(take, told) for take in takes)
        storage.update_episode_metadata(told)
        storage.update_metadata(
            {
                "dataset_id": folder.name, "minari_version": minari.__version__, "algorithm_name": source,
                "description": f"{len(told)} episodes of {spec.id} by {source}",
                "requirements": [f"magwire-env=={version('magwire-env')}"],
            }
        )  # fmt: skip

    made_whole(folder, fill)
    return len(told), sum(one["success"] for one in told)


def replayed(dataset: Any) -> Iterator[tuple[Any, Take]]:
    """Every episode of a data set as `write` left it, and its actions played again in the env it names.

    dataset : a `minari.MinariDataset`
    """
    env = dataset.recover_environment()
    metadata = dataset.storage.get_episode_metadata(dataset.episode_indices)
    for episode, about in zip(dataset.iterate_episodes(), metadata, strict=True):
        options = json.loads(about[_OPTIONS])
        if options is not None and isinstance(options.get("start"), list):
            options["start"] = tuple(options["start"])
        yield episode, _take(env, _given(episode.actions), about["seed"], options)
    env.close()


def _given(actions: np.ndarray) -> Callable[[Any], np.ndarray]:
    """What takes the actions (steps, k) one after the other; `ValueError` where they are over before the episode is."""
    left = iter(actions)

    def act(observation: Any) -> np.ndarray:
        action = next(left, None)
        if action is None:
            raise ValueError(
                f"an episode must end with its {len(actions)} actions, and goes on: the env is another one"
            )
        return action

    return act


def _take(env: gym.Env, act: Callable[[Any], np.ndarray], seed: int, options: dict[str, Any] | None) -> Take:
    observation, _ = env.reset(seed=seed, options=options)
    seen, taken, rows, over = [observation], [], [], False
    while not over:
        action = np.asarray(act(observation), dtype=np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append(observation)
        taken.append(action)
        rows.append((float(reward), terminated, truncated))
        over = terminated or truncated
    rewards, terminations, truncations = (np.array(column) for column in zip(*rows, strict=True))
    return Take(
        seed, options, _together(seen), np.array(taken), rewards, terminations, truncations, bool(info["is_success"])
    )


def _together(observations: list[Any]) -> Any:
    """Observations of single steps as one array, or as a dict with one for each part."""
    if isinstance(observations[0], dict):
        return {name: np.array([one[name] for one in observations]) for name in observations[0]}
    return np.array(observations)


def _buffer(take: Take, told: list[dict[str, Any]]) -> Any:
    """A take as Minari stores it; what else is told of it goes into `told`."""
    from minari.data_collector.episode_buffer import EpisodeBuffer

    told.append({_OPTIONS: json.dumps(take.options, default=lambda array: array.tolist()), "success": take.success})
    return EpisodeBuffer(
        seed=take.seed, observations=take.observations, actions=take.actions, rewards=take.rewards,
        terminations=take.terminations, truncations=take.truncations,
    )  # fmt: skip
