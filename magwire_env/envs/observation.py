"""Observation channels: what a policy may see, by name, each with its scale and its bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from gymnasium.spaces import Box

from ..simulation import Simulator
from ..simulation.lanes import LANES
from ..simulation.locked.algorithm1 import OUT_FIELDS
from . import kernels

if TYPE_CHECKING:
    from .core import SteeringCore

__all__ = ["CHANNELS", "DEFAULT", "Observer"]

FORCE_SCALE = 10e-3
SPEED_SCALE = 0.1
TORQUE_SCALE = 1e-3
WALL_SCALE = 0.1
LENGTH_SCALE = 0.1
PREVIEW_OFFSETS = (0.0, 0.01, 0.02, 0.04, 0.06, 0.08)
"""m ahead of the tip at which `tract_preview` looks."""

REFERENCE_OFFSETS = (0.0, 0.5, 1.0, 2.0)
"""s ahead at which `reference_preview` looks."""


@dataclass(frozen=True)
class Number:
    """One number of the observation, as `kernels.observe` fills it in.

    kind : of `kernels`
    row : which of the simulator's results (for ``RESULT``), or which degree of freedom
    scale : what a result is divided by; 0 for the tract's length
    quantity : of `Sensing`, whose errors it suffers; empty for none
    """

    kind: int
    row: int = 0
    scale: float = 1.0
    quantity: str = ""


@dataclass(frozen=True)
class Channel:
    """A named part of the observation.

    bound : its numbers lie in [−bound, bound]; values beyond are clipped
    text : what it is, with its scale
    numbers : simulator → its numbers
    read : for a channel that no kernel fills in, the core → (n, size), already scaled
    """

    bound: float
    text: str
    numbers: Callable[[Simulator], Sequence[Number]]
    read: Callable[[SteeringCore], np.ndarray] | None = None


def _results(name: str, scale: float, quantity: str, count: int = 1) -> Callable[[Simulator], Sequence[Number]]:
    """`count` of the simulator's results from the one of this name on, over `scale`."""
    first = OUT_FIELDS.index(name)
    return lambda _: [Number(kernels.RESULT, first + i, scale, quantity) for i in range(count)]


def _length(kind: int) -> Callable[[Simulator], Sequence[Number]]:
    """One length over the tract's."""
    return lambda _: [Number(kind, scale=0.0, quantity="length")]


def _elsewhere(points: int, others: int, scale: float) -> Callable[[Simulator], Sequence[Number]]:
    """Lengths over `scale`, then numbers without a reading's error, that no kernel fills in."""
    numbers = [Number(-1, scale=scale, quantity="length")] * points + [Number(-1)] * others
    return lambda _: numbers


def _magnet(sim: Simulator) -> Sequence[Number]:
    """sin and cos of every turn from its home; every slide over its range, in [−1, 1]."""
    numbers = []
    for dof, turn in enumerate(sim.library.is_turn):
        kinds = (kernels.SINE, kernels.COSINE) if turn else (kernels.SLIDE,)
        numbers += [Number(kind, dof, quantity="angle") for kind in kinds]
    return numbers


def _preview(core: SteeringCore) -> np.ndarray:
    sim = core.sim
    magnets = sim.magnet_positions
    centre = magnets[:, 0].copy() if magnets.shape[1] else np.zeros((sim.num_envs, 3))
    seen = np.empty((sim.num_envs, 6 * len(PREVIEW_OFFSETS)))
    kernels.preview(
        np.array(PREVIEW_OFFSETS), sim.arrays.par, sim.tip_arclength, sim.library.table, centre, LENGTH_SCALE, seen
    )
    return seen


def _drives(sim: Simulator) -> Sequence[Number]:
    return [Number(-1, scale=FORCE_SCALE, quantity="force")] * (len(PREVIEW_OFFSETS) * (1 + sim.dof))


def _drive_preview(core: SteeringCore) -> np.ndarray:
    sim = core.sim
    library = sim.library
    count = library.magnet_count
    seen = np.empty((sim.num_envs, len(PREVIEW_OFFSETS) * (1 + sim.dof)))
    magnets = np.ascontiguousarray(library.magnets[sim.lane_scenario, :count, :4])
    kernels.drive_preview(
        np.array(PREVIEW_OFFSETS), sim.arrays.par, sim.tip_arclength, library.table, library.rig[:count], magnets,
        sim.arrays.q, np.where(library.is_turn, 1.0, LENGTH_SCALE), seen,
    )  # fmt: skip
    return seen / FORCE_SCALE


def _reference(core: SteeringCore) -> np.ndarray:
    return (core.reference_ahead(REFERENCE_OFFSETS) - core.sim.tip_arclength[:, None]) / LENGTH_SCALE


