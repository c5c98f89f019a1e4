"""Makes the benchmark's cells as tasks of an engine; a failed cell does not stop the others."""

from __future__ import annotations

import contextlib
import fnmatch
import secrets
import tempfile
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from magwire_env.progress import Progress

from ..engines import Outcome, Task, engine, run
from ..engines.shared import Shared
from ..learning.run_folder import locked
from .plan import Cell, Plan

__all__ = ["Job", "jobs_of", "make_cells", "run_cells", "selected"]


@dataclass(frozen=True)
class Job:
    """Cells that one process makes one after the other, when all cells of `needs` have been tried."""

    cells: tuple[Cell, ...]
    needs: frozenset[Cell]

    @property
    def name(self) -> str:
        """Its first cell's."""
        return self.cells[0].name


def selected(cells: Sequence[Cell], only: Sequence[str]) -> list[Cell]:
    """The cells whose name contains one of the patterns `only` (with * and ? as in a shell); all without a pattern."""
    if not only:
        return list(cells)
    kept = [cell for cell in cells if any(fnmatch.fnmatch(cell.name, f"*{pattern}*") for pattern in only)]
    if not kept:
        raise ValueError(f"only must match some cell's name, such as {cells[0].name!r}; got {', '.join(only)}")
    return kept


def jobs_of(plan: Plan, cells: Sequence[Cell]) -> list[Job]:
    """A job for each long cell; one for the seeds of a training, and for an arena's short cells, which share a pool."""
    together: dict[tuple[str, ...], list[Cell]] = {}
    jobs, asked = [], set(cells)

    def job(some: Sequence[Cell]) -> Job:
        needs = {training for cell in some if (training := plan.training_of(cell)) is not None}
        return Job(tuple(some), frozenset(needs & asked))

    for cell in cells:
        if cell.kind in ("par", "robustness") or plan.plans_online(cell.policy):
            jobs.append(job([cell]))
        else:
            own = ("train", cell.policy) if cell.kind == "train" else ()
            together.setdefault((cell.arena, *own), []).append(cell)
    # Trainings first, because most other cells wait for them.
    found = [*jobs, *(job(some) for some in together.values())]
    return sorted(found, key=lambda one: one.cells[0].kind != "train")


def run_cells(
    plan: Plan, cells: Sequence[Cell], out: Path, workers: int, ray: str | None = None, store: str | None = None
) -> list[Cell]:
    """Make `cells`, and have their files in `out`; returns the cells that failed, whose logs have the tracebacks.

    workers, ray : see `agents.engines.engine`
    store : URL through which workers share files, for nodes that do not share the folder `out`
    """
    chosen = engine(workers, ray)
    with locked(out):
        token, jobs = secrets.token_hex(8), jobs_of(plan, cells)
        failed: list[Cell] = []
        names = {cell: job.name for job in jobs for cell in job.cells}
        tasks = [
            Task(job.name, make_cells, (plan, job.cells, out, store, token), frozenset(names[c] for c in job.needs))
            for job in jobs
        ]

        def told(outcome: Outcome) -> None:
            made = outcome.task.arguments[1]
            if store is not None:
                Shared(store).pull([name for cell in made for name in _files(plan, cell)], out)
            for cell in made:
                if not _is_new(plan, cell, out, token):
                    failed.append(cell)
                    if outcome.failure is not None:
                        with _opened(cell.log(out)) as log:
                            log.write(f"{type(outcome.failure).__name__}: {outcome.failure}\n")
                print(_said(plan, cell, out, cell in failed), flush=True)
            progress.done += len(made)

        with Progress("making the benchmark's cells", len(cells)) as progress:
            run(chosen, tasks, told)
    return failed


def make_cells(plan: Plan, cells: Sequence[Cell], out: Path, store: str | None, token: str, attempt: int = 0) -> None:
    """A task: make cells in turn, each with its own log. One that fails does not stop the next.

    attempt : of a task that has lost workers; what they finished is not made again
    token : of this run, which the records get
    """
    if store is None:
        _make_each(plan, cells, out, token, attempt)
        return
    shared = Shared(store)
    with tempfile.TemporaryDirectory() as scratch:
        here = Path(scratch)
        needed = {training for cell in cells if (training := plan.training_of(cell)) is not None}
        shared.pull([name for cell in (*needed, *cells) for name in _files(plan, cell)], here)
        try:
            _make_each(plan, cells, here, token, attempt, lambda cell: shared.push(_files(plan, cell), here))
        except KeyboardInterrupt:
            shared.push([name for cell in cells for name in _files(plan, cell)], here)
            raise


def _make_each(
    plan: Plan,
    cells: Sequence[Cell],
    out: Path,
    token: str,
    attempt: int,
    keep: Callable[[Cell], None] = lambda _: None,
) -> None:
    from .cells import make

    for cell in cells:
        if attempt and _is_new(plan, cell, out, token):
            continue
        log = cell.log(out)
        log.parent.mkdir(parents=True, exist_ok=True)
        try:
            with (
                log.open("w", encoding="utf-8", buffering=1) as file,
                contextlib.redirect_stdout(file),
                contextlib.redirect_stderr(file),
            ):
                make(plan, cell, out, token)
        except Exception:
            with _opened(log) as end:
                traceback.print_exc(file=end)
        keep(cell)


def _files(plan: Plan, cell: Cell) -> list[str]:
    """Names of a cell's files and folders, relative to the output folder."""
    root = Path()
    found = [cell.file(root), cell.log(root), *([cell.run(root)] if cell.kind == "train" else [])]
    return [path.as_posix() for path in found]


def _is_new(plan: Plan, cell: Cell, out: Path, token: str) -> bool:
    """The cell has a record with the plan's settings that this run has made."""
    record = plan.record(cell, out)
    return record is not None and record.get("made_by") == token


def _said(plan: Plan, cell: Cell, out: Path, failed: bool) -> str:
    """A line about a cell that has been tried."""
    record = None if failed else plan.record(cell, out)
    if record is None:
        reason = cell.log(out).read_text(encoding="utf-8").strip().splitlines()[-1:] if cell.log(out).exists() else []
        return f"FAILED    {cell.name}: {''.join(reason)}, see {cell.log(out)}"
    return f"{'n/a' if 'not_applicable' in record else 'done':<9} {cell.name}, {record['seconds']:.1f} s"


def _opened(path: Path) -> TextIO:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("a", encoding="utf-8", buffering=1)
