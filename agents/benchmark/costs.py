"""How long the benchmark's cells will take: from those that are finished, else from those that the docs report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from magwire_env.words import counted

from .plan import Cell, Plan

__all__ = ["SECONDS", "estimate"]

SECONDS = {"train": 99.0, "par": 250.0, "evaluate": 10.3, "robustness": 20.8, "decide": 0.8}
"""Seconds of one core that a cell of each kind takes on the average, as docs/benchmark.md has them; but for the par,
whose plans had been kept there: its number is of an empty cache, 0.5 s an episode on Reach, 1.6 s on Track."""


def estimate(plan: Plan, missing: Sequence[Cell], out: Path, workers: int) -> str:
    """A sentence: how many cells are missing, and how long they will take.

    A kind of cell is taken to need the mean of its finished cells in `out`, or else `SECONDS`.
    """
    if not missing:
        return "all cells are finished"
    seconds, measured = 0.0, set()
    for kind in {cell.kind for cell in missing}:
        finished = [r["seconds"] for c in plan.cells() if c.kind == kind and (r := plan.record(c, out)) is not None]
        if finished:
            measured.add(kind)
        each = sum(finished) / len(finished) if finished else SECONDS[kind]
        seconds += sum(each * (1.0 if finished else _share(plan, cell)) for cell in missing if cell.kind == kind)
    source = "measured here" if len(measured) == len({c.kind for c in missing}) else "partly from earlier measurements"
    hands = f"{_time(seconds / workers)} with {counted(workers, 'worker')}"
    return f"{counted(len(missing), 'cell')} missing: about {hands} ({source})"


def _share(plan: Plan, cell: Cell) -> float:
    """How much smaller a cell is than by itself, where the plan is limited to try things out."""
    arena = plan.arena(cell.arena)
    if cell.kind == "train":
        full = Plan(plan.arenas, plan.learners).settings(cell)["hyperparameters"]["n_timesteps"]
        return plan.settings(cell)["hyperparameters"]["n_timesteps"] / full
    return 1.0 if cell.kind == "decide" else plan.episodes_of(arena) / arena.episodes


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
