"""The renderer. It lives a floor above and needs an extra, so it is found by name when a render mode asks for it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..render.frames import Frames, Window
    from ..render.snapshot import Snapshot
    from .core import SteeringCore

__all__ = ["frames", "present", "window"]


def frames(core: SteeringCore) -> Frames:
    """What draws the lanes of `core`."""
    return _render("frames").Frames(core)


def window(size: tuple[int, int]) -> Window:
    """A window of `size` pixels."""
    return _render("frames").Window(size)


def present(core: SteeringCore) -> list[Snapshot]:
    """The lanes of `core` as they are now."""
    return _render("snapshot").snapshots(core)


def _render(module: str) -> Any:
    return import_module(f"magwire_env.render.{module}")
