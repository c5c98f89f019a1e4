"""A scenario: one tree of frozen values that says everything a run needs, and its TOML form."""

from __future__ import annotations

import dataclasses
import math
import tomllib
import types
import typing
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ..lumen.curve import Tract
from ..lumen.lumen import Lumen, Wall
from ..lumen.rooms import BoxWall
from ..physics.checks import one_of, positive
from ..physics.guidewire import Guidewire
from ..physics.magnets import BlockMagnet, CylinderMagnet, PointDipole
from ..physics.profile import Profile
from ..physics.ranges import counted, ranged, ranged_vector
from . import steps
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


_SHIPPED = Path(__file__).parents[1] / "scenarios"
_MOST_BYTES = 64 * 2**20
"""Size beyond which a scenario's file is refused unread."""


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
        magnets, distances = self._magnets()
        object.__setattr__(self, "rig", dataclasses.replace(self.rig, magnets=magnets, feed=self._feed()))
        if self.model == "locked":
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

    def _magnets(self) -> tuple[tuple[ActuatedMagnet, ...], list[float]]:
        """The magnets, clear of the lumen, each with its rule; and their least distances from the centreline, m."""
        curves = [branch.curve for branch in self.tree.branches]
        centrelines = [c.position(np.linspace(0.0, c.length, 4 * len(c.table))) for c in curves]
        magnets, distances = [], []
        for i, mount in enumerate(self.rig.magnets):
            spare = [mount.distance_to(line) - c.widest for line, c in zip(centrelines, curves, strict=True)]
            nearest = int(np.argmin(spare))
            distance = mount.distance_to(centrelines[nearest]) - 3**0.5 * self.variation.placement
            clear = mount.magnet.reach + curves[nearest].widest
            if distance < clear:
                raise ValueError(
                    f"Scenario.rig.magnets[{i}].position must keep the magnet's centre at least {clear:.4g} m from the "
                    f"centreline, or the turning magnet enters the tract, got {distance:.4g} m from {mount.position} m"
                )
            if not mount.dipoles:
                mount = dataclasses.replace(mount, dipoles=cheapest_rule(mount.magnet, distance))
            magnets.append(mount)
            distances.append(distance)
        return tuple(magnets), distances

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

    def save(self, path: str | Path) -> None:
        """Write the scenario as TOML; a lumen is stored by its points, so the file stands alone.

        A lumen whose wall is a surface goes into a file of its own beside it, ``<path's stem>.lumen``.
        """
        import tomli_w

        file = Path(path)
        if self.lumen is None or type(self.lumen.wall) in _SAVED_WALLS:
            file.write_text(self.dumps(), encoding="utf-8")
            return
        beside = file.with_suffix(".lumen")
        self.lumen.save(beside)
        tree = _to_toml(dataclasses.replace(self, lumen=None)) | {"lumen": beside.name}
        del tree["tract"]
        file.write_text(tomli_w.dumps(tree), encoding="utf-8")

    def dumps(self) -> str:
        """The text that `save` writes. Raises `ValueError` for a lumen whose wall is a surface: it needs a file."""
        import tomli_w

        if self.lumen is not None and type(self.lumen.wall) not in _SAVED_WALLS:
            raise ValueError("Scenario.lumen must have a wall of tubes or a box to become text; use Scenario.save")
        tree = _to_toml(self)
        if self.lumen is not None:
            del tree["tract"]
        return tomli_w.dumps(tree)

    @classmethod
    def loads(cls, text: str, where: str = "the scenario", folder: Path | None = None) -> Scenario:
        """Read a scenario from TOML text; `where` names it in errors, which are those of `load`.

        folder : where a lumen that is a file of its own lies; without it such a scenario is refused
        """
        try:
            tree = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{where} is not valid TOML: {error}") from error
        except (RecursionError, ValueError) as error:  # brackets in brackets, whole numbers of thousands of digits
            raise ValueError(f"{where} is not valid TOML: {type(error).__name__}: {error}") from error
        if isinstance(tree.get("lumen"), str):
            tree["lumen"] = _lumen_beside(tree["lumen"], where, folder)
        elif "tract" not in tree and "lumen" not in tree:
            raise ValueError(f"{where} lacks the key 'tract' (or 'lumen')")
        return _from_toml(cls, tree, where)

    @classmethod
    def load(cls, path: str | Path) -> Scenario:
        """Read a scenario from a TOML file, or a shipped one by name (``Scenario.load("paper")``).

        Raises `ValueError` naming an unknown, missing or impossible entry, `FileNotFoundError` if there is no file.
        """
        file = Path(path)
        if not file.suffix and not file.exists():
            names = sorted(p.stem for p in _SHIPPED.glob("*.toml"))
            if str(path) not in names:
                raise FileNotFoundError(
                    f"no file {str(path)!r}, and no shipped scenario of that name; shipped: {', '.join(names)}"
                )
            file = _SHIPPED / f"{path}.toml"
        size = file.stat().st_size
        if size > _MOST_BYTES:
            raise ValueError(f"{file} is {size} bytes long, more than the {_MOST_BYTES} of a scenario")
        try:
            text = file.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"{file} must be text in UTF-8: {error}") from error
        return cls.loads(text, str(file), file.parent)


