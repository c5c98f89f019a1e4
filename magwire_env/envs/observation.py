"""Observation channels: what a policy may see, by name, each with its scale and its bounds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from gymnasium.spaces import Box

from ..quasistatic.preview import DrivePreview
from ..quasistatic.sight import SightPreview
from ..simulation import Simulator
from ..simulation.lanes import LANES
from ..simulation.readout import ROW
from . import kernels
from .channel import (
    FORCE_SCALE,
    LENGTH_SCALE,
    SPEED_SCALE,
    TORQUE_SCALE,
    WALL_SCALE,
    Channel,
    Number,
    Reader,
    always,
    rows_of,
)
from .fluoroscopy import FLUOROSCOPY
from .route_channels import ROUTE_CHANNELS

if TYPE_CHECKING:
    from .episodes import Episodes

__all__ = ["CHANNELS", "Channel", "Number", "Observer", "Reader", "register_channel"]

PREVIEW_OFFSETS = (0.0, 0.01, 0.02, 0.04, 0.06, 0.08)
"""m ahead of the tip at which `tract_preview` looks."""

CLOSE_SCALES = (5e-3, 0.02, 0.1)
"""m; `goal_close` is finest within these."""

REFERENCE_OFFSETS = (0.0, 0.5, 1.0, 2.0)
"""s ahead at which `reference_preview` looks."""


def _of_route(sim: Simulator, kind: int) -> Sequence[Number]:
    """One length over the route's."""
    return [Number(kind, scale=0.0, quantity="length")]


def _magnet(sim: Simulator) -> Sequence[Number]:
    """sin and cos of every turn from its home; every slide over its range, in [−1, 1]."""
    numbers = []
    for dof, (turn, name) in enumerate(zip(sim.library.is_turn, sim.library.scenarios[0].rig.names, strict=True)):
        if turn:
            numbers.append(Number(kernels.SINE, dof, quantity="angle", label=f"sin of the {name} from home"))
            numbers.append(Number(kernels.COSINE, dof, quantity="angle", label=f"cos of the {name} from home"))
        else:
            numbers.append(Number(kernels.SLIDE, dof, quantity="angle", label=f"{name} over its range"))
    return numbers


def _magnet_speeds(sim: Simulator) -> Sequence[Number]:
    return [Number()] * sim.dof


def _turned(sim: Simulator, episodes: Episodes) -> np.ndarray:
    return episodes.turned


def _preview_numbers(sim: Simulator) -> Sequence[Number]:
    """The points suffer the reading's error, the tangents do not."""
    count = 3 * len(PREVIEW_OFFSETS)
    return [Number(scale=LENGTH_SCALE, quantity="length")] * count + [Number()] * count


def _preview(sim: Simulator, episodes: Episodes) -> np.ndarray:
    """From the first magnet's centre; from the world's origin where the rig has coils alone."""
    magnets = sim.magnet_positions
    centre = np.ascontiguousarray(magnets[:, 0]) if magnets.shape[1] else np.zeros((sim.num_envs, 3))
    seen = np.empty((sim.num_envs, 6 * len(PREVIEW_OFFSETS)))
    kernels.previewed(sim.model.ahead(np.array(PREVIEW_OFFSETS)), centre, LENGTH_SCALE, seen)
    return seen


def _drives(sim: Simulator) -> Sequence[Number]:
    return [Number(scale=FORCE_SCALE, quantity="force")] * (len(PREVIEW_OFFSETS) * (1 + sim.dof))


class _DriveReader:
    """`DrivePreview` over the force scale."""

    def __init__(self, sim: Simulator) -> None:
        reach = np.where(sim.library.is_turn, 1.0, LENGTH_SCALE)
        self._preview = DrivePreview(sim, np.array(PREVIEW_OFFSETS), reach)

    def __call__(self, sim: Simulator, episodes: Episodes) -> np.ndarray:
        return self._preview.read() / FORCE_SCALE


def _sights(sim: Simulator) -> Sequence[Number]:
    return [Number(quantity="length")] * SightPreview(sim, np.array(PREVIEW_OFFSETS), LENGTH_SCALE).size


