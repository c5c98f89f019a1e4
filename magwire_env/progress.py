"""What long work says while it lasts: nothing for two seconds, then how far it is, on the error stream."""

from __future__ import annotations

import os
import sys
import threading
import time
from types import TracebackType
from typing import TextIO

__all__ = ["Progress"]

FIRST = 2.0
"""s of silence before the first line."""

AGAIN = 10.0
"""s between lines; in a terminal one line is written over every second."""


_open: list[Progress] = []
"""Pieces of work that are entered, each a part of the one before it."""


class Progress:
    """Says how far a piece of work is, as long as it is entered; a thread speaks, so that a long step is no silence.

    Of nested pieces, only the innermost speaks.

    what : the work, for people
    total : how many there are of what `done` counts; 0 if nobody knows
    stage : what is being done just now; set it as the work goes on
    stream : by default the error stream

    ``MAGWIRE_PROGRESS=0`` in the environment keeps it quiet.

    >>> with Progress("certifying scenarios", 3) as progress:
    ...     for _ in range(3):
    ...         progress.done += 1
    """

    def __init__(self, what: str, total: int = 0, stream: TextIO | None = None) -> None:
        self.what, self.total, self.done, self.stage = what, total, 0, ""
        self._stream = stream
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._started, self._written = 0.0, 0

    def __enter__(self) -> Progress:
        stream = self._stream or sys.stderr
        _open.append(self)
        if stream is not None and os.environ.get("MAGWIRE_PROGRESS", "1") != "0":
            self._started = time.monotonic()
            self._thread = threading.Thread(target=self._speak, args=(stream,), name="says how far it is", daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _open.remove(self)
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def line(self) -> str:
        """What is said now."""
        seconds = time.monotonic() - self._started
        parts = [self.what]
        if self.total:
            parts.append(f"{self.done} of {self.total}")
        if self.stage:
            parts.append(self.stage)
        parts.append(f"{seconds:.0f} s")
        if self.total and 0 < self.done < self.total:
            parts.append(f"about {seconds * (self.total - self.done) / self.done:.0f} s to go")
        return ", ".join(parts)

    def _speak(self, stream: TextIO) -> None:
        terminal = stream.isatty()
        pause = FIRST
        while not self._ended.wait(pause):
            if _open[-1:] != [self]:  # a part of this work speaks for it
                continue
            text = self.line()
            try:
                if terminal:
                    stream.write("\r" + text.ljust(self._written))
                else:
                    stream.write(text + "\n")
                stream.flush()
            except (OSError, ValueError):  # the stream is closed: nobody listens any more
                return
            self._written = len(text)
            pause = 1.0 if terminal else AGAIN
        if terminal and self._written:
            stream.write("\r" + " " * self._written + "\r")
            stream.flush()
