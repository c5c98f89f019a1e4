"""Rigs of a batch's lanes: what is kept of them."""

import dataclasses

import numpy as np

from magwire_env import Scenario, Simulator
from magwire_env.scenario import Rig
from magwire_env.simulation.lanes import LANES

PAPER = Scenario.paper()


def with_grid(count: int) -> Scenario:
    """The paper's scenario with a magnet of count³ dipoles."""
    magnet = dataclasses.replace(PAPER.rig.magnets[0], dipoles=("grid", (count, count, count)))
    return PAPER.replace(name=f"grid {count}", rig=Rig((magnet,)))


def test_lanes_that_change_their_magnets_for_ever_fill_no_memory():
    """A block of lanes shares one table of dipoles; every new mix of magnets in it makes a new one."""
    sim = Simulator([with_grid(count) for count in (2, 3, 4, 5)], 64, lane_scenario=np.zeros(64, dtype=np.int64))
    rng, lanes = np.random.default_rng(0), np.arange(64)
    for _ in range(100):
        sim.assign(lanes, rng.integers(0, 4, 64))
    blocks = -(-64 // LANES)
    assert len(sim.rig._clouds) == len(sim.rig._tables) <= 2 * blocks + 2  # 100 mixes a block came by
    entries = rng.integers(0, 4, 64)
    sim.assign(lanes, entries)
    fresh = Simulator([with_grid(count) for count in (2, 3, 4, 5)], 64, lane_scenario=entries)
    for one in (sim, fresh):
        one.reset(tip_arclength=0.3)
        one.step(np.full((64, 1), 3.5))
    assert np.array_equal(sim.tip_force, fresh.tip_force)
    assert sim.state() == fresh.state()
