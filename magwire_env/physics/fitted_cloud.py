"""A few dipoles whose field outside a cuboid magnet is the magnet's own, by least squares on the field's gradient.

Outside a uniformly magnetised body the field depends only on the body's harmonic moments, and few well-placed dipoles
share the leading ones; Gauss points spend most of their freedom on moments that the field does not see. Worst error
of the force in any direction, for the paper's 50.8 mm cube, by distance from its centre:

| cloud | 6 cm | 6.5 cm | 7 cm | 9.5 cm | 15 cm |
|---|---|---|---|---|---|
| 9 fitted | 4.5 % | 2.1 % | 1.1 % | 0.10 % | 0.013 % |
| 21 fitted | 0.74 % | 0.24 % | 0.092 % | 0.005 % | 0.0008 % |
| 27 Gauss | 5.5 % | 2.8 % | 1.6 % | 0.12 % | 0.005 % |
| 64 Gauss | 1.6 % | 0.53 % | 0.20 % | 0.005 % | 1e-6 |
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .dipoles import DipoleCloud, field_gradient

__all__ = ["SIZES", "fitted_points"]

SIZES = (9, 21)
"""Dipoles of a fitted cloud: the centre and 8 points towards the corners, or also 12 towards the edges' middles."""

_FIT_DISTANCE = 1.5
"""Where the field is fitted, over the distance of a corner; closer it is worse, farther it only gets better."""

_CORNERS = np.array([[i, j, k] for i in (-1.0, 1.0) for j in (-1.0, 1.0) for k in (-1.0, 1.0)])
_EDGES = [np.insert([[i, j] for i in (-1.0, 1.0) for j in (-1.0, 1.0)], axis, 0.0, axis=1) for axis in range(3)]

# A cube's fit, from which others start: the first orbit's x, y, z in half edges, its weight, then each next orbit's.
_START = {
    9: (0.499, 0.499, 0.499, 0.132),
    21: (0.689, 0.689, 0.689, 0.031, 0.785, 0.787, 0.0141, 0.785, 0.787, 0.0141, 0.78, 0.78, 0.0145),
}


@lru_cache(maxsize=64)
def fitted_points(half: tuple[float, float, float], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) in units of the half edges, and shares of the moment (n,), which sum to 1.

    half : half edges along x, y, z, the magnetisation along z; only their ratios matter
    n : one of `SIZES`

    Gauss–Newton with a damping that only a step uphill raises.
    """
    size = np.asarray(half) / np.linalg.norm(half)
    k = np.arange(80) + 0.5
    z, turn = 1 - k / 80, np.pi * (1 + 5**0.5) * k  # one octant will do: cloud and magnet are symmetric
    r = np.sqrt(1 - z**2)
    places = _FIT_DISTANCE * np.abs(np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1))
    x, w = np.polynomial.legendre.leggauss(10)
    grid = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3)
    exact = _gradient(grid, np.einsum("i,j,k->ijk", w, w, w).ravel() / 8, size, places)
    scale = 1 / np.linalg.norm(exact, axis=1, keepdims=True)

    def miss(unknowns: np.ndarray) -> np.ndarray:
        return ((_gradient(*_cloud(unknowns), size, places) - exact) * scale).ravel()

    unknowns = np.array(_START[n])
    error, damping, nudge = miss(unknowns), 1e-6, 1e-6
    for _ in range(20):
        slopes = np.stack([(miss(unknowns + e) - error) / nudge for e in nudge * np.eye(len(unknowns))], axis=1)
        step = np.linalg.solve(slopes.T @ slopes + damping**2 * np.eye(len(unknowns)), -slopes.T @ error)
        tried = miss(unknowns + step)
        if tried @ tried >= error @ error:
            damping *= 10
            continue
        gain = 1 - (tried @ tried) / (error @ error)
        unknowns, error, damping = unknowns + step, tried, 0.3 * damping
        if gain < 1e-3:
            break
    positions, shares = _cloud(unknowns)
    positions.flags.writeable = shares.flags.writeable = False
    return positions, shares


def _cloud(unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The orbits' points and weights, and the centre with what is left of the moment."""
    points, shares, at = [], [], 0
    for orbit in (_CORNERS, *_EDGES) if len(unknowns) > 4 else (_CORNERS,):
        axes = np.flatnonzero(orbit[0])
        moved = orbit.copy()
        moved[:, axes] *= unknowns[at : at + len(axes)]
        at += len(axes) + 1
        points.append(moved)
        shares.append(np.full(len(orbit), unknowns[at - 1]))
    share = np.concatenate(shares)
    return np.vstack([*points, np.zeros((1, 3))]), np.append(share, 1 - share.sum())


def _gradient(positions: np.ndarray, shares: np.ndarray, size: np.ndarray, places: np.ndarray) -> np.ndarray:
    moments = np.zeros_like(positions)
    moments[:, 2] = shares
    return field_gradient(DipoleCloud(positions * size, moments), places).reshape(len(places), 9)
