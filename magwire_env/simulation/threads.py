"""Sharing a batch's blocks out over threads.

The kernels release the interpreter's lock, so plain threads run them side by side: the very same compiled code, and
so the same bits, as in one thread. After a fork the child has no worker threads and runs serially.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

__all__ = ["cores", "share_out"]

_BLOCKS_A_THREAD = 4
"""Fewest blocks worth a thread: below, waking it costs more than it saves."""

_pool: ThreadPoolExecutor | None = None
_forked = False


def share_out(
    run: Callable[[np.ndarray, np.ndarray], None],
    blocks: np.ndarray,
    workspaces: list[np.ndarray],
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
    pieces = np.array_split(blocks, parts)
    waiting = [_workers().submit(run, piece, work) for piece, work in zip(pieces[1:], workspaces[1:], strict=False)]
    run(pieces[0], workspaces[0])
    for job in waiting:
        job.result()


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _workers() -> ThreadPoolExecutor:
    global _pool
    if _pool is None:
        _pool = ThreadPoolExecutor(max_workers=max(1, cores() - 1), thread_name_prefix="magwire")
    return _pool


def _after_fork() -> None:
    global _pool, _forked
    _pool, _forked = None, True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
