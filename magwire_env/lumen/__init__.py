"""The lumen: centrelines, tracts with a name, random ones, and those from other tools' files."""

from typing import TYPE_CHECKING, Any

from .curve import Tract
from .files import Centreline, read_centreline
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

if TYPE_CHECKING:
    from .generator import Bounds, generate, within_bounds

__all__ = [
    "NAMED",
    "Bounds",
    "Centreline",
    "Tract",
    "aortic_arch",
    "circle",
    "colon_frame",
    "generate",
    "helix",
    "paper_spiral",
    "read_centreline",
    "s_bend",
    "small_bowel_loops",
    "straight",
    "within_bounds",
]


def __getattr__(name: str) -> Any:
    # Late, so that `python -m magwire_env.lumen.generator` does not find itself imported already.
    if name in ("Bounds", "generate", "within_bounds"):
        from . import generator

        return getattr(generator, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
