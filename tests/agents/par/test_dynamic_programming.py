"""The recursion solves cases that have a closed form."""

from __future__ import annotations

import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.par import dynamic_programming as dp


def test_at_a_constant_speed_time_is_the_way_over_it():
    speed = np.full((101, 40), 0.1)
    values = dp.to_the_end(dp.moves(speed, 0.005, 2.0, 0.1), 0.005, 0.5, 2.0, 0.1, 100, 1e-9)
    place = 0.005 * np.arange(len(values))
    assert values == pytest.approx(np.broadcast_to(((0.5 - place) / 0.1)[:, None], values.shape), abs=1e-9)


def test_a_magnet_that_must_first_turn_takes_its_servos_time():
    """The wire moves, at 0.1 m/s, in a quarter of the angles; from opposite the servo needs 3/8 of a turn to there."""
    columns = 80
    speed = np.zeros((101, columns))
    speed[:, columns // 2 - 10 : columns // 2 + 11] = 0.1
    values = dp.to_the_end(dp.moves(speed, 0.005, 4.0, 0.1), 0.005, 0.5, 4.0, 0.1, 200, 1e-9)
    turning = 0.1 * 30 / 4.0
    assert values[0, columns // 2] == pytest.approx(5.0, abs=1e-6)
    assert values[0, 0] == pytest.approx(5.0 + turning, abs=0.1)
    assert (np.diff(values[:, columns // 2]) < 1e-12).all()


def test_a_target_takes_the_way_and_the_hold():
    """Forward under half of the angles, backward under the other half, at rest between; hold 5 periods within 5 mm."""
    angle = 2 * np.pi * np.arange(80) / 80
    speed = np.broadcast_to(0.1 * np.sin(angle), (101, 80)).copy()
    way = dp.moves(speed, 0.005, 8.0, 0.1)
    values, held = dp.to_a_target(way, 0.005, 0.3, 0.005, 5, 1e-3, 0, 100, 8.0, 0.1, 300, 1e-9)
    assert held[0].max() == 0.0
    assert held[4, len(held[0]) // 2, 0] == pytest.approx(0.4)
    assert values[60, 0] == pytest.approx(0.5)
    assert 1.5 < values[40, 20] < 2.2
    assert values[40, 20] == pytest.approx(values[80, 60], abs=0.02)


def test_a_reference_at_the_wires_own_speed_costs_nothing():
    speed = np.full((101, 40), 0.05)
    reference = 0.1 + 0.05 * 0.1 * np.arange(21)
    values = dp.along_a_reference(dp.moves(speed, 0.005, 2.0, 0.1), 0.005, reference, 1e-3, 31, 2.0, 0.1)
    assert values[0, 15] == pytest.approx(0.0, abs=1e-12)
    assert values[0, 17] == pytest.approx(20 * (2e-3) ** 2, rel=1e-3)
