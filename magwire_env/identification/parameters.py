"""What can be fitted: how each parameter is read from a scenario, put into one, and where it is searched."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..physics.checks import finite, one_of
from ..scenario import Scenario

__all__ = ["PARAMETERS", "Parameter", "chosen"]


@dataclass(frozen=True)
class Parameter:
    """One number of a scenario that a log may tell.

    unit, text : for people
    read : scenario → its value
    put : (scenario, value) → the scenario with that value; `ValueError` for a value that the scenario refuses
    span : its value → lowest and highest value searched
    ratio : it is searched by ratios (logarithmically), else by differences
    step : for finite differences: of its logarithm for a ratio, else in its unit. It is small, since a tip that passes
        a place where the drive changes sign goes one way or the other: after 20 s the paper's wire answers a hundredth
        of a per cent of drag with 20 mm, and a difference over more is no derivative
    turns_offset : not the scenario's but the rig's: an angle that every turn of the rig has beyond its reading
    """

    name: str
    unit: str
    text: str
    read: Callable[[Scenario], float]
    put: Callable[[Scenario, float], Scenario]
    span: Callable[[float], tuple[float, float]]
    ratio: bool = True
    step: float = 1e-6
    turns_offset: bool = False

    def to_search(self, value: float) -> float:
        """A value as the search counts it."""
        return math.log(value) if self.ratio else value

    def from_search(self, z: float) -> float:
        """Inverse of `to_search`."""
        return math.exp(z) if self.ratio else z


def _times(factor: float) -> Callable[[float], tuple[float, float]]:
    return lambda value: (value / factor, value * factor)


def _about(reach: float) -> Callable[[float], tuple[float, float]]:
    return lambda value: (value - reach, value + reach)


def _with_bending(scenario: Scenario, value: float) -> Scenario:
    return scenario.replace(wire__bending_modulus=value / scenario.wire.second_moment)


def _with_axial(scenario: Scenario, value: float) -> Scenario:
    return scenario.replace(wire__axial_modulus=value / scenario.wire.area)


def _stronger(scenario: Scenario, factor: float) -> Scenario:
    return scenario.replace(rig=scenario.rig.stronger(factor))


def _shifted(axis: int, scenario: Scenario, shift: float) -> Scenario:
    """The whole rig moved along an axis."""
    parts: dict[str, tuple] = {}
    for kind in ("magnets", "coils"):
        moved = []
        for part in getattr(scenario.rig, kind):
            position = [x + shift * (i == axis) for i, x in enumerate(part.position)]
            moved.append(dataclasses.replace(part, position=tuple(position)))
        parts[kind] = tuple(moved)
    rig = dataclasses.replace(scenario.rig, magnets=parts["magnets"], coils=parts["coils"])
    return scenario.replace(rig=rig)


def _shift(axis: str) -> Parameter:
    number = "xyz".index(axis)
    return Parameter(
        f"rig_{axis}", "m", f"shift of the whole rig along {axis} from where the scenario places it",
        lambda _: 0.0, lambda sc, v: _shifted(number, sc, v), _about(15e-3), ratio=False, step=1e-8,
    )  # fmt: skip


def _clearance(scenario: Scenario) -> float:
    if scenario.model == "locked":
        raise ValueError(
            "parameters must not name 'clearance' for the wire model 'locked', which has no walls; "
            "Scenario.model must be one that touches the wall"
        )
    if not isinstance(scenario.tract.radius, float):
        raise ValueError("parameters may name 'clearance' only for a tract of one radius, got one a control point")
    return scenario.tract.radius - scenario.wire.radius


def _with_clearance(scenario: Scenario, value: float) -> Scenario:
    _clearance(scenario)
    return scenario.replace(tract=dataclasses.replace(scenario.tract, radius=scenario.wire.radius + value))


PARAMETERS: dict[str, Parameter] = {
    p.name: p
    for p in (
        Parameter(
            "friction", "", "Coulomb coefficient μ",
            lambda sc: sc.contact.friction, lambda sc, v: sc.replace(contact__friction=v),
            lambda v: (0.0, max(0.5, 4.0 * v)), ratio=False, step=2e-7,
        ),
        Parameter(
            "bending_rigidity", "N·m²", "E I of the wire",
            lambda sc: sc.wire.bending_rigidity, _with_bending, _times(8.0),
        ),
        Parameter(
            "axial_rigidity", "N", "E A of the wire",
            lambda sc: sc.wire.axial_rigidity, _with_axial, _times(8.0),
        ),
        Parameter(
            "drag", "N·s/m²", "viscous drag per metre of wire and per m/s",
            lambda sc: sc.contact.drag, lambda sc, v: sc.replace(contact__drag=v), _times(8.0),
        ),
        Parameter(
            "remanence", "×", "strength of every magnet and coil of the rig, as a factor on the scenario's",
            lambda _: 1.0, _stronger, _times(2.0),
        ),
        Parameter(
            "tip_remanence", "T", "remanence of the tip magnet",
            lambda sc: sc.tip.remanence, lambda sc, v: sc.replace(tip__remanence=v), _times(2.0),
        ),
        _shift("x"), _shift("y"), _shift("z"),
        Parameter(
            "angle_offset", "rad", "angle of every turn of the rig beyond its reading; the scenario stays as it is",
            lambda _: 0.0, lambda sc, _: sc, _about(0.5), ratio=False, step=1e-7, turns_offset=True,
        ),
        Parameter(
            "clearance", "m", "between wire and wall, of wire models that touch the wall",
            _clearance, _with_clearance, _times(4.0),
        ),
    )
}  # fmt: skip
"""By name."""


def chosen(
    scenario: Scenario, names: Sequence[str], bounds: dict[str, tuple[float, float]] | None = None
) -> tuple[tuple[Parameter, ...], list[tuple[float, float]]]:
    """The parameters of these names, and where each is searched: `bounds` by name, or else its `span`.

    Raises `ValueError` for names that do not exist, are doubled, or that this scenario cannot have.
    """
    names = (names,) if isinstance(names, str) else tuple(names)
    if not names or len(set(names)) != len(names):
        raise ValueError(f"parameters must be different names of {', '.join(PARAMETERS)}, got {names!r}")
    found = tuple(PARAMETERS[one_of("parameters", name, tuple(PARAMETERS))] for name in names)
    given = dict(bounds or {})
    if unknown := set(given) - set(names):
        raise ValueError(f"bounds must be of the fitted parameters {', '.join(names)}, got {min(unknown)!r}")
    spans = []
    for parameter in found:
        low, high = given.get(parameter.name) or parameter.span(parameter.read(scenario))
        name = f"bounds[{parameter.name!r}]"
        low, high = finite(name, low, parameter.unit), finite(name, high, parameter.unit)
        if not low < high or (parameter.ratio and low <= 0):
            least = "0 < low" if parameter.ratio else "low"
            raise ValueError(f"{name} must be {least} < high (in {parameter.unit or '1'}), got {low:g} and {high:g}")
        for value in (low, high):
            parameter.put(scenario, value)
        spans.append((low, high))
    return found, spans
