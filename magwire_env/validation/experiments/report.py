"""What an experiment is, and what it gives back: a table, a figure, its free parameters, and what others reached."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..report import Row, table

__all__ = ["Experiment", "Outcome", "published", "rows_of_file"]


@dataclass(frozen=True)
class Outcome:
    """What an experiment found.

    rows : quantity, bar or published value, ours
    free : the free parameters, in words: what was fitted to the same data
    remarks : what else a reader has to know
    columns : heading → values, written as CSV
    draw : writes the figure
    """

    rows: tuple[Row, ...]
    free: str
    remarks: str
    columns: Mapping[str, Any]
    draw: Callable[[Path], None]

    @property
    def holds(self) -> bool:
        """Whether every row holds."""
        return all(row.holds for row in self.rows)

    def text(self, markdown: bool = False) -> str:
        """The table and the words."""
        return f"{table(self.rows, markdown)}\n\nfree parameters: {self.free}\n{self.remarks}"


@dataclass(frozen=True)
class Experiment:
    """A measurement by others that our models are held against.

    data, source : name of its file, and where it comes from; without a name it needs none
    run : (the data's file) → `Outcome`
    run_in : (the data's file, a lumen's file) → `Outcome`, of an experiment that can take the walls from the user
    """

    name: str
    title: str
    data: str
    source: str
    run: Callable[[Path], Outcome]
    run_in: Callable[[Path, Path], Outcome] | None = None

    def __call__(self, data: Path, lumen: Path | None = None) -> Outcome:
        """Run it on a file, or on the file of its name in a folder. `FileNotFoundError` says what to fetch.

        lumen : file of the walls. Raises `ValueError` for an experiment that takes none
        """
        file = data / self.data if data.is_dir() else data
        if self.data and not file.is_file():
            raise FileNotFoundError(f"{file} is missing: the experiment {self.name!r} reads {self.data}, {self.source}")
        if lumen is None:
            return self.run(file)
        if self.run_in is None:
            raise ValueError(f"lumen must be left out, since the experiment {self.name!r} has no walls, got {lumen}")
        return self.run_in(file, lumen)


def published(bound: str, quantity: str, unit: str, value: float, source: str, ours: float) -> Row:
    """A row that holds if `ours` is on the right side, "≤" or "≥", of a figure of others."""
    return Row(quantity, unit, value, source, ours, bound=bound, published=True)


def rows_of_file(file: Path, columns: tuple[str, ...]) -> list[dict[str, str]]:
    """The rows of a CSV file with remarks. Raises `ValueError` if a column is missing."""
    with file.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    if not rows or (missing := set(columns) - set(rows[0])):
        lacking = ", ".join(sorted(missing)) if rows else "rows"
        raise ValueError(f"{file} must be a CSV file with the columns {', '.join(columns)}; it lacks {lacking}")
    return rows
