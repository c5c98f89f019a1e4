"""What the rows of the free wire share: uniform rods, coming to rest, thresholds from both sides, energies."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...simulation.free.wires import FreeWires, Pieces, carried
from ..report import Row

__all__ = ["clamped", "come_to_rest", "energy", "growth", "spun", "straight", "threshold", "tip_angle"]


def straight(segments: int, length: float = 1.0, bending: float = 1.0, axial: float = 1e5, **more: Any) -> Pieces:
    """A uniform rod of 1 kg/m in equal segments, unless said otherwise; stiff in stretching."""
    return Pieces.uniform(np.full(segments, length / segments), bending, axial, more.pop("mass", 1.0), **more)


def clamped(pieces: Pieces, lanes: int = 1, tip: bool = False, **more: Any) -> FreeWires:
    """Wires clamped at the base, and at the tip if asked for, where the tip's node may still slide along x."""
    wires = FreeWires(pieces, lanes, **more)
    wires.par("BASE_CLAMPED", 1.0)
    wires.hold([0])
    if tip:
        wires.par("TIP_CLAMPED", 1.0)
        wires.hold([wires.nodes - 1], "YZ")
    return wires


def come_to_rest(wires: FreeWires, speed: float, periods: int) -> int:
    """Let damped wires move until no node is faster than `speed` m/s; returns the periods it took."""
    for k in range(periods):
        wires.step()
        if np.abs(wires.velocities).max() < speed:
            return k + 1
    raise RuntimeError(
        f"free wires: not at rest after {periods} periods, {np.abs(wires.velocities).max():.2e} m/s left"
    )


def tip_angle(wires: FreeWires) -> np.ndarray:
    """Angle of the last segments to the x axis, degrees, (n,)."""
    e = wires.positions[:, -1] - wires.positions[:, -2]
    return np.degrees(np.arctan2(np.hypot(e[:, 1], e[:, 2]), e[:, 0]))


def spun(positions: np.ndarray, first: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Directors (n, segments, 3) of wires (n, nodes, 3) m, evenly twisted by `twist` (n,) rad from clamp to clamp."""
    m = carried(positions, np.broadcast_to(first, (len(positions), 3)))
    t = np.diff(positions, axis=1)
    t /= np.linalg.norm(t, axis=-1, keepdims=True)
    share = (np.arange(m.shape[1]) + 0.5) / m.shape[1]
    angle = (np.asarray(twist)[:, None] * share)[..., None]
    return m * np.cos(angle) + np.cross(t, m) * np.sin(angle)


def threshold(
    name: str, unit: str, expected: float, source: str, factors: np.ndarray, rates: np.ndarray, tolerance: float
) -> list[Row]:
    """Rows of a threshold from how fast small motions of free wires grow at `factors` of the expected value.

    rates : growth a second (any unit), negative where the wire comes back; the threshold is where they pass through 0
    """
    gone = rates > 0.0
    turns = np.flatnonzero(gone[1:] != gone[:-1])
    if len(turns) != 1 or gone[0]:
        return [Row(f"{name}: threshold", unit, expected, source, float("nan"), tolerance)]
    k = int(turns[0])
    share = rates[k] / (rates[k] - rates[k + 1])
    found = expected * (factors[k] + share * (factors[k + 1] - factors[k]))
    return [
        Row(f"{name}: threshold, where disturbances neither grow nor die", unit, expected, source, found, tolerance)
    ]


REST = 1e-10
"""m/s; see `growth`."""


def growth(wires: FreeWires, first: int, second: int) -> np.ndarray:
    """Growth of the root mean square speed, as a logarithm a period, (n,), between two counts of periods.

    Speeds below `REST` count as `REST`: what is left of them is rounding, which neither grows nor dies.
    """
    sizes = []
    for k in range(second):
        wires.step()
        if k + 1 in (first, second):
            sizes.append(np.maximum(np.sqrt((wires.velocities**2).mean(axis=(1, 2))), REST))
    return np.log(sizes[1] / sizes[0]) / (second - first)


def energy(pieces: Pieces, positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Kinetic, stretching and bending energy, J, (n,), of wires without twist, both ends free."""
    e = np.diff(positions, axis=1)
    length = np.linalg.norm(e, axis=-1)
    t = e / length[..., None]
    c = (t[:, 1:] * t[:, :-1]).sum(axis=-1)
    rest = np.asarray(pieces.rest)
    span = 0.5 * (rest[1:] + rest[:-1])
    bend = 2.0 * np.asarray(pieces.bending)[1:-1] / span * (1.0 - c) / (1.0 + c)
    stretch = 0.5 * np.asarray(pieces.axial) / rest * (length - rest) ** 2
    kinetic = 0.5 * np.asarray(pieces.mass)[:, None] * velocities**2
    return kinetic.sum(axis=(1, 2)) + stretch.sum(axis=1) + bend.sum(axis=1)
