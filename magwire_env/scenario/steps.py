"""Which locked wires can be integrated, and how many steps locked and free ones need in a control period."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..physics.dipoles import MU0

if TYPE_CHECKING:
    from .scenario import Scenario

__all__ = [
    "FREE_STEP", "LONGEST_STEP", "MOST_STRETCH", "MOST_SUBSTEPS", "STIFF_STEP", "bending_step", "check",
    "common_substeps", "free_step", "is_stiff", "substeps_needed",
]  # fmt: skip

LONGEST_STEP = 0.05
"""s. With it, the paper's wire meets the accuracy at which speed is quoted (`tests/speed/accuracy.py`)."""

_LIGHT_STEP, _LIGHT_SHARE = 0.0125, 0.9
"""s, and 1: a wire that weighs little for its drag follows the magnet at once, and takes a quarter of that step."""

FREE_STEP = 0.02
"""s. The free wire's: its own search halves steps that do not converge, and the mesh decides the accuracy, see
`tests/speed/free_accuracy.py`."""

_STRETCHING, _BENDING = 2.6e4, 6.3e3
"""What h √(E A/μ)/ℓ and h √(E I/μ)/ℓ² of a free wire may be together, see `free_step`."""

STIFF_STEP = 0.02
"""s. A wire whose `bending_step` is shorter counts as stiff; the paper's has 56 ms, one of 5 cm 28 ms."""

MOST_SUBSTEPS = 10_000
"""A scenario that needs more steps in a control period is refused."""

MOST_STRETCH = 2.0
"""A wire that magnets, coils and weight could stretch by more than this share of its length is refused: its springs are
linear."""

_ERROR = 1e-3
"""m, that the bending of a stiff wire may put the tip off."""

_ERROR_CONSTANT = 0.16
"""Error over X (h ω)², see `bending_step`; of the size of the largest that `python -m tests.speed.stiff` measures."""


def bending_step(scenario: Scenario) -> float:
    """The longest step, s, with which a bent wire's push is integrated to 1 mm; infinite for a wire that is not bent.

    A bend pushes a wire towards straighter places with F = ½ E I κ². A stiff wire is thrown back: its acceleration is
    a = F/m, and since the push changes over about a bend's radius, it starts to swing with ω² = 2 F κ/m. Over a
    control period T it goes X = min(½ a T², v T, v m/D) at most, with ½ m v² = F L, the energy of its bend, and D its
    drag. The step is second order in its length h: its error is at most about 0.16 X (h ω)².

    κ is the tract's largest curvature, E I the largest that `Variation` draws, m the mass of wire and tip.
    """
    wire, period, mass = scenario.wire, scenario.timing.control_period, scenario.moving_mass
    stiffness = (1.0 + scenario.variation.stiffness) * wire.bending_rigidity
    bend = float(np.linalg.norm(2.0 * scenario.tract.table[:, 6:9], axis=1).max())
    force = 0.5 * stiffness * bend**2
    if not force > 0.0:
        return math.inf
    speed = math.sqrt(2.0 * force * wire.length / mass)
    drag = scenario.contact.drag * wire.length
    way = min(0.5 * force / mass * period**2, speed * period, speed * mass / drag if drag else math.inf)
    omega = math.sqrt(2.0 * force * bend / mass)
    return math.sqrt(_ERROR / (_ERROR_CONSTANT * way)) / omega


def is_stiff(scenario: Scenario) -> bool:
    """Whether bends throw the wire about so fast that the step is set by that."""
    return bending_step(scenario) < STIFF_STEP


def free_step(scenario: Scenario) -> float:
    """The longest step, s, of a free wire: `FREE_STEP`, or less for one so stiff and thick that its search would fail.

    A trial that moves a node by d across its segments, of length ℓ, stretches them by d²/2ℓ: the stiffer they are
    beside the inertia of μ kg/m, the shorter the trials that are taken. Thick wires of the paper's shape that are
    pressed into a bend failed where both h √(E A/μ)/ℓ was 30 600 and h √(E I/μ)/ℓ² was 7300, and did not at 26 600 and
    6400; thin wires, of which one number is large alone, did not fail.
    """
    wire, stiffer = scenario.wire, 1.0 + scenario.variation.stiffness
    line = wire.density * wire.area if wire.mass_per_length is None else wire.mass_per_length.least
    axial = wire.axial_rigidity if wire.axial is None else wire.axial.most
    bending = wire.bending_rigidity if wire.bending is None else wire.bending.most
    stretches = _STRETCHING * wire.segment_length / math.sqrt(stiffer * axial / line)
    bends = _BENDING * wire.segment_length**2 / math.sqrt(stiffer * bending / line)
    return min(FREE_STEP, max(stretches, bends))


def substeps_needed(scenario: Scenario) -> int:
    """Steps in a control period: none longer than 50 ms, than 12.5 ms + 0.9 m/D, and of stiff wires `bending_step`;
    of the free wire `free_step`.

    m/D is the time that drag needs to slow the wire down, 43 ms for the paper's.
    """
    if scenario.model == "free":
        return math.ceil(scenario.timing.control_period / free_step(scenario) - 1e-9)
    drag = scenario.contact.drag * scenario.wire.length
    follows = _LIGHT_STEP + _LIGHT_SHARE * scenario.moving_mass / drag if drag else math.inf
    bends = bending_step(scenario)
    step = min(LONGEST_STEP, follows, bends if bends < STIFF_STEP else math.inf)
    return math.ceil(scenario.timing.control_period / step - 1e-9)


def common_substeps(scenarios: Sequence[Scenario]) -> int:
    """Substeps of scenarios that run side by side: the most that one of them needs."""
    return max(scenario.substeps for scenario in scenarios)


def check(scenario: Scenario, distances: list[float]) -> None:
    """Raise `ValueError` for a wire too stiff or too soft to be integrated.

    distances : m, smallest from each magnet's centre to the centreline
    """
    wire, tip = scenario.wire, scenario.tip
    pull = sum(
        1.5 * MU0 / math.pi * mount.magnet.moment * tip.moment / distance**4
        for mount, distance in zip(scenario.rig.magnets, distances, strict=True)
    )
    for coil in scenario.rig.coils:
        pull += tip.moment * abs(coil.gradient) * max(abs(coil.current.low), abs(coil.current.high))
    pull += scenario.moving_mass * math.hypot(*scenario.gravity)
    if pull > MOST_STRETCH * wire.axial_rigidity:
        least = pull / (MOST_STRETCH * wire.area)
        raise ValueError(
            f"Scenario.wire.axial_modulus must be at least {least:.3g} Pa, or magnets, coils and weight, which pull "
            f"with up to {pull:.3g} N, stretch the wire to more than {1 + MOST_STRETCH:g} times its length, "
            f"got {wire.axial_modulus:g} Pa"
        )
    if scenario.timing.substeps is None and scenario.substeps > MOST_SUBSTEPS:
        raise ValueError(
            f"Scenario.wire.bending_modulus must be so low that at most {MOST_SUBSTEPS} integration steps are needed "
            f"in a control period of {scenario.timing.control_period:g} s, got {wire.bending_modulus:g} Pa, with which "
            f"the tract's bends throw {scenario.moving_mass:.3g} kg about so fast that {scenario.substeps} are needed"
        )
