"""The sets of arenas that `magwire benchmark --set` makes, each with a report of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import free_report
from .free import FREE_ARENAS, FREE_LEARNERS
from .plan import ARENAS, LEARNERS, ROBUSTNESS, Arena, Learner
from .report import LOCKED, Form

__all__ = ["SETS", "BenchmarkSet"]


@dataclass(frozen=True)
class BenchmarkSet:
    """What is benchmarked together, and the form of its report."""

    arenas: tuple[Arena, ...]
    learners: tuple[Learner, ...]
    robustness: Mapping[str, tuple[str, ...]]
    form: Form


def _no_figures(data: dict[str, Any], docs: Path, digest: str) -> list[Path]:
    return []


_FREE = Form(
    "benchmark_trees",
    ("<!-- benchmark_trees:begin -->", "<!-- benchmark_trees:end -->"),
    free_report.markdown,
    free_report.readme_table,
    _no_figures,
)

SETS = {
    "locked": BenchmarkSet(ARENAS, LEARNERS, ROBUSTNESS, LOCKED),
    "free": BenchmarkSet(FREE_ARENAS, FREE_LEARNERS, {}, _FREE),
}
