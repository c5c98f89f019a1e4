"""One training for each of several seeds, as tasks of an engine."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from agents.cli.train import train
from agents.engines import Outcome, Task, engine, run
from agents.learning.config import Config

__all__ = ["numbers", "train_all"]

MOST_SEEDS = 1000


def numbers(text: str) -> list[int]:
    """The seeds that a text such as "0-9" or "0,3,5" names. Raises `ValueError` for another text."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        if not first.isdecimal() or not (last.isdecimal() or part.strip() == first):
            raise ValueError(f"seeds must be whole numbers such as 0-9 or 0,3,5, got {text!r}")
        if len(first) > 9 or len(last) > 9 or int(last or first) - int(first) >= MOST_SEEDS:
            raise ValueError(f"seeds must be at most {MOST_SEEDS} numbers below a billion, got {text!r}")
        found += range(int(first), int(last or first) + 1)
    if len(set(found)) != len(found) or not found:
        raise ValueError(f"seeds must be different ones, in rising order within a range, got {text!r}")
    return found


def train_all(config: Config, seeds: Sequence[int], workers: int, ray: str | None = None) -> list[str]:
    """A run for each seed; returns a line for each that failed. What a run prints stands in a log beside it.

    config : of every run but for its seed; `run` is then the folder of their folders, by default runs/
    """
    base = Path("runs") if config.run is None else config.run
    task = config.task.split("/")[-1]
    tasks = []
    for seed in seeds:
        folder = (base / f"{task}-{config.algorithm}-seed{seed}").absolute()
        own = replace(config, seed=seed, run=folder, progress=False)
        tasks.append(Task(str(folder), train_one, (own,)))
    failed = []

    def told(outcome: Outcome) -> None:
        if outcome.failure is not None:
            failed.append(f"{outcome.task.name}: {outcome.failure}")
        print(f"{'FAILED' if outcome.failure else 'done':<9} {outcome.task.name}", flush=True)

    run(engine(workers, ray), tasks, told)
    return failed


def train_one(config: Config, attempt: int = 0) -> None:
    """A task: one run. After a worker was lost it goes on from its last checkpoint."""
    assert config.run is not None
    begun = (config.run / "config.json").exists()
    log = config.run.with_name(f"{config.run.name}.log")
    log.parent.mkdir(parents=True, exist_ok=True)
    with (
        log.open("a", encoding="utf-8", buffering=1) as file,
        contextlib.redirect_stdout(file),
        contextlib.redirect_stderr(file),
    ):
        try:
            results = train(replace(config, resume=config.resume or (begun and attempt > 0)))
        except Exception:
            traceback.print_exc()
            raise
    if not results:
        raise KeyboardInterrupt