class _SightReader:
    """`SightPreview` over the length scale."""

    def __init__(self, sim: Simulator) -> None:
        self._preview = SightPreview(sim, np.array(PREVIEW_OFFSETS), LENGTH_SCALE)

    def __call__(self, sim: Simulator, episodes: Episodes) -> np.ndarray:
        return self._preview.read()


def _reference_numbers(sim: Simulator) -> Sequence[Number]:
    return [Number(scale=LENGTH_SCALE, quantity="length")] * len(REFERENCE_OFFSETS)


def _reference(sim: Simulator, episodes: Episodes) -> np.ndarray:
    return (episodes.reference_ahead(np.array(REFERENCE_OFFSETS)) - sim.travelled[:, None]) / LENGTH_SCALE


def _close_numbers(sim: Simulator) -> Sequence[Number]:
    return [Number(quantity="length", label=f"way left / {1e3 * scale:g} mm, through tanh") for scale in CLOSE_SCALES]


def _close(sim: Simulator, episodes: Episodes) -> np.ndarray:
    return np.tanh(sim.remaining[:, None] / np.array(CLOSE_SCALES))


CHANNELS: dict[str, Channel] = {
    "tip_arclength": Channel(2, "tip arc length / tract length", partial(_of_route, kind=kernels.TRAVELLED)),
    "tip_speed": Channel(10, "tip speed along the tract / 0.1 m/s", rows_of(ROW.speed, SPEED_SCALE, "speed")),
    "drive_force": Channel(10, "drive along the tract / 10 mN", rows_of(ROW.drive, FORCE_SCALE, "force")),
    "lateral_force": Channel(10, "magnetic force across the tract / 10 mN", rows_of(ROW.lateral, FORCE_SCALE, "force")),
    "magnet": Channel(1, "each turn's angle from home (sin, cos); each slide over its range", _magnet),
    "magnet_speed": Channel(
        1, "how far each degree of freedom moved in the last control period / what its servo covers in one",
        _magnet_speeds, always(_turned), watches_rig=True,
    ),
    "distance_left": Channel(
        2, "way left to the goal / length of the tract (in a tree, of the way from the inlet to the target's end)",
        partial(_of_route, kind=kernels.DISTANCE_LEFT),
    ),
    "tip_force": Channel(10, "magnetic force on the tip, x y z / 10 mN", rows_of(ROW.force_x, FORCE_SCALE, "force", 3)),
    "tip_torque": Channel(10, "magnetic torque on the tip / 1 mN·m", rows_of(ROW.torque, TORQUE_SCALE, "torque")),
    "wall_force": Channel(10, "force on the wall / 0.1 N", rows_of(ROW.wall, WALL_SCALE, "force")),
    "tip_position": Channel(10, "tip, x y z / 0.1 m", rows_of(ROW.tip_x, LENGTH_SCALE, "length", 3)),
    "tip_tangent": Channel(1, "direction of the tip's moment", rows_of(ROW.tangent_x, 1.0, "", 3)),
    "goal_close": Channel(
        1, "way left to the goal / 5, 20 and 100 mm, each through tanh: fine where the goal is close",
        _close_numbers, always(_close),
    ),
    "tract_preview": Channel(
        10, "centreline 0, 10, 20, 40, 60, 80 mm ahead of the tip: points from the first magnet's centre / 0.1 m, "
        "then tangents",
        _preview_numbers, always(_preview),
    ),
    "magnet_preview": Channel(
        10, "how every magnet stands to the centreline 0, 10, 20, 40, 60, 80 mm ahead of the tip, without force: the "
        "line from it (in place of its second number the distance / 0.1 m), its moment's direction, what a radian of "
        "each turn adds to that, and the axis of each slide, along tangent, line and curvature vector · 0.1 m",
        _sights, _SightReader,
    ),
    "drive_preview": Channel(
        10, "drive 0, 10, 20, 40, 60, 80 mm ahead of the tip / 10 mN, each followed by its slope by every degree of "
        "freedom, a radian or 0.1 m; the magnets as point dipoles where they now are, coils left out",
        _drives, _DriveReader, needs="quasistatic",
    ),
    "reference_preview": Channel(
        10, "a tracking task's reference now, in 0.5, 1 and 2 s, from the tip / 0.1 m",
        _reference_numbers, always(_reference), follows=True,
    ),
    **ROUTE_CHANNELS,
}  # fmt: skip


