"""The scenarios of a batch as rows of numbers, shared by all arrays of lanes that run them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..scenario import Scenario
from ..scenario.steps import common_substeps
from .model import model_class, require
from .rig_arrays import RigLibrary
from .servo import LIMIT

__all__ = ["Library", "Limits"]


class Limits(NamedTuple):
    """What a rig's degrees of freedom can do, (entries, dof) each.

    speed : rad/s, m/s or A/s at most
    low, high : rad, m or A; of a turn the circle about its home
    """

    speed: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def of(self, entries: np.ndarray) -> Limits:
        """The limits of `entries` (n,), (n, dof) each."""
        return Limits(*(column[entries] for column in self))


class Library:
    """Scenarios as rows, one row an entry.

    scenarios : the entries
    control_period, model : what they have in common, s and a name
    substeps : in a control period, the most that one of them needs
    rigs, wires : rows of the rig, and the wire model's own
    dof, magnet_count, is_turn, home : see `RigLibrary`
    limits : `Limits`
    wire_length, tract_length : (entries,) m
    start_length : (entries,) m, where the tip of a wire stands that lies just inside the inlet: the wire's length, or
        what its feed has inserted
    reach : (entries, 2) m, how far from the inlet a feed can bring a tip; −∞ and ∞ of a wire that is dragged, its length
        of one that is clamped
    too_long_step : (entries,), the integration step is too long for the wire, see `Scenario.step_too_long`

    Raises `ValueError` if the scenarios differ in timing, wire model or the kinds of their degrees of freedom.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        if not scenarios:
            raise ValueError("scenario must be one scenario or a sequence of at least one, got none")
        self.scenarios = tuple(scenarios)
        timing, self.model = self.scenarios[0].timing, self.scenarios[0].model
        for i, sc in enumerate(self.scenarios):
            if sc.timing != timing:
                raise ValueError(f"scenario[{i}].timing must be that of the batch, {timing}, got {sc.timing}")
            if sc.model != self.model:
                raise ValueError(f"scenario[{i}].model must be that of the batch, {self.model!r}, got {sc.model!r}")
            _check_model(sc)
        self.control_period, self.substeps = timing.control_period, common_substeps(self.scenarios)
        self.rigs = RigLibrary(self.scenarios)
        self.wires: Any = model_class(self.model).library(self.scenarios)
        self.dof, self.magnet_count = self.rigs.dof, self.rigs.magnet_count
        self.is_turn, self.home = self.rigs.is_turn, self.rigs.home
        rows = self.rigs.limits
        self.limits = Limits(rows[:, :, LIMIT.speed], rows[:, :, LIMIT.low], rows[:, :, LIMIT.high])
        self.too_long_step = np.array(
            [sc.step_too_long and self.substeps < sc.substeps_needed for sc in self.scenarios]
        )
        self.wire_length = np.array([sc.wire.length for sc in self.scenarios])
        self.tract_length = np.array([sc.tract.length for sc in self.scenarios])
        self.start_length = np.array(
            [sc.wire.length if sc.rig.feed is None else sc.rig.feed.home for sc in self.scenarios], dtype=np.float64
        )
        feeds = [sc.rig.feed for sc in self.scenarios]
        reach = [(-np.inf, np.inf) if f is None else (f.low, f.high) for f in feeds]
        clamps = [(sc.wire.length,) * 2 if sc.rig.clamped else None for sc in self.scenarios]
        self.reach = np.array([c or r for c, r in zip(clamps, reach, strict=True)], dtype=np.float64)


def _check_model(sc: Scenario) -> None:
    """Raise `ValueError` if the scenario holds what its wire model knows nothing of."""
    if sc.rig.base:
        require(sc, "base", "Scenario.rig.feed")
    if sc.rig.clamped:
        require(sc, "base", "Scenario.rig.clamped")
    if sc.wire.profiled:
        require(sc, "profiles", f"Scenario.wire.{sc.wire.profiled[0]}")
    if sc.lumen is not None and (len(sc.lumen.branches) > 1 or sc.lumen.wall is not None):
        require(sc, "branches", "Scenario.lumen")
