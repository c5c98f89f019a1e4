"""A scenario: one tree of frozen values that says everything a run needs, and its TOML form."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..lumen.curve import Tract
from ..lumen.lumen import Lumen
from ..lumen.rooms import BoxWall
from ..physics.checks import one_of, positive
from ..physics.guidewire import Guidewire
from ..physics.magnets import BlockMagnet, CylinderMagnet
from ..physics.ranges import counted, ranged, ranged_vector
from . import plausible, randomised, steps, toml
from .base import Feed, Twist
from .rig import ActuatedMagnet, Coil, Current, Rig, Slide, Turn, cheapest_rule
from .sensing import Reading, Sensing, Variation

__all__ = [
    "COUPLINGS",
    "ActuatedMagnet",
    "Coil",
    "Contact",
    "Current",
    "Feed",
    "Reading",
    "Rig",
    "Scenario",
    "Sensing",
    "Slide",
    "Timing",
    "Turn",
    "Twist",
    "Variation",
]

COUPLINGS = ("force", "wrench")


def _missing(name: str) -> Any:
    raise ValueError(f"Scenario.{name} must be given")


_PLAIN_WALLS = (type(None), BoxWall)
"""Walls that a scenario's own file can hold; others are saved beside it."""


@dataclass(frozen=True)
class Contact:
    """What holds the wire back, and what presses on the wall.

    friction : Coulomb coefficient μ (hydrophilic guidewires about 0.02; other simulators 0.1)
    stick_speed : m/s, the speed ε that smooths Coulomb's law: f = −μ n v/√(v² + ε²)
    drag : N·s/m², viscous drag per metre of wire and per m/s
    lever : m, between the two contacts that bear the tip magnet's couple
    lever_friction : the couple's contacts add to the tip's friction
    wall_force_limit : N; `cost` is the wall force above it
    stiffness : N/m², of the wall, for each metre of wire and of penetration; for the free wire
    per_segment : contact points a segment of the free wire, 1 for its nodes alone
    """

    friction: float = 0.05
    stick_speed: float = 1e-4
    drag: float = 0.5
    lever: float = 10e-3
    lever_friction: bool = False
    wall_force_limit: float = 0.1
    stiffness: float = 2e5
    per_segment: int = 1

    def __post_init__(self) -> None:
        for name in ("friction", "drag", "stick_speed", "lever", "wall_force_limit", "stiffness"):
            object.__setattr__(self, name, ranged(f"Contact.{name}", getattr(self, name)))
        object.__setattr__(self, "per_segment", counted("Contact.per_segment", self.per_segment))


@dataclass(frozen=True)
class Timing:
    """control_period : s between commands

    substeps : integration steps in one control period; by default as many as the wire needs, see `Scenario.substeps`
    """

    control_period: float = 0.1
    substeps: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "control_period", ranged("Timing.control_period", self.control_period))
        if self.substeps is not None:
            object.__setattr__(self, "substeps", counted("Timing.substeps", self.substeps))


