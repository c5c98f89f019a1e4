"""Fitting a scenario to a log: the whole of it in one call, and what comes out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.checks import in_range, one_of, positive, whole
from ..scenario import Scenario
from .intervals import INTERVALS, Interval, Precision, intervals, precision, unknown_combinations
from .logs import MEASURED, Log
from .parameters import Parameter, chosen
from .problem import Problem
from .rollouts import Predictor
from .search import search

__all__ = ["Identified", "identify"]

_NOISE_ROUNDS = 2
"""How often the noise of each kind of measurement is estimated anew from the residuals."""

_STEP_ROUNDS = 3
"""How often the fit begins anew because a stiffer wire than expected needs shorter steps."""


@dataclass(frozen=True, eq=False)
class Identified:
    """What a log says of a scenario.

    scenario : with the best values
    parameters, values, intervals : (p,) each; values in the parameters' units
    level : probability that an interval holds the truth
    correlation : (p, p) between the parameters
    starts : (E,) m, where the tips began
    noise : kind of measurement → standard deviation, given or estimated
    warnings : sentences about what the data cannot tell, and about a model that does not explain them
    predictor, predicted : of every measurement, see `Predictor`
    """

    scenario: Scenario
    parameters: tuple[Parameter, ...]
    values: np.ndarray
    intervals: tuple[Interval, ...]
    level: float
    correlation: np.ndarray
    starts: np.ndarray
    noise: dict[str, float]
    warnings: tuple[str, ...]
    predictor: Predictor
    predicted: np.ndarray

    @property
    def residuals(self) -> np.ndarray:
        """(M,) measured less predicted, in the measurements' own units."""
        return self.predictor.measured - self.predicted

    def value(self, name: str) -> float:
        """The best value of a parameter by name."""
        return float(self.values[self._place(name)])

    def interval(self, name: str) -> Interval:
        """The interval of a parameter by name."""
        return self.intervals[self._place(name)]

    def _place(self, name: str) -> int:
        names = [p.name for p in self.parameters]
        return names.index(one_of("name", name, tuple(names)))

    def table(self) -> str:
        """Values, intervals and noise as text."""
        lines = []
        for p, value, interval in zip(self.parameters, self.values, self.intervals, strict=True):
            low = f"{'≤ ' if interval.open_low else ''}{interval.low:.5g}"
            high = f"{'≥ ' if interval.open_high else ''}{interval.high:.5g}"
            lines.append(f"{p.name:<17} {value:<11.5g} [{low}, {high}] {p.unit}".rstrip())
        noise = ", ".join(f"{kind} {value:.3g}" for kind, value in self.noise.items())
        return "\n".join([
            f"{len(self.predictor.measured)} measurements, intervals of {self.level:.0%}", *lines,
            f"noise (standard deviation, SI): {noise}",
        ])  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """For `json.dump`."""
        rows = {
            p.name: {
                "value": float(value), "low": interval.low, "high": interval.high, "open_low": interval.open_low,
                "open_high": interval.open_high, "unit": p.unit,
            }
            for p, value, interval in zip(self.parameters, self.values, self.intervals, strict=True)
        }  # fmt: skip
        return {
            "scenario": self.scenario.name, "level": self.level, "parameters": rows, "noise": self.noise,
            "correlation": self.correlation.tolist(), "starts": self.starts.tolist(), "warnings": list(self.warnings),
            "measurements": len(self.predictor.measured), "substeps": self.predictor.substeps,
        }  # fmt: skip

    def randomised(self) -> Scenario:
        """A scenario for domain randomisation: the best one, with the intervals as the ranges of its `Variation`.

        Parameters that `Variation` does not draw (drag, the tip's remanence, clearance, an angle's offset) keep their
        best value.
        """
        known = {p.name: i for p, i in zip(self.parameters, self.intervals, strict=True)}
        ranges: dict[str, Any] = {
            name: (known[name].low, known[name].high) for name in ("friction", "bending_rigidity") if name in known
        }
        if "remanence" in known:
            best = self.value("remanence")  # the scenario has it already
            ranges["remanence"] = known["remanence"].low / best, known["remanence"].high / best
        shifts = [i.high - i.low for name, i in known.items() if name.startswith("rig_")]
        if shifts:
            ranges["placement"] = 0.5 * max(shifts)
        return self.scenario.randomised(**ranges)


