"""Imperfect readings: the scenario's `Sensing` applied to the observations of a batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..simulation import Simulator
from .episodes import Episodes
from .observation import Observer

__all__ = ["Readings"]


class Readings:
    """Noise, bias, resolution and delay of every lane's observation, drawn from the lane's own random stream.

    An episode's noise is drawn whole at its start, so that a lane's stream does not depend on its neighbours'.
    """

    def __init__(self, sim: Simulator, observer: Observer, step_limit: int) -> None:
        self._sim, self._bound = sim, observer.space.high
        scenarios = sim.library.scenarios
        self.active = any(sc.sensing for sc in scenarios)
        if not self.active:
            return
        numbers, lengths = observer.numbers, sim.library.tract_length
        shape = (len(scenarios), len(numbers))
        self._noise, self._bias, self._step = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        for i, sc in enumerate(scenarios):
            for j, number in enumerate(numbers):
                if number.quantity:
                    reading = getattr(sc.sensing, number.quantity)
                    scale = number.scale or lengths[i]
                    self._noise[i, j] = reading.noise / scale
                    self._bias[i, j] = reading.bias / scale
                    self._step[i, j] = reading.step / scale
        self._delay = np.array([sc.sensing.delay for sc in scenarios])
        n, size, depth = sim.num_envs, len(numbers), int(self._delay.max()) + 1
        self._errors = np.zeros((n, step_limit + 1, size), dtype=np.float32)
        self._offsets = np.zeros((n, size))
        self._history = np.zeros((depth, n, size), dtype=np.float32)

    def begin(self, lanes: np.ndarray, rngs: Sequence[np.random.Generator]) -> None:
        """Draw the errors of the episodes that begin in `lanes` (n,)."""
        if not self.active:
            return
        entries = self._sim.lane_scenario[lanes]
        for lane, entry, rng in zip(lanes, entries, rngs, strict=True):
            self._offsets[lane] = self._bias[entry] * rng.standard_normal(self._offsets.shape[1])
            if self._noise[entry].any():
                self._errors[lane] = self._noise[entry] * rng.standard_normal(self._errors.shape[1:], dtype=np.float32)
            else:
                self._errors[lane] = 0.0

    def of(self, truth: np.ndarray, episodes: Episodes) -> np.ndarray:
        """What is read where `truth` (n, size) stands, at the present step of the episodes.

        Reading the same step twice gives the same: each step has its own error and its own place in the history.
        """
        if not self.active:
            return truth
        lanes, entries = np.arange(len(truth)), self._sim.lane_scenario
        steps = np.minimum(episodes.steps, self._errors.shape[1] - 1)
        seen = truth + self._offsets + self._errors[lanes, steps]
        step = self._step[entries]
        seen = np.where(step > 0, np.round(seen / np.where(step > 0, step, 1.0)) * step, seen)
        # Each lane keeps its own last `delay` + 1 readings; before that many steps the first one is still seen.
        depth = self._delay[entries] + 1
        self._history[steps % depth, lanes] = np.clip(seen, -self._bound, self._bound)
        return self._history[np.maximum(steps - depth + 1, 0) % depth, lanes]

    def history(self) -> np.ndarray | None:
        """The last readings of every lane, (depth, n, size); None where readings are perfect."""
        return self._history.copy() if self.active else None

    def load_history(self, history: np.ndarray | None) -> None:
        """Put back what `history` gave."""
        if self.active:
            self._history[:] = history
