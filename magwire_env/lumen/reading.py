"""Reading files that may be damaged or hostile: sizes are bounded, nothing is executed, every fault is a sentence."""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["MOST_BYTES", "decoded_text", "inflated", "naming", "reading", "whole_file"]

MOST_BYTES = 1 << 30
"""Largest file, and largest content of a compressed one, that is read: 1 GiB."""


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into a `ValueError` that names the file."""
    try:
        yield
    except ImportError:
        raise
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{path} cannot be read as {what}: {_short(error)}") from None
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path} cannot be read as {what}: {_short(error)}") from None


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name before a `ValueError` that lacks it."""
    try:
        yield
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{path} {error}") from None


def _short(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) < 200 else text[:197] + "…"


def whole_file(path: Path, most: int = MOST_BYTES) -> bytes:
    """The bytes of a file that is not too large."""
    if path.is_dir():
        raise ValueError(f"{path} must be a file, got a folder")
    size = path.stat().st_size
    if size == 0:
        raise ValueError(f"{path} must not be empty")
    if size > most:
        raise ValueError(f"{path} must not be larger than {most / 2**20:.0f} MiB, got {size / 2**20:.0f} MiB")
    return path.read_bytes()


def decoded_text(path: Path, data: bytes | None = None) -> str:
    """The text of a file in UTF-8."""
    data = whole_file(path) if data is None else data
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} must be UTF-8 text, but byte {error.start} is not") from None


def inflated(path: Path, data: bytes, count: int, how: str) -> bytes:
    """Exactly `count` bytes out of compressed data ("gzip", "zlib" or "bzip2"), and never more in memory.

    Raises `ValueError` if the data hold fewer or more.
    """
    if count > MOST_BYTES:
        raise ValueError(f"{path} announces {count} bytes; at most {MOST_BYTES} are read")
    decoder: Any = bz2.BZ2Decompressor() if how == "bzip2" else zlib.decompressobj(31 if how == "gzip" else 15)
    try:
        found: bytes = decoder.decompress(data, count + 1)
    except (zlib.error, OSError, EOFError) as error:
        raise ValueError(f"{path} has damaged {how} data: {error}") from None
    if len(found) != count:
        more = "more" if len(found) > count else f"{len(found)}"
        raise ValueError(f"{path} announces {count} bytes of {how} data, but holds {more} (cut off, or a wrong header)")
    return found
