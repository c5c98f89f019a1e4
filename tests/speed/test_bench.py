"""docs/speed.md keeps one set of tables for each processor."""

import pytest

from tests.speed.bench import DOCS, machine, processor, with_tables


def test_each_processor_keeps_its_own_tables():
    page = (DOCS / "speed.md").read_text(encoding="utf-8")
    other = with_tables(page, "Another (AVX2)", "its figures")
    assert other.count("<!-- end -->") == page.count("<!-- end -->") + 1
    assert "## On Another (AVX2)\n\nits figures\n" in other
    again = with_tables(other, "Another (AVX2)", "newer figures")
    assert again == other.replace("its figures", "newer figures")
    assert (
        again.replace(
            again[again.index("\n\n<!-- printed by tests.speed.bench on Another") : again.rindex("<!-- end -->") + 12],
            "",
        )
        == page
    )
    with pytest.raises(ValueError, match="must hold the tables"):
        with_tables("nothing", "Another", "figures")


def test_the_bench_names_the_processor():
    assert processor() in machine()