def _lumen_beside(name: str, where: str, folder: Path | None) -> Lumen:
    """The lumen in a file of its own, which must lie beside the scenario's."""
    if folder is None or Path(name).name != name or Path(name).suffix != ".lumen":
        raise ValueError(f"{where}.lumen must be a table, or the name of a .lumen file beside it, got {name!r}")
    return Lumen.load(folder / name)


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


# --- TOML -------------------------------------------------------------------------------------------------------------

_KINDS: dict[str, type] = {
    "block": BlockMagnet, "cylinder": CylinderMagnet, "point": PointDipole, "turn": Turn, "slide": Slide,
    "box": BoxWall,
}  # fmt: skip
_KIND_OF = {cls: kind for kind, cls in _KINDS.items()}
_SAVED_WALLS = (type(None), BoxWall)


def _to_toml(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        tree = {"kind": _KIND_OF[type(value)]} if type(value) in _KIND_OF else {}
        values = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return tree | {name: _to_toml(inner) for name, inner in values.items() if inner is not None}
    if isinstance(value, tuple):
        return [_to_toml(v) for v in value]
    return value


def _from_toml(kind: Any, tree: Any, where: str) -> Any:
    if kind is Lumen and isinstance(tree, Lumen):
        return tree
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType) and types.NoneType in args and len(args) == 2:
        (kind,) = (a for a in args if a is not types.NoneType)
        if kind is Wall:
            return _tagged((BoxWall,), tree, where)
        if kind is Profile and not isinstance(tree, dict):
            return tree  # a number is a profile that is constant
        return _from_toml(kind, tree, where)
    if origin in (typing.Union, types.UnionType) and any(a in _KIND_OF for a in args):
        return _tagged(args, tree, where)
    if dataclasses.is_dataclass(kind):
        return _built(typing.cast(type, kind), tree, where)
    if origin is tuple:
        if not isinstance(tree, list):
            raise ValueError(f"{where} must be a list, got {tree!r}")
        inner = args[0] if len(args) == 2 and args[1] is Ellipsis else None
        items = [_from_toml(inner if inner else a, t, f"{where}[{i}]") for i, (t, a) in enumerate(_zip(tree, args))]
        return tuple(items)
    return tuple(tree) if isinstance(tree, list) else tree


def _zip(tree: list, args: tuple) -> list:
    return [(t, args[i] if i < len(args) else args[-1]) for i, t in enumerate(tree)]


def _tagged(allowed: tuple, tree: Any, where: str) -> Any:
    names = [_KIND_OF[a] for a in allowed if a in _KIND_OF]
    if not isinstance(tree, dict) or tree.get("kind") not in names:
        got = tree.get("kind") if isinstance(tree, dict) else tree
        raise ValueError(f"{where}.kind must be one of {', '.join(map(repr, names))}, got {got!r}")
    return _built(_KINDS[tree["kind"]], tree, where)


def _built(kind: type, tree: Any, where: str) -> Any:
    if not isinstance(tree, dict):
        raise ValueError(f"{where} must be a table, got {tree!r}")
    hints = typing.get_type_hints(kind)
    tree = {k: v for k, v in tree.items() if not (k == "kind" and kind in _KIND_OF)}
    fields = {f.name: f for f in dataclasses.fields(kind)}
    if unknown := sorted(set(tree) - set(fields)):
        raise ValueError(f"{where} has an unknown key {unknown[0]!r}; allowed: {', '.join(fields)}")
    for name, f in fields.items():
        if name not in tree and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
            raise ValueError(f"{where} lacks the key {name!r}")
    for name, value in tree.items():
        wanted = hints[name]
        if wanted in (bool, str) and not isinstance(value, wanted):
            raise ValueError(
                f"{where}.{name} must be {'true or false' if wanted is bool else 'a string'}, got {value!r}"
            )
    values = {name: _from_toml(hints[name], value, f"{where}.{name}") for name, value in tree.items()}
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
