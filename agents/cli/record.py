"""The subcommand `record`: logs of a simulated wire, and data sets of demonstrations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from magwire_env.physics.checks import whole
from magwire_env.words import counted

from .identify import pairs

if TYPE_CHECKING:
    from magwire_env.identification import Log

__all__ = ["RUN", "Record", "record"]

_COLUMNS, _NOISE, _SECONDS = ("tip_x", "tip_y", "tip_z"), ("position=1e-3",), 20.0


@dataclass
class Record:
    """Write a log as CSV, of a simulated wire with noise, or a policy's episodes as a Minari data set.

    A log shows the format, or what a log would tell; a data set is there to learn from.
    """

    out: tyro.conf.Positional[Path]
    """A file that ends in .csv, for a log; or a new folder whose name ends in -v0, for a data set."""
    policy: str | None = None
    """A run's or policy's folder, or a controller's name; "certified": the runs that certify trees (data sets only).
    A log without a policy has commands to and fro that tell parameters apart."""
    task: str | None = None
    """Environment id for a policy; by default the policy's own task, or MagWire/Steer-v1."""
    scenario: str | None = None
    """A TOML file or a shipped name; by default the task's, and without a policy the paper's."""
    episodes: int | None = None
    """Number of episodes; by default one, and all of the certified runs."""
    env_kwargs: tuple[str, ...] = ()
    """With a policy, key=value for the env: observe, action_mode, reward, split, pool_size and so on."""
    seconds: float = _SECONDS
    """Of a log: its length without a policy."""
    columns: tuple[str, ...] = _COLUMNS
    """Of a log: what is measured; see magwire_env.identification.MEASURED."""
    noise: tuple[str, ...] = _NOISE
    """Of a log: standard deviations by kind of measurement, in SI units, as kind=value."""
    seed: int = 0
    """Of a policy's first episode, and of the noise."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


def record(options: Record) -> None:
    """Write the log or the data set, and print its name."""
    if options.episodes is not None:
        whole("episodes", options.episodes, 1)
    if options.out.suffix == ".csv":
        _log(options)
    else:
        _data_set(options)
    print(options.out)


# --- data sets --------------------------------------------------------------------------------------------------------


def _data_set(options: Record) -> None:
    import gymnasium as gym

    from agents.catalogue import resolve
    from agents.env_kwargs import parsed
    from agents.evaluation.episodes import built
    from agents.learning.demonstrations import CERTIFIED, certified, played, write
    from magwire_env.envs.task import known_task

    if (options.seconds, options.columns, options.noise) != (_SECONDS, _COLUMNS, _NOISE):
        raise ValueError(
            f"seconds, columns and noise are of logs, whose name ends in .csv; got out {str(options.out)!r}"
        )
    if options.policy is None:
        raise ValueError("policy must be given for a data set, got none")
    if options.policy == CERTIFIED:
        if options.scenario is not None:
            raise ValueError(f"scenario must be left to the certified runs' own trees, got {options.scenario!r}")
        settings, name = parsed(options.env_kwargs), options.policy
        env = gym.make(known_task(options.task or "MagWire/NavigateAny-v0"), **settings)
        takes = certified(env, settings.get("split", "train"), options.episodes)
    else:
        own = resolve(options.policy, options.task, options.scenario, None, options.trust, options.env_kwargs)
        env, name = gym.make(own.task, **own.settings), own.name
        policy = built(own.policy, env)
        takes = (played(env, policy, options.seed + i) for i in range(options.episodes or 1))
    many, reached = write(options.out, env, takes, name)
    env.close()
    print(f"{counted(many, 'episode')}, {reached} of which reached the goal")


# --- logs -------------------------------------------------------------------------------------------------------------


def _log(options: Record) -> None:
    from magwire_env import Scenario
    from magwire_env.identification import Log
    from magwire_env.identification import record as simulated

    noise = pairs("noise", options.noise, float)
    if options.policy is None:
        scenario = Scenario.load(options.scenario or "paper")
    logs = [
        _played(options, noise, seed)
        if options.policy
        else simulated(scenario, seconds=options.seconds, columns=options.columns, noise=noise, seed=seed)
        for seed in range(options.seed, options.seed + (options.episodes or 1))
    ]
    Log(tuple(log.episodes[0] for log in logs)).save(options.out)


def _played(options: Record, noise: dict[str, float], seed: int) -> Log:
    """A policy's episode."""
    import gymnasium as gym
    import numpy as np

    from agents.catalogue import resolve
    from agents.evaluation.episodes import built
    from magwire_env.identification import Log
    from magwire_env.identification.recording import Recorder

    own = resolve(
        str(options.policy), options.task, options.scenario, trust=options.trust, env_kwargs=options.env_kwargs
    )
    env = gym.make(own.task, **own.settings)
    policy = built(own.policy, env)
    sim = env.unwrapped.core.sim  # type: ignore[attr-defined]
    recorder = Recorder(options.columns, noise, np.random.default_rng(seed))
    observation, _ = env.reset(seed=seed)
    state, over, first = None, False, np.ones(1, dtype=np.bool_)
    while not over:
        action, state = policy.predict(observation, state=state, episode_start=first, deterministic=True)
        recorder.note(sim, env.unwrapped.core.actuation.command(action[None])[0])  # type: ignore[attr-defined]
        observation, _, terminated, truncated, _ = env.step(action)
        over, first = terminated or truncated, np.zeros(1, dtype=np.bool_)
    recorder.note(sim, sim.command[:, 0])
    env.close()
    return Log((recorder.episode(),))


RUN: dict[type, Callable[[Any], Any]] = {Record: record}
