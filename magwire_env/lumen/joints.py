"""How a tree's branches meet: a branch is led to its parent's axis, and a tree is checked branch by branch."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..physics.checks import points_array
from .branch import Branch
from .curve import Tract

__all__ = ["attached", "check_tree"]

_OFF_AXIS = 1e-5
"""How far a branch may begin from its parent's axis, m: readers of files attach it exactly."""


def attached(name: str, points: Any, radius: Any, parent: Branch | None) -> Branch:
    """A branch led to its parent's axis: points (n, 3) m, radius m or (n,) m.

    Points of the branch that lie in the parent's lumen within a quarter of its radius of the axis are dropped, so that
    a first step from the axis of any length is taken straight. Raises `ValueError` if it begins outside the parent.
    """
    xyz = points_array(f"points of {name!r}", points, "m")
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(xyz),)).copy()
    if parent is None:
        return Branch(name, _tract(xyz, radii))
    s = float(parent.curve.project(xyz[0]))
    axis, r = parent.curve.position(s), float(parent.radius(s))
    gap = float(np.linalg.norm(xyz[0] - axis))
    if gap > r:
        raise ValueError(
            f"branch {name!r} must begin inside its parent {parent.name!r} (radius {r:.4g} m there), "
            f"got {gap:.4g} m from its axis at {xyz[0].tolist()}"
        )
    if gap > _OFF_AXIS:
        ahead = np.linalg.norm(xyz - axis, axis=1) > 0.25 * r
        first = int(np.argmax(ahead)) if ahead.any() else len(xyz) - 1
        xyz, radii = np.vstack([axis, xyz[first:]]), np.concatenate([[min(radii[0], r)], radii[first:]])
    else:
        xyz[0] = axis
    return Branch(name, _tract(xyz, radii), parent.name, s)


def _tract(xyz: np.ndarray, radii: np.ndarray) -> Tract:
    same = bool((radii == radii[0]).all())
    return Tract.from_points(xyz, float(radii[0]) if same else radii)


def check_tree(branches: tuple[Branch, ...]) -> None:
    """Raise `ValueError` naming the first branch that is no part of a tree: each stands after its parent."""
    if not branches:
        raise ValueError("Lumen.branches must hold at least one branch, got none")
    seen: dict[str, Branch] = {}
    for i, b in enumerate(branches):
        if not isinstance(b, Branch):
            raise ValueError(f"Lumen.branches[{i}] must be a Branch, got {type(b).__name__}")
        if b.name in seen or b.name == "inlet":
            raise ValueError(f"Lumen.branches[{i}].name must be another one, got {b.name!r} twice or the inlet's")
        if (b.parent is None) != (i == 0):
            raise ValueError(
                f"Lumen.branches[{i}].parent must be {'None, as the trunk is' if i == 0 else 'a branch'}, "
                f"got {b.parent!r} for {b.name!r}"
            )
        if b.parent is not None:
            _check_joint(i, b, seen)
        seen[b.name] = b


def _check_joint(i: int, b: Branch, seen: dict[str, Branch]) -> None:
    assert b.parent is not None
    if b.parent not in seen:
        raise ValueError(f"Lumen.branches[{i}].parent must name a branch before it, got {b.parent!r} for {b.name!r}")
    parent = seen[b.parent]
    if b.curve.closed or parent.curve.closed:
        raise ValueError(
            f"Lumen.branches[{i}] must be open, as its parent, to be part of a tree, got a loop ({b.name!r})"
        )
    if not 0.0 <= b.start <= parent.length * (1 + 1e-12) or not math.isfinite(b.start):
        raise ValueError(
            f"Lumen.branches[{i}].start must lie in [0, {parent.length:.6g}] m on {b.parent!r}, got {b.start:g}"
        )
    gap = float(np.linalg.norm(b.curve.position(0.0) - parent.curve.position(b.start)))
    if gap > _OFF_AXIS:
        raise ValueError(
            f"branch {b.name!r} must begin on the axis of {b.parent!r} (to {_OFF_AXIS:g} m; `Lumen.from_lines` leads "
            f"it there), got {gap:.4g} m beside it"
        )
