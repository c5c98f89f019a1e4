"""A free wire's course is its own: bit for bit the same whatever the batch, its place in it, and the process."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from numba import njit

from magwire_env import Scenario, Simulator
from magwire_env.lumen.lumen import Lumen
from magwire_env.simulation import lanes as width
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.free.stepper import actuate
from magwire_env.simulation.lanes import spread
from tests.support.free import fed_fork, paper_free

LANES, PERIODS = 64, 6
SCENES = ("fork", "fork, twists", "tube", "tube, fed, twists")


def scene(name: str) -> Scenario:
    """Wires that touch walls: fed into a fork of bricks and a tube, and dragged through the paper's tube."""
    if name == "tube":
        return paper_free(contact__per_segment=2)
    if name == "tube, fed, twists":
        trunk = Lumen.from_lines([("trunk", [(0, 0, 0), (0.1, 0, 0), (0.2, 0.05, 0)], 4e-3, None)], "bend")
        return fed_fork(twist=True).replace(contact__friction=0.2, lumen=trunk)
    return fed_fork(twist="twists" in name).replace(contact__friction=0.2)


def played(name: str, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """State and readout, (n, …) each, of wires that follow the commands of `lanes` out of 64."""
    scenario, rng = scene(name), np.random.default_rng(4)
    sim = Simulator(scenario, num_envs=len(lanes))
    low, high = np.array([limits[1:] for limits in scenario.rig.limits]).T
    told = rng.uniform(np.maximum(low, -np.pi), np.minimum(high, np.pi), (PERIODS, LANES, len(low)))
    for command in told:
        sim.step(command[lanes])
    return sim.state().wire, sim.readout[:, : len(lanes)].T.copy()


def digest(name: str, lanes: np.ndarray) -> str:
    """What a process tells of the wires."""
    wire, readout = played(name, lanes)
    return hashlib.sha256(wire.tobytes() + readout.tobytes()).hexdigest()


@pytest.mark.parametrize("name", SCENES)
def test_a_wire_goes_the_same_way_in_every_batch_and_place(name):
    wire, readout = played(name, np.arange(LANES))
    assert len(np.unique(wire, axis=0)) > LANES // 2  # a magnet of limited speed goes as far towards any command
    assert (readout != 0.0).any()
    elsewhere = (np.arange(LANES) * 5 + 3) % LANES
    for lanes in (np.arange(1), np.arange(3), np.arange(4), np.arange(5), elsewhere):
        again, read = played(name, lanes)
        assert np.array_equal(again, wire[lanes]), len(lanes)
        assert np.array_equal(read, readout[lanes]), len(lanes)


@pytest.mark.parametrize("name", SCENES)
def test_another_process_goes_the_same_way_in_another_batch(name):
    wire, readout = played(name, np.arange(LANES))
    code = f"from tests.simulation.free.test_lanes import *; print(digest({name!r}, np.arange(5)))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert told == hashlib.sha256(wire[:5].tobytes() + readout[:5].tobytes()).hexdigest()


@njit
def begun(par, lane, nothing, is_turn):
    """Begin a step of 20 ms in every lane of a block whose rig is its base alone."""
    actuate(
        spread(0.0) > 1.0, spread(0.0) < 1.0, par, lane, nothing, is_turn, nothing, nothing, spread(0.02)
    )  # fmt: skip


def test_a_base_at_rest_keeps_every_bit_while_a_neighbour_turns():
    par, lane = (
        np.zeros((at.PAR_SIZE // width.LANES, width.LANES)),
        np.zeros((at.LANE_SIZE // width.LANES, width.LANES)),
    )
    for number in (at.BASE_TX, at.FEED_FORCE, at.FEED_STIFFNESS, at.TWIST_SPEED):
        par[number // width.LANES] = 1.0
    director = slice(at.BASE_MX // width.LANES, at.BASE_MX // width.LANES + 3)
    lane[director] = np.array([1e-9, 0.6, 0.8 + 1e-9])[:, None]
    lane[at.TWIST_WANT // width.LANES, 0] = 1.0
    before = lane[director].copy()
    begun(par.reshape(-1), lane.reshape(-1), np.zeros(width.LANES), np.zeros(0, dtype=np.bool_))
    assert np.array_equal(lane[director, 1:], before[:, 1:])
    assert lane[at.SPUN // width.LANES].tolist() == [0.02] + [0.0] * (width.LANES - 1)
    assert np.linalg.norm(lane[director, 0]) == pytest.approx(1.0, abs=1e-12)
