"""Certificates: what follows from the balance and the best command."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from magwire_env.lumen import Tract, straight
from magwire_env.quasistatic import certificate
from magwire_env.quasistatic.pool import candidates
from magwire_env.scenario import ActuatedMagnet, Coil, Contact, Current, Rig, Scenario, Turn, above
from magwire_env.simulation import certify
from tests.support.scenes import line, world

PAPER = Scenario.paper()
BLOCK = PAPER.rig.magnets[0].magnet


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
    assert found.blocked is None  # 0.4 m is below the magnet; the force dies away beyond it, but not quite
    assert "too slow" in str(found)
    assert found.traverse_time > 2 * found.time_limit
    assert found.margin[-1] < 0.1e-3


def test_too_slow_where_time_runs_out_and_doubtful_where_the_margin_is_not_trusted():
    found = certificate(PAPER, time_limit=5.0)
    assert not found.solvable
    assert found.blocked is None
    assert "too slow" in str(found)
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


def test_a_long_tract_takes_no_more_than_its_length():
    """Of 80 m, which once took 40 s: the time grew with the square of the length."""
    along = np.linspace(0, 80, 2000)
    tract = Tract.from_points(np.stack([along, 0.02 * np.sin(6 * along), 0 * along], axis=1), radius=7.5e-3)
    certificate(PAPER)  # compiles
    began = time.process_time()
    found = certificate(PAPER.replace(tract=tract))
    assert time.process_time() - began < 10.0
    assert len(found.arclengths) > 10_000
    assert not found.solvable
