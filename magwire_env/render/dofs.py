"""Degrees of freedom as people read and set them: degrees, millimetres, amperes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..quasistatic.forcemap import command_range
from ..scenario import Feed, Scenario
from ..scenario.rig import Slide, Turn

__all__ = ["Dof", "dofs_of", "number"]


@dataclass(frozen=True)
class Dof:
    """One degree of freedom.

    name, unit : such as "θ" and "°", "x" and "mm", "coil x" and "A"
    factor : from the command's rad, m or A to the unit
    turn : it goes round, `low` and `high` being the same place
    low, high, speed : the command's range and its speed, in rad, m or A
    magnet : number of the magnet it moves, None for a coil's current and the wire's base
    axis : 0, 1, 2 for x, y, z
    """

    name: str
    unit: str
    factor: float
    turn: bool
    low: float
    high: float
    speed: float
    magnet: int | None
    axis: int

    def wrapped(self, value: Any) -> Any:
        """A command (or many) brought into the range: a turn's by whole circles."""
        if self.turn:
            return self.low + (np.asarray(value) - self.low) % (2 * np.pi)
        return np.clip(value, self.low, self.high)

    def towards(self, command: float, wish: float) -> float:
        """The command that fulfils a wish: a turn goes the short way round, the others keep to their range."""
        if self.turn:
            gap = wish - command
            return command + gap - 2 * np.pi * float(np.floor(gap / (2 * np.pi) + 0.5))
        return float(np.clip(wish, self.low, self.high))

    def text(self, value: float) -> str:
        """Such as "θ 187°" or "x −12 mm"."""
        if self.turn:
            return f"{self.name} {round(np.degrees(value)) % 360}°"
        return f"{self.name} {number(self.factor * value, 1 if self.unit == 'A' else 0)} {self.unit}"


def dofs_of(scenario: Scenario) -> list[Dof]:
    """The rig's degrees of freedom in the order of the command; numbered where there are several magnets.

    Those of the wire's base, "feed" and "twist", come last.
    """
    rig = scenario.rig
    several, lone = len(rig.magnets) > 1, sum(isinstance(d, Turn) for d in rig.dofs) == 1
    low, high = command_range(scenario)
    out: list[Dof] = []
    for m, mount in enumerate(rig.magnets):
        which = str(m + 1) if several else ""
        for part in mount.dofs:
            turn = not isinstance(part, Slide)
            name = part.axis + which if not turn else ("θ" if lone else f"θ{part.axis}{which}")
            unit, factor = ("°", float(np.degrees(1.0))) if turn else ("mm", 1e3)
            k = len(out)
            out.append(Dof(name, unit, factor, turn, low[k], high[k], part.speed, m, "xyz".index(part.axis)))
    for i, coil in enumerate(rig.coils):
        same = sum(other.axis == coil.axis for other in rig.coils) > 1
        name = f"coil {coil.axis}{i + 1 if same else ''}"
        k = len(out)
        out.append(Dof(name, "A", 1.0, False, low[k], high[k], coil.current.speed, None, "xyz".index(coil.axis)))
    for own in rig.base:
        k = len(out)
        unit, factor = ("mm", 1e3) if isinstance(own, Feed) else ("°", float(np.degrees(1.0)))
        out.append(Dof(own.axis, unit, factor, False, low[k], high[k], own.speed, None, 0))
    return out


def number(value: float, digits: int = 0) -> str:
    """A number with a true minus sign, and no minus before zero."""
    text = f"{value:.{digits}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")
