"""The base of a free wire: how it is fed into the lumen, and turned."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..physics.ranges import ranged

__all__ = ["Feed", "Twist"]


@dataclass(frozen=True)
class Feed:
    """A drive that pushes the wire out of a straight frictionless sleeve at the inlet, as one degree of freedom.

    speed : m/s at most
    low, high : m of wire inside the lumen, the command's limits; by default (None) `high` is the wire's length, and
        `low` the three segments that the sleeve cannot take in
    home : m, at rest and at an episode's start; by default `low`, at least 20 mm
    force : N, the drive's largest push or pull; it gives way beyond
    """

    speed: float = 0.03
    low: float | None = None
    high: float | None = None
    home: float | None = None
    force: float = 5.0

    def __post_init__(self) -> None:
        for name in ("speed", "force", "low", "high", "home"):
            if getattr(self, name) is not None or name in ("speed", "force"):
                object.__setattr__(self, name, ranged(f"Feed.{name}", getattr(self, name)))

    @property
    def axis(self) -> str:
        """As other degrees of freedom have one."""
        return "feed"

    def within(self, length: float, segment: float) -> Feed:
        """With every limit filled in for a wire of `length` m, its segments of `segment` m. Refuses impossible ones."""
        least = 3.0 * segment
        low = least if self.low is None else self.low
        high = length if self.high is None else self.high
        home = min(max(low, 20e-3), high) if self.home is None else self.home
        if not least * (1 - 1e-9) <= low < high <= length * (1 + 1e-9):
            raise ValueError(
                f"Feed.low and Feed.high must lie in [{least:.4g}, {length:.4g}] (in m: three segments, the wire), "
                f"low below high, got {low:.4g} and {high:.4g}"
            )
        if not low <= home <= high:
            raise ValueError(f"Feed.home must lie in [{low:.4g}, {high:.4g}] (in m), got {home:.4g}")
        return Feed(self.speed, low, high, home, self.force)


@dataclass(frozen=True)
class Twist:
    """A drive that turns the wire's base about the inlet's axis, as one degree of freedom; whole turns count.

    low, high : rad, the command's limits
    home : rad, at rest
    speed : rad/s at most
    """

    low: float = -4 * math.pi
    high: float = 4 * math.pi
    home: float = 0.0
    speed: float = 2 * math.pi

    def __post_init__(self) -> None:
        for name in ("low", "high", "home", "speed"):
            object.__setattr__(self, name, ranged(f"Twist.{name}", getattr(self, name)))
        if not self.low <= self.home <= self.high or self.low == self.high:
            raise ValueError(f"Twist.home must lie in [low, high] with low < high (in rad), got {self}")

    @property
    def axis(self) -> str:
        """As other degrees of freedom have one."""
        return "twist"
