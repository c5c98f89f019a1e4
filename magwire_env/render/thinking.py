"""Slow work beside a loop that must not stand still: one piece at a time, in a thread of its own."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import Any

__all__ = ["Thinker", "Thought"]


class Thought:
    """A piece of work that was asked for.

    what : for people, such as "Optimal"
    started : `time.perf_counter` of when it was asked for
    """

    def __init__(self, what: str, work: Callable[[], Any]) -> None:
        self.what, self.started = what, time.perf_counter()
        self._work, self._done, self._given_up = work, threading.Event(), False
        self._result: Any = None
        self._failure: Exception | None = None

    def wait(self, seconds: float = 0.0) -> bool:
        """Whether it is done, waiting for at most `seconds`."""
        return self._done.wait(seconds)

    def result(self) -> Any:
        """What the work returned; raises what it raised."""
        if self._failure is not None:
            raise self._failure
        return self._result

    def give_up(self) -> None:
        """Nobody wants it any more: it is not begun, or its result is nobody's."""
        self._given_up = True

    def run(self) -> None:
        """Do the work."""
        if not self._given_up:
            try:
                self._result = self._work()
            except Exception as failure:
                self._failure = failure
        self._done.set()


class Thinker:
    """A thread that does what it is asked for, in turn; it ends with the process."""

    def __init__(self) -> None:
        self._asked: queue.SimpleQueue[Thought] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="magwire thinks", daemon=True).start()

    def think(self, what: str, work: Callable[[], Any]) -> Thought:
        """Ask for `work`."""
        thought = Thought(what, work)
        self._asked.put(thought)
        return thought

    def _run(self) -> None:
        while True:
            self._asked.get().run()
