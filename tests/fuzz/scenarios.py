"""Random scenarios: near the paper's, far from it, and anywhere in the accepted ranges.

A draw may be refused by `Scenario`; then it is no scenario, and `drawn` counts it.
"""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache

import numpy as np

from magwire_env import Scenario
from magwire_env.lumen.generator import generate
from magwire_env.physics import BlockMagnet, CylinderMagnet, Guidewire, PointDipole, Tract
from magwire_env.physics.ranges import RANGES
from magwire_env.scenario import (
    ActuatedMagnet,
    Coil,
    Contact,
    Current,
    Reading,
    Rig,
    Sensing,
    Slide,
    Timing,
    Turn,
    Variation,
)  # fmt: skip

__all__ = ["SPREADS", "Layout", "batch", "layout"]

SPREADS = {"near": 0.7, "far": 4.0, "anywhere": math.inf}
"""Name → standard deviation of the logarithm of every number about the paper's; ∞ for the whole range."""

MOST_SUBSTEPS = 64
"""Scenarios that need more are as good, and slow: they are left out here."""

PAPER = Scenario.paper()


@lru_cache
def tracts() -> tuple[Tract, ...]:
    """The paper's, straight ones, closed ones, generated ones, and some at extreme sizes."""
    line = np.linspace(0.0, 1.0, 12)[:, None] * [1.0, 0.2, 0.0]
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(2 * angle)], axis=1)
    found = [PAPER.tract, Tract.from_points(line), Tract.from_points(0.12 * ring, closed=True)]
    found += [Tract.from_points(30.0 * line, radius=0.02), Tract.from_points(0.2 * line, radius=1e-3)]
    found += [generate(seed, split) for seed in range(4) for split in ("train", "ood")]
    return tuple(found)


@dataclasses.dataclass(frozen=True)
class Layout:
    """What the scenarios of a batch share: the rig's degrees of freedom, and the control period."""

    dofs: tuple[tuple[str, ...], ...]
    coils: tuple[str, ...]
    period: float


def layout(rng: np.random.Generator) -> Layout:
    """A random layout with at least one degree of freedom."""
    while True:
        dofs = []
        for _ in range(int(rng.integers(0, 3))):
            turns = [f"turn {a}" for a in rng.choice(list("xyz"), int(rng.integers(0, 3)))]
            slides = [f"slide {a}" for a in rng.choice(list("xyz"), int(rng.integers(0, 3)), replace=False)]
            dofs.append((*turns, *slides))
        coils = tuple(str(a) for a in rng.choice(list("xyz"), int(rng.integers(0, 3))))
        if coils or any(dofs):
            return Layout(tuple(dofs), coils, float(rng.choice([0.02, 0.1, 0.1, 0.1, 0.5, 1.0])))


class _Draw:
    """Numbers about given ones, by a spread."""

    def __init__(self, rng: np.random.Generator, spread: str) -> None:
        self.rng, self.width = rng, SPREADS[spread]

    def number(self, name: str, about: float) -> float:
        """In the range of `name`, most often near `about`."""
        low, high, _ = RANGES[name]
        if low < 0:
            return float(np.clip(about + min(self.width, 3.0) * self.rng.normal(), low, high))
        if low == 0 and self.rng.random() < 0.15:
            return 0.0
        floor = max(float(low), 1e-9)
        if math.isinf(self.width):
            return float(np.exp(self.rng.uniform(math.log(floor), math.log(high))))
        return float(np.clip(max(about, floor) * np.exp(self.width * self.rng.normal()), floor, high))

    def whole(self, low: int, high: int) -> int:
        return int(self.rng.integers(low, high + 1))


def batch(rng: np.random.Generator, spread: str, count: int, shared: Layout) -> tuple[list[Scenario], int]:
    """`count` accepted scenarios of one layout with equal steps, and how many draws were refused on the way."""
    found: list[Scenario] = []
    refused = 0
    while len(found) < count:
        try:
            scenario = _one(_Draw(rng, spread), shared, len(found))
            if scenario.substeps <= MOST_SUBSTEPS:
                found.append(scenario)
        except ValueError:
            refused += 1
        if refused > 2000 * (count + 1):
            raise RuntimeError(f"{refused} draws of {shared} were refused")
    steps = max(scenario.substeps for scenario in found)
    return [scenario.replace(timing__substeps=steps) for scenario in found], refused


