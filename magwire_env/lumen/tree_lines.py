"""What a file of centrelines is read as: lines with points, radii and names, in the file's own unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["FoundLines", "TreeLine"]


@dataclass
class TreeLine:
    """One line: its name ("" if it has none), points (n, 3), radii (n,) or none (0,), and its parent's number.

    parent : where the file says which line it leaves; None where that must be found
    """

    name: str
    points: np.ndarray
    radii: np.ndarray
    parent: int | None = None


@dataclass
class FoundLines:
    """The lines of a file; unit : as declared, "" if it declares none; axes : as declared, "" if unknown."""

    lines: list[TreeLine]
    unit: str = ""
    axes: str = ""
