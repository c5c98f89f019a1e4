"""Observation channels: what a policy may see, by name, each with its scale and its bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box

from ..simulation import Simulator

__all__ = ["CHANNELS", "DEFAULT", "Observer"]

FORCE_SCALE = 10e-3
SPEED_SCALE = 0.1
TORQUE_SCALE = 1e-3
WALL_SCALE = 0.1
LENGTH_SCALE = 0.1
PREVIEW_OFFSETS = (0.0, 0.01, 0.02, 0.04, 0.06, 0.08)
"""m ahead of the tip at which `tract_preview` looks."""


@dataclass(frozen=True)
class Channel:
    """A named part of the observation.

    size : numbers, given the simulator
    bound : they lie in [−bound, bound]; values beyond are clipped
    read : simulator, goal (n,) m → (n,) or (n, size), already scaled
    text : what it is, with its scale
    """

    size: Callable[[Simulator], int]
    bound: float
    read: Callable[[Simulator, np.ndarray], np.ndarray]
    text: str


def _one(_: Simulator) -> int:
    return 1


def _three(_: Simulator) -> int:
    return 3


def _angles(sim: Simulator, _: np.ndarray) -> np.ndarray:
    """sin and cos of every turn from its home; every slide over its range, in [−1, 1]."""
    q, rows = sim.magnet, sim.library.dofs[sim.lane_scenario]
    columns = []
    for i, turn in enumerate(sim.library.is_turn):
        share = (2 * q[:, i] - rows[:, i, 1] - rows[:, i, 2]) / (rows[:, i, 2] - rows[:, i, 1])
        columns += [np.sin(np.pi * share), np.cos(np.pi * share)] if turn else [share]
    return np.stack(columns, axis=1)


def _angles_size(sim: Simulator) -> int:
    return sim.dof + int(sim.library.is_turn.sum())


def _preview(sim: Simulator, _: np.ndarray) -> np.ndarray:
    points, tangents = sim.look_ahead(np.array(PREVIEW_OFFSETS))
    seen = points - sim.magnet_positions[:, :1]
    return np.concatenate([seen.reshape(len(seen), -1) / LENGTH_SCALE, tangents.reshape(len(seen), -1)], axis=1)


def _length(sim: Simulator) -> np.ndarray:
    return sim.library.tract_length[sim.lane_scenario]


CHANNELS: dict[str, Channel] = {
    "tip_arclength": Channel(_one, 2, lambda sim, goal: sim.tip_arclength / _length(sim), "tip arc length / tract length"),
    "tip_speed": Channel(_one, 10, lambda sim, goal: sim.tip_velocity / SPEED_SCALE, "tip speed along the tract / 0.1 m/s"),
    "drive_force": Channel(_one, 10, lambda sim, goal: sim.drive_force / FORCE_SCALE, "drive along the tract / 10 mN"),
    "lateral_force": Channel(_one, 10, lambda sim, goal: sim.lateral_force / FORCE_SCALE, "magnetic force across the tract / 10 mN"),
    "magnet": Channel(_angles_size, 1, _angles, "each turn's angle from home (sin, cos); each slide over its range"),
    "distance_left": Channel(_one, 2, lambda sim, goal: sim.distance_to(goal) / _length(sim), "way left to the goal / tract length"),
    "tip_force": Channel(_three, 10, lambda sim, goal: sim.tip_force / FORCE_SCALE, "magnetic force on the tip, x y z / 10 mN"),
    "tip_torque": Channel(_one, 10, lambda sim, goal: sim.tip_torque / TORQUE_SCALE, "magnetic torque on the tip / 1 mN·m"),
    "wall_force": Channel(_one, 10, lambda sim, goal: sim.wall_force / WALL_SCALE, "force on the wall / 0.1 N"),
    "tip_position": Channel(_three, 10, lambda sim, goal: sim.tip_position / LENGTH_SCALE, "tip, x y z / 0.1 m"),
    "tip_tangent": Channel(_three, 1, lambda sim, goal: sim.tip_tangent, "direction of the tip's moment"),
    "tract_preview": Channel(
        lambda sim: 6 * len(PREVIEW_OFFSETS), 10, _preview,
        "centreline 0, 10, 20, 40, 60, 80 mm ahead of the tip: points from the first magnet's centre / 0.1 m, then tangents",
    ),
}  # fmt: skip

DEFAULT = ("tip_arclength", "tip_speed", "drive_force", "lateral_force", "magnet", "distance_left")


class Observer:
    """Concatenates channels into one float32 array.

    Raises `ValueError` for a channel that does not exist, or none at all.
    """

    def __init__(self, sim: Simulator, names: Sequence[str] = DEFAULT) -> None:
        names = (names,) if isinstance(names, str) else tuple(names)
        unknown = [n for n in names if n not in CHANNELS]
        if unknown or not names or len(set(names)) != len(names):
            got = repr(unknown[0]) if unknown else repr(names)
            raise ValueError(f"observe must name different channels of {', '.join(CHANNELS)}; got {got}")
        self.names = names
        self._sim = sim
        self._parts: list[tuple[Channel, slice]] = []
        at = 0
        for channel in (CHANNELS[n] for n in names):
            size = channel.size(sim)
            self._parts.append((channel, slice(at, at + size)))
            at += size
        bound = np.concatenate([np.full(part.stop - part.start, c.bound) for c, part in self._parts]).astype(np.float32)
        self.space = Box(-bound, bound, dtype=np.float32)
        self._bound = bound

    def part(self, name: str) -> slice:
        """Where a channel stands in the observation; `ValueError` if it is not observed."""
        if name not in self.names:
            raise ValueError(f"observe must include {name!r} here, got {self.names}")
        return self._parts[self.names.index(name)][1]

    def read(self, goal: np.ndarray) -> np.ndarray:
        """The observation of every lane, (n, size) float32, given the goals (n,) m."""
        out = np.empty((self._sim.num_envs, len(self._bound)), dtype=np.float32)
        for channel, part in self._parts:
            value = channel.read(self._sim, goal)
            out[:, part] = value if value.ndim == 2 else value[:, None]
        return np.clip(out, -self._bound, self._bound, out=out)
