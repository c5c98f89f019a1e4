"""Small tasks for engines."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def square(x: int, attempt: int = 0) -> int:
    """x²."""
    return x * x


def fails(attempt: int = 0) -> None:
    """Raises."""
    raise ValueError("it does not want to")


def dies_once(mark: str, attempt: int = 0) -> int:
    """Kills its process in the first attempt; returns the number of the attempt in the next."""
    if attempt == 0:
        Path(mark).write_text("here")
        os.kill(os.getpid(), signal.SIGKILL)
    return attempt


def always_dies(attempt: int = 0) -> None:
    """Kills its process."""
    os.kill(os.getpid(), signal.SIGKILL)


def environment(names: tuple[str, ...], attempt: int = 0) -> dict[str, str | None]:
    """What the worker's environment has."""
    return {name: os.environ.get(name) for name in names}


def stays(folder: str, attempt: int = 0) -> None:
    """Leaves the number of its process in a folder, and stays for a minute."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60.0)


def slow(seconds: float, attempt: int = 0) -> None:
    """Takes its time."""
    time.sleep(seconds)
