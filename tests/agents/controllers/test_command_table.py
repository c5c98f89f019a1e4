"""Best commands along the tract, and the time under them."""

from __future__ import annotations

import numpy as np
import pytest

from agents.controllers.command_table import CommandTable
from magwire_env import Scenario
from magwire_env.quasistatic import certificate
from magwire_env.quasistatic.net_force import greatest
from magwire_env.simulation import Library

PAPER, FIRST = Scenario.paper(), np.zeros(1, dtype=np.int64)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_commands_are_those_of_greatest_net_force(direction):
    table = CommandTable(Library([PAPER]), 2e-3, direction)
    places = 2e-3 * np.arange(50, 350, 7)
    entries = np.zeros(len(places), dtype=np.int64)
    grid = 2e-3 * np.arange(401)
    commands, _ = greatest([PAPER], np.zeros(401, dtype=np.int64), grid, direction)
    assert table.command(entries, places) == pytest.approx(commands[50:350:7], abs=1e-12)


def test_the_time_is_about_the_certificates():
    table = CommandTable(Library([PAPER]), 2e-3, 1)
    found = certificate(PAPER, start=0.1, goal=0.79)
    assert table.time(FIRST, np.array([0.1]), np.array([0.79]))[0] == pytest.approx(found.traverse_time, rel=0.1)


def test_time_adds_up_and_is_negative_beyond_the_goal():
    table = CommandTable(Library([PAPER]), 2e-3, 1)
    a, b, c = np.array([0.1]), np.array([0.3]), np.array([0.7])
    assert table.time(FIRST, a, b) + table.time(FIRST, b, c) == pytest.approx(table.time(FIRST, a, c))
    assert table.time(FIRST, c, b) == pytest.approx(-table.time(FIRST, b, c))
    assert table.time(FIRST, -a, b) > table.time(FIRST, np.zeros(1), b) + 1.0
