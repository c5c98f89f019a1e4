"""Certificates: the balance of the whole wire, the command of greatest net force, and what follows from both."""

import dataclasses

import numpy as np
import pytest

from magwire_env.lumen import straight
from magwire_env.physics import PointDipole, Tract
from magwire_env.quasistatic import certificate
from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import Places, greatest
from magwire_env.quasistatic.pool import candidates
from magwire_env.scenario import ActuatedMagnet, Coil, Contact, Current, Rig, Scenario, Slide, Timing, Turn, above
from magwire_env.simulation import Simulator, best_command, best_placement, certify
from magwire_env.simulation.locked.arrays import Library
from tests.support.scenes import bent, line, world

PAPER = Scenario.paper()
BLOCK = PAPER.rig.magnets[0].magnet
FIRST = np.zeros(1, dtype=np.int64)


def pull(scenario, tip, direction=1.0):
    force, growth = Tails([scenario]).pull(FIRST, np.array([tip]), direction)
    return force[0], growth[0]


# --- the balance ------------------------------------------------------------------------------------------------------


def test_without_friction_a_bend_costs_its_energy_and_gives_it_back():
    sc = world(bent(0.05, 1.5))
    rigidity, tract = sc.wire.bending_rigidity, sc.tract
    for tip in (0.15, 0.22, 0.27, 0.35):
        cost = 0.5 * rigidity * float(tract.curvature(tip) ** 2 - tract.curvature(tip - sc.wire.length) ** 2)
        assert pull(sc, tip)[0] == pytest.approx(cost, abs=2e-5)
        assert pull(sc, tip, -1.0)[0] == pytest.approx(-cost, abs=2e-5)


def test_a_wire_on_a_slope_weighs_and_rubs():
    slope = np.deg2rad(30)
    xyz = np.linspace(0, 1, 5)[:, None] * [np.cos(slope), 0.0, np.sin(slope)]
    sc = world(Tract.from_points(xyz), gravity=(0.0, 0.0, -9.81), contact=Contact(friction=0.2, drag=0.7))
    weight = sc.wire.mass * 9.81
    for direction in (1.0, -1.0):
        force, growth = pull(sc, 0.5, direction)
        assert force == pytest.approx(weight * (direction * np.sin(slope) + 0.2 * np.cos(slope)), rel=1e-9)
        assert growth == pytest.approx(0.7 * sc.wire.length, rel=1e-9)


def test_the_capstan_multiplies_the_tension_of_a_hanging_tail():
    # The tail hangs down a straight shaft, the tip has gone round a quarter circle; the wire bends for nothing.
    radius = 0.04
    turn = np.linspace(0, np.pi / 2, 80)
    arc = np.stack([radius * (1 - np.cos(turn)), 0 * turn, radius * np.sin(turn)], axis=1)
    shaft = np.stack([0 * np.arange(30.0), 0 * np.arange(30.0), -0.002 * np.arange(30, 0, -1.0)], axis=1)
    sc = world(Tract.from_points(np.vstack([shaft, arc])), gravity=(0, 0, -9.81), wire__bending_modulus=1e-3,
               contact=Contact(friction=0.3, drag=0.0))  # fmt: skip
    tip = sc.tract.length - 0.01
    w, mu = sc.wire.mass / sc.wire.length * 9.81, 0.3
    phi = (tip - 0.06) / radius
    n = 40_000
    tension = w * (sc.wire.length - radius * phi)
    for a in (np.arange(n) + 0.5) / n * phi:  # from the foot of the bend: n = (cos a, 0, −sin a), t = (sin a, 0, cos a)
        tension += radius * phi / n * (w * np.cos(a) + mu * abs(tension / radius + w * np.sin(a)))
    assert tension > 1.1 * w * sc.wire.length  # friction is a good part of it
    assert pull(sc, tip)[0] == pytest.approx(tension, rel=0.01)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.0, -2.0)])
