"""Walls in bricks come back from the disk: of tubes and of surfaces, and of no other lumen."""

from __future__ import annotations

import numpy as np
import pytest

from agents.cli.anatomy import scene_of
from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.named_trees import fork
from magwire_env.lumen.surface import Surface
from magwire_env.simulation.free import walls
from magwire_env.simulation.free.kept_walls import _Kept, kept_walls
from tests.support import lumen_writers as writers


def lumen(kind: str) -> Lumen:
    """A short fork of tubes, or with its mesh as its wall."""
    known = fork(35.0, 4e-3, 0.02)
    if kind == "tubes":
        return known
    vertices, faces = writers.meshed(known, 1e-3)
    return known.replace(wall=Surface(1e-3 * vertices, faces))


@pytest.mark.parametrize("kind", ["tubes", "surface"])
def test_a_wall_is_made_once(kind, tmp_path, monkeypatch):
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path))
    monkeypatch.setattr(_Kept, "walls", {})
    scene = scene_of(lumen(kind))
    first = walls.Walls([scene])
    assert len(list(kept_walls().glob("*.npz"))) == 1

    def refused(*_):
        raise AssertionError("it is made again")

    monkeypatch.setattr(_Kept, "walls", {})
    monkeypatch.setattr(walls, "Bricks", refused)
    again = walls.Walls([scene])
    assert np.array_equal(first.grid, again.grid)
    assert np.array_equal(first.fields, again.fields, equal_nan=True)
    if kind == "surface":
        moved = scene.lumen.wall.vertices + [0.0, 1e-6, 0.0]
        other = scene.replace(lumen=scene.lumen.replace(wall=Surface(moved, scene.lumen.wall.faces)))
        with pytest.raises(AssertionError, match="made again"):
            walls.Walls([other])
