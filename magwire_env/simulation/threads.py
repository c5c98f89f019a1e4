"""Sharing a batch's blocks out over threads.

The kernels release the interpreter's lock, so plain threads run them side by side: the very same compiled code, and
so the same bits, as in one thread. After a fork the child has no worker threads and runs serially.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from operator import length_hint
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

__all__ = ["cores", "share_out"]

_BLOCKS_A_THREAD = 4
"""Fewest blocks worth a thread: below, waking it costs more than it saves."""

_jobs: SimpleQueue | None = None
_forked = False


def share_out(
    run: Callable[[np.ndarray, Any], None],
    blocks: np.ndarray,
    workspaces: Sequence[Any],
    threads: int | None = None,
) -> None:
    """Call ``run(some_blocks, workspace)`` over all `blocks`, on `threads` threads or as many as pay.

    workspaces : one a thread, made by the caller, as many as `cores()`; no two calls at a time may share them
    """
    parts = threads or len(blocks) // _BLOCKS_A_THREAD
    parts = max(1, min(parts, len(blocks), len(workspaces)))
    if parts == 1 or _forked:
        run(blocks, workspaces[0])
        return
    jobs, others = _queue(), _Others(parts - 1)
    ends = [len(blocks) * i // parts for i in range(parts + 1)]
    asked = iter([(run, blocks[ends[i] : ends[i + 1]], workspaces[i], others.tell, i - 1) for i in range(1, parts)])
    failure: BaseException | None = None
    try:
        try:
            deque(map(jobs.put, asked), maxlen=0)  # all of them or, if Ctrl-C comes before, none
            run(blocks[: ends[1]], workspaces[0])
        except BaseException as own:
            failure = own
    finally:
        late = others.wait() if length_hint(asked) == 0 else None
    failure = failure or late
    if failure is not None:
        raise failure


class _Others:
    """Waits until the other threads' parts have ended: nobody may still be writing when a step returns.

    A second Ctrl-C comes while one waits after the first. So each part leaves its outcome in a place of its own, and
    an interrupted wait looks there again.
    """

    def __init__(self, count: int) -> None:
        self._outcomes: list[Any] = [_RUNNING] * count
        self._news: SimpleQueue[None] = SimpleQueue()

    def tell(self, part: int, outcome: BaseException | None) -> None:
        """A part has ended, by a failure or not."""
        self._outcomes[part] = outcome
        self._news.put(None)

    def wait(self) -> BaseException | None:
        """Returns the first failure, or None; an interrupt while waiting counts as one."""
        stopped: BaseException | None = None
        while True:
            try:
                while any(outcome is _RUNNING for outcome in self._outcomes):
                    with suppress(Empty):
                        self._news.get(timeout=None if stopped is None else 0.01)
                break
            except BaseException as interrupt:
                stopped = interrupt
        failures = (outcome for outcome in self._outcomes if isinstance(outcome, BaseException))
        return next(failures, stopped)


_RUNNING = object()


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _queue() -> SimpleQueue:
    """The workers' queue; they are started with it. A plain queue wakes them in half the time of an executor."""
    global _jobs
    if _jobs is None:
        _jobs = SimpleQueue()
        for _ in range(max(1, cores() - 1)):
            threading.Thread(target=_work, args=(_jobs,), name="magwire", daemon=True).start()
    return _jobs


def _work(jobs: SimpleQueue) -> None:
    while True:
        run, blocks, workspace, tell, part = jobs.get()
        try:
            run(blocks, workspace)
        except BaseException as failure:
            tell(part, failure)
        else:
            tell(part, None)
        del run, blocks, workspace, tell  # no array is kept alive by an idle worker


def _after_fork() -> None:
    global _jobs, _forked
    _jobs, _forked = None, True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
