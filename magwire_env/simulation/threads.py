"""Sharing a batch's blocks out over threads.

The kernels release the interpreter's lock, so plain threads run them side by side: the very same compiled code, and
so the same bits, as in one thread. After a fork the child has no worker threads and runs serially.
"""

from __future__ import annotations

import _signal  # what `signal` wraps: its own functions make enums of handlers, for 10 µs a call
import os
import signal
import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import Any

import numpy as np

from .lanes import LANES

__all__ = ["cores", "share_out"]

_BLOCKS_A_THREAD = 64 // LANES
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
    jobs = _queue()
    done: SimpleQueue[BaseException | None] = SimpleQueue()
    ends = [len(blocks) * i // parts for i in range(parts + 1)]
    failures = []
    with _SignalsWait():
        for i in range(1, parts):
            jobs.put((run, blocks[ends[i] : ends[i + 1]], workspaces[i], done))
        try:
            run(blocks[: ends[1]], workspaces[0])
        finally:  # nobody may still be writing when this returns
            for _ in range(1, parts):
                failures.append(done.get())
    for failure in failures:
        if failure is not None:
            raise failure


class _SignalsWait:
    """Signals that raise, such as Ctrl-C, take effect at the end of what is done within.

    Anywhere in it one could leave threads at work on arrays that the caller believes to be at rest: a third of the
    steps that Ctrl-C met twice did.
    """

    def __enter__(self) -> None:
        self._came: list[int] = []
        self._before: dict[int, Any] = {}
        if threading.current_thread() is threading.main_thread():  # no other is interrupted
            try:
                for number in _RAISING:
                    handler = _signal.getsignal(number)
                    if callable(handler):
                        self._before[number] = handler
                        _signal.signal(number, self._note)
            except BaseException:
                self._put_back()
                raise

    def _note(self, number: int, _: Any) -> None:
        self._came.append(number)

    def _put_back(self) -> None:
        for number, handler in self._before.items():
            _signal.signal(number, handler)

    def __exit__(self, *_: object) -> None:
        try:
            self._put_back()
        except BaseException:  # another one came just now
            self._put_back()
            raise
        self._deliver(self._came)

    def _deliver(self, came: list[int]) -> None:
        """Each signal to its own handler, also where the one before it raised."""
        if came:
            try:
                self._before[came[0]](came[0], None)
            finally:
                self._deliver(came[1:])


_RAISING = [int(getattr(signal, name)) for name in ("SIGINT", "SIGTERM", "SIGALRM") if hasattr(signal, name)]


def cores() -> int:
    """Cores this process may use; ``MAGWIRE_THREADS`` in the environment says how many."""
    told = os.environ.get("MAGWIRE_THREADS", "")
    if told.isdecimal() and int(told) > 0:
        return int(told)
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
        run, blocks, workspace, done = jobs.get()
        try:
            run(blocks, workspace)
        except BaseException as failure:
            done.put(failure)
        else:
            done.put(None)
        del run, blocks, workspace, done  # no array is kept alive by an idle worker


def _after_fork() -> None:
    global _jobs, _forked
    _jobs, _forked = None, True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
