"""The speed benchmarks: every figure a ratio or a median from this one run, with its spread.

`python -m tests.speed.bench` prints them all as Markdown; `--only rates cold` some; `--write` puts them, with the plot,
into ``docs/speed.md`` between its marks.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path

from tests.speed import cold, rates, scaling, stages
from tests.speed.accuracy import references

DOCS = Path(__file__).parents[2] / "docs"
BEGIN, END = "<!-- printed by tests.speed.bench on {} -->", "<!-- end -->"


def processor() -> str:
    """The processor's name, with its widest vectors."""
    name, flags = platform.processor() or platform.machine(), set[str]()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
        flags = set(next((line.split(":")[1].split() for line in lines if line.startswith("flags")), ()))
    except (OSError, StopIteration):
        pass
    widest = next((word for flag, word in (("avx512f", " (AVX-512)"), ("avx2", " (AVX2)")) if flag in flags), "")
    return name + widest


def machine() -> str:
    """Processor and how busy it was."""
    name = processor()
    load = f", load average {os.getloadavg()[0]:.2f} before the run" if hasattr(os, "getloadavg") else ""
    return f"{os.cpu_count()} cores of {name}, Python {platform.python_version()}{load}."


def sections(plot: Path | None) -> dict[str, tuple[str, Callable[[], str]]]:
    """By the name to ask for one: heading and what prints it."""
    refs = references()
    return {
        "batch": ("1. The native batch", lambda: rates.batch(refs)),
        "differ": ("2. Lanes that differ", rates.lanes_that_differ),
        "single": ("3. The single env", rates.single),
        "plans": ("4. Rolling plans out", rates.plans),
        "training": ("5. Training", rates.training),
        "elastica": ("6. PyElastica", rates.elastica),
        "scaling": ("7. Cost against size", lambda: scaling.scaling(plot)),
        "cold": ("8. Cold start", cold.cold_start),
        "stages": ("9. Where the time goes", stages.where_the_time_goes),
        "precision": ("10. Work and precision", lambda: scaling.work_precision(refs)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="batch, differ, single, plans, training, …")
    parser.add_argument("--write", action="store_true", help="into docs/speed.md")
    options = parser.parse_args()
    found = sections(DOCS / "speed.png" if options.write else None)
    unknown = set(options.only or ()) - set(found)
    if unknown:
        parser.error(f"--only must name some of {', '.join(found)}; got {min(unknown)!r}")
    printed = [machine()]
    print(printed[0], flush=True)
    for name in options.only or found:
        heading, section = found[name]
        start = time.perf_counter()
        printed.append(f"### {heading}\n\n{section()}")
        print(f"\n{printed[-1]}\n\n({time.perf_counter() - start:.0f} s)", flush=True)
    if options.write:
        page = DOCS / "speed.md"
        text = with_tables(page.read_text(encoding="utf-8"), processor(), "\n\n".join(printed))
        page.write_text(text, encoding="utf-8")


def with_tables(page: str, name: str, tables: str) -> str:
    """The page with a processor's tables in place of those it had, or behind those of the others."""
    begin = BEGIN.format(name)
    block = f"{begin}\n\n## On {name}\n\n{tables}\n\n{END}"
    before, found, rest = page.partition(begin)
    if found:
        return before + block + rest.partition(END)[2]
    before, found, rest = page.rpartition(END)
    if not found:
        raise ValueError(f"the page must hold the tables of a processor, up to {END!r}; it has none")
    return f"{before}{END}\n\n{block}{rest}"


if __name__ == "__main__":
    main()