CHANNELS: dict[str, Channel] = {
    "tip_arclength": Channel(2, "tip arc length / tract length", _length(kernels.ARCLENGTH)),
    "tip_speed": Channel(10, "tip speed along the tract / 0.1 m/s", _results("TIP_V", SPEED_SCALE, "speed")),
    "drive_force": Channel(10, "drive along the tract / 10 mN", _results("DRIVE", FORCE_SCALE, "force")),
    "lateral_force": Channel(10, "magnetic force across the tract / 10 mN", _results("LATERAL", FORCE_SCALE, "force")),
    "magnet": Channel(1, "each turn's angle from home (sin, cos); each slide over its range", _magnet),
    "magnet_speed": Channel(
        1, "how far each degree of freedom moved in the last control period / what its servo covers in one",
        lambda sim: [Number(-1)] * sim.dof, lambda core: cast(np.ndarray, core.turning),
    ),
    "distance_left": Channel(2, "way left to the goal / tract length", _length(kernels.DISTANCE_LEFT)),
    "tip_force": Channel(10, "magnetic force on the tip, x y z / 10 mN", _results("FX", FORCE_SCALE, "force", 3)),
    "tip_torque": Channel(10, "magnetic torque on the tip / 1 mN·m", _results("TORQUE", TORQUE_SCALE, "torque")),
    "wall_force": Channel(10, "force on the wall / 0.1 N", _results("WALL", WALL_SCALE, "force")),
    "tip_position": Channel(10, "tip, x y z / 0.1 m", _results("TIP_X", LENGTH_SCALE, "length", 3)),
    "tip_tangent": Channel(1, "direction of the tip's moment", _results("TAN_X", 1.0, "", 3)),
    "tract_preview": Channel(
        10, "centreline 0, 10, 20, 40, 60, 80 mm ahead of the tip: points from the first magnet's centre / 0.1 m, "
        "then tangents",
        _elsewhere(3 * len(PREVIEW_OFFSETS), 3 * len(PREVIEW_OFFSETS), LENGTH_SCALE), _preview,
    ),
    "drive_preview": Channel(
        10, "drive 0, 10, 20, 40, 60, 80 mm ahead of the tip / 10 mN, each followed by its slope by every degree of "
        "freedom, a radian or 0.1 m; the magnets as point dipoles where they now are, coils left out",
        _drives, _drive_preview,
    ),
    "reference_preview": Channel(
        10, "a tracking task's reference now, in 0.5, 1 and 2 s, from the tip / 0.1 m",
        _elsewhere(len(REFERENCE_OFFSETS), 0, LENGTH_SCALE), _reference,
    ),
}  # fmt: skip

DEFAULT = ("tip_arclength", "tip_speed", "drive_force", "lateral_force", "magnet", "distance_left")


class Observer:
    """Concatenates channels into one float32 array.

    numbers : what stands in each column

    Raises `ValueError` for a channel that does not exist, or none at all.
    """

    def __init__(self, core: SteeringCore, names: Sequence[str] = DEFAULT) -> None:
        sim = core.sim
        names = (names,) if isinstance(names, str) else tuple(names)
        unknown = [n for n in names if n not in CHANNELS]
        if unknown or not names or len(set(names)) != len(names):
            got = repr(unknown[0]) if unknown else repr(names)
            raise ValueError(f"observe must name different channels of {', '.join(CHANNELS)}; got {got}")
        self.names = names
        self._core = core
        self._parts: list[tuple[Channel, slice]] = []
        numbers: list[Number] = []
        for channel in (CHANNELS[n] for n in names):
            own = channel.numbers(sim)
            self._parts.append((channel, slice(len(numbers), len(numbers) + len(own))))
            numbers += own
        self.numbers: tuple[Number, ...] = tuple(numbers)
        self._kinds, self._rows = np.array([(x.kind, x.row) for x in numbers], dtype=np.int64).T.copy()
        self._scales = np.array([x.scale or 1.0 for x in numbers])
        self._bounds = np.concatenate([np.full(p.stop - p.start, float(c.bound)) for c, p in self._parts])
        self._others = [(c.read, part) for c, part in self._parts if c.read is not None]
        self._work = np.empty(LANES)
        bound = self._bounds.astype(np.float32)
        self.space = Box(-bound, bound, dtype=np.float32)

    def part(self, name: str) -> slice:
        """Where a channel stands in the observation; `ValueError` if it is not observed."""
        if name not in self.names:
            raise ValueError(f"observe must include {name!r} here, got {self.names}")
        return self._parts[self.names.index(name)][1]

    def read(self, lanes: np.ndarray) -> np.ndarray:
        """The observation of every lane, (n, size) float32; `lanes` is what the core keeps of them, see `kernels`."""
        sim = self._core.sim
        arrays, n = sim.arrays, sim.num_envs
        out = np.empty((n, len(self._kinds)), dtype=np.float32)
        kernels.observe(
            n, self._kinds, self._rows, self._scales, self._bounds, arrays.out, arrays.q, arrays.dofs, lanes,
            self._work, out,
        )  # fmt: skip
        for read, part in self._others:
            bound = self._bounds[part]
            out[:, part] = np.clip(read(self._core), -bound, bound)
        return out
