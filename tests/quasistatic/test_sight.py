"""How magnets stand to the tract ahead: the numbers that a force law needs, and no force."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from magwire_env.physics.dipoles import MU0
from magwire_env.quasistatic.pool import scenario_pool
from magwire_env.quasistatic.preview import DrivePreview
from magwire_env.quasistatic.sight import SightPreview, own_dofs
from magwire_env.scenario import Coil, Rig, Scenario
from magwire_env.simulation import Simulator

OFFSETS = np.array([0.0, 0.03])


def simulator(kind: str) -> Simulator:
    """Two wires of a kind's pool at work, their magnets anywhere."""
    sim = Simulator([Scenario.paper()] * 2 if kind == "paper" else scenario_pool(kind, "train", 2))
    low, high = (np.array([d[i] for d in sim.scenarios[0].rig.limits]) for i in (1, 2))
    sim.reset(magnet=np.random.default_rng(3).uniform(low, high, (2, sim.dof)))
    return sim


@pytest.mark.parametrize("kind", ["paper", "Orient", "Chase", "Dual"])
def test_the_dipole_law_makes_the_drive_and_its_slopes_of_the_numbers_seen(kind):
    sim = simulator(kind)
    seen, drives = SightPreview(sim, OFFSETS, 0.1), DrivePreview(sim, OFFSETS, np.ones(sim.dof))
    numbers, wanted = seen.read(), drives.read().reshape(2, len(OFFSETS), 1 + sim.dof)
    library, column = sim.library, 0
    got = np.zeros_like(wanted)
    for k in range(len(OFFSETS)):
        for m in range(library.magnet_count):
            size = 2 + len([d for d in own_dofs(library.rigs.slots[m]) if library.is_turn[d]])
            triples = numbers[:, column : column + 3 * size].reshape(2, size, 3)
            column += 3 * size + 3 * len([d for d in own_dofs(library.rigs.slots[m]) if not library.is_turn[d]])
            c, r, bent = triples[:, 0, 0], 0.1 * triples[:, 0, 1], triples[:, 0, 2] / 0.1
            for i, sc in enumerate(sim.scenarios):
                turns = [d for d in own_dofs(library.rigs.slots[m]) if library.is_turn[d]]
                strength = 1e-7 * sc.rig.magnets[m].magnet.moment * sc.tip.moment
                for place, (along, line, curved) in zip([0, *(1 + d for d in turns)], triples[i, 1:], strict=True):
                    force = 3 * ((1 - 5 * c[i] ** 2) * line + 2 * c[i] * along) / r[i]
                    couple = 3 * bent[i] * line - curved / 0.1 if sc.coupling == "wrench" else 0.0
                    got[i, k, place] += strength * (force + couple) / r[i] ** 3
    assert column == numbers.shape[1]
    turns = [0, *(1 + np.flatnonzero(library.is_turn))]
    np.testing.assert_allclose(got[..., turns], wanted[..., turns], rtol=1e-9, atol=1e-12)
    assert abs(wanted).max() > 1e-4
    assert np.isclose(MU0 / (4 * np.pi), 1e-7, rtol=1e-8)


def test_a_slide_shows_its_axis():
    sim = simulator("Chase")
    numbers = SightPreview(sim, OFFSETS[:1], 0.1).read()
    at, centre = sim.model.ahead(OFFSETS[:1])[:, 0], sim.magnet_positions[:, 0]
    line = at[:, :3] - centre
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    slides = [d for d in own_dofs(sim.library.rigs.slots[0]) if not sim.library.is_turn[d]]
    assert len(slides) == 2
    for i in range(len(slides)):  # x, then y
        seen = numbers[:, -6 + 3 * i : numbers.shape[1] - 3 + 3 * i]
        np.testing.assert_allclose(seen, np.stack([at[:, 3 + i], line[:, i], 0.1 * at[:, 6 + i]], axis=1), rtol=1e-12)


def test_a_rig_without_magnets_shows_none():
    coils = Scenario.paper().replace(rig=Rig(coils=(Coil("x"),)))
    assert gym.make(
        "MagWire/Steer-v1", scenario=coils, observe=("magnet", "magnet_preview")
    ).observation_space.shape == (1,)
    with pytest.raises(ValueError, match="observe must show a number; with this rig magnet_preview shows none"):
        gym.make("MagWire/Steer-v1", scenario=coils, observe=("magnet_preview",))
