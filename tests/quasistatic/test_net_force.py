"""The command of greatest net force."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from magwire_env.quasistatic.net_force import FINE, TipForces, greatest, search
from magwire_env.quasistatic.pool import candidates
from magwire_env.scenario import Rig, Scenario, Turn
from magwire_env.simulation import Library, Simulator, best_command, drive_at

PAPER = Scenario.paper()


@pytest.mark.parametrize(("lever", "short"), [(False, 1e-5), (True, 1e-4)])
def test_one_axis_as_good_as_trying_all_angles_and_net_is_not_drive(lever, short):
    # With the couple's contacts the force has kinks in the angle: there the search ends within 0.1 mN.
    sc = PAPER.replace(contact__friction=0.4, coupling="wrench", gravity=(0, 0, -9.81), contact__lever_friction=lever)
    places = np.arange(0.09, 0.79, 0.002)
    entries = np.zeros(len(places), dtype=np.int64)
    commands, force = greatest([sc], entries, places)
    here = TipForces(Library([sc]), entries, places)
    most = np.max([here.force(np.full((len(places), 1), a)) for a in np.linspace(0, 2 * np.pi, 721)], axis=0)
    assert force == pytest.approx(here.force(commands), abs=1e-12)
    assert (most - force).max() < short
    drive, _ = greatest([sc], entries, places, objective="drive")
    assert (force - here.force(drive)).max() > 1e-4


@pytest.mark.parametrize("kind", ["Orient", "Chase", "Dual"])
def test_several_degrees_of_freedom_as_good_as_a_far_finer_search(kind):
    sc = candidates(kind, "test", 1, seed=7)[0]
    every = np.arange(0.1, 0.7, 0.002)
    commands, force = greatest([sc], np.zeros(len(every), dtype=np.int64), every, objective="drive")
    some = slice(10, None, 60)
    _, best = best_command(sc, every[some])
    assert (force[some] > 0.97 * best - 1e-5).all()
    speeds = [d.speed for d in sc.rig.dofs]
    jumps = (np.abs(np.diff(commands, axis=0)) / speeds).max(axis=1)
    assert np.median(jumps) < 0.05
    assert jumps.max() <= 1.0 + 1e-9 or kind == "Chase"


def test_two_turns_take_the_form_that_needs_least_turning():
    sc = candidates("Orient", "test", 1, seed=7)[0]
    places = np.arange(0.1, 0.7, 0.002)
    entries = np.zeros(len(places), dtype=np.int64)
    commands, force = greatest([sc], entries, places)
    other = np.stack([-commands[:, 0], commands[:, 1] + np.pi], axis=1)  # the same moment
    assert TipForces(Library([sc]), entries, places).force(other) == pytest.approx(force, abs=1e-9)
    for axes in (("x", "y"), ("y", "x")):
        mount = dataclasses.replace(sc.rig.magnets[0], dofs=tuple(Turn(a) for a in axes))
        turned = dataclasses.replace(sc, rig=Rig((mount,)))
        q = np.tile([[0.3, 1.1]], (len(places), 1))
        here = TipForces(Library([turned]), entries, places)
        assert here.force(q) == pytest.approx(here.force([np.pi, np.pi] + q * [-1, 1]), abs=1e-9)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_coarse_search_of_tables_comes_near_the_fine_one_of_figure_7(direction):
    """Both are one search; tables take 2 mrad, Figure 7 a millionth of the range."""
    places = np.linspace(0.0, 0.8, 81)
    entries = np.zeros(81, dtype=np.int64)
    rough, force = greatest([PAPER], entries, places, direction, "drive")
    fine, drive = best_command(PAPER, places, direction)
    assert (direction * drive >= force - 1e-15).all()
    assert direction * drive == pytest.approx(force, rel=1e-4)
    assert np.abs(np.angle(np.exp(1j * (rough - fine)))).max() < 5e-3


def test_a_bad_objective_is_refused():
    with pytest.raises(ValueError, match="objective must be one of net, drive, torque, got 'speed'"):
        greatest([PAPER], np.zeros(1, dtype=np.int64), np.array([0.3]), objective="speed")


def test_least_torque_at_a_floor_of_the_drive_is_that_of_trying_all_angles():
    places = np.linspace(0.1, 0.79, 8)
    entries, library = np.zeros(len(places), dtype=np.int64), Library([PAPER])
    floor = 0.6 * best_command(PAPER, places)[1]
    commands, value = search(library, entries, places, 1.0, "torque", FINE, floor)
    assert (drive_at(PAPER, commands, places) >= floor - 1e-9).all()
    angles = np.linspace(0, 2 * np.pi, 3601)
    least = np.full(len(places), np.inf)
    sim = Simulator(PAPER, num_envs=len(angles))
    for i, s in enumerate(places):
        sim.reset(tip_arclength=s, magnet=angles[:, None])
        least[i] = sim.tip_torque[sim.drive_force >= floor[i]].min()
    np.testing.assert_allclose(-value, least, rtol=2e-3)


@pytest.mark.parametrize(("objective", "floor"), [("torque", None), ("drive", np.zeros(1)), ("net", np.zeros(1))])
def test_a_floor_of_the_drive_belongs_to_least_torque_alone(objective, floor):
    with pytest.raises(ValueError, match="floor \\(in N\\) must be given with the objective 'torque' and no other"):
        TipForces(Library([PAPER]), np.zeros(1, dtype=np.int64), np.array([0.2]), objective=objective, floor=floor)
