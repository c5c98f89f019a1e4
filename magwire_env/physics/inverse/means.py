"""What may be set to bring a rod where it is wanted: a uniform field, or the commands of a rig's magnets and coils.

Either turns free numbers z, all of about the size of one, into a load, with the rates at which each changes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..checks import positive
from ..dipoles import DipoleCloud
from ..guidewire import Guidewire

__all__ = ["Apart", "FieldRate", "Means", "RigLike", "RigMeans", "UniformField"]

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_AT_LIMIT = 1e-3
"""A parameter this near its limit, of its range, counts as being there."""

_SCATTERED = 24
"""Starts over the range of a rig."""


class FieldRate(NamedTuple):
    """The rate at which one number changes the field.

    uniform : (3,) T; positions, moments : (K, 3) m and A·m² of the cloud's dipoles
    """

    uniform: np.ndarray
    positions: np.ndarray
    moments: np.ndarray


class Apart(NamedTuple):
    """How far a magnet must keep from the rod.

    centre : (3,) m; rates : (P, 3) m, by which its place changes; clear : m, from its centre to any node
    """

    centre: np.ndarray
    rates: np.ndarray
    clear: float


class Means(Protocol):
    """What the search asks of a set of parameters.

    names : of the parameters; low, high : (P,) bounds of z, infinite where there is none
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray

    def load(self, z: np.ndarray, share: float = 1.0) -> dict[str, Any]:
        """Keywords of `FreeRod.equilibrium`, of `share` of the field."""

    def rates(self, z: np.ndarray) -> list[FieldRate]:
        """How each of z changes the field."""

    def parameters(self, z: np.ndarray) -> np.ndarray:
        """(P,) in SI units."""

    def parameters_by(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of the parameters by z, (P, P): row k by z_k."""

    def at_limits(self, z: np.ndarray) -> list[str]:
        """What cannot go further, in words."""

    def apart(self, z: np.ndarray) -> list[Apart]:
        """What must keep off the rod."""

    def seeds(self) -> np.ndarray:
        """Values of z to start from, (n, P); the first is the rig at rest, or no field."""


class UniformField:
    """A uniform field, no stronger than `limit` T.

    With u the field in units of E·I/(m L), z spans the ball of fields: B = unit z/√(1 + (unit |z|/limit)²).
    """

    names: tuple[str, ...] = ("B_x", "B_y", "B_z")

    def __init__(self, wire: Guidewire, moment: float, limit: float) -> None:
        self.unit = wire.bending_rigidity / (wire.length * moment)
        self.limit = positive("limit", limit, "T")
        self.low, self.high = np.full(3, -np.inf), np.full(3, np.inf)

    def parameters(self, z: np.ndarray) -> np.ndarray:
        return self.unit * z / self._shrunk(z)

    def _shrunk(self, z: np.ndarray) -> float:
        return math.hypot(1.0, self.unit * float(np.linalg.norm(z)) / self.limit)

    def load(self, z: np.ndarray, share: float = 1.0) -> dict[str, Any]:
        return {"uniform_field": share * self.parameters(z)}

    def parameters_by(self, z: np.ndarray) -> np.ndarray:
        shrunk = self._shrunk(z)
        return self.unit * (np.eye(3) / shrunk - np.outer(z, z) * (self.unit / self.limit) ** 2 / shrunk**3)

    def rates(self, z: np.ndarray) -> list[FieldRate]:
        return [FieldRate(row, np.zeros((0, 3)), np.zeros((0, 3))) for row in self.parameters_by(z)]

    def at_limits(self, z: np.ndarray) -> list[str]:
        full = float(np.linalg.norm(self.parameters(z))) > 0.98 * self.limit
        return [f"the field is at its limit of {self.limit:g} T"] if full else []

    def apart(self, z: np.ndarray) -> list[Apart]:
        return []

    def seeds(self) -> np.ndarray:
        """No field, and fields of three units in scattered directions."""
        k = np.arange(_SCATTERED // 2)
        height, turn = 1 - (2 * k + 1) / len(k), math.pi * (1 + 5**0.5) * k
        flat = np.sqrt(1 - height**2)
        return np.vstack([np.zeros(3), 3 * np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)])


class RigLike(Protocol):
    """A rig as `magwire_env.scenario.Rig` is: magnets with a place and turns or slides, and coils.

    A magnet has `magnet`, `position` m, `dofs` and `dipoles` (rule, n), empty for 64 Gauss points. A degree of freedom
    has an `axis` and a `home`; a slide has `low` and `high` besides, a turn has not.
    """

    @property
    def magnets(self) -> Sequence[Any]: ...

    @property
    def coils(self) -> Sequence[Any]: ...


class _Knob(NamedTuple):
    """One degree of freedom: command = scale × z, about `home`, within `low` and `high`."""

    name: str
    unit: str
    home: float
    scale: float
    low: float
    high: float


class RigMeans:
    """The commands of a rig that stands in the rod's frame.

    Its magnets keep clear of the rod: no node may come nearer to a magnet's centre than its reach and the wire's
    radius. Its coils must make a uniform field.
    """

    def __init__(self, wire: Guidewire, rig: RigLike) -> None:
        self.rig, self._wire = rig, wire
        self._clouds = [m.magnet.dipoles(*m.dipoles) if m.dipoles else m.magnet.dipoles() for m in rig.magnets]
        knobs = []
        for i, mount in enumerate(rig.magnets):
            for dof in mount.dofs:
                if hasattr(dof, "low"):
                    scale = wire.length
                    knobs.append(_Knob(f"slide {dof.axis} of magnet {i}", "m", dof.home, scale, dof.low, dof.high))
                else:
                    knobs.append(_Knob(f"turn {dof.axis} of magnet {i}", "rad", dof.home, 1.0, -np.inf, np.inf))
        for i, coil in enumerate(rig.coils):
            if coil.gradient:
                raise ValueError(f"rig.coils[{i}].gradient must be 0 T/(m·A) for a free rod, got {coil.gradient:g}")
            c = coil.current
            knobs.append(_Knob(f"current of coil {i}", "A", c.home, 0.5 * (c.high - c.low), c.low, c.high))
        if not knobs:
            raise ValueError("rig must have a degree of freedom to set, got none")
        self.knobs = tuple(knobs)
        self.names = tuple(k.name for k in knobs)
        self._scale = np.array([k.scale for k in knobs])
        self._home = np.array([k.home for k in knobs])
        self.low = np.array([k.low for k in knobs]) / self._scale
        self.high = np.array([k.high for k in knobs]) / self._scale

    def parameters(self, z: np.ndarray) -> np.ndarray:
        """Turns within π of home."""
        command = self._scale * z
        around = np.round((command - self._home) / (2 * math.pi)) * 2 * math.pi
        return np.where(np.isfinite(self.low), command, command - around)

    def parameters_by(self, z: np.ndarray) -> np.ndarray:
        return np.diag(self._scale)

    def _posed(self, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, list[tuple[str, np.ndarray]]]]:
        """Of every magnet its rotation (3, 3), its centre (3,) m, and for each of its degrees of freedom whether it is
        a "turn" or a "slide" and its axis in the world, (3,)."""
        command, posed, k = self.parameters(z), [], 0
        for mount in self.rig.magnets:
            turned, centre, axes = np.eye(3), np.array(mount.position, dtype=float), []
            for dof in mount.dofs:
                axis = np.array(_AXES[dof.axis])
                if hasattr(dof, "low"):
                    centre = centre + command[k] * axis
                    axes.append(("slide", axis))
                else:
                    turn = _rotation(dof.axis, command[k])
                    axes = [(kind, turn @ a if kind == "turn" else a) for kind, a in axes]
                    axes.append(("turn", axis))
                    turned = turn @ turned
                k += 1
            posed.append((turned, centre, axes))
        return posed

    def load(self, z: np.ndarray, share: float = 1.0) -> dict[str, Any]:
        out: dict[str, Any] = {}
        if self._clouds:
            moved = [c.moved(r, x) for c, (r, x, _) in zip(self._clouds, self._posed(z), strict=True)]
            out["cloud"] = DipoleCloud(
                np.concatenate([c.positions for c in moved]), share * np.concatenate([c.moments for c in moved])
            )
        if self.rig.coils:
            out["uniform_field"] = share * self._coil_fields().T @ self.parameters(z)[-len(self.rig.coils) :]
        return out

    def _coil_fields(self) -> np.ndarray:
        """Field of each coil by its current, (coils, 3) T/A."""
        return np.array([coil.uniform * np.array(_AXES[coil.axis]) for coil in self.rig.coils])

    def rates(self, z: np.ndarray) -> list[FieldRate]:
        total = sum(len(c) for c in self._clouds)
        out, first, k = [], 0, 0
        for cloud, (turned, _, axes) in zip(self._clouds, self._posed(z), strict=True):
            own = slice(first, first + len(cloud))
            arms, moments = cloud.positions @ turned.T, cloud.moments @ turned.T
            for kind, axis in axes:
                shift, change = np.zeros((total, 3)), np.zeros((total, 3))
                shift[own] = axis if kind == "slide" else np.cross(axis, arms)
                change[own] = 0.0 if kind == "slide" else np.cross(axis, moments)
                out.append(FieldRate(np.zeros(3), self._scale[k] * shift, self._scale[k] * change))
                k += 1
            first += len(cloud)
        for row in self._coil_fields():
            out.append(FieldRate(self._scale[k] * row, np.zeros((total, 3)), np.zeros((total, 3))))
            k += 1
        return out

    def apart(self, z: np.ndarray) -> list[Apart]:
        out, k = [], 0
        for mount, (_, centre, axes) in zip(self.rig.magnets, self._posed(z), strict=True):
            rates = np.zeros((len(self.knobs), 3))
            for kind, axis in axes:
                rates[k] = self._scale[k] * axis if kind == "slide" else 0.0
                k += 1
            out.append(Apart(centre, rates, mount.magnet.reach + self._wire.radius))
        return out

    def at_limits(self, z: np.ndarray) -> list[str]:
        out = []
        for knob, value in zip(self.knobs, self.parameters(z), strict=True):
            near = _AT_LIMIT * (knob.high - knob.low)
            for limit in (knob.low, knob.high):
                if np.isfinite(limit) and abs(value - limit) <= near:
                    out.append(f"{knob.name} is at its limit of {limit:g} {knob.unit}")
        return out

    def seeds(self) -> np.ndarray:
        """The rig at rest, then commands scattered over its range (a Kronecker sequence)."""
        home = self._home / self._scale
        low = np.where(np.isfinite(self.low), self.low, home - math.pi)
        high = np.where(np.isfinite(self.high), self.high, home + math.pi)
        k = np.arange(1, _SCATTERED)[:, None]
        return np.vstack([home, low + (k * _steps(len(home))) % 1.0 * (high - low)])


def _rotation(axis: str, angle: float) -> np.ndarray:
    """About a world axis, (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


def _steps(count: int) -> np.ndarray:
    """Steps of a low-discrepancy sequence in `count` dimensions: powers of the root of x^(n+1) = x + 1 (Roberts)."""
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (count + 1))
    return (1 / root) ** np.arange(1, count + 1)
