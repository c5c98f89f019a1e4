"""The magnets that a rod carries, and what dipoles outside do to them, in the units of `rod_energy`.

A rod carries its moment along its own direction: the tip magnet at the last node, and what each magnetised segment
holds at its middle. A carrier's energy is −V with V = m d̂·B(x); its derivatives by the place x and by the direction
d̂ are the force and the field. The sums here are those of `dipoles.field` and `dipoles.field_gradient`, for C carriers
and K dipoles at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .checks import finite

__all__ = [
    "Carriers",
    "Magnetisation",
    "carriers_of",
    "first",
    "moved",
    "reference_moment",
    "second",
    "segment_moments",
]

Magnetisation = Callable[[np.ndarray], np.ndarray] | Sequence[float] | np.ndarray
"""Moment along the tangent per length of wire, A·m²/m: a function of the arc length from the clamp, (n,) m → (n,), or
one number for each segment."""

_SAMPLES = 32
"""Points of each segment at which a magnetisation given as a function is averaged (midpoint rule)."""


class Carriers(NamedTuple):
    """Moments along the rod.

    segment : (C,) the segment whose direction the moment has
    share : (C,) where on the segment it sits, from 0 at its start to 1 at its end
    moment : (C,) as a multiple of the reference moment
    """

    segment: np.ndarray
    share: np.ndarray
    moment: np.ndarray

    def places(self, steps: np.ndarray) -> np.ndarray:
        """Where they are, (C, 3), on a rod whose segments are the vectors `steps` (N, 3)."""
        return np.cumsum(steps, axis=0)[self.segment] - (1 - self.share)[:, None] * steps[self.segment]

    def by_segment(self, values: np.ndarray, segments: int) -> np.ndarray:
        """Sums of the carriers' `values` (C, ...) over each segment, (N, ...)."""
        out = np.zeros((segments, *values.shape[1:]))
        np.add.at(out, self.segment, values)
        return out

    def carried(self, values: np.ndarray, segments: int) -> np.ndarray:
        """What each segment carries of the carriers' `values` (C, ...), (N, ...): all that sits beyond it, and of
        what sits on it the share by which its own vector moves it."""
        whole = self.by_segment(values, segments)
        beyond = np.cumsum(whole[::-1], axis=0)[::-1] - whole
        share = self.share.reshape(-1, *(1,) * (values.ndim - 1))
        return beyond + self.by_segment(share * values, segments)


def carriers_of(tip_moment: float, moments: np.ndarray, reference: float) -> Carriers:
    """The carriers of a rod with `tip_moment` (A·m²) at its end and `moments` (N,) A·m² in its segments."""
    held = np.flatnonzero(moments)
    segment, share, moment = held, np.full(len(held), 0.5), moments[held]
    if tip_moment or not len(held):
        segment, share, moment = np.r_[held, len(moments) - 1], np.r_[share, 1.0], np.r_[moment, tip_moment]
    return Carriers(segment, share, moment / reference)


def reference_moment(tip_moment: float, moments: np.ndarray) -> float:
    """Moment in whose units the rod's magnets are taken, A·m²: the tip's, or what the segments hold without one."""
    held = float(np.abs(moments).sum())
    if tip_moment == 0.0 == held:
        raise ValueError("FreeRod.tip must be a magnet, or FreeRod.magnetisation not zero (in A·m²/m), got neither")
    return tip_moment or held


def segment_moments(name: str, magnetisation: Magnetisation | None, segments: int, length: float) -> np.ndarray:
    """Moments of the segments, (N,) A·m², of a `magnetisation` along a wire of `length` m."""
    if magnetisation is None:
        return np.zeros(segments)
    if callable(magnetisation):
        s = (np.arange(segments * _SAMPLES) + 0.5) * length / (segments * _SAMPLES)
        values = np.asarray(magnetisation(s), dtype=np.float64)
        if values.shape != s.shape:
            raise ValueError(f"{name} must give one number (in A·m²/m) for each arc length, got shape {values.shape}")
        density = values.reshape(segments, _SAMPLES).mean(axis=1)
    else:
        density = np.array([finite(f"{name}[{i}]", value, "A·m²/m") for i, value in enumerate(magnetisation)])
        if len(density) != segments:
            raise ValueError(f"{name} must hold {segments} numbers (in A·m²/m), one a segment, got {len(density)}")
    if not np.isfinite(density).all():
        raise ValueError(f"{name} must be finite (in A·m²/m), got {density.tolist()} over the segments")
    return density * length / segments


