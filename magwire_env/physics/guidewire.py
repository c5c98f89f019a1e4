"""The soft wire: geometry and material to consistent spring constants (paper Sections III-B and IV)."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from .checks import in_range, one_of
from .profile import Profile, as_profile
from .ranges import counted, ranged

__all__ = ["CLINICAL", "PROFILES", "Guidewire"]

PROFILES = (
    "bending", "twisting", "axial", "outer_radius", "mass_per_length", "curl", "curl_across", "magnetisation",
)  # fmt: skip
"""Properties that may change along a wire."""

CLINICAL = {
    "amplatz": 9.5e9,
    "amplatz stiff": 17e9,
    "amplatz extra stiff": 29.2e9,
    "amplatz super stiff": 60.3e9,
    "lunderquist extra stiff": 158.4e9,
}
"""Flexural moduli of 0.035 inch guidewires, Pa, in three-point bending (Harrison et al. 2011, J Vasc Surg 53:1570)."""

_STEEL = 7900.0  # kg/m³
_NITINOL = 6450.0  # kg/m³
_POISSON = 0.3


@dataclass(frozen=True)
class Guidewire:
    """A wire of equal segments: linear springs joined by rotational springs, straight at rest unless it has `curl`.

    length : m
    radius : m, circular cross-section
    axial_modulus : Young's modulus of the linear springs, Pa
    bending_modulus : Young's modulus of the rotational springs, Pa
    density : kg/m³
    segments : number of segments N; there are N + 1 nodes

    Of the free wire alone, each a number or a `Profile` along the wire, from its base on; by default what the numbers
    above make, the same everywhere:

    bending : E I(s), N·m²
    twisting : G J(s), N·m²; by default the wire knows no twist, which costs less
    axial : E A(s), N
    outer_radius : m
    mass_per_length : kg/m
    curl, curl_across : natural curvature about two directions across the wire, 1/m; needs `twisting`
    magnetisation : moment along the wire, A·m² a metre, beside the tip magnet's

    G J is independent of E I: a braided shaft transmits torque one to one without being stiff in bending.

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
    bending: Profile | None = None
    twisting: Profile | None = None
    axial: Profile | None = None
    outer_radius: Profile | None = None
    mass_per_length: Profile | None = None
    curl: Profile | None = None
    curl_across: Profile | None = None
    magnetisation: Profile | None = None

    def __post_init__(self) -> None:
        for name in ("length", "radius", "axial_modulus", "bending_modulus", "density"):
            object.__setattr__(self, name, ranged(f"Guidewire.{name}", getattr(self, name)))
        object.__setattr__(self, "segments", counted("Guidewire.segments", self.segments))
        for name in PROFILES:
            given = as_profile(f"Guidewire.{name}", getattr(self, name), self.length)
            object.__setattr__(self, name, given)
        if (self.curl or self.curl_across) and not self.twisting:
            raise ValueError(
                "Guidewire.twisting must be given (in N·m²) for a wire with natural curvature, which turns with its "
                "twist, got None"
            )

    @classmethod
    def nitinol(cls, length: float = 0.4, diameter: float = 0.36e-3, segments: int = 40) -> Guidewire:
        """A bare nitinol core, by default of 0.36 mm: E 60 GPa (its austenite), Poisson's ratio 0.3, 6450 kg/m³."""
        return _round_wire(length, diameter, 60e9, _NITINOL, segments)

    @classmethod
    def clinical(
        cls, name: str = "amplatz stiff", length: float = 0.6, floppy: float = 0.0, segments: int = 60
    ) -> Guidewire:
        """A guidewire of 0.035 inch by the flexural moduli of Harrison et al. 2011, see `CLINICAL`.

        floppy : m of its end that are soft: E I 2e-5 N·m², as of a plain tip without core (ours, not Harrison's)
        """
        one_of("name", name, tuple(CLINICAL))
        wire = _round_wire(length, 0.889e-3, CLINICAL[name], _STEEL, segments)
        if not in_range("floppy", floppy, 0.0, wire.length, "m"):
            return wire
        shaft = (wire.length - floppy, wire.bending_rigidity)
        pieces = [shaft, (floppy, 2e-5)] if floppy < wire.length else [(floppy, 2e-5)]
        return dataclasses.replace(wire, bending=Profile.steps(*pieces))

    @classmethod
    def two_rings(cls, length: float = 0.1, segments: int = 25, ring_from_tip: float = 20e-3) -> Guidewire:
        """The magnetic robot of Dreyfus, Boehler, Nelson 2022 (RA-L): a tube with a soft end and two ring magnets.

        E 170 MPa, of the last 34 mm 21 MPa; outer diameter 1.33 mm, inner 0.80 mm; rings 4 mm long, remanence 1.45 T,
        3.73e-3 A·m² each. The end ring is the scenario's tip: ``CylinderMagnet(1.0145e-3, 4e-3, 1.45)`` has its moment.

        ring_from_tip : m, of the second ring's middle; it lies inside the soft end (its place is ours)
        """
        soft, ring, moment = 34e-3, 4e-3, 3.73e-3
        in_range("length", length, soft + 1e-3, 10.0, "m")
        in_range("ring_from_tip", ring_from_tip, ring, soft - ring, "m")
        outer, inner = 0.665e-3, 0.4e-3
        second, area = math.pi * (outer**4 - inner**4) / 4, math.pi * (outer**2 - inner**2)
        shaft = length - soft
        at = length - ring_from_tip
        return cls(
            length, outer, 170e6, 170e6, 1100.0, segments,
            bending=Profile.steps((shaft, 170e6 * second), (soft, 21e6 * second)),
            axial=Profile.steps((shaft, 170e6 * area), (soft, 21e6 * area)),
            mass_per_length=Profile.constant(1100.0 * area),
            magnetisation=Profile.steps(
                (at - ring / 2, 0.0), (ring, moment / ring), (length - at - ring / 2, 0.0)
            ),
        )  # fmt: skip

    @property
    def profiled(self) -> tuple[str, ...]:
        """Names of the properties that only the free wire knows and that are given."""
        return tuple(name for name in PROFILES if getattr(self, name) is not None)

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
        if self.mass_per_length is not None:
            return self.length * float(self.mass_per_length.mean(np.zeros(1), np.full(1, self.length))[0])
        return self.density * self.area * self.length


def _round_wire(length: float, diameter: float, modulus: float, density: float, segments: int) -> Guidewire:
    """A solid round wire that twists: G J = E I/(1 + ν)."""
    wire = Guidewire(length, ranged("Guidewire.radius", diameter, "diameter") / 2, modulus, modulus, density, segments)
    twisting = Profile.constant(wire.bending_rigidity / (1 + _POISSON))
    return dataclasses.replace(wire, twisting=twisting)
