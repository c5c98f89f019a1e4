"""What is kept on disk between runs: where, and arrays in files that are whole or not there.

A file that cannot be read or written costs the making, and never an error.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["DAMAGE", "kept_folder", "read_arrays", "write_arrays"]

DAMAGE = (OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError, MemoryError, OverflowError, SyntaxError,
          struct.error, zlib.error, zipfile.BadZipFile)  # fmt: skip
"""What reading a damaged archive raises."""


def kept_folder(name: str) -> Path:
    """``$MAGWIRE_CACHE/<name>``, or ``~/.cache/magwire/<name>``; it need not exist."""
    return Path(os.environ.get("MAGWIRE_CACHE") or Path.home() / ".cache" / "magwire") / name


def read_arrays(file: Path) -> dict[str, np.ndarray] | None:
    """The arrays of an .npz file by name; None if it is not there, damaged or holds objects."""
    try:
        with file.open("rb") as opened, np.load(opened, allow_pickle=False) as stored:
            return dict(stored)
    except DAMAGE:
        return None


def write_arrays(file: Path, **arrays: Any) -> None:
    """Put arrays into an .npz file, whole or not at all."""
    own = file.with_name(f"{file.stem}.{os.getpid()}.npz")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez(own, **arrays)
        own.replace(file)
    except OSError:
        with contextlib.suppress(OSError):
            own.unlink()
