"""The record of how far the claim reaches: complete, in order, and what the present code counts."""

import numpy as np
import pytest

from magwire_env.lumen.generator import generate
from magwire_env.quasistatic.certificate import certify
from magwire_env.quasistatic.reach import (
    FIRST,
    KINDS,
    READINGS,
    TRACTS,
    distance,
    drives,
    reach,
    recorded,
    scenario_of,
)
from magwire_env.quasistatic.rigs import RIGS
from magwire_env.scenario.scenario import COUPLINGS
from magwire_env.validation.claims import greatest_margin


def test_the_record_holds_every_case_once():
    rows = recorded()
    cases = [(row.tracts, row.reading, row.coupling, row.rig) for row in rows]
    assert cases == [(t, d, c, r) for t in KINDS for d in READINGS for c in COUPLINGS for r in RIGS]
    for row in rows:
        assert row.number == TRACTS
        assert 0 <= row.both <= min(row.forward, row.back)
        assert row.first <= FIRST


@pytest.mark.parametrize("index", [0, 6, 16, 19, 22, 31])
def test_the_first_tracts_of_the_record_are_counted_again(index):
    row = recorded()[index]
    now = reach(row.tracts, row.reading, row.rig, row.coupling, FIRST)
    assert now.first == now.forward == row.first


def test_more_magnets_raise_the_least_drive_along_the_papers_tract_and_spare_torque_at_equal_drive():
    """PHYSICS.md: 2.9 → 4.2 → 6.7 → 9.6 mN; the median torque at these drives does not fall."""
    force, wrench = (drives(41)[first : first + len(RIGS)] for first in (0, len(RIGS)))
    least = [1e3 * row.least for row in force]
    assert least == pytest.approx([2.9, 4.2, 6.7, 9.6], abs=0.1)
    assert force[3].torque > force[2].torque * 0.9 > force[0].torque
    for first, *others in (force, wrench):
        assert 0.9 * first.torque < first.spared <= first.torque
        assert all(row.spared < 0.9 * first.spared for row in others)


def test_the_7_cm_end_at_the_centre_or_half_an_edge_farther():
    assert distance("centre") == 0.07
    assert distance("face") == pytest.approx(0.07 + 0.0254)
    with pytest.raises(ValueError, match="reading must be one of 'centre', 'face', got 'edge'"):
        distance("edge")


@pytest.mark.parametrize(("reading", "coupling"), [("centre", "force"), ("face", "wrench")])
def test_the_weakest_margin_of_a_tract_is_that_of_the_plain_balance(reading, coupling):
    """`validation.claims` balances the wire by another integration, and tries every half degree."""
    kind, rig = "bends of 40 mm or more", "one magnet, one axis"
    scenario = scenario_of(generate(0, "test", KINDS[kind]), rig, reading, coupling)
    at, weakest = certify([scenario], start=scenario.wire.length)[0].weakest
    assert reach(kind, reading, rig, coupling, 1).weakest == weakest
    assert greatest_margin(scenario, at, 1.0) == pytest.approx(weakest, abs=3e-5)
    for s in np.linspace(scenario.wire.length, scenario.tract.length - 0.01, 12):
        assert greatest_margin(scenario, float(s), 1.0) > weakest - 3e-5
