"""What no wire and no lumen can be, and what is hardly meant: a scenario is looked at when it is made."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .scenario import Scenario

__all__ = ["check", "doubts"]


def check(scenario: Scenario) -> None:
    """Raise `ValueError` for a wire or tip that the lumen is too narrow for; warn, once, of every doubt."""
    narrowest = float(np.min(scenario.tract.radius))
    for name, radius in (("wire.radius", scenario.wire.radius), ("tip.diameter / 2", scenario.tip.diameter / 2)):
        if radius >= narrowest:
            raise ValueError(
                f"Scenario.{name} must be less than the lumen's narrowest radius of {1e3 * narrowest:.4g} mm, "
                f"got {1e3 * radius:.4g} mm"
            )
    for text in doubts(scenario):
        _warn(text)


def doubts(scenario: Scenario) -> list[str]:
    """Sentences about numbers that are possible and unlikely, most often because of a unit."""
    wire, contact = scenario.wire, scenario.contact
    looked_at = [
        ("contact.friction", contact.friction, 0.0, 1.0, "", "hydrophilic wires have about 0.02, dry rubber 1"),
        ("wire.density", wire.density, 500.0, 23e3, "kg/m³", "polymers have about 1000, platinum 21500"),
        ("tip.remanence", scenario.tip.remanence, 0.0, 1.6, "T", "the strongest permanent magnets have 1.5"),
        ("wire.axial_modulus", wire.axial_modulus, 0.0, 5e11, "Pa", "steel has 2e11"),
        ("wire.bending_modulus", wire.bending_modulus, 0.0, 5e11, "Pa", "steel has 2e11"),
        ("timing.control_period", scenario.timing.control_period, 1e-4, 1.0, "s", "0.1 is 10 commands a second"),
    ]
    for i, mount in enumerate(scenario.rig.magnets):
        if (remanence := getattr(mount.magnet, "remanence", None)) is not None:
            name = f"rig.magnets[{i}].magnet.remanence"
            looked_at.append((name, remanence, 0.0, 1.6, "T", "the strongest permanent magnets have 1.5"))
    return [
        f"Scenario.{name} is {value:g}{f' {unit}' if unit else ''}, which is hardly meant: {why}"
        for name, value, low, high, unit, why in looked_at
        if not low <= value <= high
    ]


@lru_cache(maxsize=256)
def _warn(text: str) -> None:
    warnings.warn(text, UserWarning, stacklevel=5)
