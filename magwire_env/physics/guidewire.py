"""The soft wire: geometry and material to consistent spring constants (paper Sections III-B and IV)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .ranges import counted, ranged

__all__ = ["Guidewire"]


@dataclass(frozen=True)
class Guidewire:
    """A wire of equal segments: linear springs joined by rotational springs, no twist, straight at rest.

    length : m
    radius : m, circular cross-section
    axial_modulus : Young's modulus of the linear springs, Pa
    bending_modulus : Young's modulus of the rotational springs, Pa
    density : kg/m³
    segments : number of segments N; there are N + 1 nodes

    The paper prints spring constants of 10.79 and 11.78 "N/m" for its 1 m of wire with 550 and 600 kPa. Those
    are E·A in newtons (E·A/L for L = 1 m), for the rotational springs too: used as N·m/rad, 10.79 would be 6400
    times too stiff. Here the constants follow from the segments instead, k_axial = E·A/ℓ and k_bend = E·I/ℓ, so
    that a finer mesh is the same wire. Both printed numbers come out as properties of the wire:

    >>> paper = Guidewire(.1, radius=2.5e-3, axial_modulus=600e3, bending_modulus=550e3, density=1100., segments=16)
    >>> round(paper.axial_rigidity, 3), round(paper.bending_modulus * paper.area, 3)
    (11.781, 10.799)
    """

    length: float
    radius: float
    axial_modulus: float
    bending_modulus: float
    density: float
    segments: int

    def __post_init__(self) -> None:
        for name in ("length", "radius", "axial_modulus", "bending_modulus", "density"):
            object.__setattr__(self, name, ranged(f"Guidewire.{name}", getattr(self, name)))
        object.__setattr__(self, "segments", counted("Guidewire.segments", self.segments))

    @property
    def area(self) -> float:
        """Cross-section A = π r², m²."""
        return math.pi * self.radius**2

    @property
    def second_moment(self) -> float:
        """Second moment of area I = π r⁴/4, m⁴."""
        return math.pi * self.radius**4 / 4

    @property
    def segment_length(self) -> float:
        """Rest length ℓ of one segment, m."""
        return self.length / self.segments

    @property
    def axial_rigidity(self) -> float:
        """E·A, N."""
        return self.axial_modulus * self.area

    @property
    def bending_rigidity(self) -> float:
        """E·I, N·m²."""
        return self.bending_modulus * self.second_moment

    @property
    def axial_spring(self) -> float:
        """E·A/ℓ, N/m."""
        return self.axial_rigidity / self.segment_length

    @property
    def bending_spring(self) -> float:
        """E·I/ℓ, N·m/rad."""
        return self.bending_rigidity / self.segment_length

    @property
    def mass(self) -> float:
        """kg, without the tip magnet."""
        return self.density * self.area * self.length
