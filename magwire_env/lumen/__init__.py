"""The lumen: trees of branches with their wall, tracts, those with a name, random ones, and other tools' files."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .branch import Branch
from .curve import Tract
from .files import Centreline, read_centreline
from .lumen import Lumen
from .named import (
    NAMED,
    aortic_arch,
    circle,
    colon_frame,
    helix,
    paper_spiral,
    s_bend,
    small_bowel_loops,
    straight,
)
from .route import Place, Route

if TYPE_CHECKING:
    from .generator import Bounds, generate, within_bounds
    from .loading import LumenNote
    from .named_trees import LUMENS
    from .random_trees import TreeBounds, grow

_LATE = {
    "Bounds": "generator",
    "generate": "generator",
    "within_bounds": "generator",
    "LumenNote": "loading",
    "LUMENS": "named_trees",
    "TreeBounds": "random_trees",
    "grow": "random_trees",
}
"""Loaded when first used: `python -m magwire_env.lumen.generator` must not find itself imported already."""

__all__ = [
    "LUMENS",
    "NAMED",
    "Bounds",
    "Branch",
    "Centreline",
    "Lumen",
    "LumenNote",
    "Place",
    "Route",
    "Tract",
    "TreeBounds",
    "aortic_arch",
    "circle",
    "colon_frame",
    "generate",
    "grow",
    "helix",
    "paper_spiral",
    "read_centreline",
    "s_bend",
    "small_bowel_loops",
    "straight",
    "within_bounds",
]


def __getattr__(name: str) -> Any:
    if name in _LATE:
        return getattr(import_module(f"{__name__}.{_LATE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
