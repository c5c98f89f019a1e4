"""The subcommands `identify` and `twins`: parameters from logs, and how well that works."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

__all__ = ["RUN", "Identify", "Twins", "identify", "pairs", "twins"]


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
        noise=pairs("noise", options.noise, float),
        bounds=pairs("bounds", options.bounds, _ends),
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
        Scenario.load(options.scenario), options.fit, options.count, pairs("noise", options.noise, float),
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


def pairs(name: str, given: tuple[str, ...], read: Callable[[str], Any]) -> dict[str, Any]:
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


RUN: dict[type, Callable[[Any], Any]] = {Identify: identify, Twins: twins}
