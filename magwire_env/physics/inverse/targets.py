"""What a rod is wanted to be: a curve along its arc length, or a pose of its tip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from ..checks import finite, points_array, positive, vector
from ..guidewire import Guidewire

__all__ = ["Curve", "Fit", "Target", "TipPose", "as_target"]


@dataclass(frozen=True, eq=False)
class Curve:
    """A wanted course of the rod.

    points : (n, 3) m, in the rod's frame: its clamp at the origin along +x
    arclengths : (n,) m, the wire's arc lengths at rest that belong to the points, rising; by default equally spaced
        from the clamp to the tip, as the nodes are that `FreeRod.equilibrium` returns
    within : m; the curve counts as reached if no point is farther from its place on the rod. Default: 1 % of the wire
    """

    points: np.ndarray
    arclengths: Sequence[float] | np.ndarray | None = None
    within: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", points_array("Curve.points", self.points, "m"))
        if len(self.points) < 2:
            raise ValueError(f"Curve.points must hold at least 2 points (in m), got {len(self.points)}")
        if self.arclengths is not None:
            s = np.array([finite(f"Curve.arclengths[{i}]", v, "m") for i, v in enumerate(self.arclengths)])
            if len(s) != len(self.points) or s.min() < 0 or (np.diff(s) <= 0).any():
                raise ValueError(
                    f"Curve.arclengths must be {len(self.points)} rising numbers of at least 0 (in m), one a point, "
                    f"got {s.tolist()}"
                )
            object.__setattr__(self, "arclengths", s)
        if self.within is not None:
            object.__setattr__(self, "within", positive("Curve.within", self.within, "m"))


@dataclass(frozen=True)
class TipPose:
    """A wanted place of the rod's end, and the direction in which it points.

    position : (3,) m, in the rod's frame: its clamp at the origin along +x
    direction : (3,) along the last segment, of any length; None: any direction will do
    within, turn : m and rad; the pose counts as reached within both
    """

    position: Any
    direction: Any = None
    within: float = 1e-3
    turn: float = math.radians(1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector("TipPose.position", self.position, 3, "m"))
        if self.direction is not None:
            direction = np.array(vector("TipPose.direction", self.direction))
            size = float(np.linalg.norm(direction))
            if size == 0.0:
                raise ValueError(f"TipPose.direction must not be zero, got {self.direction!r}")
            object.__setattr__(self, "direction", tuple((direction / size).tolist()))
        object.__setattr__(self, "within", positive("TipPose.within", self.within, "m"))
        object.__setattr__(self, "turn", positive("TipPose.turn", self.turn, "rad"))


Target = Curve | TipPose


def as_target(value: Any) -> Target:
    """A `Curve` from plain points; a target as it is."""
    return value if isinstance(value, Curve | TipPose) else Curve(points_array("target", value, "m"))


class Fit(NamedTuple):
    """How near a rod comes.

    residual : (r,) whose norm is least where the rod is nearest: m over the tolerance, root mean square over a curve
    distance : m, of the farthest point of a curve, or of the tip
    turn : rad, between the tip's direction and the wanted one; 0 where none is wanted
    error : the greater of the two over what is allowed; reached at 1 or less
    """

    residual: np.ndarray
    distance: float
    turn: float
    error: float


class Aim:
    """A target as seen by one wire: how far the rod's nodes are from it."""

    def __init__(self, target: Target, wire: Guidewire) -> None:
        self.target = target
        self.nodes = np.linspace(0.0, wire.length, wire.segments + 1)
        if isinstance(target, Curve):
            given = target.arclengths
            s = np.linspace(0.0, wire.length, len(target.points)) if given is None else np.asarray(given)
            if s[-1] > wire.length * (1 + 1e-9):
                raise ValueError(f"Curve.arclengths must end within the wire's {wire.length:g} m, got {s[-1]:g} m")
            self.arclengths = s
            self.within = target.within or 0.01 * wire.length
            self._weights = _linear(s, self.nodes)
        else:
            self.within = target.within
            self._weights = _linear(self.nodes[-1:], self.nodes)

    def fit(self, positions: np.ndarray) -> Fit:
        """Of a rod with its nodes at `positions` (nodes, 3) m."""
        target, off = self.target, self._weights @ positions
        if isinstance(target, Curve):
            off = off - target.points
            far = float(np.linalg.norm(off, axis=1).max())
            return Fit(off.ravel() / (self.within * math.sqrt(len(off))), far, 0.0, far / self.within)
        off = off[0] - target.position
        far = float(np.linalg.norm(off))
        if target.direction is None:
            return Fit(off / self.within, far, 0.0, far / self.within)
        askew = _last(positions) - target.direction
        turn = 2 * math.asin(min(1.0, float(np.linalg.norm(askew)) / 2))
        residual = np.concatenate([off / self.within, askew / target.turn])
        return Fit(residual, far, turn, max(far / self.within, turn / target.turn))

    def slopes(self, moves: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Derivatives of the residual, (r, P), by P parameters that move the nodes by `moves` (nodes, 3, P) m and turn
        the last segment's direction by `turns` (3, P)."""
        shift = np.einsum("kn,njp->kjp", self._weights, moves).reshape(-1, moves.shape[2])
        if isinstance(self.target, Curve):
            return shift / (self.within * math.sqrt(len(self._weights)))
        if self.target.direction is None:
            return shift / self.within
        return np.concatenate([shift / self.within, turns / self.target.turn])

    def sketch(self) -> np.ndarray:
        """Node positions (nodes, 3) m of a rod much as wanted: on the curve, or on a smooth way to the tip's pose."""
        s, points, length = self.nodes, np.zeros((0, 3)), self.nodes[-1]
        if isinstance(self.target, Curve):
            known, points = self.arclengths, self.target.points
            if known[0] > 1e-3 * length:
                known, points = np.r_[0.0, known], np.vstack([np.zeros(3), points])
            spline = make_interp_spline(known, points, k=min(3, len(known) - 1))
            end = points[-1] - points[-2]
            end = end / max(float(np.linalg.norm(end)), 1e-12)
            on = np.where(s[:, None] <= known[-1], spline(np.minimum(s, known[-1])), 0.0)
            return on + np.where(s[:, None] > known[-1], points[-1] + (s - known[-1])[:, None] * end, 0.0)
        place = np.array(self.target.position)
        chord = place / max(float(np.linalg.norm(place)), 1e-12)
        arc = 2 * chord[0] * chord - np.array([1.0, 0.0, 0.0])  # the end of a circle's arc from the clamp
        end = arc if self.target.direction is None else np.array(self.target.direction)
        t = np.linspace(0.0, 1.0, 4 * len(s))[:, None]
        course = (t**3 - 2 * t**2 + t) * length * [1.0, 0, 0] + (3 * t**2 - 2 * t**3) * place
        course = course + (t**3 - t**2) * length * end
        along = np.r_[0.0, np.linalg.norm(np.diff(course, axis=0), axis=1).cumsum()]
        at = s / length * along[-1]
        return np.stack([np.interp(at, along, c) for c in course.T], axis=1)


def _last(positions: np.ndarray) -> np.ndarray:
    end = positions[-1] - positions[-2]
    return end / np.linalg.norm(end)


def _linear(s: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Weights (n, nodes) of linear interpolation at `s` (n,)."""
    at = np.clip(s / nodes[-1], 0.0, 1.0) * (len(nodes) - 1)
    low = np.minimum(at.astype(int), len(nodes) - 2)
    weights = np.zeros((len(s), len(nodes)))
    weights[np.arange(len(s)), low] = 1 - (at - low)
    weights[np.arange(len(s)), low + 1] += at - low
    return weights
