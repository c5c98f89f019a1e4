"""How the benchmarks measure: cases in turn, round after round, so that a busy machine slows all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

Rates = dict[str, np.ndarray]


def rates(cases: Mapping[str, Callable[[], tuple[int, float]]], rounds: int = 7) -> Rates:
    """Steps per second of every case, one number a round: a case runs a while and returns steps and seconds."""
    return both_rates(cases, rounds)[0]


def both_rates(cases: Mapping[str, Callable[[], tuple[int, float]]], rounds: int = 7) -> tuple[Rates, Rates]:
    """As `rates`, and steps per second of processor time, all threads together: what a busy machine does not hide.

    The processor time is the whole case's, resets before it included.
    """
    for case in cases.values():
        case()
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
    for _ in range(rounds):
        for name, case in cases.items():
            before = time.process_time()
            steps, seconds = case()
            found[name].append((steps / seconds, steps / (time.process_time() - before)))
    both = {name: np.array(values).T for name, values in found.items()}
    return {name: pair[0] for name, pair in both.items()}, {name: pair[1] for name, pair in both.items()}


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
