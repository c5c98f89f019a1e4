"""Checks of the way back from a shape to the field that makes it: round trips, and verdicts held against arcs.

A round trip draws a load at random, lets the rod come to rest under it, and asks for that shape, or for that pose of
the tip: it is reachable by construction. For what cannot be reached there is a closed form to judge by: a uniform field
exerts a couple alone on a tip magnet, so the inextensible rod is a circle's arc, and the nearest arc can be found
without any of the code under test.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from ..physics import FreeRod, Guidewire, NotConverged
from ..physics.inverse import Curve, ShapeSolution, TipPose
from ..physics.inverse.means import RigMeans
from ..scenario import ActuatedMagnet, Rig, Slide, Turn
from .magnets import BLOCK
from .report import Row, Size, at_least, at_most
from .rods import LENGTH, make_rod, random_unit

__all__ = ["MEANS", "Means", "Trips", "Verdicts", "arc", "arc_verdicts", "inverse", "round_trips", "tip_magnetised"]

_SEGMENTS = 12
_WITHIN, _NEAR, _TURN = 0.01 * LENGTH, 1e-3, math.radians(1.0)
"""What counts as reached: 1 % of the length for a curve, 1 mm and 1° for the tip's pose."""


def tip_magnetised(segments: int = _SEGMENTS) -> FreeRod:
    """The paper's wire with the tip magnet's moment (within 3 %) spread over its last half, and no tip magnet."""
    wire = Guidewire(LENGTH, 2.5e-3, 600e3, 550e3, 1100.0, segments)
    return FreeRod(wire, None, magnetisation=lambda s: np.where(s > 0.5 * LENGTH, 0.2, 0.0))


def rig_of(count: int) -> Rig:
    """One or two of the paper's blocks that turn and slide freely, the first above the rod and the second below."""
    slides = Slide("x", -0.06, 0.06), Slide("y", -0.06, 0.06), Slide("z", -0.04, 0.04)
    places = ((0.09, 0.0, 0.2), (0.09, 0.0, -0.2))[:count]
    return Rig(tuple(ActuatedMagnet(BLOCK, p, (*slides, Turn("y"), Turn("z")), ("fitted", 9)) for p in places))


class Means(NamedTuple):
    """A rod, a random load for it, and the way back from a target."""

    rod: FreeRod
    draw: Callable[[np.random.Generator], dict[str, Any]]
    back: Callable[[Any], ShapeSolution]


def _field(rod: FreeRod) -> Means:
    """Uniform fields up to ten times that of β = 1."""
    moment = float(rod.segment_moments.sum()) + (rod.tip.moment if rod.tip is not None else 0.0)
    unit = rod.wire.bending_rigidity / (LENGTH * moment)
    return Means(rod, lambda rng: {"uniform_field": random_unit(rng) * rng.uniform(0, 10) * unit}, rod.field_for)


def _rig(rod: FreeRod, rig: Rig) -> Means:
    """Commands over the whole range of the slides, and any turn."""
    means = RigMeans(rod.wire, rig)
    low = np.where(np.isfinite(means.low), means.low, -math.pi)
    high = np.where(np.isfinite(means.high), means.high, math.pi)

    def draw(rng: np.random.Generator) -> dict[str, Any]:
        return means.load(low + rng.random(len(low)) * (high - low))

    return Means(rod, draw, partial(rod.rig_for, rig=rig))


MEANS: dict[str, Callable[[], Means]] = {
    "uniform field, tip magnet": lambda: _field(make_rod(_SEGMENTS)),
    "uniform field, rod magnetised along its tip": lambda: _field(tip_magnetised()),
    "one magnet, tip magnet": lambda: _rig(make_rod(_SEGMENTS), rig_of(1)),
    "two magnets, tip magnet": lambda: _rig(make_rod(_SEGMENTS), rig_of(2)),
    "one magnet, rod magnetised along its tip": lambda: _rig(tip_magnetised(), rig_of(1)),
}
"""A magnet stands 16 to 24 cm to the side of the rod's axis, slides 12 cm along and across it, and turns any way."""


class Trips(NamedTuple):
    """Round trips: how many were made, how many came back, and the worst that did, over its tolerance."""

    made: int
    reached: int
    worst: float


def round_trips(means: Means, count: int, pose: bool, seed: int = 0) -> Trips:
    """Random loads to shapes (or tip poses) and back to a load, under which the straight rod then comes to rest.

    A load under which the rod has no equilibrium is drawn again. What comes back is measured on the rod, not taken
    from the solution.
    """
    rng, made, reached, worst = np.random.default_rng(seed), 0, 0, 0.0
    while made < count:
        try:
            wanted = means.rod.equilibrium(**means.draw(rng))
        except NotConverged:
            continue
        made += 1
        found = means.back(TipPose(wanted[-1], _end(wanted)) if pose else wanted)
        if not found.reached:
            continue
        got = means.rod.path(found.loads).positions[-1]
        off = np.linalg.norm(got - wanted, axis=1)
        error = max(off[-1] / _NEAR, _angle(_end(got), _end(wanted)) / _TURN) if pose else off.max() / _WITHIN
        reached += int(error <= 1)
        worst = max(worst, float(error)) if error <= 1 else worst
    return Trips(made, reached, worst)


# --- what cannot be reached -------------------------------------------------------------------------------------------


def arc(turn: float, plane: float, segments: int = _SEGMENTS) -> np.ndarray:
    """The chain of `segments` as an arc that turns by `turn` in the plane at `plane` about x, (nodes, 3) m.

    Its half-cell joints lay segment i at the angle (i + ½)/N of the turn, and the last at the whole of it.
    """
    angle = turn * (np.arange(segments) + 0.5) / segments
    angle[-1] = turn
    out = np.stack([np.cos(angle), np.sin(angle) * math.cos(plane), np.sin(angle) * math.sin(plane)], axis=1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(out, axis=0)]) * LENGTH / segments