def identify(
    scenario: Scenario,
    log: Log,
    parameters: Sequence[str] = ("friction", "bending_rigidity", "drag"),
    *,
    columns: Sequence[str] | None = None,
    noise: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    method: str = "least-squares",
    interval: str = "profile",
    level: float = 0.9,
    samples: int = 128,
    polished: int = 3,
    seed: int = 0,
    threads: int | None = None,
) -> Identified:
    """Fit parameters of a scenario to logged data.

    parameters : names of `PARAMETERS`
    columns : which of the log's columns are used; by default all
    noise : kind of measurement → standard deviation, SI; others are estimated from the residuals
    bounds : parameter → lowest and highest value searched
    method, samples, polished, seed : see `magwire_env.identification.search.search`
    interval, level : see `magwire_env.identification.intervals.intervals`

    The start of every episode is fitted too, and the steps of integration are those that the scenario takes by itself.
    Every evaluation replays the log's commands, one lane a parameter set and episode.
    Raises `ValueError` for a log that does not fit the scenario, or too short for its unknowns.
    """
    found, spans = chosen(scenario, parameters, dict(bounds or {}))
    in_range("level", level, 0.5, 0.999)
    whole("samples", samples, 1)
    whole("polished", polished, 1)
    one_of("interval", interval, INTERVALS)
    used = log.columns if columns is None else tuple(one_of("columns", c, log.columns) for c in columns)
    substeps = scenario.substeps
    x = np.array([p.to_search(p.read(scenario)) for p in found])
    for _ in range(_STEP_ROUNDS):
        predictor = Predictor(scenario, log, found, used, substeps, threads)
        given = _checked_noise(noise, predictor)
        problem = _problem(predictor, spans, given)
        x = np.concatenate([x[: problem.count], predictor.starts])
        x = search(problem, np.clip(x, problem.low, problem.high), method, samples, polished, seed)
        x, squares = _with_noise(problem, x, given)
        needed = _substeps_of(problem, x, scenario)
        if needed <= substeps:
            break
        substeps = needed
    return _described(scenario, problem, x, squares, given, level, interval)


def _problem(predictor: Predictor, spans: Sequence[tuple[float, float]], given: Mapping[str, float]) -> Problem:
    guess = {MEASURED[name].kind: MEASURED[name].noise for name in predictor.columns}
    noise = np.array([given.get(kind, guess[kind]) for kind in predictor.kind_names])
    problem = Problem(predictor, spans, noise)
    if len(predictor.measured) <= problem.size:
        raise ValueError(
            f"the log must hold more measurements than there are unknowns ({problem.size}), got "
            f"{len(predictor.measured)}"
        )
    return problem


def _substeps_of(problem: Problem, x: np.ndarray, scenario: Scenario) -> int:
    """How many the best scenario takes by itself."""
    return problem.predictor.scenario_of(problem.values(x)).replace(timing=scenario.timing).substeps


def _with_noise(problem: Problem, x: np.ndarray, given: Mapping[str, float]) -> tuple[np.ndarray, float]:
    """Solve, and estimate the noise that was not given from the residuals, in turns → x, sum of squares."""
    if len(given) < len(problem.predictor.kind_names):
        for _ in range(_NOISE_ROUNDS):
            x, _ = problem.solve(x)
            _estimate_noise(problem, x, given)
    return problem.solve(x)


def _described(
    scenario: Scenario, problem: Problem, x: np.ndarray, squares: float, given: Mapping[str, float], level: float,
    interval: str,
) -> Identified:  # fmt: skip
    predictor, n = problem.predictor, problem.count
    known = precision(problem, x, squares)
    values, deviations = problem.values(x), known.deviations[:n]
    return Identified(
        scenario=predictor.scenario_of(values).replace(timing=scenario.timing),
        parameters=problem.parameters,
        values=values,
        intervals=tuple(intervals(problem, x, squares, known, level, interval)),
        level=level,
        correlation=known.covariance[:n, :n] / np.outer(deviations, deviations),
        starts=x[n:],
        noise={k: float(v) for k, v in zip(predictor.kind_names, problem.noise, strict=True)},
        warnings=tuple(unknown_combinations(problem, known) + _misfits(problem, x, known, given)),
        predictor=predictor,
        predicted=problem.predicted(x[None])[0],
    )


def _checked_noise(noise: Mapping[str, float] | None, predictor: Predictor) -> dict[str, float]:
    given = dict(noise or {})
    for kind, value in given.items():
        one_of("noise", kind, predictor.kind_names)
        positive(f"noise[{kind!r}]", value)
    return given


def _estimate_noise(problem: Problem, x: np.ndarray, given: Mapping[str, float]) -> None:
    """Put the residuals' standard deviation in place of each noise that was not given."""
    gaps = problem.residuals(x[None])[0]
    share = 1.0 - problem.size / len(gaps)
    for number, kind in enumerate(problem.predictor.kind_names):
        if kind not in given:
            mine = gaps[problem.predictor.kinds == number]
            spread = float(np.sqrt((mine**2).mean() / share)) if mine.size else 1.0
            problem.noise[number] *= max(spread, 1e-6)


def _misfits(problem: Problem, x: np.ndarray, known: Precision, given: Mapping[str, float]) -> list[str]:
    """Signs that the model does not explain the data, in sentences."""
    gaps, predictor = problem.residuals(x[None])[0], problem.predictor
    told = []
    if len(given) == len(predictor.kind_names) and known.spread > 1.5:
        told.append(
            f"the residuals are {known.spread:.2g} times as large as the given noise: the model does not explain the "
            "data, and the intervals are widened by that factor"
        )
    for number, name in enumerate(predictor.columns):
        mine = gaps[predictor.column_of == number]
        if len(mine) < 20:
            continue
        mine = mine - mine.mean()
        follow = float((mine[1:] * mine[:-1]).sum() / (mine**2).sum())
        if follow > max(0.3, 4.0 / np.sqrt(len(mine))):
            told.append(
                f"the residuals of {name} follow one another (correlation from row to row {follow:.2f}): the model "
                "misses something, and the intervals are too narrow"
            )
    return told