def first(
    positions: np.ndarray, moments: np.ndarray, places: np.ndarray, along: np.ndarray, contact: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """V (C,) per unit moment, the forces ∂V/∂x (C, 3) and the fields ∂V/∂d̂ (C, 3); V −∞ nearer than `contact`.

    positions, moments : (K, 3) of the dipoles; places, along : (C, 3) of the carriers
    """
    r, square = _apart(positions, places)
    if square.min() < contact**2:
        nothing = np.zeros_like(places)
        return np.full(len(places), -np.inf), nothing, nothing
    a, b, c = _products(r, moments, along)
    w3 = square**-1.5
    w5 = 3 * w3 / square
    field = np.einsum("ck,ckj->cj", w5 * a, r) - w3 @ moments
    force = (w5 * b) @ moments + (w5 * a).sum(axis=1)[:, None] * along
    force += np.einsum("ck,ckj->cj", w5 * (c - 5 * a * b / square), r)
    return np.einsum("cj,cj->c", field, along), force, field


def second(
    positions: np.ndarray, moments: np.ndarray, places: np.ndarray, along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """∂²V/∂x∂x and ∂²V/∂x∂d̂ per unit moment, both (C, 3, 3)."""
    r, square = _apart(positions, places)
    a, b, c = _products(r, moments, along)
    w5 = 3 * square**-2.5
    w7 = 5 * w5 / square
    one = np.einsum("ci,cj->cij", w5 @ moments, along)
    mixed = (w7 * b)[:, :, None] * moments + (w7 * a)[:, :, None] * along[:, None, :]
    two = np.einsum("cki,ckj->cij", mixed, r)
    by_place = one + one.transpose(0, 2, 1) - two - two.transpose(0, 2, 1)
    by_place += (w5 * (c - 5 * a * b / square)).sum(axis=1)[:, None, None] * np.eye(3)
    by_place += np.einsum("cki,ckj->cij", r * (w7 * (7 * a * b / square - c))[:, :, None], r)
    turned = np.einsum("cki,ckj->cij", w5[:, :, None] * moments, r)
    by_both = turned + turned.transpose(0, 2, 1) + (w5 * a).sum(axis=1)[:, None, None] * np.eye(3)
    by_both -= np.einsum("cki,ckj->cij", r * (w7 * a)[:, :, None], r)
    return by_place, by_both


def moved(
    positions: np.ndarray, moments: np.ndarray, places: np.ndarray, along: np.ndarray, shift: np.ndarray,
    change: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Changes of the forces and of the fields per unit moment, (C, 3) each, while the carriers stay.

    shift, change : (K, 3), the rates at which the dipoles' positions and moments change
    """
    _, force, field = first(positions, change, places, along, 0.0)
    r, square = _apart(positions, places)
    a, b, c = _products(r, moments, along)
    w5 = 3 * square**-2.5
    on_s, on_r = np.einsum("kj,kj->k", moments, shift), np.einsum("ckj,kj->ck", r, shift)
    on_d = along @ shift.T
    field = field - np.einsum("ck,ckj->cj", w5 * (on_s - 5 * a * on_r / square), r)
    field -= (w5 * a) @ shift + (w5 * on_r) @ moments
    middle = c - 5 * a * b / square
    force = force - (w5 * (on_d - 5 * on_r * b / square)) @ moments
    force -= (w5 * (on_s - 5 * on_r * a / square)).sum(axis=1)[:, None] * along
    force -= (w5 * middle) @ shift
    stretch = -5 * (on_s * b + a * on_d - 2 * a * b * on_r / square) / square - 5 * on_r * middle / square
    force -= np.einsum("ck,ckj->cj", w5 * stretch, r)
    return force, field


def _apart(positions: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From every dipole to every carrier, (C, K, 3), and the squares of the distances, (C, K)."""
    r = places[:, None, :] - positions
    return r, np.einsum("ckj,ckj->ck", r, r)


def _products(r: np.ndarray, moments: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """s·r, d̂·r and s·d̂, (C, K) each."""
    return np.einsum("kj,ckj->ck", moments, r), np.einsum("ckj,cj->ck", r, along), along @ moments.T
