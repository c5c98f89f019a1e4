"""What a policy is shown: numbers by channel, under the errors of their readings, and an image beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Space

from ..simulation import Simulator
from ..words import counted
from .episodes import Episodes
from .fluoroscope import Fluoroscope
from .fluoroscopy import split
from .observation import Observer
from .readings import Readings

__all__ = ["Observation", "Shown", "of_lane"]

Observation = np.ndarray | dict[str, np.ndarray]
"""(n, size) float32; or, with an image, {"image": (n, 1, size, size) uint8, "state": (n, size) float32}, where "state"
is there only if channels are asked for too."""


class Shown:
    """The observations of a batch.

    observer : of the numbers; it has none where an image is all there is
    readings : their errors. The image suffers none of them: its noise is its own
    fluoroscope : takes the images, or None
    space : of one lane's observation
    """

    def __init__(
        self, sim: Simulator, episodes: Episodes, observe: Any, step_limit: int, threads: int | None = None
    ) -> None:
        names, options = split(observe)
        self.observer = Observer(sim, episodes, names, alone=options is None)
        self.readings = Readings(sim, self.observer, step_limit)
        self._episodes = episodes
        self.fluoroscope = None if options is None else Fluoroscope(sim, episodes, options, threads)
        self.space: Box | Dict = self.observer.space
        if self.fluoroscope is not None:
            spaces: dict[str, Space] = {"image": self.fluoroscope.space} | (
                {"state": self.observer.space} if names else {}
            )
            self.space = Dict(spaces)

    @property
    def plain(self) -> tuple[str | dict[str, Any], ...]:
        """What `observe=` takes to show the same, in values that JSON can hold."""
        image = () if self.fluoroscope is None else (self.fluoroscope.options.plain(),)
        return (*image, *self.observer.names)

    @property
    def text(self) -> str:
        """For people: how many numbers of which channels, and the image."""
        names = self.observer.names
        parts = [f"{counted(self.observer.space.shape[0], 'number')} ({', '.join(names)})"] if names else []
        if self.fluoroscope is not None:
            size = self.fluoroscope.options.size
            parts.insert(0, f"an image of {size} × {size} px")
        return " and ".join(parts)

    def begin(self, lanes: np.ndarray, rngs: Sequence[np.random.Generator]) -> None:
        """Draw what the episodes that begin in `lanes` (n,) need, each from its own generator."""
        self.readings.begin(lanes, rngs)
        if self.fluoroscope is not None:
            self.fluoroscope.begin(lanes, rngs)

    def read(self) -> Observation:
        """Every lane's observation of the present step; reading it twice gives the same."""
        if self.fluoroscope is None:
            return self.readings.of(self.observer.read(), self._episodes)
        seen = {"image": self.fluoroscope.read()}
        if self.observer.names:
            seen["state"] = self.readings.of(self.observer.read(), self._episodes)
        return seen


def of_lane(observation: Observation, lane: int) -> Any:
    """One lane's observation out of a batch's."""
    if isinstance(observation, dict):
        return {name: part[lane] for name, part in observation.items()}
    return observation[lane]
