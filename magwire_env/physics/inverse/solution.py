"""What the search found: the load, the shape, how near it is to what was wanted, and what stands in the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["ShapeSolution"]


@dataclass(frozen=True, eq=False, repr=False)
class ShapeSolution:
    """The load that brings a rod nearest to a target.

    reached : the straight rod comes there from rest, within the tolerance, by `route`
    why : a sentence on what was reached, or what limits it
    limit : "" if reached, else one of
        "range" (a field, slide or current is at its limit), "snap" (the branch of equilibria ends before the target),
        "branch" (the shape is an equilibrium, but a rod from rest goes to another), "contact" (the rod is drawn into
        a magnet, or a magnet would stand in it), "directions" (no small change of the load brings the rod nearer),
        "search" (the search stopped elsewhere)
    load : keywords for `FreeRod.equilibrium`
    parameters : (P,), the field in T, or the rig's command in rad, m and A
    names : (P,), of the parameters
    positions : (nodes, 3) m, the shape under `load`
    distance, turn : m of the farthest point of a curve or of the tip, and rad of the tip's direction, off the target
    error : the greater of them over its tolerance
    route : how a rod from rest comes to `positions`, which need not be its only shape under `load`: "at once"
        (`FreeRod.equilibrium`), "growing" (as the load grows in proportion), "by way of another" (first another load,
        then its parameters changing to the last); or "": it goes elsewhere, as far as was tried
    loads : the loads of that route, the last of them `load`, for `FreeRod.path`; none without a route
    snap : share of the growing load at which a rod without a route leaves its branch, if it does
    sensitivity : (k,), singular values of the target's points by the parameters, greatest first: m (root mean square
        over a curve) by one unit of a direction
    directions : (k, P), these directions, in SI units of the parameters
    rank : directions that move the rod, by at least a thousandth of the greatest; the others are singular
    stiffness : the softest mode of the rod under the load, over that of the straight rod without any; 0 at a snap
    tried : starts of the search that were followed
    """

    reached: bool
    why: str
    limit: str
    load: Mapping[str, Any]
    parameters: np.ndarray
    names: tuple[str, ...]
    positions: np.ndarray
    distance: float
    turn: float
    error: float
    route: str
    loads: tuple[Mapping[str, Any], ...]
    snap: float | None
    sensitivity: np.ndarray
    directions: np.ndarray
    rank: int
    stiffness: float
    tried: int

    def __repr__(self) -> str:
        return f"<ShapeSolution: {self.why}>"
