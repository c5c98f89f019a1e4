"""The substeps that locked and free wires choose, and the wires that are refused."""

import gymnasium as gym
import pytest

from magwire_env import Scenario
from magwire_env.envs import arenas
from magwire_env.scenario.steps import MOST_SUBSTEPS, is_stiff

PAPER = Scenario.paper()


def wire(modulus: float, **changes) -> Scenario:
    return PAPER.replace(wire__axial_modulus=modulus, wire__bending_modulus=modulus, **changes)


@pytest.mark.parametrize("name", ["paper", "hard", "unmeasured"])
def test_the_shipped_scenarios_take_steps_of_50_ms(name):
    scenario = Scenario.load(name)
    assert scenario.timing.substeps is None
    assert scenario.substeps == 2
    assert not is_stiff(scenario)


def test_a_longer_control_period_takes_more_steps():
    slow = PAPER.replace(timing__control_period=1.0)
    assert slow.timing.control_period / slow.substeps <= 0.05


def test_a_stiffer_wire_takes_more_steps():
    counts = [wire(modulus).substeps for modulus in (5.5e5, 1e7, 1e8, 1e9)]
    assert counts == sorted(counts)
    assert counts[-1] > 100
    assert wire(1e8, variation__stiffness=0.5).substeps > wire(1e8).substeps


def test_a_replaced_wire_chooses_anew():
    assert wire(1e8).replace(wire=PAPER.wire).substeps == 2


def test_substeps_that_are_given_stand():
    assert wire(1e8, timing__substeps=3).substeps == 3
    assert wire(2e11, timing__substeps=3).substeps == 3


def test_a_straight_tract_needs_no_more_steps_for_a_stiff_wire():
    from magwire_env.lumen import Tract

    straight = Tract.from_points([(x, 0.0, 0.0) for x in (-0.4, -0.2, 0.0, 0.2, 0.4)])
    assert wire(1e10, tract=straight).substeps == 2


def test_a_wire_too_stiff_is_refused_by_name():
    with pytest.raises(
        ValueError, match=rf"Scenario\.wire\.bending_modulus .* at most {MOST_SUBSTEPS} .*got 2e\+11 Pa"
    ):
        wire(2e11)


def test_a_wire_that_the_magnet_would_tear_out_is_refused_by_name():
    with pytest.raises(ValueError, match=r"Scenario\.wire\.axial_modulus must be at least .* Pa, .*got 1000 Pa"):
        wire(1e3, wire__radius=0.45e-3)


def test_the_file_of_a_scenario_says_nothing_of_substeps_that_it_chooses(tmp_path):
    PAPER.save(tmp_path / "a.toml")
    assert "substeps" not in (tmp_path / "a.toml").read_text()
    assert Scenario.load(tmp_path / "a.toml") == PAPER
    given = PAPER.replace(timing__substeps=4)
    given.save(tmp_path / "b.toml")
    assert Scenario.load(tmp_path / "b.toml") == given


def test_a_free_wire_takes_steps_of_20_ms_and_shorter_ones_if_thick_and_stiff():
    free = PAPER.replace(model="free", wire__segments=24)
    assert free.substeps == 5
    thick, thin = free.replace(wire__bending_modulus=2e11, wire__axial_modulus=2e11), {"wire__radius": 0.2e-3}
    assert thick.substeps > 5
    assert thick.replace(**thin).substeps == 5
    assert thick.replace(wire__segments=48).substeps > thick.substeps
    assert thick.replace(variation__stiffness=0.9).substeps > thick.substeps
    assert thick.replace(timing__substeps=5).substeps == 5


@pytest.mark.parametrize("scenario", [arenas.arch(), arenas.dragged(), arenas.clamped()])
def test_arenas_of_free_wires_take_steps_of_20_ms(scenario):
    assert scenario.model == "free"
    own = scenario.replace(timing__substeps=None).substeps
    assert scenario.timing.control_period / own == pytest.approx(0.02)


@pytest.mark.parametrize("task", ["MagWire/SteerAny-v0", "MagWire/Orient-v0", "MagWire/Chase-v0", "MagWire/Dual-v0"])
def test_generated_tasks_take_steps_of_50_ms(task):
    envs = gym.make_vec(task, num_envs=1, pool_size=4)
    assert {scenario.substeps for scenario in envs.unwrapped.core.sim.library.scenarios} == {2}
