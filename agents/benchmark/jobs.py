"""Runs the benchmark's cells in worker processes, each on a core of its own; a failed cell does not stop the others."""

from __future__ import annotations

import contextlib
import fnmatch
import multiprocessing
import os
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TextIO

from .plan import Cell, Plan

__all__ = ["Job", "jobs_of", "run_cells", "selected"]

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_PATIENCE = 30.0
"""Time for workers to save their results after Ctrl-C, s."""


@dataclass(frozen=True)
class Job:
    """Cells that one process makes one after the other, when all cells of `needs` have been tried."""

    cells: tuple[Cell, ...]
    needs: frozenset[Cell]


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


def run_cells(plan: Plan, cells: Sequence[Cell], out: Path, workers: int) -> list[Cell]:
    """Make `cells` in `workers` processes; returns the cells that failed. The log of such a cell has its traceback."""
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    waiting = jobs_of(plan, cells)
    running: dict[int, tuple[BaseProcess, Job]] = {}
    undone, failed = set(cells), []
    context = multiprocessing.get_context("spawn")
    started = time.time()
    try:
        while waiting or running:
            for slot in set(range(workers)) - set(running):
                ready = next((job for job in waiting if not job.needs & undone), None)
                if ready is None:
                    break
                waiting.remove(ready)
                with _one_thread():
                    process = context.Process(target=_work, args=(plan, ready.cells, out, slot, workers))
                    process.start()
                running[slot] = process, ready
            wait([process.sentinel for process, _ in running.values()])
            for slot, (ended, job) in list(running.items()):
                if not ended.is_alive():
                    ended.join()
                    del running[slot]
                    undone -= set(job.cells)
                    failed += _failures(plan, job, out, ended.exitcode, started)
    except KeyboardInterrupt:
        for worker, _ in running.values():
            worker.join(_PATIENCE)
            worker.terminate()
        raise
    return failed


def _failures(plan: Plan, job: Job, out: Path, status: int | None, started: float) -> list[Cell]:
    """The job's cells that have no new record. If their process died, their logs get a line that says so."""
    failed = []
    for cell in job.cells:
        file = cell.file(out)
        if file.exists() and file.stat().st_mtime >= started - 2 and plan.record(cell, out) is not None:
            continue
        failed.append(cell)
        if status:
            with _opened(cell.log(out)) as log:
                log.write(f"the worker process ended with status {status}\n")
    return failed


def _opened(path: Path) -> TextIO:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("a", encoding="utf-8", buffering=1)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Processes that are started within use one thread for each library; libraries read this when they are imported."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _work(plan: Plan, cells: Sequence[Cell], out: Path, slot: int, workers: int) -> None:
    """A worker process: it makes its cells in turn, logs what they print, and prints a line for each."""
    _take_core(slot, workers)
    from .cells import make

    for cell in cells:
        log = cell.log(out)
        log.parent.mkdir(parents=True, exist_ok=True)
        try:
            with (
                log.open("w", encoding="utf-8", buffering=1) as file,
                contextlib.redirect_stdout(file),
                contextlib.redirect_stderr(file),
            ):
                record = make(plan, cell, out)
        except KeyboardInterrupt:
            return
        except Exception as failure:
            with _opened(log) as end:
                traceback.print_exc(file=end)
            print(f"FAILED    {cell.name}: {failure!r}, see {log}", flush=True)
        else:
            word = "n/a" if "not_applicable" in record else "done"
            print(f"{word:<9} {cell.name}, {record['seconds']:.1f} s", flush=True)


def _take_core(slot: int, workers: int) -> None:
    """Bind the process to one core; the simulator would share large batches out over all cores that it may use."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        if workers <= len(cores):
            os.sched_setaffinity(0, {cores[slot]})
