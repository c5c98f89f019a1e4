"""How the benchmarks measure: cases in turn, round after round, so that a busy machine slows all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

Rates = dict[str, np.ndarray]


def rates(cases: Mapping[str, Callable[[], tuple[int, float]]], rounds: int = 7) -> Rates:
    """Steps per second of every case, one number a round: a case runs a while and returns steps and seconds."""
    for case in cases.values():
        case()
    found: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(rounds):
        for name, case in cases.items():
            steps, seconds = case()
            found[name].append(steps / seconds)
    return {name: np.array(values) for name, values in found.items()}


def timed(run: Callable[[], object]) -> float:
    """Seconds of one call."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def ratio(found: Rates, above: str, below: str) -> str:
    """Median and range, over the rounds, of one case's rate over another's in the same round."""
    r = found[above] / found[below]
    return f"{np.median(r):.2f} ({r.min():.2f}–{r.max():.2f})"


def rate(values: np.ndarray) -> str:
    """Median and range of a rate, in steps/s."""
    return f"{number(float(np.median(values)))} ({number(float(values.min()))}–{number(float(values.max()))})"


def number(x: float) -> str:
    """1 234 567 as 1.23 M."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if x >= size:
            return f"{x / size:.3g} {letter}"
    return f"{x:.3g}"


def table(head: tuple[str, ...], rows: list[tuple]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)