def _one(draw: _Draw, shared: Layout, number: int) -> Scenario:
    rng = draw.rng
    tract = tracts()[rng.integers(len(tracts()))]
    about = PAPER.wire
    modulus = draw.number("Guidewire.axial_modulus", about.axial_modulus)
    bending = modulus if rng.random() < 0.7 else draw.number("Guidewire.bending_modulus", about.bending_modulus)
    length = min(0.025 + tract.length * rng.uniform(0.0, 0.5), tract.length - 0.09)
    room = 0.95 * float(np.min(tract.radius))  # a wire and a tip that do not fit in are refused
    wire = Guidewire(
        length, min(draw.number("Guidewire.radius", about.radius), room), modulus, bending,
        draw.number("Guidewire.density", about.density), draw.whole(2, 24),
    )  # fmt: skip
    tip = CylinderMagnet(
        min(draw.number("CylinderMagnet.diameter", 2e-3), 2 * room), draw.number("CylinderMagnet.height", 3e-3),
        draw.number("CylinderMagnet.remanence", 1.37), draw.number("CylinderMagnet.mass", 7e-5),
    )  # fmt: skip
    contact = Contact(
        **{f.name: draw.number(f"Contact.{f.name}", f.default) for f in dataclasses.fields(Contact)
           if f.name not in ("lever_friction", "per_segment")},
        lever_friction=bool(rng.random() < 0.3),
    )  # fmt: skip
    readings = {
        name: Reading(*(draw.number(f"Reading.{k}", 1e-3) for k in ("noise", "bias", "step")))
        for name in ("length", "speed", "force", "torque", "angle")
    }
    sensing = Sensing(**readings, delay=draw.whole(0, 4)) if rng.random() < 0.3 else Sensing()
    variation = Variation()
    if rng.random() < 0.3:
        variation = Variation(*(draw.number(f"Variation.{k}", 0.2) for k in ("friction", "stiffness", "remanence")))
    gravity = tuple(draw.number("Scenario.gravity", 0.0) for _ in range(3)) if rng.random() < 0.3 else (0.0, 0.0, 0.0)
    coupling = "wrench" if tract.closed or rng.random() < 0.5 else "force"
    return Scenario(
        f"fuzz {number}", tract, wire, tip, _rig(draw, shared, tract), contact, coupling, gravity,  # type: ignore[arg-type]
        Timing(shared.period), sensing, variation,
    )  # fmt: skip


def _rig(draw: _Draw, shared: Layout, tract: Tract) -> Rig:
    rng = draw.rng
    magnets, coils = [], []
    xyz = tract.table[1:, 0:3]
    for kinds in shared.dofs:
        away = rng.normal(size=3)
        distance = float(np.ptp(xyz, axis=0).max()) / 2 + 0.1 * np.exp(min(draw.width, 1.5) * rng.normal())
        position = xyz.mean(axis=0) + away / np.linalg.norm(away) * distance
        magnets.append(_mount(draw, tuple(position), kinds))
    for axis in shared.coils:
        high = draw.number("Current.high", 10.0)
        current = Current(-high, high, 0.0, draw.number("Current.speed", 100.0))
        uniform = draw.number("Coil.uniform", 1e-3) * 1e-2
        coils.append(Coil(axis, uniform or 1e-3, rng.normal() * 0.1, current=current))
    return Rig(tuple(magnets), tuple(coils))


def _mount(draw: _Draw, position: tuple[float, ...], kinds: tuple[str, ...]) -> ActuatedMagnet:
    rng, remanence = draw.rng, draw.number("BlockMagnet.remanence", 1.3)
    edge = draw.number("BlockMagnet.size", 0.05)
    magnet, rule = [
        (BlockMagnet((edge, edge, edge), remanence), ("fitted", 21)),
        (CylinderMagnet(edge, edge, remanence), ("gauss", 2)),
        (PointDipole(draw.number("PointDipole.strength", 100.0)), ("gauss", 1)),
    ][rng.integers(3)]
    dofs: list[Turn | Slide] = []
    for kind in kinds:
        name, axis = kind.split()
        if name == "turn":
            dofs.append(Turn(axis, float(rng.uniform(-4, 4)), draw.number("Turn.speed", math.pi)))
        else:
            reach = draw.number("Slide.high", 0.05) % 1.0 + 1e-3
            dofs.append(Slide(axis, -reach, reach, 0.0, draw.number("Slide.speed", 0.2)))
    return ActuatedMagnet(magnet, position, tuple(dofs), rule)  # type: ignore[arg-type]
