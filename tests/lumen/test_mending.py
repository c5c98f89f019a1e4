"""Nothing is silently wrong: what is put right in a surface is said, the rest is refused with its place."""

import numpy as np
import pytest

from magwire_env.lumen.files import UNITS
from magwire_env.lumen.loading import LumenNote
from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.mending import RawSurface, mended
from magwire_env.lumen.units import settled_unit
from tests.support import lumen_writers as writers


def told(vertices, faces, **arguments):
    notes = []
    surface, openings = mended("a.stl", RawSurface(vertices, faces), notes, **arguments)
    return surface, openings, "; ".join(notes)


def open_fork():
    vertices, faces = writers.mesh()
    return vertices, writers.opened(writers.the_fork(), vertices, faces)


def tube(radius=4.0, length=40.0, shift=(0.0, 0.0, 0.0), around=24, along=20):
    """An open tube along x: vertices and faces with normals outwards, mm."""
    turn = 2 * np.pi * np.arange(around) / around
    x = np.linspace(0.0, length, along + 1)
    grid = np.stack(np.broadcast_arrays(x[:, None], radius * np.cos(turn), radius * np.sin(turn)), axis=-1)
    number = np.arange((along + 1) * around).reshape(along + 1, around)
    a, b = number[:-1], np.roll(number, -1, axis=1)[:-1]
    c, d = number[1:], np.roll(number, -1, axis=1)[1:]
    faces = np.concatenate([np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([b, d, c], axis=-1).reshape(-1, 3)])
    return grid.reshape(-1, 3) + shift, faces[:, ::-1]


def joined(*meshes):
    counts = np.cumsum([0, *(len(v) for v, _ in meshes)])
    faces = [f + n for (_, f), n in zip(meshes, counts, strict=False)]
    return np.concatenate([v for v, _ in meshes]), np.concatenate(faces)


def test_open_ends_are_capped_and_said():
    surface, openings, notes = told(*open_fork())
    assert len(openings) == 1
    assert openings[0].centre == pytest.approx([0, 0, 0], abs=0.2)
    assert openings[0].out == pytest.approx([-1, 0, 0], abs=1e-2)
    assert "1 open ends are capped" in notes
    assert surface.volume == pytest.approx(3395, rel=0.03)  # mm³


def test_inward_normals_are_turned_and_said():
    vertices, faces = open_fork()
    surface, _, notes = told(vertices, faces[:, ::-1])
    assert "its normals pointed inwards: they are turned" in notes
    assert surface.volume > 0
    mixed = faces.copy()
    mixed[::7] = mixed[::7, ::-1]
    assert "faces that pointed the other way than the neighbours" in told(vertices, mixed)[2]


def test_doubled_and_flat_faces_are_dropped_and_said():
    vertices, faces = open_fork()
    more = np.concatenate([faces, faces[:5], [[3, 3, 9]]])
    notes = told(vertices, more)[2]
    assert "dropped: 5 doubled faces" in notes
    assert "dropped: 1 face without an area" in notes


def test_several_pieces_are_refused_unless_one_is_meant():
    two = joined(tube(), tube(shift=(0, 30, 0)))
    with pytest.raises(ValueError, match=r"a\.stl holds 2 separate pieces .*\(20, 0, 0\)|.*about \(20, 30.*inlet="):
        told(*two)
    surface, _, notes = told(*two, near=np.array([0.0, 30.0, 0.0]))
    assert "the one nearest to the inlet is taken" in notes
    assert surface.bounds[0][1] == pytest.approx(26.0, abs=0.1)
    speck = joined(tube(), tube(radius=0.2, length=1.0, shift=(0, 30, 0)))
    assert "dropped: 1 small separate piece, the first at (" in told(*speck)[2]


def test_a_surface_that_crosses_itself_is_refused_with_the_place():
    v, f = tube(length=40.0)
    bent = v.copy()
    bent[:, 1] += 8.0 * np.sin(v[:, 0] / 40.0 * 2 * np.pi)
    told(bent, f)  # a bend alone is sound
    folded = v.copy()
    folded[:, 0] = np.where(v[:, 0] > 20, 40 - v[:, 0], v[:, 0])
    folded[:, 1] += np.where(v[:, 0] > 20, 3.0, 0.0)
    with pytest.raises(ValueError, match=r"a\.stl crosses itself: \d+ of its \d+ faces cut others, the first at \("):
        told(folded, f)


