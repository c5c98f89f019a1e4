"""Walls in bricks, kept: in this process, and on disk for the next one. The aortic arch takes half a minute to make.

Disk: ``$MAGWIRE_CACHE/walls`` or ``~/.cache/magwire/walls``, a file a wall, by the digest of all that it follows from.
A file that cannot be read or written costs the making, and never an error.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...kept import kept_folder, read_arrays, write_arrays
from ...lumen.lumen import Lumen
from ...lumen.surface import Surface
from .bricks import Bricks

__all__ = ["digest_of", "kept", "kept_walls"]

_VERSION = b"bricks 2"
"""Changes when the numbers in a file mean something else, or are made otherwise."""

_MOST = 128
"""Walls kept in a process, of some megabytes each."""


def digest_of(lumen: Lumen, *numbers: float) -> str:
    """A digest of a lumen of tubes or with a surface, and of what else its bricks follow from."""
    digest = hashlib.sha256(_VERSION)
    for branch, parent in zip(lumen.branches, lumen.parents, strict=True):
        digest.update(np.ascontiguousarray(branch.curve.table).tobytes())
        digest.update(np.ascontiguousarray(branch.radius_table).tobytes())
        digest.update(np.array([parent, branch.start, branch.length]).tobytes())
    if isinstance(lumen.wall, Surface):
        digest.update(lumen.wall.digest.encode())
    digest.update(np.array(numbers).tobytes())
    return digest.hexdigest()


def kept(digest: str, make: Callable[[], Bricks]) -> Bricks:
    """The bricks of this digest, made by `make` if they are kept nowhere."""
    return _Kept.of(digest) or _Kept.put(digest, make())


class _Kept:
    """The walls of this process; the oldest goes when there are too many."""

    walls: dict[str, Bricks] = {}  # noqa: RUF012

    @classmethod
    def of(cls, digest: str) -> Bricks | None:
        if digest in cls.walls:
            return cls.walls[digest]
        stored = read_arrays(kept_walls() / f"{digest}.npz") or {}
        try:
            found = Bricks.of(stored["origin"], float(stored["cell"]), stored["index"], stored["coefficients"])
        except (KeyError, ValueError, TypeError):
            return None
        return cls._remember(digest, found)

    @classmethod
    def put(cls, digest: str, bricks: Bricks) -> Bricks:
        write_arrays(
            kept_walls() / f"{digest}.npz", origin=bricks.origin, cell=bricks.cell,
            index=bricks.index.reshape(bricks.shape), coefficients=bricks.coefficients,
        )  # fmt: skip
        return cls._remember(digest, bricks)

    @classmethod
    def _remember(cls, digest: str, bricks: Bricks) -> Bricks:
        while len(cls.walls) >= _MOST:
            cls.walls.pop(next(iter(cls.walls)))
        cls.walls[digest] = bricks
        return bricks


def kept_walls() -> Path:
    """The folder of the walls that are kept."""
    return kept_folder("walls")
