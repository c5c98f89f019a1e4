"""docs/physics.md is printed by a command. Its short tables say what its long one says; bad pages are refused."""

from pathlib import Path

import pytest

from magwire_env.quasistatic.reach import drives, recorded
from magwire_env.validation import CHECKS, FULL, Row, run
from magwire_env.validation.page import LONG, REACH, SHORT, UNLOCKED, reach_tables, verdicts, without_numbers, written
from magwire_env.validation.report import at_most

PAGE = (Path(__file__).parents[2] / "docs/physics.md").read_text(encoding="utf-8")
SMALL = (
    f"text\n\n{SHORT}\n|---|---|\n| a, 3 of 4 | stale |\n\n{REACH[0]}\nstale\n{REACH[1]}\n"
    f"{UNLOCKED[0]}\nstale\n{UNLOCKED[1]}\n\n{LONG}\nstale\n"
)


def long_lines() -> list[list[str]]:
    """The cells of the page's long table."""
    lines = [line for line in PAGE[PAGE.index(LONG) :].splitlines()[2:] if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def long_table() -> dict[str, list[str]]:
    """The same by quantity."""
    return {line[0]: line for line in long_lines()}


def test_short_tables_say_what_the_long_one_says():
    long, found = long_table(), 0
    for block in PAGE.split(SHORT)[1:]:
        for line in block.strip().splitlines()[1:]:
            if not line.startswith("| "):
                break
            quantity, ours = (cell.strip() for cell in line.strip("|").split(" | "))
            assert long[quantity][3] == ours
            found += 1
    assert found > 10


@pytest.mark.parametrize("name", ["printed constants", "block and tip, coaxial", "its limits"])
def test_the_long_table_is_what_the_command_prints(name):
    rows = run([check for check in CHECKS if check.name == name], FULL)
    long = long_table()
    for row in rows:
        if abs(row.ours) > 1e-9:  # what is rounding alone differs between processors
            assert [cell.strip() for cell in row.cells()] == long[row.quantity]


def test_the_reach_tables_on_the_page_are_what_the_command_prints():
    inside = PAGE.partition(REACH[0])[2].partition(REACH[1])[0]
    assert inside.strip() == reach_tables(recorded(), drives())


def test_the_number_of_rows_that_hold_is_that_of_the_table():
    lines = long_lines()
    assert f"{len(lines)} hold, 0 skipped, 0 fail." in PAGE


def test_a_page_is_printed_anew(monkeypatch):
    monkeypatch.setattr("magwire_env.validation.page.drives", lambda: ())
    monkeypatch.setattr("magwire_env.validation.unlocked.crossings", lambda: ())
    rows = [at_most("a, 5 of 6", "mm", 2.0, "theory", 1.5)]
    page = written(SMALL, rows)
    assert "| a, 5 of 6 | 1.5 mm |" in page
    assert "stale" not in page
    assert page.endswith("1 hold, 0 skipped, 0 fail.\n")
    assert without_numbers("a, 5 of 6") == without_numbers("a, 3 of 4")
    assert verdicts([Row("b", "", 1.0, "s", 2.0, 0.1)]) == "0 hold, 0 skipped, 1 fail"


@pytest.mark.parametrize(
    ("page", "message"),
    [
        (SMALL.replace(LONG, ""), "page must hold the line"),
        (SMALL.replace(REACH[1], ""), "page must hold the lines"),
        (SMALL.replace(UNLOCKED[0], ""), "page must hold the lines"),
        (SMALL.replace("a, 3 of 4", "unknown"), "no check prints: 'unknown'"),
    ],
)
def test_a_page_without_its_marks_is_refused(page, message, monkeypatch):
    monkeypatch.setattr("magwire_env.validation.unlocked.crossings", lambda: ())
    with pytest.raises(ValueError, match=message):
        written(page, [at_most("a, 5 of 6", "mm", 2.0, "theory", 1.5)])