@dataclass(frozen=True)
class Scenario:
    """Everything a run needs; frozen and equal by value.

    name : for people
    tract, wire, tip : the lumen, the guidewire, and the magnet at its tip (moment along the tract's tangent)
    rig : the external magnets, and how the wire's base is moved
    contact, coupling, gravity, timing : see the parts; gravity in m/s²
    sensing, variation : what the policy's readings suffer, and what differs from episode to episode; by default nothing
    model : the wire model that moves it, see `magwire_env.simulation.model`; "locked" is the paper's, "free" a rod in
        space that touches the wall
    lumen : in place of `tract`, a tree of branches, whose trunk is then the tract

    `coupling` is the force that drives the tip along the tract: ``"force"``, the paper's projection F·t, or
    ``"wrench"``, the generalised force F·t + m κ n·B that follows from the energy −m t·B, since a tip locked to a
    bend turns as it slides. A closed tract takes "wrench" only: F·t is not conservative round a loop. The free wire
    feels force and couple as they are, whatever `coupling` says.

    >>> Scenario.paper().rig.magnets[0].dipoles       # the rule it took for its own smallest distance
    ('fitted', 21)
    """

    REQUIRED: ClassVar[tuple[str, ...]] = ("wire", "tip", "rig")
    """Fields that must be given beside the name and a lumen; `tract` or `lumen` comes before them."""

    name: str
    tract: Tract = field(default=None)  # type: ignore[assignment]  # or `lumen`
    wire: Guidewire = field(default_factory=partial(_missing, "wire"))
    tip: CylinderMagnet = field(default_factory=partial(_missing, "tip"))
    rig: Rig = field(default_factory=partial(_missing, "rig"))
    contact: Contact = field(default_factory=Contact)
    coupling: str = "force"
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    timing: Timing = field(default_factory=Timing)
    sensing: Sensing = field(default_factory=Sensing)
    variation: Variation = field(default_factory=Variation)
    model: str = "locked"
    lumen: Lumen | None = None

    def __post_init__(self) -> None:
        self._check_lumen()
        one_of("Scenario.coupling", self.coupling, COUPLINGS)
        object.__setattr__(self, "gravity", ranged_vector("Scenario.gravity", self.gravity))
        if self.tract.closed and self.coupling == "force":
            raise ValueError(
                "Scenario.coupling must be 'wrench' on a closed tract, where F·t does net work a lap, got 'force'"
            )
        if self.rig.feed is None and self.wire.length >= self.tract.length:
            raise ValueError(
                f"Scenario.wire.length must be less than the tract's {self.tract.length:.4g} m, "
                f"got {self.wire.length:g} m"
            )
        plausible.check(self)
        magnets, distances = [], []
        for mount, (distance, clear) in zip(self.rig.magnets, self._distances, strict=True):
            if distance >= clear:
                if not mount.dipoles:
                    mount = dataclasses.replace(mount, dipoles=cheapest_rule(mount.magnet, distance))
                distances.append(distance)
            magnets.append(mount)
        object.__setattr__(self, "rig", dataclasses.replace(self.rig, magnets=tuple(magnets), feed=self._feed()))
        if self.model == "locked" and len(distances) == len(magnets):
            steps.check(self, distances)

    def _check_lumen(self) -> None:
        if self.lumen is None and self.tract is None:
            raise ValueError("Scenario.tract or Scenario.lumen must be given, got neither")
        if self.lumen is None:
            if not isinstance(self.tract, Tract):
                raise ValueError(f"Scenario.tract must be a Tract, got {self.tract!r}")
            return
        if not isinstance(self.lumen, Lumen):
            raise ValueError(f"Scenario.lumen must be a Lumen, got {self.lumen!r}")
        trunk = self.lumen.trunk.curve
        if self.tract is None:
            object.__setattr__(self, "tract", trunk)
        elif self.tract != trunk:
            raise ValueError("Scenario.tract must be left out where Scenario.lumen is given, whose trunk it is")

    def _feed(self) -> Feed | None:
        """The feed with its limits filled in."""
        if self.rig.feed is None:
            return None
        if self.tract.closed:
            raise ValueError("Scenario.tract must be open to have a wire fed in, got a closed one")
        if self.rig.twist and not self.wire.twisting:
            raise ValueError("Scenario.wire.twisting must be given (in N·m²) with Rig.twist, got None")
        return self.rig.feed.within(self.wire.length, self.wire.segment_length)

    @property
    def tree(self) -> Lumen:
        """The lumen as a tree: of one branch, "trunk", where a tract is given."""
        return self.lumen if self.lumen is not None else _of_one_branch(self.tract)

    @cached_property
    def _distances(self) -> list[tuple[float, float]]:
        """For each magnet the least distance of its centre from the centreline of the branch that is nearest to its
        body, and how far it must stay away from that, m."""
        curves = [branch.curve for branch in self.tree.branches]
        centrelines = [c.position(np.linspace(0.0, c.length, 4 * len(c.table))) for c in curves]
        found = []
        for mount in self.rig.magnets:
            spare = [mount.distance_to(line) - c.widest for line, c in zip(centrelines, curves, strict=True)]
            nearest = int(np.argmin(spare))
            distance = mount.distance_to(centrelines[nearest]) - 3**0.5 * self.variation.placement
            found.append((distance, mount.magnet.reach + curves[nearest].widest))
        return found

    def check_placed(self) -> None:
        """Raise `ValueError` where a magnet reaches into the lumen.

        Such a scenario can be made, so that a tract can be replaced before the magnets are moved, but not simulated.
        """
        for i, (mount, (distance, clear)) in enumerate(zip(self.rig.magnets, self._distances, strict=True)):
            if distance < clear:
                raise ValueError(
                    f"Scenario.rig.magnets[{i}].position must keep the magnet's centre at least {clear:.4g} m from the "
                    f"centreline, or the turning magnet enters the tract, got {distance:.4g} m from {mount.position} "
                    f"m; magwire_env.quasistatic.best_placement finds a place"
                )

    @property
    def substeps(self) -> int:
        """Integration steps in one control period: those of `timing`, or else as many as the wire needs.

        `magwire_env.scenario.steps.substeps_needed` derives the number. Soft wires, the paper's among them, take steps
        of 50 ms. A scenario that needs more than `MOST_SUBSTEPS` is refused.
        """
        return self.substeps_needed if self.timing.substeps is None else self.timing.substeps

    @property
    def step_too_long(self) -> bool:
        """Whether `timing` gives fewer substeps than the wire needs: all its motion is then reported as unconverged."""
        given = self.timing.substeps
        return given is not None and self.model == "locked" and given < self.substeps_needed

    @cached_property
    def substeps_needed(self) -> int:
        """Integration steps in one control period that the wire needs."""
        return steps.substeps_needed(self)

    @property
    def moving_mass(self) -> float:
        """Mass of the wire and its tip, kg."""
        return self.wire.mass + (self.tip.mass or 0.0)

    @classmethod
    def paper(cls, magnet_distance: float = 0.07, measured_to: str = "centre") -> Scenario:
        """The paper's set-up (Section IV), every number of it.

        magnet_distance : m. The paper's 7 cm "from the GI tract" may end at the magnet's centre or at its face; here
            it is the smallest distance from the tract's centreline to the magnet's ``"centre"`` or its ``"face"``
            (half an edge farther).
        """
        from ..lumen.named import paper_spiral

        block = BlockMagnet(size=(50.8e-3,) * 3, remanence=1.3)
        one_of("measured_to", measured_to, ("centre", "face"))
        distance = positive("magnet_distance", magnet_distance, "m") + (
            block.size[2] / 2 if measured_to == "face" else 0.0
        )
        tract = paper_spiral()
        return cls(
            name="paper",
            tract=tract,
            wire=Guidewire(
                length=0.1, radius=2.5e-3, axial_modulus=600e3, bending_modulus=550e3, density=1100.0, segments=16
            ),
            tip=CylinderMagnet(diameter=2e-3, height=3e-3, remanence=1.37, mass=7.2e-5),
            rig=Rig((ActuatedMagnet(block, above(tract, distance), (Turn("y", home=math.pi),)),)),
        )

    def replace(self, **changes: Any) -> Scenario:
        """A copy with some fields changed, those of parts by two underscores: ``sc.replace(contact__friction=0.1)``."""
        nested: dict[str, dict[str, Any]] = {}
        flat: dict[str, Any] = {}
        for key, value in changes.items():
            part, _, inner = key.partition("__")
            if part not in {f.name for f in dataclasses.fields(self)}:
                raise ValueError(f"Scenario.replace got an unknown field {key!r}")
            if inner:
                nested.setdefault(part, {})[inner] = value
            else:
                flat[part] = value
        if flat.get("lumen") is not None:
            flat.setdefault("tract", None)
        elif "tract" in flat:
            flat.setdefault("lumen", None)
        for part, inner_changes in nested.items():
            known = (
                {f.name for f in dataclasses.fields(getattr(self, part))}
                if part not in ("name", "coupling", "gravity", "model", "lumen")
                else set()
            )
            if unknown := set(inner_changes) - known:
                raise ValueError(f"Scenario.replace got an unknown field {part}__{min(unknown)}")
            flat[part] = dataclasses.replace(flat.get(part, getattr(self, part)), **inner_changes)
        return dataclasses.replace(self, **flat)

    def randomised(
        self,
        friction: tuple[float, float] | None = None,
        bending_rigidity: tuple[float, float] | None = None,
        remanence: tuple[float, float] | None = None,
        placement: float | None = None,
    ) -> Scenario:
        """A copy for domain randomisation: every range's middle becomes its value, its half-width its `Variation`.

        friction : lowest and highest coefficient
        bending_rigidity : lowest and highest E I, N·m²; the axial modulus varies by the same share
        remanence : lowest and highest strength of the magnets, as factors on this scenario's
        placement : half-width of each coordinate of each magnet's position, m

        What is not given stays as it is. `magwire_env.identification` gives such ranges from logs. Raises `ValueError`
        for a range that is empty or not positive.

        >>> round(Scenario.paper().randomised(friction=(0.03, 0.05)).variation.friction, 9)
        0.25
        """
        ends = {"friction": friction, "bending_rigidity": bending_rigidity, "remanence": remanence}
        return self.replace(**randomised.changes(self, ends, placement))

    def save(self, path: str | Path) -> None:
        """Write the scenario as TOML, for people too; a lumen is stored by its points, so the file stands alone.

        A lumen whose wall is a surface goes into a file of its own beside it, ``<path's stem>.lumen``.
        """
        from .toml_text import text_of

        file = Path(path)
        if self.lumen is None or type(self.lumen.wall) in _PLAIN_WALLS:
            file.write_text(self.dumps(), encoding="utf-8")
            return
        beside = file.with_suffix(".lumen")
        self.lumen.save(beside)
        file.write_text(text_of(self, lumen=beside.name), encoding="utf-8")

    def dumps(self) -> str:
        """The text that `save` writes. Raises `ValueError` for a lumen whose wall is a surface: it needs a file."""
        from .toml_text import text_of

        if self.lumen is not None and type(self.lumen.wall) not in _PLAIN_WALLS:
            raise ValueError("Scenario.lumen must have a wall of tubes or a box to become text; use Scenario.save")
        return text_of(self)

    @classmethod
    def loads(cls, text: str, where: str = "the scenario") -> Scenario:
        """Read a scenario from TOML text, which may name no files; errors as `load`'s, in which `where` names it."""
        return toml.from_text(cls, text, where)

    @classmethod
    def load(cls, path: str | Path) -> Scenario:
        """Read a scenario from a TOML file, or a shipped one by name (``Scenario.load("paper")``).

        `magwire_env.scenario.toml` says what a file may leave out. Raises `ValueError` naming all entries that are
        unknown, missing or impossible, `FileNotFoundError` if there is no file.
        """
        return toml.from_file(cls, path)


@lru_cache(maxsize=256)
def _of_one_branch(tract: Tract) -> Lumen:
    return Lumen.from_tract(tract)


def above(tract: Tract, distance: float) -> tuple[float, float, float]:
    """The point above (+z) the mean of the tract's control points, `distance` m from the centreline's nearest point."""
    p = tract.position(np.linspace(0.0, tract.length, 4001))
    x, y = np.mean(tract.points, axis=0)[:2]
    flat = np.hypot(p[:, 0] - x, p[:, 1] - y)
    near = flat < distance
    # Above every near point by at least what keeps it on or outside its sphere of radius `distance`.
    z = (p[near, 2] + np.sqrt(distance**2 - flat[near] ** 2)).max() if near.any() else p[:, 2].mean()
    return (float(x), float(y), float(z))
