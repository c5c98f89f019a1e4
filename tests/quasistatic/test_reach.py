"""The record of how far the claim reaches: complete, in order, and what the present code counts."""

import pytest

from magwire_env.quasistatic.reach import FIRST, KINDS, READINGS, TRACTS, drives, reach, recorded
from magwire_env.quasistatic.rigs import RIGS
from magwire_env.scenario.scenario import COUPLINGS


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


def test_more_magnets_raise_the_least_drive_along_the_papers_tract_and_keep_the_torque():
    """PHYSICS.md: 2.9 → 4.2 → 6.7 → 9.6 mN; the median torque does not fall."""
    force = drives(81)[: len(RIGS)]
    least = [1e3 * row.least for row in force]
    assert least == pytest.approx([2.9, 4.2, 6.7, 9.6], abs=0.1)
    assert force[3].torque > force[2].torque * 0.9 > force[0].torque
