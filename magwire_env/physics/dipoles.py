"""Fields, forces and torques of dipole clouds (paper Section III-A).

Everything here is plain NumPy and holds for any cloud. The batched kernel carries its own copy of the
same sums for one cloud whose moments are all parallel; the tests hold the two against each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .checks import points_array

__all__ = ["MU0", "DipoleCloud", "field", "field_gradient", "force", "torque"]

MU0 = 4e-7 * np.pi
"""Vacuum permeability, T·m/A (the pre-2019 value: the paper's figures do not resolve the difference)."""

_PAIRS_AT_ONCE = 200_000  # keeps the temporaries of a large sum within a few tens of MB


@dataclass(frozen=True, eq=False)
class DipoleCloud:
    """A magnet as point dipoles.

    positions : (K, 3) m
    moments : (K, 3) A·m²
    """

    positions: np.ndarray
    moments: np.ndarray

    def __post_init__(self) -> None:
        positions = points_array("positions", self.positions, "m")
        moments = points_array("moments", self.moments, "A·m²")
        if positions.shape != moments.shape:
            raise ValueError(f"moments must have the shape of positions {positions.shape}, got {moments.shape}")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "moments", moments)

    def __len__(self) -> int:
        return len(self.positions)

    def moved(self, rotation: np.ndarray | None = None, translation: np.ndarray | None = None) -> DipoleCloud:
        """The same cloud turned by `rotation` (3, 3) about its origin, then shifted by `translation` (3,) m."""
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
        shift = np.zeros(3) if translation is None else np.asarray(translation, dtype=np.float64)
        return DipoleCloud(self.positions @ turn.T + shift, self.moments @ turn.T)


def field(cloud: DipoleCloud, points: np.ndarray) -> np.ndarray:
    """Flux density of `cloud` at `points`: (n, 3) m → (n, 3) T.

    B(d) = μ0/4π · (3 d (μ·d)/d⁵ − μ/d³), d from the dipole to the point (paper Section III-A).
    """
    points = points_array("points", points, "m")
    out = np.empty_like(points)
    for part in _chunks(len(points), len(cloud)):
        d, r2 = _separations(cloud, points[part])
        along = np.einsum("kj,nkj->nk", cloud.moments, d)
        out[part] = np.einsum("nk,nkj->nj", 3 * along * r2**-2.5, d) - (r2**-1.5) @ cloud.moments
    return MU0 / (4 * np.pi) * out


def field_gradient(cloud: DipoleCloud, points: np.ndarray) -> np.ndarray:
    """Gradient ∂B_i/∂x_j of `cloud` at `points`: (n, 3) m → (n, 3, 3) T/m, symmetric and traceless."""
    points = points_array("points", points, "m")
    out = np.empty((len(points), 3, 3))
    for part in _chunks(len(points), len(cloud)):
        d, r2 = _separations(cloud, points[part])
        along = np.einsum("kj,nkj->nk", cloud.moments, d)
        w5 = 3 * r2**-2.5
        mixed = np.einsum("nk,kj,nkl->njl", w5, cloud.moments, d)
        out[part] = (
            mixed
            + mixed.transpose(0, 2, 1)
            + (w5 * along).sum(axis=1)[:, None, None] * np.eye(3)
            - np.einsum("nk,nkj,nkl->njl", 5 * w5 * along / r2, d, d)
        )
    return MU0 / (4 * np.pi) * out


def force(cloud: DipoleCloud, points: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Force of `cloud` on point dipoles: points (n, 3) m, moments (n, 3) A·m² → (n, 3) N.

    F = 3μ0/(4π d⁵) · [(μ1·d) μ2 + (μ2·d) μ1 + (μ1·μ2) d − 5 (μ1·d)(μ2·d) d/d²], d = r2 − r1
    (paper Section III-A), summed over the cloud.
    """
    points = points_array("points", points, "m")
    moments = _moments_like(points, moments)
    return np.einsum("nij,nj->ni", field_gradient(cloud, points), moments)


def torque(cloud: DipoleCloud, points: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Torque of `cloud` on point dipoles, τ = μ × B: points (n, 3) m, moments (n, 3) A·m² → (n, 3) N·m."""
    points = points_array("points", points, "m")
    return np.cross(_moments_like(points, moments), field(cloud, points))


def _moments_like(points: np.ndarray, moments: np.ndarray) -> np.ndarray:
    moments = points_array("moments", moments, "A·m²")
    if moments.shape != points.shape:
        raise ValueError(f"moments must have the shape of points {points.shape}, got {moments.shape}")
    return moments


def _separations(cloud: DipoleCloud, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    d = points[:, None, :] - cloud.positions[None, :, :]
    r2 = np.einsum("nkj,nkj->nk", d, d)
    if r2.size and r2.min() == 0.0:
        raise ValueError("points must not coincide with a dipole of the cloud, where its field is infinite")
    return d, r2


def _chunks(n_points: int, n_dipoles: int) -> list[slice]:
    step = max(1, _PAIRS_AT_ONCE // max(1, n_dipoles))
    return [slice(i, min(i + step, n_points)) for i in range(0, n_points, step)]