def register_channel(name: str, size: int, read: Reader, bound: float = 10.0, text: str = "") -> None:
    """Make an observation channel of your own known; `observe=("tip_speed", name)` then asks for it.

    size : how many numbers it has
    read : (simulator, episodes) → (n, size), already scaled, after every reset and step
    bound : its numbers are clipped to [−bound, bound]

    Raises `ValueError` for a name that exists.

    >>> import gymnasium as gym, magwire_env
    >>> from magwire_env.envs.observation import register_channel
    >>> register_channel("field", 3, lambda sim, episodes: sim.tip_field / 10e-3, text="field at the tip / 10 mT")
    >>> gym.make("MagWire/Steer-v0", observe=("magnet", "field")).observation_space.shape
    (5,)
    """
    if name in CHANNELS or name == FLUOROSCOPY:
        raise ValueError(f"name must be of a channel that does not exist yet, got {name!r}")
    if isinstance(size, bool) or not isinstance(size, int) or size < 1:
        raise ValueError(f"size must be a whole number of at least 1, got {size!r}")
    CHANNELS[name] = Channel(bound, text or name, partial(_numbers_of_own, size=size), always(read))


def _numbers_of_own(sim: Simulator, size: int) -> Sequence[Number]:
    return [Number()] * size


class Observer:
    """Concatenates channels into one float32 array.

    alone : there is no image beside the numbers, so there must be some
    numbers : what stands in each column

    Raises `ValueError` for a channel that does not exist or that this env cannot show, or none at all.
    """

    def __init__(self, sim: Simulator, episodes: Episodes, names: Sequence[str], alone: bool = True) -> None:
        names = tuple(names)
        unknown = [n for n in names if n not in CHANNELS]
        if unknown or (alone and not names) or len(set(names)) != len(names):
            got = repr(unknown[0]) if unknown else repr(names)
            known = ", ".join((*CHANNELS, FLUOROSCOPY))
            raise ValueError(f"observe must name different channels of {known}; got {got}")
        self.names = names
        self._sim, self._episodes = sim, episodes
        self._parts: dict[str, slice] = {}
        self._others: list[tuple[str, Reader]] = []
        numbers: list[Number] = []
        for name in names:
            channel = CHANNELS[name]
            channel.check(name, sim, episodes)
            own = channel.numbers(sim)
            self._parts[name] = slice(len(numbers), len(numbers) + len(own))
            numbers += own
            if channel.reader is not None:
                self._others.append((name, channel.reader(sim)))
        if names and not numbers:
            raise ValueError(f"observe must show a number; with this rig {', '.join(names)} shows none")
        self.numbers: tuple[Number, ...] = tuple(numbers)
        self._kinds, self._rows = np.array([(x.kind, x.row) for x in numbers], dtype=np.int64).reshape(-1, 2).T.copy()
        self._scales = np.array([x.scale or 1.0 for x in numbers])
        self._bounds = np.empty(len(numbers))
        for name, part in self._parts.items():
            self._bounds[part] = CHANNELS[name].bound
        self._work = np.empty(LANES)
        bound = self._bounds.astype(np.float32)
        self.space = Box(-bound, bound, dtype=np.float32)

    def part(self, name: str) -> slice:
        """Where a channel stands in the observation; `ValueError` if it is not observed."""
        if name not in self._parts:
            raise ValueError(f"observe must include {name!r} here, got {self.names}")
        return self._parts[name]

    def read(self) -> np.ndarray:
        """The observation of every lane, (n, size) float32."""
        sim, n = self._sim, self._sim.num_envs
        out = np.empty((n, len(self._kinds)), dtype=np.float32)
        kernels.observe(
            n, self._kinds, self._rows, self._scales, self._bounds, sim.readout, sim.rig.q, sim.rig.limits,
            self._episodes.lanes, self._work, out,
        )  # fmt: skip
        for name, read in self._others:
            part = self._parts[name]
            values = np.asarray(read(sim, self._episodes))
            if values.shape != (n, part.stop - part.start):
                raise ValueError(
                    f"channel {name!r} must give {(n, part.stop - part.start)} numbers, got {values.shape}"
                )
            if np.isnan(values).any():
                raise ValueError(f"channel {name!r} must give numbers, got NaN")
            bound = self._bounds[part]
            out[:, part] = np.clip(values, -bound, bound)
        return out
