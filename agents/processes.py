"""Processes that end as they should: by a signal, and with the process that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["PATIENCE", "end_with_parent", "sigterm_as_ctrl_c"]

PATIENCE = 30.0
"""s that a process has, once it is asked to end, to save what it has."""


def end_with_parent() -> None:
    """In a worker process: end when the process that started it has ended, however it did.

    The worker is then asked by SIGTERM, and ends by itself if it has not within `PATIENCE`. Ctrl-C in a terminal
    reaches all its processes: it is left to the parent, who asks the workers.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(PATIENCE)
        os._exit(1)

    threading.Thread(target=watch, name="ends with its parent", daemon=True).start()


@contextmanager
def sigterm_as_ctrl_c() -> Iterator[None]:
    """SIGTERM, which schedulers and containers send, raises `KeyboardInterrupt` within, as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's business
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