def nearest_arc(error: Callable[[np.ndarray], float]) -> np.ndarray:
    """The arc of least `error`, (nodes, 3) m: a grid of turns up to 170° and planes, then a simplex from the best."""
    turns, planes = np.radians(np.arange(2.5, 171.0, 5.0)), np.radians(np.arange(0.0, 360.0, 12.0))
    tried = sorted((error(arc(t, p)), t, p) for t in turns for p in planes)
    best, least = arc(*tried[0][1:]), tried[0][0]
    for _, turn, plane in tried[:2]:
        simplex = np.array([[turn, plane], [turn + 0.05, plane], [turn, plane + 0.1]])
        options = {"xatol": 1e-5, "fatol": 1e-6, "initial_simplex": simplex}
        found = minimize(lambda x: error(arc(x[0], x[1])), simplex[0], method="Nelder-Mead", options=options)
        if found.fun < least:
            best, least = arc(*found.x), float(found.fun)
    return best


class _Wanted(NamedTuple):
    """A target, and two measures of a rod's nodes: error over tolerance, and what least squares makes least."""

    target: Curve | TipPose
    error: Callable[[np.ndarray], float]
    squares: Callable[[np.ndarray], float]


def _curve_off(rng: np.random.Generator, base: np.ndarray, off: float) -> _Wanted:
    """A smooth curve whose farthest point lies `off` tolerances from its place on `base`."""
    s = np.linspace(0.0, 1.0, len(base))
    bend = sum(np.outer(np.sin(k * math.pi * s / 2), rng.normal(size=3) / k) for k in (1, 2, 3))
    points = base + off * _WITHIN * bend / np.linalg.norm(bend, axis=1).max()

    def error(nodes: np.ndarray) -> float:
        return float(np.linalg.norm(nodes - points, axis=1).max()) / _WITHIN

    return _Wanted(Curve(points), error, lambda nodes: float(np.sum((nodes - points) ** 2)) / _WITHIN**2)


def _pose_off(rng: np.random.Generator, base: np.ndarray, off: float) -> _Wanted:
    """A pose up to `off` tolerances from that of `base`, in place and in direction."""
    place = base[-1] + rng.random() * off * _NEAR * random_unit(rng)
    across = np.cross(_end(base), random_unit(rng))
    turn = rng.random() * off * _TURN
    direction = math.cos(turn) * _end(base) + math.sin(turn) * across / np.linalg.norm(across)

    def parts(nodes: np.ndarray) -> tuple[float, float]:
        return float(np.linalg.norm(nodes[-1] - place)) / _NEAR, _angle(_end(nodes), direction) / _TURN

    return _Wanted(TipPose(place, direction), lambda x: max(parts(x)), lambda x: float(np.sum(np.square(parts(x)))))


class Verdicts(NamedTuple):
    """Verdicts on random targets.

    reachable : targets that some arc meets; said : those said to be reached
    wrong : verdicts that the nearest arc contradicts. Where the arc of least squares misses but another just meets the
        target, neither verdict is wrong: the search takes the least squares.
    nameless : targets that were not reached and got no other reason than that the search ended
    """

    made: int
    reachable: int
    said: int
    wrong: int
    nameless: int


def arc_verdicts(count: int, pose: bool, seed: int = 0) -> Verdicts:
    """What is said of random curves, or tip poses, that lie a tenth of the tolerance to thirty times it off an arc."""
    rng, rod = np.random.default_rng(seed), make_rod(_SEGMENTS, stretch=1000)
    reachable = said = wrong = nameless = 0
    for _ in range(count):
        base = arc(rng.uniform(0.2, 2.2), rng.uniform(0, 2 * math.pi))
        wanted = (_pose_off if pose else _curve_off)(rng, base, 10 ** rng.uniform(-1.0, 1.5))
        least, middle = (wanted.error(nearest_arc(measure)) for measure in (wanted.error, wanted.squares))
        found = rod.field_for(wanted.target)
        reachable += least <= 1
        said += found.reached
        wrong += (least > 1.001) if found.reached else (middle < 0.999)
        nameless += found.limit == "search"
    return Verdicts(count, reachable, said, wrong, nameless)


# --- rows -------------------------------------------------------------------------------------------------------------


def inverse(size: Size) -> list[Row]:
    """Round trips by every means, and the verdicts on what cannot be reached."""
    rows = []
    for name, make in MEANS.items():
        means = make()
        for pose, what in ((False, "shapes back within 1 % of the length"), (True, "tip poses back within 1 mm, 1°")):
            trips = round_trips(means, size.trips, pose)
            quantity = f"{name}: of {trips.made} {what}"
            rows.append(at_least(quantity, "", float(trips.made), "required of the solver", float(trips.reached)))
    for pose, what in ((False, "curves"), (True, "tip poses")):
        found = arc_verdicts(size.trips, pose)
        quantity = f"uniform field: of {found.made} {what} ({found.reachable} reachable), wrong verdicts"
        rows.append(at_most(quantity, "", 0.0, "nearest circular arc", float(found.wrong)))
        quantity = f"uniform field: of {found.made} {what}, unreachable without a named limit"
        rows.append(at_most(quantity, "", 0.0, "required of the solver", float(found.nameless)))
    return rows


def _end(nodes: np.ndarray) -> np.ndarray:
    last = nodes[-1] - nodes[-2]
    return last / np.linalg.norm(last)


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    """Between unit vectors, rad."""
    return 2 * math.asin(min(1.0, float(np.linalg.norm(a - b)) / 2))
