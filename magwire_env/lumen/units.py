"""The unit of a file's coordinates: declared, passed, or guessed from the size, and said."""

from __future__ import annotations

import numpy as np

from .files import UNITS

__all__ = ["UNITS", "settled_unit"]

_RADIUS = (0.5e-3, 16e-3)
_SIZE = (0.04, 1.5)
"""Typical radius and size of what wires are steered through, m."""

_SURELY = (0.05e-3, 0.06)
"""A typical radius beyond these, m, is said to be odd even in a unit that was given."""


def settled_unit(path: str, declared: str, given: str | None, size: float, radius: float, notes: list[str]) -> float:
    """Metres in the unit of a file, whose lumen is `size` long and typically `radius` wide in that unit.

    A declared unit and a given one must agree. A guessed one is told in `notes`, with what it means; so is a size that
    no lumen has. Raises `ValueError` naming the file if no unit fits.
    """
    if given is not None and given not in UNITS:
        raise ValueError(f"unit must be one of {', '.join(map(repr, UNITS))}, got {given!r}")
    if declared and given and declared != given:
        raise ValueError(
            f"{path} declares its coordinates in {declared!r}, but unit={given!r} was passed; leave unit out, or "
            "mend the file"
        )
    if not (np.isfinite(size) and np.isfinite(radius)):
        raise ValueError(f"{path} must have a finite size, got {size} with radius {radius}")
    unit = declared or given
    if unit:
        scale = UNITS[unit]
        if not _SURELY[0] <= radius * scale <= _SURELY[1] or not 5e-3 <= size * scale <= 5.0:
            notes.append(
                f"in {unit} this is a lumen {_length(size * scale)} long with a typical radius of "
                f"{_length(radius * scale)}: is the unit right?"
            )
        return scale
    typical = [
        u for u in ("mm", "cm", "m", "um") if _fits(size * UNITS[u], _SIZE) and _fits(radius * UNITS[u], _RADIUS)
    ]
    if not typical:
        meant = ", ".join(
            f"in {u} {_length(size * s)} long with a radius of {_length(radius * s)}" for u, s in UNITS.items()
        )
        raise ValueError(
            f"{path} declares no unit, and none makes it a usual lumen ({meant}); pass unit='mm' (or another)"
        )
    scale = UNITS[typical[0]]
    others = f" ({' or '.join(typical[1:])} would be possible too)" if typical[1:] else ""
    notes.append(
        f"no unit is declared: taken as {typical[0]}, so it is {_length(size * scale)} long with a typical radius of "
        f"{_length(radius * scale)}{others}; unit= settles it"
    )
    return scale


def _fits(value: float, between: tuple[float, float]) -> bool:
    return between[0] <= value <= between[1]


def _length(metres: float) -> str:
    for unit, scale in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)):
        if metres >= scale:
            return f"{metres / scale:.3g} {unit}"
    return f"{metres / 1e-3:.2g} mm"
