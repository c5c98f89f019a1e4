"""Twin experiments: logs that the simulator makes with known parameters, and whether a fit finds these again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.checks import whole
from ..scenario import Scenario
from .identified import Identified, identify
from .logs import Episode, Log
from .parameters import PARAMETERS, chosen
from .recording import record, turns_of

__all__ = ["RANGES", "Twin", "Twins", "twins"]

RANGES: dict[str, tuple[float, float]] = {
    "friction": (0.02, 0.15),
    "bending_rigidity": (0.6, 1.6),
    "axial_rigidity": (0.6, 1.6),
    "drag": (0.6, 1.6),
    "remanence": (0.9, 1.1),
    "tip_remanence": (0.9, 1.1),
    "rig_x": (-5e-3, 5e-3),
    "rig_y": (-5e-3, 5e-3),
    "rig_z": (0.0, 5e-3),
    "angle_offset": (-0.15, 0.15),
}
"""Truths are drawn from these, uniform or, for ratios, uniform in the logarithm, as factors on the scenario's value."""


@dataclass(frozen=True, eq=False)
class Twin:
    """One experiment. truth : (p,) in the parameters' units."""

    truth: np.ndarray
    found: Identified

    @property
    def errors(self) -> np.ndarray:
        """(p,) the values' errors; relative for ratios and friction, else in the unit."""
        gaps = self.found.values - self.truth
        relative = np.array([p.ratio or p.name == "friction" for p in self.found.parameters])
        return np.where(relative, gaps / np.where(relative, self.truth, 1.0), gaps)

    @property
    def covered(self) -> np.ndarray:
        """(p,) whether the interval holds the truth."""
        return np.array([value in ends for value, ends in zip(self.truth, self.found.intervals, strict=True)])


@dataclass(frozen=True, eq=False)
class Twins:
    """Experiments with one scenario and the same parameters."""

    each: tuple[Twin, ...]

    @property
    def coverage(self) -> np.ndarray:
        """(p,) share of the intervals that hold the truth."""
        return np.array([twin.covered for twin in self.each]).mean(axis=0)

    def table(self) -> str:
        """Per parameter: coverage and errors, as text."""
        errors = np.array([twin.errors for twin in self.each])
        lines = [f"{len(self.each)} truths, intervals of {self.each[0].found.level:.0%}"]
        for i, p in enumerate(self.each[0].found.parameters):
            relative = p.ratio or p.name == "friction"
            scale, unit = (100.0, "%") if relative else (1.0, p.unit)
            rms, most = scale * np.sqrt((errors[:, i] ** 2).mean()), scale * np.abs(errors[:, i]).max()
            lines.append(
                f"{p.name:<17} covered {self.coverage[i]:.0%}, error {rms:.3g} {unit} rms, {most:.3g} {unit} at most"
            )
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """For `json.dump`."""
        return {
            "parameters": [p.name for p in self.each[0].found.parameters],
            "coverage": self.coverage.tolist(),
            "twins": [{"truth": t.truth.tolist(), "errors": t.errors.tolist(), **t.found.to_json()} for t in self.each],
        }


def twins(
    scenario: Scenario,
    parameters: Sequence[str] = ("friction", "bending_rigidity", "drag"),
    count: int = 20,
    noise: Mapping[str, float] | None = None,
    columns: Sequence[str] = ("tip_x", "tip_y", "tip_z"),
    seconds: float = 20.0,
    episodes: int = 6,
    seed: int = 0,
    **settings: Any,
) -> Twins:
    """`count` experiments with truths drawn from `RANGES`.

    noise, columns, seconds, episodes : of the logs, see `record`
    settings : of `identify`; the noise is not told to it
    """
    whole("count", count, 1)
    chosen(scenario, parameters)
    scenario = scenario.replace(timing__substeps=scenario.substeps)
    done = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        truth = _drawn(scenario, parameters, rng)
        log = _true_log(scenario, parameters, truth, columns, noise, seconds, int(rng.integers(2**31)), episodes)
        done.append(Twin(truth, identify(scenario, log, parameters, seed=number, **settings)))
    return Twins(tuple(done))


def _drawn(scenario: Scenario, parameters: Sequence[str], rng: np.random.Generator) -> np.ndarray:
    truth = []
    for name in parameters:
        parameter = PARAMETERS[name]
        if name not in RANGES:
            raise ValueError(f"parameters must be of {', '.join(RANGES)} for twin experiments, got {name!r}")
        low, high = RANGES[name]
        if parameter.ratio:
            truth.append(parameter.read(scenario) * float(np.exp(rng.uniform(np.log(low), np.log(high)))))
        else:
            truth.append(float(rng.uniform(low, high)))
    return np.array(truth)


def _true_log(
    scenario: Scenario, parameters: Sequence[str], truth: np.ndarray, columns: Sequence[str],
    noise: Mapping[str, float] | None, seconds: float, seed: int, episodes: int = 1,
) -> Log:  # fmt: skip
    """A log of the scenario with the true parameters; where turns are off, what was commanded is not what was done."""
    actual, offset = scenario, 0.0
    for name, value in zip(parameters, truth, strict=True):
        actual = PARAMETERS[name].put(actual, float(value))
        offset += float(value) if PARAMETERS[name].turns_offset else 0.0
    log = record(actual, seconds=seconds, columns=columns, noise=noise, seed=seed, episodes=episodes)
    if not offset:
        return log
    turns = offset * turns_of(scenario)
    told = [
        Episode(ep.time, ep.commands - turns, None if ep.rig is None else ep.rig - turns, ep.measured)
        for ep in log.episodes
    ]
    return Log(tuple(told))
