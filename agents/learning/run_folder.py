"""A run's folder on disk: checkpoints that are there whole or not at all, one writer at a time.

::

    runs/mine/
      config.json versions.json scenario.toml
      checkpoints/000007/       the newest; it took its name when it was complete, and the one before then went
        checkpoint.json         steps, seconds, score of the best so far
        learning_curve.csv
        best/                   policy.json policy.safetensors policy.onnx
        last/                   the same of the last policy, and training.json training.safetensors: all that goes on
"""

from __future__ import annotations

import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["BEST", "LAST", "Checkpoints", "best_of", "locked", "made_whole", "write_whole"]

BEST, LAST = "best", "last"
_MARK = "checkpoint.json"
_UNFINISHED = ".unfinished-"
_ABANDONED = 3600.0
"""s after which an unfinished file is nobody's any more."""


class Checkpoints:
    """The checkpoints of a run's folder, of which the newest counts.

    A checkpoint is written beside the others, forced to the disk, and takes its number by one rename; the older one is
    removed after that. Whatever stops the program, the newest complete one is there.
    """

    def __init__(self, run: Path) -> None:
        self.folder = run / "checkpoints"

    def newest(self) -> Path | None:
        """The newest complete checkpoint, or None."""
        found = [p for p in _numbered(self.folder) if (p / _MARK).is_file()]
        return max(found, key=lambda p: int(p.name), default=None)

    def write(self, fill: Callable[[Path], None]) -> Path:
        """Make a checkpoint, which `fill` writes into the folder it is given; returns it.

        Raises `OSError` where the disk is full or cannot be written, and leaves the newest checkpoint as it was.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        self.sweep()
        newest = self.newest()
        number = 1 + max((int(p.name) for p in _numbered(self.folder)), default=0)
        made = made_whole(self.folder / f"{number:06d}", fill)
        if newest is not None:
            shutil.rmtree(newest, ignore_errors=True)
        return made

    def sweep(self) -> None:
        """Remove what a stopped program left unfinished, and all checkpoints but the newest."""
        newest = self.newest()
        for path in self.folder.iterdir() if self.folder.is_dir() else ():
            if path.name.startswith(_UNFINISHED) or (path.name.isdecimal() and newest is not None and path != newest):
                shutil.rmtree(path, ignore_errors=True)


def best_of(folder: Path) -> Path | None:
    """The folder of the best policy in `folder`, which may be a policy's own, a checkpoint's or a run's; or None."""
    newest = Checkpoints(folder).newest()
    places = [folder, *([] if newest is None else [newest / BEST]), folder / BEST]
    return next((place for place in places if (place / "policy.json").is_file()), None)


def made_whole(folder: Path, fill: Callable[[Path], None]) -> Path:
    """Make `folder`, which is there with all that `fill` writes into it, or not at all.

    Raises `FileExistsError` if there is one already.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    if folder.exists():
        raise FileExistsError(f"{folder} exists")
    partial = _partial(folder)
    partial.mkdir()
    try:
        fill(partial)
        for path in sorted(partial.rglob("*"), reverse=True):
            _flush(path)
        _flush(partial)
        os.rename(partial, folder)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    _flush(folder.parent)
    return folder


def write_whole(path: Path, content: str) -> None:
    """Write a text file, whole or not at all; what stood there before stays until then."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(path)
    try:
        partial.write_text(content, encoding="utf-8")
        _flush(partial)
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


@contextmanager
def locked(folder: Path, patience: float = 0.0) -> Iterator[None]:
    """Hold `folder` against every other writer, in this process or another, on this machine or one that shares it.

    patience : s to wait for somebody else who holds it

    The lock goes with the process, however it ends. Raises `ValueError` if somebody else keeps it.
    """
    from filelock import FileLock, Timeout  # which only writers need

    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / "lock", timeout=patience)
    try:
        lock.acquire()
    except Timeout:
        raise ValueError(f"{folder} is being written by another process, which holds {folder / 'lock'}") from None
    try:
        yield
    finally:
        lock.release()


def _numbered(folder: Path) -> list[Path]:
    with suppress(FileNotFoundError, NotADirectoryError):
        return [p for p in folder.iterdir() if p.name.isdecimal() and p.is_dir()]
    return []


def _flush(path: Path) -> None:
    """Have the disk hold what was written to a file or a folder, where the system can be asked."""
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _partial(path: Path) -> Path:
    """A name beside `path` to write under until it is complete; removes what programs stopped long ago left there."""
    for old in path.parent.glob(f"{_UNFINISHED}{path.name}-*"):
        with suppress(OSError):
            if time.time() - old.stat().st_mtime > _ABANDONED:
                shutil.rmtree(old) if old.is_dir() else old.unlink()
    return path.with_name(f"{_UNFINISHED}{path.name}-{secrets.token_hex(4)}")
