"""A small benchmark plan."""

from __future__ import annotations

from typing import Any

from agents.benchmark.plan import Arena, Learner, Plan

ID = "MagWire/Steer-v0"
STEER = Arena("Steer", ID, episodes=4)


def small(*arenas: Arena, learners: tuple[Learner, ...] = (), **changed: Any) -> Plan:
    """A plan of these arenas without the robustness sweep."""
    return Plan(arenas, learners, robustness={}, **changed)
