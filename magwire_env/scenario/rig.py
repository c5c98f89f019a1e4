"""The rig: external magnets and their actuated degrees of freedom (paper Section III-C)."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..physics.checks import one_of
from ..physics.dipoles import field_gradient
from ..physics.fitted_cloud import SIZES
from ..physics.magnets import RULES, BlockMagnet, Magnet, PointDipole
from ..physics.ranges import ranged, ranged_vector
from .base import Feed, Twist

__all__ = ["ActuatedMagnet", "Coil", "Current", "Rig", "Slide", "Turn", "cheapest_rule", "wrapped"]

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Turn:
    """A magnet's rotation about a world axis through its centre.

    axis : "x", "y" or "z"
    home : rad; the action's zero, and the angle at rest
    speed : rad/s at most; the servo turns the short way round
    """

    axis: str = "y"
    home: float = 0.0
    speed: float = math.pi

    def __post_init__(self) -> None:
        one_of("Turn.axis", self.axis, tuple(_AXES))
        for name in ("home", "speed"):
            object.__setattr__(self, name, ranged(f"Turn.{name}", getattr(self, name)))


@dataclass(frozen=True)
class Slide:
    """A magnet's translation along a world axis, as an offset from its position.

    axis : "x", "y" or "z"
    low, high : m, the offset's limits; the action's −1 and +1
    home : m; the offset at rest
    speed : m/s at most
    """

    axis: str
    low: float
    high: float
    home: float = 0.0
    speed: float = 0.2

    def __post_init__(self) -> None:
        one_of("Slide.axis", self.axis, tuple(_AXES))
        for name in ("low", "high", "home", "speed"):
            object.__setattr__(self, name, ranged(f"Slide.{name}", getattr(self, name)))
        if not self.low <= self.home <= self.high or self.low == self.high:
            raise ValueError(f"Slide.home must lie in [low, high] with low < high (in m), got {self}")


@dataclass(frozen=True)
class ActuatedMagnet:
    """An external magnet and how it may move.

    magnet : the body
    position : m, of its centre with every slide at 0
    dofs : its actuated degrees of freedom in the order of the command; at most two turns (the second about a world
        axis after the first) and three slides. At rest its moment lies along z; a turn by θ about y brings it to
        (sin θ, 0, cos θ), as in the paper's Section III-C.
    dipoles : (rule, n) of its cloud, see `magwire_env.physics.magnets`; empty: the scenario takes, and records, the
        cheapest rule within 0.5 % of the exact force gradient at its own smallest distance
    """

    magnet: Magnet
    position: tuple[float, float, float]
    dofs: tuple[Turn | Slide, ...] = (Turn(),)
    dipoles: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", ranged_vector("ActuatedMagnet.position", self.position))
        object.__setattr__(self, "dofs", tuple(self.dofs))
        turns = [d for d in self.dofs if isinstance(d, Turn)]
        slides = [d.axis for d in self.dofs if isinstance(d, Slide)]
        if len(turns) > 2 or len(set(slides)) != len(slides):
            raise ValueError(f"ActuatedMagnet.dofs must hold at most two turns and one slide an axis, got {self.dofs}")
        if self.dipoles:
            if not isinstance(self.dipoles, (tuple, list)) or len(self.dipoles) != 2:
                raise ValueError(f"ActuatedMagnet.dipoles must be (rule, n) or empty, got {self.dipoles!r}")
            rule, n = self.dipoles
            one_of("ActuatedMagnet.dipoles", rule, RULES)
            try:
                self.magnet.dipoles(rule, n)
            except ValueError as error:
                raise ValueError(f"ActuatedMagnet.dipoles: {error}") from None
            object.__setattr__(self, "dipoles", (rule, tuple(map(int, n)) if isinstance(n, (tuple, list)) else int(n)))

    def distance_to(self, points: np.ndarray) -> float:
        """Smallest distance from `points` (n, 3) m to the magnet's centre over the range of its slides, m."""
        low, high = np.array(self.position), np.array(self.position)
        for slide in self.dofs:
            if isinstance(slide, Slide):
                low += slide.low * np.array(_AXES[slide.axis])
                high += slide.high * np.array(_AXES[slide.axis])
        return float(np.linalg.norm(points - np.clip(points, low, high), axis=1).min())


