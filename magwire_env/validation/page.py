"""docs/physics.md, its tables printed anew: `python -m magwire_env.validation.page docs/physics.md`.

The long table is what `magwire validate --markdown` prints. The short ones take their rows from it. The tables on the
claim's reach are those of `magwire_env.quasistatic.reach`, from its record; that on the free wire is made by
`magwire_env.validation.unlocked`. All checks at full size take about half an
hour; a run that was broken off goes on with the checks that it had not finished.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from ..quasistatic.reach import Drive, Reach, drives, recorded
from . import CHECKS, FULL, Row, run, table, unlocked
from .report import format_table

__all__ = ["LONG", "REACH", "SHORT", "UNLOCKED", "reach_tables", "verdicts", "written"]

LONG = "| quantity | expected | source | ours | relative error (allowed) | verdict |"
"""Heading of the long table; it is the last on the page."""

SHORT = "| quantity | ours |"
"""Heading of the short ones."""

REACH = ("<!-- reach:begin -->", "<!-- reach:end -->")
UNLOCKED = ("<!-- unlocked:begin -->", "<!-- unlocked:end -->")


def written(page: str, rows: Sequence[Row]) -> str:
    """The text `page` with all its tables printed anew.

    Raises `ValueError` for a short table's line whose quantity no row has, or a page without its marks.
    """
    cells = {without_numbers(row.quantity): row.cells() for row in rows}
    lines, short = [], False
    for line in page.splitlines():
        if line == LONG:
            break
        short = line == SHORT or (short and line.startswith("|"))
        if short and line != SHORT and not line.startswith("|---"):
            lines.append(_short_line(line, cells))
        else:
            lines.append(line)
    else:
        raise ValueError(f"page must hold the line {LONG!r}")
    text = "\n".join(lines) + "\n" + table(rows, markdown=True) + "\n\n" + verdicts(rows) + ".\n"
    text = _between(text, REACH, reach_tables(recorded(), drives()))
    return _between(text, UNLOCKED, unlocked.table(unlocked.crossings()))


def _between(text: str, marks: tuple[str, str], inside: str) -> str:
    """The text with what stands between two marks printed anew."""
    before, first, rest = text.partition(marks[0])
    _, last, after = rest.partition(marks[1])
    if not first or not last:
        raise ValueError(f"page must hold the lines {marks[0]!r} and {marks[1]!r}, in this order")
    return f"{before}{first}\n{inside}\n{last}{after}"


def reach_tables(reaches: Sequence[Reach], found: Sequence[Drive]) -> str:
    """On how many tracts the claim holds, and what every rig does along the paper's, as Markdown."""
    head: tuple[str, ...] = (
        "tracts",
        "7 cm to the",
        "rig",
        "coupling",
        "forwards",
        "backwards",
        "both",
        "weakest margin, median",
    )
    lines: list[tuple[str, ...]] = [
        (r.tracts, r.reading, r.rig, f"`{r.coupling}`", *(f"{n} of {r.number}" for n in (r.forward, r.back, r.both)),
         f"{1e3 * r.weakest:.2f} mN")
        for r in reaches
    ]  # fmt: skip
    first = format_table(head, lines, markdown=True)
    head = (
        "rig, on the paper's tract",
        "coupling",
        "least drive",
        "median drive",
        "median torque",
        "the same at the drive of the first rig",
    )
    rows: list[tuple[str, ...]] = [
        (d.rig, f"`{d.coupling}`", f"{1e3 * d.least:.1f} mN", f"{1e3 * d.median:.1f} mN", f"{1e3 * d.torque:.2f} mN·m",
         f"{1e3 * d.spared:.2f} mN·m")
        for d in found
    ]  # fmt: skip
    return f"{first}\n\n{format_table(head, rows, markdown=True)}"


def without_numbers(quantity: str) -> str:
    """A row's quantity without the numbers in it, which depend on the size of the check."""
    return re.sub(r"[-\d.]+", "#", quantity)


def verdicts(rows: Sequence[Row]) -> str:
    """How many rows hold, were skipped, and fail."""
    found = [row.verdict for row in rows]
    return f"{found.count('holds')} hold, {found.count('skipped')} skipped, {found.count('FAILS')} fail"


def _short_line(line: str, cells: dict[str, tuple[str, ...]]) -> str:
    quantity = line.split(" | ")[0].strip("| ")
    if without_numbers(quantity) not in cells:
        raise ValueError(f"page has a line for a quantity that no check prints: {quantity!r}")
    now = cells[without_numbers(quantity)]
    return f"| {now[0]} | {now[3]} |"


def finished(store: Path) -> dict[str, list[Row]]:
    """The rows of the checks that an earlier run finished, by check."""
    if not store.exists():
        return {}
    tree = json.loads(store.read_text(encoding="utf-8"))
    return {name: [Row(**row) for row in rows] for name, rows in tree.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("page", type=Path, help="docs/physics.md")
    parser.add_argument(
        "--store", type=Path, default=Path("runs/validation.json"), help="where finished checks are kept"
    )
    parser.add_argument("--again", action="store_true", help="run finished checks again")
    options = parser.parse_args()
    done = {} if options.again else finished(options.store)
    options.store.parent.mkdir(parents=True, exist_ok=True)
    for number, check in enumerate(CHECKS, start=1):
        if check.name not in done:
            print(f"{number} of {len(CHECKS)}: {check.name}", flush=True)
            done[check.name] = run([check], FULL)
            tree = {name: [asdict(row) for row in rows] for name, rows in done.items()}
            options.store.write_text(json.dumps(tree), encoding="utf-8")
    rows = [row for check in CHECKS for row in done[check.name]]
    options.page.write_text(written(options.page.read_text(encoding="utf-8"), rows), encoding="utf-8")
    print(verdicts(rows))


if __name__ == "__main__":
    main()
