"""What a check is, how checks are run, and the table they print."""

from __future__ import annotations

import importlib.util
import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from textwrap import wrap
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
    published : a bound is a figure of others
    """

    quantity: str
    unit: str
    expected: float
    source: str
    ours: float
    tolerance: float = 0.0
    bound: str = ""
    skipped: str = ""
    published: bool = False

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
        """The row as the table prints it. A bound of ours other than 0 is named so."""
        unit = f" {self.unit}" if self.unit else ""
        ours_alone = " (ours)" if self.bound and self.expected != 0.0 and not self.published else ""
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
    with Progress("checking", len(checks)) as progress, warnings.catch_warnings():
        # Benches have wires and periods of no real device; `Scenario` says so.
        warnings.filterwarnings("ignore", ".*which is hardly meant")
        for check in checks:
            progress.stage = check.name
            rows += check.rows(size)
            progress.done += 1
    return rows


def table(rows: Iterable[Row], markdown: bool = False) -> str:
    """The rows as a table of text, or of Markdown."""
    head = ("quantity", "expected", "source", "ours", "relative error (allowed)", "verdict")
    return format_table(head, [row.cells() for row in rows], markdown, flexible=(0, 1, 2, 3))


TERMINAL = 120
"""Columns of a terminal that tables must fit."""

_NARROWEST = 10
"""A flexible column gets no narrower than this."""


def format_table(
    head: tuple[str, ...],
    lines: Sequence[tuple[str, ...]],
    markdown: bool = False,
    flexible: tuple[int, ...] = (0,),
) -> str:
    """Columns under a heading, padded to equal widths and no wider than `TERMINAL` in all, or as Markdown.

    flexible : the columns whose texts take several lines where the table is too wide, widest first
    """
    if markdown:
        rule = ["---"] * len(head)
        return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, rule, *lines])
    widths = [max(len(cells[i]) for cells in [head, *lines]) for i in range(len(head))]
    while flexible and sum(widths) + 2 * (len(widths) - 1) > TERMINAL:
        widest = max(flexible, key=lambda i: widths[i])
        if widths[widest] <= _NARROWEST:
            break
        widths[widest] -= 1
    rows = [head, tuple("-" * w for w in widths), *lines]
    return "\n".join(line for cells in rows for line in _lines(cells, widths))


def _lines(cells: Sequence[str], widths: Sequence[int]) -> list[str]:
    """A row of the table: one line, or as many as its longest cell takes."""
    parts = [wrap(c, w) if len(c) > w else [c] for c, w in zip(cells, widths, strict=True)]
    padded = [[(p[k] if k < len(p) else "").ljust(w) for p, w in zip(parts, widths, strict=True)]
              for k in range(max(map(len, parts)))]  # fmt: skip
    return ["  ".join(row).rstrip() for row in padded]


def _number(value: float) -> str:
    return f"{value:.5g}"
