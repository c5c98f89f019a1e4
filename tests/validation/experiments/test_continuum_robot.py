"""The magnetic continuum robot: the arcs against the free rod's own equilibrium, and the measured poses."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from magwire_env.physics import CylinderMagnet, FreeRod, Guidewire
from magwire_env.validation.experiments.continuum_robot import (
    FOUND,
    MOMENT,
    SECOND_MOMENT,
    SHAFT,
    SOFA,
    SOFT_LENGTH,
    Setting,
    fitted_poses,
    measured_poses,
    rod,
)

DATA = Path(os.environ.get("MAGWIRE_DATA", Path(__file__).parents[4] / "shared" / "data"))


def test_the_arcs_are_the_free_rod_s_equilibrium():
    length, field, angle, segments = 0.1, 30e-3, math.radians(70), 100
    tip, heading, stable = rod(np.array([length]), np.array([angle]), Setting(field, 0.0, 0.0, 0.0), soft=SHAFT)
    radius = (4 * SECOND_MOMENT / math.pi) ** 0.25
    wire = Guidewire(length, radius, 1e3 * SHAFT, SHAFT, 1100.0, segments)
    magnet = CylinderMagnet(2e-3, 3e-3, 1.0)
    magnet = CylinderMagnet(2e-3, 3e-3, MOMENT / magnet.moment)
    ring = np.zeros(segments)
    ring[round((length - SOFT_LENGTH) / length * segments) - 1] = MOMENT / wire.segment_length
    free = FreeRod(wire, tip=magnet, magnetisation=ring)
    # The rod's clamp looks along +x, the robot's along +y; headings turn towards −y of the rod.
    nodes = free.equilibrium(uniform_field=field * np.array([math.cos(angle), -math.sin(angle), 0.0]))
    assert stable[0]
    np.testing.assert_allclose((-nodes[-1, 1], nodes[-1, 0]), tip[0], atol=0.01 * length)
    chord = nodes[-1] - nodes[-2]
    assert math.atan2(-chord[1], chord[0]) == pytest.approx(heading[0], abs=0.02)


def test_poses_that_the_rod_made_are_found_again():
    lengths, angles = np.array([0.08, 0.12, 0.16]), np.array([0.5, -1.0, 1.5])
    tip, heading, _ = rod(lengths, angles, FOUND)
    best, gaps = fitted_poses(np.column_stack([tip, heading]), FOUND, rounds=8)
    np.testing.assert_allclose(best[:, 0], lengths, atol=0.5e-3)
    assert np.abs(gaps).max() < 1e-3


def test_a_rod_that_points_against_the_field_does_not_count():
    _, _, stable = rod(np.array([0.15, 0.15]), np.array([math.pi, 0.0]), FOUND)
    assert stable.tolist() == [False, True]


@pytest.mark.skipif(not (DATA / "e2_mcr_tip_poses.csv").is_file(), reason="the measured poses are not here")
def test_the_measured_poses_lie_nearer_than_sofa_s():
    _, gaps = fitted_poses(measured_poses(DATA / "e2_mcr_tip_poses.csv")[::4], FOUND)
    assert np.hypot(gaps[:, 0], gaps[:, 1]).mean() < 0.5 * SOFA[0]
    assert np.abs(gaps[:, 2]).mean() < 0.5 * SOFA[1]
