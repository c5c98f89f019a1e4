"""Tasks in processes of this machine, by the standard library's executors."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Hashable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from typing import Any

from ..processes import PATIENCE, end_with_parent
from .engine import ENVIRONMENT, Lost, Task

__all__ = ["LocalEngine"]


class LocalEngine:
    """As many single-process executors as there are workers: one that dies takes no other's task with it."""

    def __init__(self, workers: int) -> None:
        self._executors: list[ProcessPoolExecutor | None] = [None] * workers
        self._busy: dict[Future, int] = {}
        self._processes: set[BaseProcess] = set()

    def room(self) -> bool:
        """As `Engine.room`."""
        return len(self._busy) < len(self._executors)

    def submit(self, task: Task, attempt: int) -> Hashable:
        """As `Engine.submit`."""
        slot = next(i for i in range(len(self._executors)) if i not in self._busy.values())
        with _environment():
            executor = self._executors[slot]
            if executor is None:
                executor = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent)
                self._executors[slot] = executor
            before = set(multiprocessing.active_children())
            future = executor.submit(_call, task.work, task.arguments, attempt)  # the first one starts the process
            self._processes |= set(multiprocessing.active_children()) - before
        self._busy[future] = slot
        return future

    def wait(self) -> Iterable[tuple[Hashable, Any, BaseException | None]]:
        """As `Engine.wait`."""
        ended, _ = wait(self._busy, return_when=FIRST_COMPLETED)
        found: list[tuple[Hashable, Any, BaseException | None]] = []
        for future in ended:
            slot, failure = self._busy.pop(future), future.exception()
            if isinstance(failure, BrokenProcessPool):
                failure = Lost("the worker process ended")
                self._drop(slot)
            found.append((future, None if failure else future.result(), failure))
        return found

    def _drop(self, slot: int) -> None:
        executor = self._executors[slot]
        self._executors[slot] = None
        if executor is not None:
            executor.shutdown(wait=False, cancel_futures=True)

    def close(self, hurry: bool = False) -> None:
        """As `Engine.close`."""
        if hurry:
            living = self._processes & set(multiprocessing.active_children())
            for process in living:
                process.terminate()
            until = time.monotonic() + PATIENCE
            try:
                for process in living:
                    process.join(max(0.0, until - time.monotonic()))
            finally:
                for process in living:
                    process.kill()
        for slot in range(len(self._executors)):
            executor = self._executors[slot]
            if executor is not None:
                executor.shutdown(wait=not hurry, cancel_futures=True)
            self._executors[slot] = None


def _call(work: Any, arguments: tuple[Any, ...], attempt: int) -> Any:
    """A task, in the worker. One that is asked to end has saved what it can, and its process goes."""
    try:
        return work(*arguments, attempt=attempt)
    except KeyboardInterrupt:
        os._exit(130)


@contextmanager
def _environment() -> Iterator[None]:
    """Processes that are started within have `ENVIRONMENT`; libraries read it when they are imported."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
