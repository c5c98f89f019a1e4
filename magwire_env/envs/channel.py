"""What an observation channel is, and the scales that channels share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..simulation import Simulator
from ..simulation.model import require
from . import kernels

if TYPE_CHECKING:
    from .episodes import Episodes

__all__ = [
    "FORCE_SCALE", "LENGTH_SCALE", "SPEED_SCALE", "TORQUE_SCALE", "WALL_SCALE", "Channel", "Number", "Reader", "always",
    "rows_of",
]  # fmt: skip

FORCE_SCALE = 10e-3
SPEED_SCALE = 0.1
TORQUE_SCALE = 1e-3
WALL_SCALE = 0.1
LENGTH_SCALE = 0.1

_ELSEWHERE = -1
"""Kind of a number that no kernel fills in: the channel's reader does."""

Reader = Callable[[Simulator, "Episodes"], np.ndarray]
"""(n, size), already scaled."""


@dataclass(frozen=True)
class Number:
    """One number of the observation, as `kernels.observe` fills it in.

    kind : of `kernels`, or `_ELSEWHERE`
    row : which row of the readout (for ``RESULT``), or which degree of freedom
    scale : what a result is divided by; 0 for the route's length
    quantity : of `Sensing`, whose errors it suffers; empty for none
    label : for people, where the numbers of a channel differ
    """

    kind: int = _ELSEWHERE
    row: int = 0
    scale: float = 1.0
    quantity: str = ""
    label: str = ""


@dataclass(frozen=True)
class Channel:
    """A named part of the observation.

    bound : its numbers lie in [−bound, bound]; values beyond are clipped
    text : what it is, with its scale
    numbers : simulator → its numbers
    reader : for numbers that no kernel fills in: simulator → `Reader`
    watches_rig : it needs `Episodes.turned`
    needs : of `magwire_env.simulation.model.FEATURES`, what the wire model must have; empty for none
    follows : it needs a task that follows a reference
    """

    bound: float
    text: str
    numbers: Callable[[Simulator], Sequence[Number]]
    reader: Callable[[Simulator], Reader] | None = None
    watches_rig: bool = False
    needs: str = ""
    follows: bool = False

    def check(self, name: str, sim: Simulator, episodes: Episodes) -> None:
        """Raise `ValueError` if an env with this simulator and task cannot show it."""
        if self.needs:
            require(sim.library.scenarios[0], self.needs, f"observe: {name!r}")
        if self.follows and not episodes.task.kind.follows:
            raise ValueError(f"observe: {name!r} needs a task that follows a reference, got {episodes.task.id}")


def _results(sim: Simulator, row: int, scale: float, quantity: str, count: int = 1) -> Sequence[Number]:
    """`count` rows of the readout from `row` on, over `scale`."""
    return [Number(kernels.RESULT, row + i, scale, quantity) for i in range(count)]


def always(reader: Reader) -> Callable[[Simulator], Reader]:
    """A reader that needs no preparation."""
    return partial(_given, reader)


def _given(reader: Reader, sim: Simulator) -> Reader:
    return reader


def rows_of(row: int, scale: float, quantity: str, count: int = 1) -> Callable[[Simulator], Sequence[Number]]:
    """The numbers of a channel that shows `count` rows of the readout from `row` on, over `scale`."""
    return partial(_results, row=row, scale=scale, quantity=quantity, count=count)
