"""Coils: a commanded field with its gradient, alone or beside magnets."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env import Scenario, Simulator
from magwire_env.scenario import Coil, Current, Rig
from magwire_env.simulation import best_command

COILS = (Coil("x", 2e-3), Coil("y", 2e-3, 0.02, (0.0, 0.01, 0.0)), Coil("z", 0.0, 0.05, (0.01, 0.02, 0.03)))


def with_coils(*magnets, coils=COILS, **changes):
    return Scenario.paper().replace(name="coils", rig=Rig(magnets, coils), **changes)


def field(points, currents):
    return sum(coil.field(points, i) for coil, i in zip(COILS, currents, strict=True))


def test_the_field_of_a_coil_is_free_of_divergence_and_curl():
    points = np.random.default_rng(0).normal(0, 0.05, (20, 3))
    step = 1e-3 * np.eye(3)
    for coil in COILS:
        slope = np.stack([(coil.field(points + e, 3.0) - coil.field(points - e, 3.0)) / 2e-3 for e in step], axis=2)
        assert np.trace(slope, axis1=1, axis2=2) == pytest.approx(0, abs=1e-12)
        assert slope == pytest.approx(slope.transpose(0, 2, 1), abs=1e-12)


@pytest.mark.parametrize("currents", [(1.0, 2.0, 3.0), (0.0, 0.0, -4.0), (5.0, -1.0, 0.0)])
def test_the_kernel_feels_the_coils_field_and_gradient(currents):
    sim = Simulator(with_coils())
    sim.reset(0.3, magnet=[currents])
    tip, moment = sim.tip_position, sim.scenarios[0].tip.moment * sim.tip_tangent[0]
    assert sim.tip_field == pytest.approx(field(tip, currents), rel=1e-9, abs=1e-15)
    slope = np.stack([(field(tip + e, currents) - field(tip - e, currents))[0] / 2e-3 for e in 1e-3 * np.eye(3)])
    assert sim.tip_force[0] == pytest.approx(slope @ moment, rel=1e-9, abs=1e-15)


def test_coils_add_to_magnets():
    magnets = Scenario.paper().rig.magnets
    both, alone, coils = Simulator(with_coils(*magnets)), Simulator(Scenario.paper()), Simulator(with_coils())
    both.reset(0.4, magnet=[[3.5, 1.0, 2.0, 3.0]])
    alone.reset(0.4, magnet=[[3.5]])
    coils.reset(0.4, magnet=[[1.0, 2.0, 3.0]])
    assert both.tip_force == pytest.approx(alone.tip_force + coils.tip_force, rel=1e-9)
    assert both.tip_field == pytest.approx(alone.tip_field + coils.tip_field, rel=1e-9)
    assert both.magnet_positions.shape == (1, 1, 3)


def test_a_current_keeps_to_its_speed_and_range():
    sim = Simulator(with_coils(coils=(Coil("x", current=Current(-2, 2, speed=10)),)))
    sim.reset()
    seen = []
    for _ in range(3):
        sim.step([[9.0]])
        seen.append(sim.magnet[0, 0])
    assert seen == pytest.approx([1.0, 2.0, 2.0])


def test_a_scenario_with_coils_is_saved_read_and_trained_on(tmp_path):
    scenario = with_coils(*Scenario.paper().rig.magnets, coupling="wrench")
    scenario.save(tmp_path / "coils.toml")
    assert Scenario.load(tmp_path / "coils.toml") == scenario
    env = gym.make("MagWire/Steer-v0", scenario=scenario)
    observation, _ = env.reset(seed=0)
    assert env.action_space.shape == (4,)
    assert observation.shape == (5 + 2 + 3,)
    assert np.isfinite(env.step(np.ones(4, dtype=np.float32))[0]).all()


def test_three_gradient_coils_drive_the_wire_anywhere_on_the_paper_tract():
    strong = tuple(Coil(axis, 0.0, 0.3) for axis in "xyz")
    scenario = with_coils(coils=strong)
    commands, drive = best_command(scenario, np.linspace(0.1, 0.79, 12))
    assert drive.min() > 5e-3
    assert np.abs(commands).max() <= 10.0


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Coil("w"), "Coil.axis must be one of 'x', 'y', 'z', got 'w'"),
        (lambda: Coil("x", 0.0, 0.0), "Coil.uniform and Coil.gradient must not both be 0"),
        (lambda: Current(1.0, -1.0), r"Current.home must lie in \[low, high\]"),
        (lambda: Rig(), "Rig.magnets and Rig.coils must hold at least one"),
        (
            lambda: Simulator([with_coils(), with_coils(coils=COILS[::-1])]),
            r"scenario\[1\].rig must have the batch's degrees of freedom",
        ),
    ],
)
def test_refusals(build, words):
    with pytest.raises(ValueError, match=words):
        build()
