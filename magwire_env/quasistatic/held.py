"""Held commands: which tracts are crossed by turning the magnets once and then doing nothing.

A fixed magnet pulls what comes towards it, so many a tract is crossed under one command. Such a tract asks for no
steering, and pools of the tasks' second versions leave it out.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ..scenario import Scenario
from ..simulation import Library
from .balance import Tails
from .certificate import START_SPREAD, Certificate, traverse
from .net_force import TipForces

__all__ = ["crossed_by_holding", "held_commands"]

ALONE, TOGETHER, PER_SLIDE = 32, 8, 3
"""Held values of a turn that is the only degree of freedom, of every turn of several, and of every slide or current."""


def held_commands(is_turn: np.ndarray) -> np.ndarray:
    """Shares of the range of every degree of freedom, (k, dof) in [0, 1]: an even grid.

    32 commands for a single turn, 8 × 8 for two turns, 3 × 3 × 8 for two slides and a turn.
    """
    turns = ALONE if len(is_turn) == 1 else TOGETHER
    axes = [np.arange(turns) / turns if turn else np.linspace(0.0, 1.0, PER_SLIDE) for turn in is_turn]
    return np.array(list(itertools.product(*axes)))


def crossed_by_holding(scenarios: Sequence[Scenario], certificates: Sequence[Certificate]) -> np.ndarray:
    """Which scenarios some held command crosses, (n,), or may cross within the balance's allowed error.

    The wire sets off at rest from the easiest of a task's starts, `START_SPREAD` beyond its length, under the net force
    of the held command, more by the certificate's reserve.

    scenarios : of one rig layout
    certificates : theirs, forwards
    """
    ways = [np.r_[sc.wire.length + START_SPREAD, c.arclengths[c.arclengths > sc.wire.length + START_SPREAD]]
            for sc, c in zip(scenarios, certificates, strict=True)]  # fmt: skip
    counts = np.array([len(way) for way in ways])
    entries, tips = np.repeat(np.arange(len(ways)), counts), np.concatenate(ways)
    library = Library(scenarios)
    resistance, growth = Tails(scenarios).resistance(entries, tips, 1)
    forces = TipForces(library, entries, tips)
    reserve = np.array([c.reserve for c in certificates])[entries]
    _, low, high = library.limits.of(entries)
    edges, crossed = np.r_[0, counts.cumsum()], np.zeros(len(ways), dtype=np.bool_)
    for share in held_commands(library.is_turn):
        margin = forces.force(low + share * (high - low)) - resistance + reserve
        for i in np.flatnonzero(~crossed).tolist():
            part = slice(edges[i], edges[i + 1])
            _, seconds = traverse(tips[part], margin[part], growth[part], scenarios[i].moving_mass, 0.0)
            crossed[i] = seconds.sum() <= certificates[i].time_limit
    return crossed