@dataclass(frozen=True)
class Current:
    """A coil's current.

    low, high : A
    home : A, at rest
    speed : A/s at most, what the supply and the inductance allow
    """

    low: float = -10.0
    high: float = 10.0
    home: float = 0.0
    speed: float = 100.0

    def __post_init__(self) -> None:
        for name in ("low", "high", "home", "speed"):
            object.__setattr__(self, name, ranged(f"Current.{name}", getattr(self, name)))
        if not self.low <= self.home <= self.high or self.low == self.high:
            raise ValueError(f"Current.home must lie in [low, high] with low < high (in A), got {self}")


@dataclass(frozen=True)
class Coil:
    """A pair of coils about a world axis, as seen near its middle: a uniform field, a gradient, or both.

    At r from the middle the field is i (u a + ½ g (3 (a·r) a − r)), a the axis: a Helmholtz pair has g = 0, a Maxwell
    pair u = 0. It is free of divergence and curl, and linear; what holds far from the middle is not modelled.

    axis : "x", "y" or "z"
    uniform : u, T/A
    gradient : g along the axis, T/(m·A)
    position : m, of the middle
    current : its range and speed, one degree of freedom
    """

    axis: str
    uniform: float = 1e-3
    gradient: float = 0.0
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    current: Current = Current()

    def __post_init__(self) -> None:
        one_of("Coil.axis", self.axis, tuple(_AXES))
        for name in ("uniform", "gradient"):
            object.__setattr__(self, name, ranged(f"Coil.{name}", getattr(self, name)))
        object.__setattr__(self, "position", ranged_vector("Coil.position", self.position))
        if not (self.uniform or self.gradient):
            raise ValueError(f"Coil.uniform and Coil.gradient must not both be 0, got {self}")

    def field(self, points: np.ndarray, current: float) -> np.ndarray:
        """Flux density at `points` (n, 3) m under `current` A → (n, 3) T."""
        axis, r = np.array(_AXES[self.axis]), np.asarray(points) - self.position
        return current * (self.uniform * axis + 0.5 * self.gradient * (3 * (r @ axis)[:, None] * axis - r))


