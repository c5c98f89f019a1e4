"""The best place for a fixed magnet."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from magwire_env.physics import PointDipole
from magwire_env.quasistatic import certificate
from magwire_env.scenario import ActuatedMagnet, Rig, Scenario, Slide, Turn
from magwire_env.simulation import best_placement

PAPER = Scenario.paper()


def test_the_best_placement_widens_the_margin_and_keeps_its_distance():
    position, found = best_placement(PAPER)
    before = certificate(PAPER, start=0.08).weakest[1]
    moved = dataclasses.replace(PAPER.rig.magnets[0], position=position)
    s = np.linspace(0, PAPER.tract.length, 2000)
    assert moved.distance_to(PAPER.tract.position(s)) >= 0.07 - 1e-5
    assert found.solvable
    assert found.weakest[1] > 1.2 * before
    again = certificate(dataclasses.replace(PAPER, rig=Rig((moved,))))
    assert again.margin == pytest.approx(found.margin, abs=1e-12)


def test_placement_refuses_what_it_cannot_place():
    sliding = ActuatedMagnet(PointDipole(100.0), (0.0, 0.0, 0.1), (Turn("y"), Slide("x", -0.1, 0.1)))
    with pytest.raises(ValueError, match="must be fixed for a placement"):
        best_placement(PAPER.replace(rig=Rig((sliding,))))
    with pytest.raises(ValueError, match="keep_out must be at least"):
        best_placement(PAPER, keep_out=0.03)
    with pytest.raises(ValueError, match="magnet must be a whole number"):
        best_placement(PAPER, magnet=1)
