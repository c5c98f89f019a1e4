"""A property along a wire, as a value."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .checks import finite
from .ranges import RANGES

__all__ = ["Profile", "as_profile"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True)
class Profile:
    """A property along a wire: linear between knots, constant beyond them; two knots at one place make a jump.

    at : m from the wire's base, in ascending order, no place more than twice
    values : one a knot, in the property's own unit

    >>> Profile.steps((0.1, 2e-5), (0.03, 1e-6)).value([0.05, 0.12]).tolist()     # a soft tip of 30 mm
    [2e-05, 1e-06]
    """

    at: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        for name, unit in (("at", "m"), ("values", "")):
            given = getattr(self, name)
            if isinstance(given, (str, bytes)) or not isinstance(given, (Sequence, np.ndarray)):
                raise ValueError(f"Profile.{name} must be numbers, got {given!r}")
            object.__setattr__(self, name, tuple(finite(f"Profile.{name}[{i}]", v, unit) for i, v in enumerate(given)))
        if not self.at or len(self.at) != len(self.values):
            raise ValueError(
                f"Profile.values must be one for each of at least one knot, got {len(self.values)} for {len(self.at)}"
            )
        steps = np.diff(self.at)
        if (steps < 0).any() or (len(steps) > 1 and ((steps[1:] == 0) & (steps[:-1] == 0)).any()):
            raise ValueError(f"Profile.at must ascend, with no place more than twice (in m), got {self.at}")

    @classmethod
    def constant(cls, value: float) -> Profile:
        """The same everywhere."""
        return cls((0.0,), (value,))

    @classmethod
    def steps(cls, *pieces: tuple[float, float]) -> Profile:
        """Pieces (length m, value) from the base on, each constant."""
        ends = np.cumsum([length for length, _ in pieces])
        at = [0.0, *np.repeat(ends[:-1], 2), ends[-1]]
        return cls(tuple(map(float, at)), tuple(value for _, value in pieces for _ in range(2)))

    def value(self, s: np.ndarray | Sequence[float] | float) -> np.ndarray:
        """Values at s (...) m; at a jump the one beyond it."""
        s = np.asarray(s, dtype=np.float64)
        i = np.clip(np.searchsorted(self.at, s, side="right"), 1, max(len(self.at) - 1, 1))
        if len(self.at) == 1:
            return np.full(s.shape, self.values[0])
        at, values = np.array(self.at), np.array(self.values)
        span = at[i] - at[i - 1]
        share = np.clip((s - at[i - 1]) / np.where(span > 0, span, 1.0), 0.0, 1.0)
        inside = values[i - 1] + share * (values[i] - values[i - 1])
        return np.where(s >= at[-1], values[-1], inside)

    def mean(self, low: np.ndarray, high: np.ndarray, inverse: bool = False) -> np.ndarray:
        """Means over the intervals from low (n,) to high (n,) m.

        inverse : 1 over the mean of 1/value, which is what springs in series make
        """
        low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        total = np.zeros(low.shape)
        edges = np.array([-np.inf, *np.unique(self.at), np.inf])
        for a, b in itertools.pairwise(edges):
            left, right = np.clip(low, a, b), np.clip(high, a, b)
            half = 0.5 * (right - left)
            places = 0.5 * (left + right)[:, None] + half[:, None] * _NODES
            found = self.value(places)
            total += half * ((1.0 / found if inverse else found) @ _WEIGHTS)
        span = high - low
        return span / total if inverse else total / span

    @property
    def least(self) -> float:
        """The smallest value."""
        return min(self.values)

    @property
    def most(self) -> float:
        """The largest value."""
        return max(self.values)


def as_profile(name: str, value: Any, length: float) -> Profile | None:
    """None, or `value` as a profile along a wire of `length` m: a number is constant along it.

    Raises `ValueError` naming the property, the place and what is allowed: the range of `name` in `ranges.RANGES`.
    """
    if value is None:
        return None
    low, high, unit = RANGES[name]
    profile = value if isinstance(value, Profile) else Profile.constant(finite(name, value, unit))
    for worst in (profile.least, profile.most):
        if not low <= worst <= high:
            raise ValueError(f"{name} must lie in [{low:g}, {high:g}] everywhere (in {unit}), got {worst:g}")
    if profile.at[0] < 0 or profile.at[-1] > length * (1 + 1e-12):
        raise ValueError(
            f"{name} must have its knots in [0, {length:g}] m, along the wire, got them from {profile.at[0]:g} to "
            f"{profile.at[-1]:g} m"
        )
    return profile
