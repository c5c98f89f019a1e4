"""Stiff wires: where they stand, how they start, and what is said of nodes that pass each other."""

import numpy as np
import pytest

from magwire_env import Scenario, Simulator
from tests.speed.accuracy import five_scenarios
from tests.speed.stiff import errors, stiffened

PAPER = Scenario.paper()
NITINOL = PAPER.replace(
    wire__radius=0.45e-3, wire__axial_modulus=60e9, wire__bending_modulus=60e9, wire__density=6450.0
)
THICK = PAPER.replace(wire__axial_modulus=500e6, wire__bending_modulus=500e6)


def held(scenario: Scenario, seconds: float = 2.0) -> np.ndarray:
    """Arc lengths of the tip, m, under a magnet held at 3.5 rad, from 0.4 m on."""
    sim = Simulator(scenario)
    sim.reset(tip_arclength=0.4)
    seen = []
    for _ in range(round(seconds / scenario.timing.control_period)):
        sim.step(np.full((1, 1), 3.5))
        seen.append(sim.tip_arclength[0])
    return np.array(seen)


@pytest.mark.parametrize(("scenario", "stands"), [(NITINOL, 0.39973), (THICK, 0.39957)])
def test_a_stiff_wire_stands_where_the_converged_one_stands(scenario, stands):
    own, fine = held(scenario), held(scenario.replace(timing__substeps=2000))
    assert abs(own - fine).max() < 0.1e-3
    assert fine[-1] == pytest.approx(stands, abs=0.1e-3)


def test_a_stiff_wire_laid_in_a_bend_is_not_thrown_back_by_missing_friction():
    sim = Simulator(NITINOL.replace(timing__substeps=20))
    sim.reset(tip_arclength=0.3)
    sim.step(np.full((1, 1), 3.5))
    assert abs(sim.tip_arclength[0] - 0.3) < 0.2e-3


def test_a_long_control_period_is_right():
    slow, quick = held(PAPER.replace(timing__control_period=1.0)), held(PAPER.replace(timing__substeps=20))
    assert abs(slow - quick[9::10]).max() < 2e-3


@pytest.mark.parametrize(
    ("number", "modulus", "radius", "density"),
    [(0, 1e8, 2.5e-3, 1100.0), (2, 2e11, 0.2e-3, 6450.0), (3, 6e10, 0.45e-3, 6450.0), (4, 1e10, 0.45e-3, 6450.0)],
)
def test_stiff_wires_are_within_1_mm_and_2_percent_of_converged_ones(number, modulus, radius, density):
    error, load, _ = errors(stiffened(five_scenarios()[number], modulus, radius, density), periods=20)
    assert error < 1e-3
    assert load < 0.02


def test_laying_a_stiff_wire_leaves_the_other_lanes_as_they_are():
    sim = Simulator(NITINOL, num_envs=3)
    sim.reset(tip_arclength=0.4)
    sim.step(np.full((3, 1), 3.5))
    before = sim.state()
    sim.reset(tip_arclength=0.3, lanes=np.array([1]))
    after = sim.state()
    assert np.array_equal(before.wire[[0, 2]], after.wire[[0, 2]])
    alone = Simulator(NITINOL)
    alone.reset(tip_arclength=0.3)
    assert np.array_equal(after.wire[1], alone.state().wire[0])
    assert (after.velocities[1] == 0.0).all()
    assert after.arclengths[1, -1] == 0.3


def test_soft_wires_are_laid_without_stretch_as_ever():
    sim = Simulator(PAPER)
    sim.reset(tip_arclength=0.4)
    chords = np.linalg.norm(np.diff(sim.positions[0], axis=0), axis=1)
    assert chords == pytest.approx(PAPER.wire.segment_length, abs=1e-12)


def test_nodes_that_pass_each_other_are_reported():
    soft = PAPER.replace(wire__axial_modulus=2e3, wire__bending_modulus=1e3)
    sim = Simulator(soft, num_envs=2)
    sim.reset(tip_arclength=0.4)
    state = sim.state()
    state.arclengths[1, 5] += 0.05
    sim.load_state(state)
    sim.step(np.full((2, 1), 3.5))
    assert [bool((np.diff(wire) > 0).all()) for wire in sim.state().arclengths] == [True, False]
    assert list(sim.unconverged) == [0, 1]


def test_a_batch_takes_the_steps_of_its_stiffest_wire():
    assert Simulator([PAPER, NITINOL], num_envs=2).library.substeps == NITINOL.substeps
