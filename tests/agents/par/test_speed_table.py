"""The quasi-static speed of the tip, against the simulator and against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from agents.par.speed_table import speed_tables
from magwire_env import Scenario, Simulator
from magwire_env.quasistatic.pool import scenario_pool
from magwire_env.scenario import Timing
from magwire_env.simulation import Library

PAPER = Scenario.paper()


def test_the_simulators_wire_has_the_tables_speed_when_drag_is_strong():
    sc = PAPER.replace(contact__drag=50.0, wire__segments=64, timing=Timing(0.05, 10))
    (table,) = speed_tables(Library([sc]), np.zeros(1, dtype=np.int64), spacing=0.02, angles=12)
    rows, columns = np.arange(8, 36, 4), np.arange(12)
    place, angle = (grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij"))
    command = (np.pi + 2 * np.pi * angle / 12 - np.pi)[:, None]
    sim = Simulator(sc, len(place))
    sim.reset(0.02 * place, command)
    for _ in range(8):
        sim.step(command)
    expected = table.speed[place, angle]
    assert (np.abs(expected) > 2e-4).sum() > 40
    assert (expected == 0.0).sum() >= 5
    assert np.abs(sim.tip_velocity - expected).max() < 0.05 * np.abs(expected).max()


def test_tables_made_together_are_those_made_alone():
    library = Library(scenario_pool("SteerAny", "test", 3))
    together = speed_tables(library, np.array([2, 0]))
    for entry, table in zip((2, 0), together, strict=True):
        (alone,) = speed_tables(library, np.array([entry]))
        assert np.array_equal(alone.speed, table.speed)
        assert (alone.lag, alone.servo) == (table.lag, table.servo)


def test_rigs_of_several_degrees_of_freedom_are_refused():
    with pytest.raises(ValueError, match="library must be of rigs with a single turn, got 3 degrees of freedom"):
        speed_tables(Library(scenario_pool("Chase", "test", 1)), np.zeros(1, dtype=np.int64))
