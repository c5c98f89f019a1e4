"""What a check is, how checks are run, and the table they print."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from ..progress import Progress

__all__ = ["FULL", "TEST", "Check", "Row", "Size", "at_least", "at_most", "format_table", "run", "table"]


class Size(NamedTuple):
    """How much work the checks put in; what they claim is the same at every size."""

    segments: int  # of a free rod held against a closed form
    directions: int  # round a magnet
    samples: int  # of a check over random cases
    loads: int  # random ones on the free rod
    places: int  # along a tract
    halvings: int  # of a step or a mesh, to observe an order
    seconds: float  # of motion whose energy is watched
    trips: int  # of every kind from a shape back to the field that makes it


FULL = Size(segments=200, directions=1000, samples=200, loads=10_000, places=1601, halvings=4, seconds=10.0, trips=200)
TEST = Size(segments=100, directions=100, samples=20, loads=60, places=401, halvings=2, seconds=2.0, trips=6)


@dataclass(frozen=True)
class Row:
    """One line of the table.

    expected, ours : in `unit`
    source : where `expected` comes from
    tolerance : largest relative error allowed; not used with a bound
    bound : "" if `ours` should equal `expected`; "≤" or "≥" if `expected` only bounds it
    skipped : why there is no `ours`
    """

    quantity: str
    unit: str
    expected: float
    source: str
    ours: float
    tolerance: float = 0.0
    bound: str = ""
    skipped: str = ""

    @property
    def error(self) -> float:
        """Relative error; NaN for a bound, infinite where `expected` is zero and `ours` is not."""
        if self.bound or self.skipped:
            return math.nan
        if self.expected == 0.0:
            return 0.0 if self.ours == 0.0 else math.inf
        return abs(self.ours / self.expected - 1.0)

    @property
    def holds(self) -> bool:
        """A row that is skipped does not fail; one that is not a number does."""
        if self.skipped:
            return True
        if self.bound:
            return self.ours <= self.expected if self.bound == "≤" else self.ours >= self.expected
        return self.error <= self.tolerance

    @property
    def verdict(self) -> str:
        return "skipped" if self.skipped else "holds" if self.holds else "FAILS"

    def cells(self) -> tuple[str, ...]:
        """The row as the table prints it. A bound other than 0 is a threshold of ours, and is named so."""
        unit = f" {self.unit}" if self.unit else ""
        ours_alone = " (ours)" if self.bound and self.expected != 0.0 else ""
        expected = f"{self.bound} {_number(self.expected)}{unit}{ours_alone}".strip()
        ours = self.skipped or f"{_number(self.ours)}{unit}"
        error = "" if math.isnan(self.error) else f"{self.error:.1e} (≤ {self.tolerance:.0e})"
        return self.quantity, expected, self.source, ours, error, self.verdict


def at_most(quantity: str, unit: str, most: float, source: str, ours: float) -> Row:
    """A row that holds if `ours` does not exceed `most`."""
    return Row(quantity, unit, most, source, ours, bound="≤")


def at_least(quantity: str, unit: str, least: float, source: str, ours: float) -> Row:
    """A row that holds if `ours` does not fall short of `least`."""
    return Row(quantity, unit, least, source, ours, bound="≥")


@dataclass(frozen=True)
class Check:
    """One check: `rows_of` takes a `Size`; `needs` names a module without which it is skipped."""

    name: str
    rows_of: Callable[[Size], list[Row]]
    needs: str = ""

    def rows(self, size: Size) -> list[Row]:
        """Its rows, or one that says why it was skipped."""
        if self.needs and importlib.util.find_spec(self.needs) is None:
            return [Row(self.name, "", math.nan, self.needs, math.nan, skipped=f"{self.needs} is not installed")]
        return self.rows_of(size)


def run(checks: Iterable[Check], size: Size = FULL) -> list[Row]:
    """Every row of `checks`, in order."""
    checks, rows = tuple(checks), []
    with Progress("checking", len(checks)) as progress:
        for check in checks:
            progress.stage = check.name
            rows += check.rows(size)
            progress.done += 1
    return rows


def table(rows: Iterable[Row], markdown: bool = False) -> str:
    """The rows as a table of text, or of Markdown."""
    head = ("quantity", "expected", "source", "ours", "relative error (allowed)", "verdict")
    return format_table(head, [row.cells() for row in rows], markdown)


def format_table(head: tuple[str, ...], lines: list[tuple[str, ...]], markdown: bool = False) -> str:
    """Columns under a heading, padded to equal widths, or as Markdown."""
    if markdown:
        rule = ["---"] * len(head)
        return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, rule, *lines])
    widths = [max(len(cells[i]) for cells in [head, *lines]) for i in range(len(head))]
    rows = [head, tuple("-" * w for w in widths), *lines]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(cells, widths, strict=True)).rstrip() for cells in rows)


def _number(value: float) -> str:
    return f"{value:.5g}"
