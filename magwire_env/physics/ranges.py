"""The ranges that a scenario's numbers must lie in: what can be integrated without overflow, with room to spare.

They are not what is sensible, only what is safe. Tests draw scenarios from all of them (`tests/fuzz/scenarios.py`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .checks import finite, non_negative, positive, vector, whole

__all__ = ["RANGES", "counted", "ranged", "ranged_vector", "table"]

RANGES: dict[str, tuple[float, float, str]] = {
    "Guidewire.length": (1e-3, 100.0, "m"),
    "Guidewire.radius": (1e-5, 0.05, "m"),
    "Guidewire.axial_modulus": (1.0, 1e13, "Pa"),
    "Guidewire.bending_modulus": (1e-3, 1e13, "Pa"),
    "Guidewire.density": (1.0, 1e5, "kg/m³"),
    "Guidewire.segments": (2, 4096, ""),
    "Tract.points": (-1e3, 1e3, "m"),
    "Tract.radius": (1e-6, 10.0, "m"),
    "BlockMagnet.size": (1e-5, 10.0, "m"),
    "BlockMagnet.remanence": (1e-9, 10.0, "T"),
    "CylinderMagnet.diameter": (1e-5, 10.0, "m"),
    "CylinderMagnet.height": (1e-5, 10.0, "m"),
    "CylinderMagnet.remanence": (1e-9, 10.0, "T"),
    "CylinderMagnet.mass": (0.0, 1e4, "kg"),
    "PointDipole.strength": (1e-12, 1e8, "A·m²"),
    "Contact.friction": (0.0, 100.0, ""),
    "Contact.stick_speed": (1e-15, 10.0, "m/s"),
    "Contact.drag": (0.0, 1e6, "N·s/m²"),
    "Contact.lever": (1e-6, 100.0, "m"),
    "Contact.wall_force_limit": (1e-12, 1e12, "N"),
    "Scenario.gravity": (-1e4, 1e4, "m/s²"),
    "Timing.control_period": (1e-12, 10.0, "s"),
    "Timing.substeps": (1, 10_000, ""),
    "ActuatedMagnet.position": (-1e3, 1e3, "m"),
    "Turn.home": (-1e3, 1e3, "rad"),
    "Turn.speed": (1e-9, 1e6, "rad/s"),
    "Slide.low": (-1e3, 1e3, "m"),
    "Slide.high": (-1e3, 1e3, "m"),
    "Slide.home": (-1e3, 1e3, "m"),
    "Slide.speed": (1e-9, 1e6, "m/s"),
    "Current.low": (-1e6, 1e6, "A"),
    "Current.high": (-1e6, 1e6, "A"),
    "Current.home": (-1e6, 1e6, "A"),
    "Current.speed": (1e-9, 1e9, "A/s"),
    "Coil.uniform": (-10.0, 10.0, "T/A"),
    "Coil.gradient": (-1e3, 1e3, "T/(m·A)"),
    "Coil.position": (-1e3, 1e3, "m"),
    "Reading.noise": (0.0, 1e6, ""),
    "Reading.bias": (0.0, 1e6, ""),
    "Reading.step": (0.0, 1e6, ""),
    "Sensing.delay": (0, 1000, ""),
    "Variation.friction": (0.0, 100.0, ""),
    "Variation.stiffness": (0.0, 0.999, ""),
    "Variation.remanence": (0.0, 0.999, ""),
    "Variation.placement": (0.0, 100.0, "m"),
}
"""Field of a scenario's part → smallest and largest value, and the unit. A small modulus also has to bear the magnets'
pull, a large one must not throw the wire about too fast: see `magwire_env.scenario`."""


def ranged(name: str, value: Any, called: str = "") -> float:
    """Return `value` as a float in the range of `name` or raise `ValueError` naming it.

    called : what it is called in the error, by default `name`
    """
    low, _, unit = RANGES[name]
    check = positive if low > 0 else non_negative if low == 0 else finite
    return _within(name, check(called or name, value, unit), called)


def ranged_vector(name: str, value: Any) -> tuple[float, ...]:
    """Return `value` as three floats, each in the range of `name`, or raise `ValueError` naming it."""
    numbers: Iterable[float] = vector(name, value, 3, RANGES[name][2])
    return tuple(_within(name, number) for number in numbers)


def counted(name: str, value: Any) -> int:
    """Return `value` as an int in its range or raise `ValueError` naming it."""
    return int(_within(name, whole(name, value, int(RANGES[name][0]))))


def _within(name: str, number: float, called: str = "") -> float:
    low, high, unit = RANGES[name]
    if not low <= number <= high:
        where = f"[{low:g}, {high:g}]{f' (in {unit})' if unit else ''}"
        raise ValueError(f"{called or name} must lie in {where}, got {number!r}")
    return number


def table() -> str:
    """The ranges as a Markdown table; ``python -m magwire_env.physics.ranges`` prints it."""
    lines = ["| number | smallest | largest | unit |", "|---|---|---|---|"]
    lines += [f"| `{name}` | {low:g} | {high:g} | {unit or '1'} |" for name, (low, high, unit) in RANGES.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
