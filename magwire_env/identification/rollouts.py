"""What the simulator predicts for a log: all parameter sets and episodes as lanes of one batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..scenario import Scenario
from ..simulation import Library, Simulator
from .logs import MEASURED, Log, start_of
from .parameters import Parameter

__all__ = ["Predictor"]

_LANES_AT_ONCE = 4096


class Predictor:
    """Replays a log's commands under many parameter sets.

    columns : which of the log's columns are predicted
    kinds : (M,) for each measurement the number of its kind in `kind_names`
    measured : (M,) the measurements, column by column within an episode, episode by episode
    times, column_of, row_of : (M,) s, the number of its column, and of its row in the episode
    rows : of the longest episode
    starts : (E,) m, where the tips seem to lie at first
    substeps : integration steps in a control period, the same for all parameter sets, so that predictions change
        smoothly with them
    """

    def __init__(
        self,
        scenario: Scenario,
        log: Log,
        parameters: Sequence[Parameter],
        columns: Sequence[str],
        substeps: int,
        threads: int | None = None,
    ) -> None:
        log.fits(scenario)
        self.scenario = scenario.replace(timing__substeps=substeps)
        self.log, self.parameters, self.columns, self.substeps = log, tuple(parameters), tuple(columns), substeps
        self._threads = threads
        self.starts = np.array([start_of(ep, scenario, i) for i, ep in enumerate(log.episodes)])
        self.rows = max(len(ep) for ep in log.episodes)
        self._commands = np.stack([_padded(ep.commands, self.rows) for ep in log.episodes])
        library = Library([self.scenario])
        self._rig = np.stack([library.home[0] if ep.rig is None else ep.rig for ep in log.episodes])
        self._turns = library.is_turn.astype(float)
        lists: list[list[np.ndarray]] = [[], [], [], [], []]
        for e, episode in enumerate(log.episodes):
            for c, name in enumerate(self.columns):
                rows = np.flatnonzero(np.isfinite(episode.measured[name]))
                for part, values in zip(
                    lists,
                    (
                        np.full(len(rows), e),
                        np.full(len(rows), c),
                        rows,
                        episode.measured[name][rows],
                        episode.time[rows],
                    ),
                    strict=True,
                ):
                    part.append(values)  # fmt: skip
        self._episode_of, self.column_of, self.row_of, self.measured, self.times = map(np.concatenate, lists)
        names = [MEASURED[name].kind for name in self.columns]
        self.kind_names = tuple(dict.fromkeys(names))
        self.kinds = np.array([self.kind_names.index(k) for k in names])[self.column_of]

    def scenario_of(self, values: Sequence[float] | np.ndarray) -> Scenario:
        """The scenario with these values of the parameters. Raises `ValueError` where it refuses them."""
        found = self.scenario
        for parameter, value in zip(self.parameters, values, strict=True):
            found = parameter.put(found, float(value))
        return found

    def __call__(self, values: np.ndarray, starts: np.ndarray, rows: int | None = None) -> np.ndarray:
        """Predicted measurements (K, M) of K parameter sets.

        values : (K, p); a set that the scenario refuses gives NaN
        starts : (K, E) m, where the tips lie at first
        rows : how many rows of each episode are replayed, by default all; later ones give NaN
        """
        sets, found = len(values), np.full((len(values), len(self.measured)), np.nan)
        scenarios: list[Scenario] = []
        possible = []
        for k in range(sets):
            try:
                scenarios.append(self.scenario_of(values[k]))
            except ValueError:  # a set that no scenario can have predicts nothing
                continue
            possible.append(k)
        at_once = max(1, _LANES_AT_ONCE // len(self.log.episodes))
        for first in range(0, len(possible), at_once):
            part = possible[first : first + at_once]
            some = scenarios[first : first + at_once]
            found[part] = self._replayed(some, self._offsets(values[part]), starts[part], rows or self.rows)
        return found

    def _offsets(self, values: np.ndarray) -> np.ndarray:
        """(K,) rad, what every turn has beyond its reading."""
        offset = np.zeros(len(values))
        for i, parameter in enumerate(self.parameters):
            if parameter.turns_offset:
                offset += values[:, i]
        return offset

    def _replayed(self, scenarios: list[Scenario], offsets: np.ndarray, starts: np.ndarray, rows: int) -> np.ndarray:
        episodes = len(self.log.episodes)
        unique = list(dict.fromkeys(scenarios))
        number = {sc: i for i, sc in enumerate(unique)}
        entries = np.repeat([number[sc] for sc in scenarios], episodes)
        sim = Simulator(Library(unique), len(entries), self._threads, entries)
        more = np.repeat(offsets, episodes)[:, None] * self._turns
        commands = np.tile(self._commands, (len(scenarios), 1, 1)) + more[:, None]
        sim.reset(tip_arclength=starts.reshape(-1), magnet=np.tile(self._rig, (len(scenarios), 1)) + more)
        seen = np.full((self.rows, len(self.columns), len(entries)), np.nan)
        for k in range(rows):
            for c, name in enumerate(self.columns):
                seen[k, c] = MEASURED[name].of(sim)
            if k + 1 < rows:
                sim.step(commands[:, k])
        lanes = np.arange(len(scenarios))[:, None] * episodes + self._episode_of
        return seen[self.row_of, self.column_of, lanes]


def _padded(commands: np.ndarray, steps: int) -> np.ndarray:
    """(steps, dof), the last command held."""
    return commands[np.minimum(np.arange(steps), len(commands) - 1)]
