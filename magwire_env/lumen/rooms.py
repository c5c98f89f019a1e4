"""Walls that are closed rooms of a simple shape, for tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..physics.checks import vector

__all__ = ["BoxWall"]


@dataclass(frozen=True)
class BoxWall:
    """The six faces of a box: its lowest and highest corner, m."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            object.__setattr__(self, name, vector(f"BoxWall.{name}", getattr(self, name), 3, "m"))
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"BoxWall.high must exceed low on every axis (in m), got {self.low} and {self.high}")

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The corners, (3,) m each."""
        return np.array(self.low), np.array(self.high)

    def distance(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Exact signed distance, positive inside, and its gradient: (n, 3) m → (n,) m, (n, 3)."""
        low, high = self.bounds
        centre, half = (low + high) / 2, (high - low) / 2
        side = np.where(xyz >= centre, 1.0, -1.0)
        over = np.abs(xyz - centre) - half
        row, axis = np.arange(len(xyz)), over.argmax(axis=1)
        distance, gradient = -over[row, axis], np.zeros_like(xyz)
        gradient[row, axis] = -side[row, axis]
        out = np.flatnonzero(distance < 0.0)
        beyond = np.maximum(over[out], 0.0)
        size = np.linalg.norm(beyond, axis=1)
        distance[out], gradient[out] = -size, -side[out] * beyond / size[:, None]
        return distance, gradient
