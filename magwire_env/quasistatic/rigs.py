"""Rigs for any tract, by rule: one magnet above it, on one axis or two; one that follows; one above and one below."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from ..lumen.curve import Tract
from ..scenario import Scenario, above
from ..scenario.rig import ActuatedMagnet, Rig, Slide, Turn, cheapest_rule

__all__ = ["DISTANCE", "RIGS", "following", "one_axis", "two_axes", "two_magnets"]

DISTANCE = 0.07
"""Least distance of every magnet's centre from the centreline, m."""


@lru_cache(maxsize=1)
def paper() -> Scenario:
    """The paper's scenario, built once."""
    return Scenario.paper()


@lru_cache(maxsize=8)
def _dipoles(distance: float) -> tuple[str, int]:
    """The cheapest dipole rule at a little less than `distance`, the same for all magnets."""
    return cheapest_rule(paper().rig.magnets[0].magnet, 0.99 * distance)


def _magnet(distance: float, position: tuple[float, float, float], *dofs: Turn | Slide) -> ActuatedMagnet:
    return ActuatedMagnet(paper().rig.magnets[0].magnet, position, dofs, _dipoles(distance))


def one_axis(tract: Tract, distance: float = DISTANCE) -> Rig:
    """The paper's: a magnet fixed above the tract that turns about y."""
    return Rig((_magnet(distance, above(tract, distance), Turn("y", home=math.pi)),))


def two_axes(tract: Tract, distance: float = DISTANCE) -> Rig:
    """The same on a second turn, about z."""
    return Rig((_magnet(distance, above(tract, distance), Turn("y", home=math.pi), Turn("z")),))


def following(tract: Tract, distance: float = DISTANCE) -> Rig:
    """A magnet that slides over the tract and 30 mm beyond it, in the plane `distance` above its highest point."""
    xyz = tract.table[1:, 0:3]
    (x0, y0, _), (x1, y1, top) = xyz.min(axis=0), xyz.max(axis=0)
    middle = ((x0 + x1) / 2, (y0 + y1) / 2, top + distance)
    x, y = (x1 - x0) / 2 + 0.03, (y1 - y0) / 2 + 0.03
    return Rig((_magnet(distance, middle, Slide("x", -x, x), Slide("y", -y, y), Turn("y", home=math.pi)),))


def two_magnets(tract: Tract, distance: float = DISTANCE) -> Rig:
    """One magnet above the tract that turns about y, and one below that turns about x."""
    x, y, z = above(Tract(tuple(map(tuple, np.array(tract.points) * (1, 1, -1)))), distance)
    high = _magnet(distance, above(tract, distance), Turn("y", home=math.pi))
    return Rig((high, _magnet(distance, (x, y, -z), Turn("x"))))


RIGS: dict[str, Callable[[Tract, float], Rig]] = {
    "one magnet, one axis": one_axis,
    "one magnet, two axes": two_axes,
    "two magnets, one axis each": two_magnets,
    "one magnet that follows, one axis": following,
}
"""The rigs by name; each takes a tract and a distance, m."""
