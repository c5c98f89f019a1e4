"""The subcommands `record`, `identify` and `twins`: logs, parameters from logs, and how well that works."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

if TYPE_CHECKING:
    from magwire_env.identification import Log

__all__ = ["RUN", "Identify", "Record", "Twins", "identify", "record", "twins"]


@dataclass
class Record:
    """Write a log as CSV, of a simulated wire with noise: to see the format, or to try out what a log would tell."""

    out: tyro.conf.Positional[Path]
    """The CSV file."""
    scenario: str = "paper"
    """A TOML file or a shipped name."""
    policy: str | None = None
    """A run's or policy's folder, or a controller's name; by default commands to and fro that tell parameters apart."""
    task: str | None = None
    """Environment id for a policy; by default the policy's own task, or MagWire/Steer-v1."""
    seconds: float = 20.0
    """Length without a policy."""
    episodes: int = 1
    """Number of episodes."""
    columns: tuple[str, ...] = ("tip_x", "tip_y", "tip_z")
    """What is measured; see magwire_env.identification.MEASURED."""
    noise: tuple[str, ...] = ("position=1e-3",)
    """Standard deviations by kind of measurement, in SI units, as kind=value."""
    seed: int = 0
    """Of the noise, and of a policy's episodes."""


@dataclass
class Identify:
    """Fit parameters of a scenario to a log, with intervals, residual plots, and a word on what the log cannot tell."""

    log: tyro.conf.Positional[str]
    """A CSV file (columns: see docs/identification.md), or minari:ID for a local Minari data set."""
    scenario: str = "paper"
    """A TOML file or a shipped name: everything that is not fitted."""
    fit: tuple[str, ...] = ("friction", "bending_rigidity", "drag")
    """Names of parameters; see magwire_env.identification.PARAMETERS."""
    columns: tuple[str, ...] = ()
    """Columns of the log that are used; by default all."""
    noise: tuple[str, ...] = ()
    """Known standard deviations by kind of measurement, SI, as kind=value; others are estimated."""
    bounds: tuple[str, ...] = ()
    """Where to search, as parameter=low:high."""
    method: str = "least-squares"
    """least-squares from a spread of starts, or cma (CMA-ES, then least squares)."""
    interval: str = "profile"
    """profile (likelihood) or laplace."""
    level: float = 0.9
    """Probability that an interval holds the truth."""
    seed: int = 0
    """Of the search."""
    out: Path = Path("identified")
    """Folder for identified.json, residuals.png, scenario.toml and randomised.toml."""


@dataclass
class Twins:
    """Twin experiments: fit logs that the simulator made with random truths; coverage of the intervals, and errors."""

    scenario: str = "paper"
    """A TOML file or a shipped name."""
    fit: tuple[str, ...] = ("friction", "bending_rigidity", "drag")
    """Names of parameters."""
    count: int = 20
    """Number of truths."""
    columns: tuple[str, ...] = ("tip_x", "tip_y", "tip_z")
    """What is measured."""
    noise: tuple[str, ...] = ("position=1e-3",)
    """Standard deviations by kind of measurement, SI, as kind=value."""
    seconds: float = 20.0
    """Length of an episode."""
    episodes: int = 6
    """Episodes of a log."""
    interval: str = "profile"
    """profile (likelihood) or laplace."""
    level: float = 0.9
    """Probability that an interval holds the truth."""
    seed: int = 0
    """Of the truths and the noise."""
    out: Path | None = None
    """Write every experiment here as JSON."""


def record(options: Record) -> None:
    """Write the log and print its name."""
    from magwire_env import Scenario
    from magwire_env.identification import Log
    from magwire_env.identification import record as simulated

    noise, scenario = _pairs("noise", options.noise, float), Scenario.load(options.scenario)
    logs = [
        _played(options, noise, seed)
        if options.policy
        else simulated(scenario, seconds=options.seconds, columns=options.columns, noise=noise, seed=seed)
        for seed in range(options.seed, options.seed + options.episodes)
    ]
    Log(tuple(log.episodes[0] for log in logs)).save(options.out)
    print(options.out)


def _played(options: Record, noise: dict[str, float], seed: int) -> Log:
    """A policy's episode."""
    import gymnasium as gym
    import numpy as np

    from agents.catalogue import resolve
    from agents.evaluation.episodes import built
    from magwire_env.identification import Log
    from magwire_env.identification.recording import Recorder

    own = resolve(str(options.policy), options.task, options.scenario)
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


def identify(options: Identify) -> None:
    """Print the table and the warnings, write the files and print their names."""
    from magwire_env import Scenario
    from magwire_env.identification import Log, from_minari, residual_plot
    from magwire_env.identification import identify as fitted

    minari = options.log.removeprefix("minari:")
    log = Log.load(options.log) if minari == options.log else from_minari(minari)
    found = fitted(
        Scenario.load(options.scenario), log, options.fit,
        columns=options.columns or None,
        noise=_pairs("noise", options.noise, float),
        bounds=_pairs("bounds", options.bounds, _ends),
        method=options.method, interval=options.interval, level=options.level, seed=options.seed,
    )  # fmt: skip
    print(found.table())
    for warning in found.warnings:
        print(f"warning: {warning}")
    out = options.out
    out.mkdir(parents=True, exist_ok=True)
    (out / "identified.json").write_text(json.dumps(found.to_json(), indent=2), encoding="utf-8")
    found.scenario.save(out / "scenario.toml")
    found.randomised().save(out / "randomised.toml")
    residual_plot(found, out / "residuals.png")
    _listed(out / name for name in ("identified.json", "residuals.png", "scenario.toml", "randomised.toml"))


def twins(options: Twins) -> None:
    """Print coverage and errors; write JSON if a file is given."""
    from magwire_env import Scenario
    from magwire_env.identification import twins as experiments

    found = experiments(
        Scenario.load(options.scenario), options.fit, options.count, _pairs("noise", options.noise, float),
        options.columns, options.seconds, options.episodes, options.seed,
        interval=options.interval, level=options.level,
    )  # fmt: skip
    print(found.table())
    if options.out is not None:
        options.out.write_text(json.dumps(found.to_json(), indent=2), encoding="utf-8")
        print(options.out)


def _ends(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    return float(low), float(high)


def _pairs(name: str, given: tuple[str, ...], read: Callable[[str], Any]) -> dict[str, Any]:
    """`("position=1e-3",)` → `{"position": 0.001}`."""
    found = {}
    for pair in given:
        key, _, text = pair.partition("=")
        try:
            found[key] = read(text)
        except ValueError:
            wanted = "parameter=low:high" if name == "bounds" else "kind=value"
            raise ValueError(f"{name} must be given as {wanted}, got {pair!r}") from None
    return found


def _listed(paths: Iterable[Path]) -> None:
    print(*paths, sep="\n")


RUN: dict[type, Callable[[Any], Any]] = {Record: record, Identify: identify, Twins: twins}
