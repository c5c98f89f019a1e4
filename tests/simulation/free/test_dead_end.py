"""A wire that its drive pushes for a minute against the closed end of a tube."""

import pytest

from tests.fuzz.dead_end import RIGIDITIES, dead_end, pushed


@pytest.mark.parametrize("rigidity", RIGIDITIES)
def test_a_full_push_leaves_nothing_outside_and_the_base_reads_what_pushes_back(rigidity):
    found = pushed(rigidity, 60.0)
    assert found.finite
    assert found.beyond <= 0.0
    assert found.base == pytest.approx(found.against, rel=0.01)
    assert found.most <= 1.01 * dead_end(rigidity).rig.feed.force
    assert found.wall > 0.1