def test_margin_over_growth_is_the_speed_of_a_finely_meshed_wire(direction, gravity):
    # A hundredfold drag makes the motion quasi-static; friction, bending, weight and capstan are all in play. The
    # growth is taken at a standstill, where a tail is pressed in bends that tension at speed pulls it out of.
    sc = PAPER.replace(contact__drag=50.0, contact__friction=0.1, gravity=gravity)
    sc = sc.replace(wire__segments=64, timing=Timing(0.05, 10))
    places = np.linspace(0.12, 0.76, 17)
    entries = np.zeros(len(places), dtype=np.int64)
    commands, _ = greatest([sc], entries, places, direction)
    sim = Simulator(sc, len(places))
    sim.reset(places, commands)
    for _ in range(8):
        sim.step(commands)
    tip = sim.tip_arclength
    force = Places(Library([sc]), entries, tip, direction).force(commands)
    held, growth = Tails([sc]).pull(entries, tip, direction)
    speed = (force - held) / growth
    moving = speed > 2e-4
    assert moving.sum() >= 12
    assert direction * sim.tip_velocity[moving] == pytest.approx(speed[moving], rel=0.07, abs=3e-5)


# --- the greatest net force -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lever", "short"), [(False, 1e-5), (True, 1e-4)])
def test_one_axis_as_good_as_trying_all_angles_and_net_is_not_drive(lever, short):
    # With the couple's contacts the force has kinks in the angle: there the search ends within 0.1 mN.
    sc = PAPER.replace(contact__friction=0.4, coupling="wrench", gravity=(0, 0, -9.81), contact__lever_friction=lever)
    places = np.arange(0.09, 0.79, 0.002)
    entries = np.zeros(len(places), dtype=np.int64)
    commands, force = greatest([sc], entries, places)
    here = Places(Library([sc]), entries, places)
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
    assert Places(Library([sc]), entries, places).force(other) == pytest.approx(force, abs=1e-9)
    for axes in (("x", "y"), ("y", "x")):
        mount = dataclasses.replace(sc.rig.magnets[0], dofs=tuple(Turn(a) for a in axes))
        turned = dataclasses.replace(sc, rig=Rig((mount,)))
        q = np.tile([[0.3, 1.1]], (len(places), 1))
        here = Places(Library([turned]), entries, places)
        assert here.force(q) == pytest.approx(here.force([np.pi, np.pi] + q * [-1, 1]), abs=1e-9)


# --- certificates -----------------------------------------------------------------------------------------------------


def test_the_papers_scenario_is_solvable_both_ways_and_its_entrance_is_the_weakest_place():
    forward, back = certificate(PAPER), certificate(PAPER, -1)
    assert forward.solvable
    assert back.solvable
    assert forward.blocked is None
    assert forward.weakest[0] == pytest.approx(0.104, abs=4e-3)
    assert forward.weakest[1] == pytest.approx(1.79e-3, rel=0.03)
    assert 7.0 < forward.traverse_time < 11.0
    assert forward.arclengths[0] < 0.08 < 0.789 < forward.arclengths[-1]
    assert back.arclengths[0] == pytest.approx(0.79)
    assert back.arclengths[-1] == pytest.approx(0.08)
    assert forward.commands.shape == (len(forward.arclengths), 1)
    assert "solvable, weakest 1.7" in str(forward)


def test_the_papers_scenario_is_blocked_under_the_energy_consistent_coupling():
    found = certificate(PAPER.replace(coupling="wrench"))
    assert not found.solvable
    assert found.blocked == pytest.approx(0.09, abs=0.01)
    assert found.traverse_time == np.inf
    assert found.blocked_command.shape == (1,)
    assert "blocked at 0.09" in str(found)


def test_a_fixed_magnet_does_not_steer_a_straight_tract():
    tract = straight()
    magnet = dataclasses.replace(PAPER.rig.magnets[0], position=above(tract, 0.07), dipoles=())
    found = certificate(PAPER.replace(tract=tract, rig=Rig((magnet,))))
    assert not found.solvable
    assert 0.55 < found.blocked < 0.7  # 0.4 m is below the magnet; the force dies away beyond it
    assert found.margin[-1] < 0.1e-3