def test_a_hole_in_the_wall_is_refused_or_closed():
    vertices, faces = tube(around=40, along=60)
    middle = vertices[faces].mean(axis=1)
    holed = faces[np.linalg.norm(middle - (20, 4, 0), axis=1) > 0.9]
    with pytest.raises(ValueError, match=r"has a hole in its wall at \(20\.?\d*, .* wide.*holes='close'"):
        told(vertices, holed)
    _, openings, notes = told(vertices, holed, holes="close")
    assert len(openings) == 2
    assert "a hole in the wall at (" in notes


def plate(path):
    """A block of 40 × 12 × 12 mm with a straight channel of 3 mm radius, as STL."""
    import trimesh

    inner, wall = tube(radius=3.0, around=32, along=4), []
    ring = inner[0].reshape(5, 32, 3)
    for at, flip in ((0, False), (-1, True)):
        outer = []
        for y, z in ring[at][:, 1:]:  # a square about the circle
            reach = 6.0 / max(abs(y), abs(z))
            outer.append((ring[at][0, 0], reach * y, reach * z))
        wall.append((ring[at], np.array(outer), flip))
    vertices, faces = [inner[0]], [inner[1][:, ::-1]]
    count = len(inner[0])
    rims = []
    for circle, square, flip in wall:
        n = len(circle)
        vertices += [circle, square]
        a = count + np.arange(n)
        b, c, d = np.roll(a, -1), a + n, np.roll(a, -1) + n
        side = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
        faces.append(side[:, ::-1] if flip else side)
        rims.append(count + n + np.arange(n))
        count += 2 * n
    a, c = rims
    b, d = np.roll(a, -1), np.roll(c, -1)
    faces.append(np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])[:, ::-1])
    mesh = trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=True)
    mesh.merge_vertices()
    mesh.fix_normals()
    mesh.export(path)
    return np.array(mesh.vertices), np.array(mesh.faces)


def test_a_block_with_a_channel_is_the_material_and_its_channel_can_be_asked_for(tmp_path):
    vertices, faces = plate(tmp_path / "plate.stl")
    with pytest.raises(ValueError, match=r"looks like the material.*1 channels through it; pass invert=True"):
        told(vertices, faces)
    with pytest.warns(LumenNote, match="the channel's ends are closed"):
        lumen = Lumen.load(tmp_path / "plate.stl", "mm", (0, 0, 0), invert=True, cache=False, progress=False)
    assert lumen.leaves == ("b0",)
    assert lumen.wall_distance(np.array([0.02, 0.0, 0.0])) == pytest.approx(3e-3, rel=0.05)
    assert not lumen.contains(np.array([0.02, 0.005, 0.0]))


def test_a_lumen_that_is_closed_on_its_way_is_refused():
    """Two open tubes, one of which is meant to be reached from the other: pieces apart."""
    with pytest.raises(ValueError, match="separate pieces"):
        told(*joined(tube(), tube(shift=(60, 0, 0))))


def test_units_are_guessed_from_the_size_and_said():
    notes = []
    assert settled_unit("a.stl", "", None, 300.0, 4.0, notes) == UNITS["mm"]
    assert "no unit is declared: taken as mm, so it is 30 cm long with a typical radius of 4 mm" in notes[0]
    notes = []
    assert settled_unit("a.stl", "", "m", 300.0, 4.0, notes) == UNITS["m"]
    assert "in m this is a lumen 300 m long with a typical radius of 4 m: is the unit right?" in notes[0]
    with pytest.raises(ValueError, match=r"a\.stl declares its coordinates in 'mm', but unit='m' was passed"):
        settled_unit("a.stl", "mm", "m", 300.0, 4.0, [])
    with pytest.raises(ValueError, match=r"none makes it a usual lumen .*pass unit='mm'"):
        settled_unit("a.stl", "", None, 3e9, 4.0, [])


def test_an_inlet_far_away_and_a_kink_are_refused_with_the_place(tmp_path):
    (tmp_path / "a.stl").write_bytes(writers.surfaces()["binary.stl"])
    with pytest.raises(ValueError, match=r"a\.stl inlet must be a point at an end .*got \(500, 0, 0\)"):
        Lumen.load(tmp_path / "a.stl", "mm", (500, 0, 0), cache=False, progress=False)
    line = np.array([(x, 0, 0) for x in range(0, 30, 3)] + [(27 - x, 0.5, 0) for x in range(3, 27, 3)], dtype=float)
    (tmp_path / "a.mrk.json").write_bytes(writers.markups({"back": (line, np.full(len(line), 0.2))}))
    with pytest.raises(ValueError, match=r"branch 'back' has a kink of 1\d\d° at \(2\d.*at most 75°"):
        Lumen.load(tmp_path / "a.mrk.json", cache=False, progress=False)