@dataclass(frozen=True)
class Rig:
    """What is actuated: external magnets and coils, at least one of either, and a free wire's base.

    feed, twist : how the base is pushed and turned; without a feed the base is free, and the wire is dragged by its tip
    clamped : the base of a free wire is held at the inlet, pointing into the lumen, and all of the wire stands out
    """

    magnets: tuple[ActuatedMagnet, ...] = ()
    coils: tuple[Coil, ...] = ()
    feed: Feed | None = None
    twist: Twist | None = None
    clamped: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "magnets", tuple(self.magnets))
        object.__setattr__(self, "coils", tuple(self.coils))
        if not self.magnets and not self.coils:
            raise ValueError("Rig.magnets and Rig.coils must hold at least one magnet or coil, got none")
        for name, kind in (("feed", Feed), ("twist", Twist)):
            if not isinstance(getattr(self, name), (kind, type(None))):
                raise ValueError(f"Rig.{name} must be a {kind.__name__} or None, got {getattr(self, name)!r}")
        if self.twist and not self.feed:
            raise ValueError("Rig.feed must be given with Rig.twist: a free base cannot be turned, got None")
        if not isinstance(self.clamped, bool) or (self.clamped and self.feed):
            raise ValueError(f"Rig.clamped must be True or False, and False with a Rig.feed, got {self.clamped!r}")

    def moved(self, position: tuple[float, float, float], magnet: int = 0) -> Rig:
        """The rig with one magnet's centre at `position` (m); the scenario takes a cloud anew for its new distance."""
        if not 0 <= magnet < len(self.magnets):
            raise ValueError(f"magnet must be a number from 0 to {len(self.magnets) - 1}, got {magnet!r}")
        there = dataclasses.replace(self.magnets[magnet], position=position, dipoles=())
        magnets = (*self.magnets[:magnet], there, *self.magnets[magnet + 1 :])
        return dataclasses.replace(self, magnets=magnets)

    @property
    def layout(self) -> tuple[tuple[tuple[str, str], ...], ...]:
        """The kinds and axes of every magnet's degrees of freedom, then of every coil: what a batch must share."""
        magnets = tuple(tuple((type(d).__name__, d.axis) for d in m.dofs) for m in self.magnets)
        coils = tuple((("Current", c.axis),) for c in self.coils)
        return magnets + coils + tuple(((type(d).__name__, d.axis),) for d in self.base)

    @property
    def limits(self) -> tuple[tuple[float, float, float], ...]:
        """Speed, lowest and highest setting of every degree of freedom: rad, m or A.

        A turn's range is the circle about its home, and does not limit it. A feed's limits are those that a scenario
        has filled in.
        """
        return tuple(
            (d.speed, d.home - math.pi, d.home + math.pi)
            if isinstance(d, Turn)
            else (d.speed, float(d.low or 0.0), float(d.high or 0.0))
            for d in self.dofs
        )

    @property
    def base(self) -> tuple[Feed | Twist, ...]:
        """The degrees of freedom of the wire's base, which come last."""
        return tuple(d for d in (self.feed, self.twist) if d is not None)

    @property
    def names(self) -> tuple[str, ...]:
        """What every degree of freedom is, in the order of the command: "angle of magnet 0 about y", …"""
        found = []
        for m, mount in enumerate(self.magnets):
            which = f"magnet {m}" if len(self.magnets) > 1 else "the magnet"
            for dof in mount.dofs:
                turns = isinstance(dof, Turn)
                found.append(f"angle of {which} about {dof.axis}" if turns else f"place of {which} along {dof.axis}")
        found += [f"current of coil {c} along {coil.axis}" for c, coil in enumerate(self.coils)]
        return (*found, *("wire inserted" if isinstance(d, Feed) else "turn of the wire's base" for d in self.base))

    def stronger(self, factor: float) -> Rig:
        """The rig with the strength of every magnet and coil times `factor`."""
        magnets = []
        for mount in self.magnets:
            name = "strength" if isinstance(mount.magnet, PointDipole) else "remanence"
            body: Any = dataclasses.replace(mount.magnet, **{name: factor * getattr(mount.magnet, name)})
            magnets.append(dataclasses.replace(mount, magnet=body))
        coils = [dataclasses.replace(c, uniform=factor * c.uniform, gradient=factor * c.gradient) for c in self.coils]
        return dataclasses.replace(self, magnets=tuple(magnets), coils=tuple(coils))

    @property
    def dofs(self) -> tuple[Turn | Slide | Current | Feed | Twist, ...]:
        """Every actuated degree of freedom, in the command's order: the magnets', the coils' currents, the base's."""
        return tuple(d for m in self.magnets for d in m.dofs) + tuple(c.current for c in self.coils) + self.base


def wrapped(gap: np.ndarray, is_turn: np.ndarray | bool = True) -> np.ndarray:
    """`gap` with its turns brought to [−π, π), the short way round: (..., dof) rad or m; is_turn (dof,) or one."""
    return np.where(is_turn, gap - 2 * np.pi * np.floor(gap / (2 * np.pi) + 0.5), gap)


@lru_cache(maxsize=256)
def cheapest_rule(magnet: Magnet, distance: float, tolerance: float = 5e-3) -> tuple[str, int]:
    """The rule of fewest dipoles whose force gradient at `distance` m from the centre is within `tolerance` of exact.

    Of the Gauss rules and, for a cuboid, the fitted clouds, which need about a third of the dipoles.

    The worst of some hundred directions counts, all in one octant. "Exact" is 16 points a direction, or 24 close to
    the body, converged to 2e-4 of the closed form even 1 mm from a corner.
    """
    count, reference = (64, 16) if distance > 1.2 * magnet.reach else (96, 24)
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z**2)
    points = distance * np.abs(np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1))  # all are symmetric
    exact = field_gradient(magnet.dipoles("gauss", reference), points)
    size = np.linalg.norm(exact, axis=(1, 2))
    rules = [(n**3, "gauss", n) for n in range(1, 16)]
    if isinstance(magnet, BlockMagnet):
        rules += [(n, "fitted", n) for n in SIZES]
    for _, rule, n in sorted(rules):
        error = np.linalg.norm(field_gradient(magnet.dipoles(rule, n), points) - exact, axis=(1, 2)) / size
        if error.max() <= 0.95 * tolerance:  # a twentieth in hand for the directions between
            return (rule, n)
    raise ValueError(
        f"no Gauss rule up to 15 points a direction is within {tolerance:g} at {distance:.4g} m from {magnet}"
    )