def test_blocked_where_time_runs_out_or_the_margin_is_not_trusted():
    found = certificate(PAPER, time_limit=5.0)
    assert not found.solvable
    assert found.blocked is not None
    assert found.traverse_time > 5.0
    picky = certificate(PAPER, reserve=2e-3)
    assert not picky.solvable
    assert picky.blocked is None
    assert "doubtful" in str(picky)


def test_a_wire_the_turning_magnet_can_pull_out_of_the_entrance_is_refused():
    magnet = ActuatedMagnet(BLOCK, (0.05, 0.0, 0.07), (Turn("y"),))
    short = world(
        line(0.3), wire__length=0.03, wire__segments=8, rig=Rig((magnet,)), contact=Contact(), coupling="force"
    )
    found = certificate(short)
    assert found.thrown_out
    assert not found.solvable
    assert not certificate(short, start=0.03).thrown_out


def test_many_at_once_are_as_each_alone_whatever_their_rigs():
    several = [
        PAPER,
        *candidates("SteerAny", "test", 3),
        *candidates("Chase", "test", 2),
        *candidates("Orient", "test", 1),
    ]
    for sc, together in zip(several, certify(several), strict=True):
        alone = certificate(sc)
        assert together.solvable == alone.solvable
        assert together.blocked == alone.blocked
        assert together.margin == pytest.approx(alone.margin, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"direction": 0}, "direction must be 1 or -1"),
        ({"start": -0.1}, r"start must lie in \[0, 0.8\] \(in m\)"),
        ({"goal": 0.9}, "goal must lie in"),
        ({"start": 0.5, "goal": 0.4}, "goal must lie ahead of start"),
        ({"time_limit": 0.0}, "time_limit"),
        ({"reserve": -1.0}, "reserve"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments, message):
    with pytest.raises(ValueError, match=message):
        certificate(PAPER, **arguments)


def test_a_coil_pulls_a_wire_along_its_gradient_and_its_certificate_says_how_far():
    maxwell = Coil("x", uniform=0.0, gradient=0.05, position=(0.2, 0.0, 0.0), current=Current(-10.0, 10.0))
    helmholtz = Coil("x", uniform=1e-3, current=Current(0.0, 10.0))
    sc = world(line(0.4), rig=Rig(coils=(maxwell, helmholtz)), contact=Contact(), wire__length=0.05)
    found = certificate(sc)
    assert found.solvable
    moment, gradient = sc.tip.moment, 0.05 * 10
    assert found.margin == pytest.approx(np.full(len(found.margin), moment * gradient), rel=1e-6)
    assert found.commands[:, 0] == pytest.approx(np.full(len(found.margin), 10.0))
    assert not certificate(sc.replace(rig=Rig(coils=(helmholtz,)))).solvable


# --- placement --------------------------------------------------------------------------------------------------------


def test_the_best_placement_widens_the_margin_and_keeps_its_distance():
    position, found = best_placement(PAPER)
    before = certificate(PAPER, start=0.08).weakest[1]
    moved = dataclasses.replace(PAPER.rig.magnets[0], position=position)
    s = np.linspace(0, PAPER.tract.length, 2000)
    assert moved.distance_to(PAPER.tract.position(s)) >= 0.07 - 1e-5
    assert found.solvable
    assert found.weakest[1] > 1.2 * before
    again = certificate(dataclasses.replace(PAPER, rig=Rig((moved,))))
    assert again.margin == pytest.approx(found.margin, abs=1e-12)


def test_placement_refuses_what_it_cannot_place():
    sliding = ActuatedMagnet(PointDipole(100.0), (0.0, 0.0, 0.1), (Turn("y"), Slide("x", -0.1, 0.1)))
    with pytest.raises(ValueError, match="must be fixed for a placement"):
        best_placement(PAPER.replace(rig=Rig((sliding,))))
    with pytest.raises(ValueError, match="keep_out must be at least"):
        best_placement(PAPER, keep_out=0.03)
    with pytest.raises(ValueError, match="magnet must be a whole number"):
        best_placement(PAPER, magnet=1)
