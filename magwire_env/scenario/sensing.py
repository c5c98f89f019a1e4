"""Imperfection: what a policy's readings suffer, and what differs from episode to episode.

Both are part of a scenario and draw on the episode's own random stream only, so a seed still gives one trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..physics.ranges import counted, ranged

__all__ = ["Reading", "Sensing", "Variation"]


@dataclass(frozen=True)
class Reading:
    """What one quantity's reading suffers, in the quantity's own unit.

    noise : standard deviation of white noise, drawn afresh every control step
    bias : standard deviation of an offset, drawn once an episode
    step : resolution; the reading is rounded to multiples of it, 0 for none
    """

    noise: float = 0.0
    bias: float = 0.0
    step: float = 0.0

    def __post_init__(self) -> None:
        for name in ("noise", "bias", "step"):
            object.__setattr__(self, name, ranged(f"Reading.{name}", getattr(self, name)))

    def __bool__(self) -> bool:
        return bool(self.noise or self.bias or self.step)


@dataclass(frozen=True)
class Sensing:
    """How well the policy sees.

    length : of arc lengths, positions and ways left, m
    speed : of the tip's speed, m/s
    force : of every force, N
    torque : of the tip's torque, N·m
    angle : of the magnet's angles, rad (of its slides, of their range)
    delay : control steps by which the whole observation is late
    """

    length: Reading = field(default_factory=Reading)
    speed: Reading = field(default_factory=Reading)
    force: Reading = field(default_factory=Reading)
    torque: Reading = field(default_factory=Reading)
    angle: Reading = field(default_factory=Reading)
    delay: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "delay", counted("Sensing.delay", self.delay))

    def __bool__(self) -> bool:
        return bool(self.length or self.speed or self.force or self.torque or self.angle or self.delay)


@dataclass(frozen=True)
class Variation:
    """What is drawn for every episode, uniform about the scenario's own value; the drawn values are in `info`.

    friction : half-width of the coefficient, as a share of it
    stiffness : half-width of both moduli, as a share of them
    remanence : half-width of the external magnets' remanence, as a share of it
    placement : half-width of each coordinate of each magnet's position, m
    """

    friction: float = 0.0
    stiffness: float = 0.0
    remanence: float = 0.0
    placement: float = 0.0

    def __post_init__(self) -> None:
        for name in ("friction", "stiffness", "remanence", "placement"):
            object.__setattr__(self, name, ranged(f"Variation.{name}", getattr(self, name)))

    def __bool__(self) -> bool:
        return bool(self.friction or self.stiffness or self.remanence or self.placement)
