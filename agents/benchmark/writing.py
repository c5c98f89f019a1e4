"""How the benchmark's pages write numbers, tables and what they were made with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from magwire_env.words import counted

__all__ = ["NONE", "between", "labelled", "percent", "provenance", "table", "trained_label"]

NONE = "–"
"""What stands for a number that does not exist."""

_LABELS = {"par": "par", "controller": "", "floor": "floor", "trained": "trained"}


def labelled(name: str, kind: str) -> str:
    """A policy's name with what kind of policy it is."""
    return name + (f" *({_LABELS[kind]})*" if _LABELS[kind] else "")


def trained_label(entry: dict[str, Any]) -> str:
    """A trained policy's name with its number of training seeds."""
    seeds, planned = entry["seeds"], entry["seeds_planned"]
    count = counted(planned, "seed") if seeds == planned else f"{seeds} of {planned} seeds"
    return f"{entry['policy']} *(trained, {count})*"


def provenance(data: dict[str, Any]) -> str:
    """The section on what the numbers were made with."""
    made = data["made"]
    versions = ", ".join(f"{name} {number}" for name, number in made["versions"].items())
    rows = [
        [kind, str(work["cells"]), f"{work['seconds']:.0f}", f"{work['seconds'] / work['cells']:.1f}"]
        for kind, work in data["work"].items()
    ]
    return (
        f"## Made with\n\nCommit {made['commit']}, {made['date']}, {made['cpu']}, {made['cores']} cores, "
        f"{made['system']}, Python {made['python']}, {versions}. One thread a worker process.\n\n"
        + table(["kind of cell", "cells", "seconds of one core", "seconds a cell"], rows)
    )


def between(values: Sequence[float | None], digits: int) -> str:
    """A number with its interval."""
    value, low, high = values
    if value is None or low is None or high is None:
        return NONE if value is None else f"{value:.{digits}f}"
    return f"{value:.{digits}f} ({low:.{digits}f}–{high:.{digits}f})"


def percent(share: float) -> str:
    """Whole percents; but 100 % only for all, and 0 % only for none."""
    text = f"{100 * share:.0f}"
    if (text == "100" and share < 1.0) or (text == "0" and share > 0.0):
        text = f"{100 * share:.1f}" if f"{100 * share:.1f}" not in ("100.0", "0.0") else f"{100 * share:.2f}"
    return f"{text} %"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
