"""The balance of the whole wire."""

from __future__ import annotations

import numpy as np
import pytest

from magwire_env.physics import Tract
from magwire_env.quasistatic.balance import Tails
from magwire_env.quasistatic.net_force import TipForces, greatest
from magwire_env.scenario import Contact, Scenario, Timing
from magwire_env.simulation import Library, Simulator
from tests.support.scenes import bent, world

PAPER = Scenario.paper()
FIRST = np.zeros(1, dtype=np.int64)


def pull(scenario, tip, direction=1.0):
    force, growth = Tails([scenario]).resistance(FIRST, np.array([tip]), direction)
    return force[0], growth[0]


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
    force = TipForces(Library([sc]), entries, tip, direction).force(commands)
    held, growth = Tails([sc]).resistance(entries, tip, direction)
    speed = (force - held) / growth
    moving = speed > 2e-4
    assert moving.sum() >= 12
    assert direction * sim.tip_velocity[moving] == pytest.approx(speed[moving], rel=0.07, abs=3e-5)
