"""Tasks in their order over an engine: those of a lost worker are done again, all others once."""

from __future__ import annotations

import sys
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from ..processes import sigterm_as_ctrl_c

__all__ = ["ENVIRONMENT", "Engine", "Lost", "Outcome", "Task", "run"]

ATTEMPTS = 3
"""Number of workers that a task may lose."""

ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "MAGWIRE_THREADS"), "1"
)
"""A worker's environment: one thread for each library, since there is a worker for each core."""


class Lost(Exception):
    """The process or the node that did a task is gone."""


@dataclass(frozen=True)
class Task:
    """A piece of work.

    work : a function at the top of a module, called as ``work(*arguments, attempt=n)`` with n from 0
    needs : names of tasks that must have been tried before
    """

    name: str
    work: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    needs: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Outcome:
    """What became of a task: what it returned, or why it failed."""

    task: Task
    result: Any = None
    failure: BaseException | None = None


class Engine(Protocol):
    """Where tasks are done. A ticket stands for one that is under way."""

    def room(self) -> bool:
        """Whether one more task would begin at once."""

    def submit(self, task: Task, attempt: int) -> Hashable:
        """Begin a task; returns its ticket."""

    def wait(self) -> Iterable[tuple[Hashable, Any, BaseException | None]]:
        """Tickets of some tasks that have ended, at least one, with what they returned or raised, or `Lost`."""

    def close(self, hurry: bool = False) -> None:
        """Give the workers back. In a hurry they are asked to save and end, and ended if they take too long."""


def run(
    engine: Engine,
    tasks: Iterable[Task],
    done: Callable[[Outcome], None] = lambda _: None,
    progress: bool | None = None,
) -> list[Outcome]:
    """Do all tasks, each when those that it needs have been tried; returns their outcomes in the order they ended in.

    done : is told every outcome at once
    progress : show a bar on the error stream; by default on a terminal

    Closes the engine. Ctrl-C and SIGTERM have the workers save what they can, and raise `KeyboardInterrupt`.
    """
    waiting = [(task, 0) for task in tasks]
    open_names = {task.name for task, _ in waiting}
    running: dict[Hashable, tuple[Task, int]] = {}
    outcomes: list[Outcome] = []
    bar = _bar(len(waiting), sys.stderr.isatty() if progress is None else progress)
    finished = False
    with sigterm_as_ctrl_c():
        try:
            while waiting or running:
                while engine.room() and (ready := _ready(waiting, open_names)) is not None:
                    waiting.remove(ready)
                    running[engine.submit(*ready)] = ready
                if not running:
                    raise ValueError(f"tasks need one another in a circle: {waiting[0][0].name}")
                for ticket, result, failure in engine.wait():
                    task, attempt = running.pop(ticket)
                    if isinstance(failure, Lost) and attempt + 1 < ATTEMPTS:
                        waiting.insert(0, (task, attempt + 1))
                        continue
                    outcomes.append(Outcome(task, result, failure))
                    open_names.discard(task.name)
                    bar.update()
                    done(outcomes[-1])
            finished = True
        finally:
            bar.close()
            engine.close(hurry=not finished)
    return outcomes


def _ready(waiting: list[tuple[Task, int]], open_names: set[str]) -> tuple[Task, int] | None:
    return next((entry for entry in waiting if not entry[0].needs & open_names), None)


def _bar(total: int, shown: bool) -> Any:
    from tqdm import tqdm

    return tqdm(total=total, disable=not shown, unit="task", file=sys.stderr)
