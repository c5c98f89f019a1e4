"""Free wires as if they were locked to their centrelines, for the theory that knows the locked wire alone."""

from __future__ import annotations

from ..simulation import Library
from ..simulation.model import supports

__all__ = ["locked_twin"]


def locked_twin(library: Library) -> Library:
    """The library with its wires locked to their tracts, for force tables and commands; itself, if they are so already.

    With the coupling "wrench" that is what a tip feels that is kept aligned with the tract: docs/physics.md,
    "What the lock hides". Fed and clamped wires, those in trees and other models have no such twin; their library comes
    back as it is, and the theory refuses it by name.
    """
    dragged = all(
        sc.model == "free" and sc.rig.feed is None and not sc.rig.clamped and sc.lumen is None
        for sc in library.scenarios
    )
    if supports(library.scenarios[0], "quasistatic") or not dragged:
        return library
    return Library([sc.replace(model="locked") for sc in library.scenarios])
