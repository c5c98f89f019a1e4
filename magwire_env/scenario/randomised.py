"""Domain randomisation: a scenario's numbers as ranges that episodes draw from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..physics.checks import non_negative

if TYPE_CHECKING:
    from .scenario import Scenario

__all__ = ["changes"]

_DRAWN = {"friction": "friction", "bending_rigidity": "stiffness", "remanence": "remanence"}
"""What is given → the field of `Variation` that draws it."""


def changes(
    scenario: Scenario, ranges: Mapping[str, tuple[float, float] | None], placement: float | None
) -> dict[str, Any]:
    """Keywords of `Scenario.replace` for `Scenario.randomised`, which says what `ranges` and `placement` are."""
    middle: dict[str, float] = {}
    share: dict[str, float] = {}
    for name, ends in ranges.items():
        if ends is not None:
            low, high = (non_negative(f"{name}[{i}]", end) for i, end in enumerate(ends))
            if low > high or not high > 0.0:
                raise ValueError(f"{name} must be (low, high) with 0 ≤ low ≤ high and high > 0, got {ends}")
            middle[name] = 0.5 * (low + high)
            share[name] = 0.5 * (high - low) / middle[name]
    found: dict[str, Any] = {f"variation__{_DRAWN[name]}": value for name, value in share.items()}
    if "friction" in middle:
        found["contact__friction"] = middle["friction"]
    if "bending_rigidity" in middle:
        found["wire__bending_modulus"] = middle["bending_rigidity"] / scenario.wire.second_moment
    if placement is not None:
        found["variation__placement"] = placement
    if "remanence" in middle:
        found["rig"] = scenario.rig.stronger(middle["remanence"])
    return found
