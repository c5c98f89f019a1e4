"""A surface as a file gave it, checked and mended: what is harmless is put right and said, the rest is refused."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ..words import counted
from .crossings import crossing_faces
from .surface import Surface, boundary_loops, edge_uses, pieces

__all__ = ["Opening", "RawSurface", "mended"]

_SPECK = 0.02
"""A separate piece with less than this share of the largest one's area is dropped, and said."""

_FLUSH = 0.35
"""An opening narrower than this share of the lumen beneath it is a hole in the wall, not an end."""


@dataclass
class RawSurface:
    """What a surface's file holds: vertices (n, 3) in the file's unit, and faces (m, 3)."""

    vertices: np.ndarray
    faces: np.ndarray


@dataclass
class Opening:
    """An open end: the vertices round it, its middle (3,), the direction out of it (3,), and its radius."""

    loop: np.ndarray
    centre: np.ndarray
    out: np.ndarray
    radius: float


@dataclass
class _Told:
    """What the user is told: places in the file's own coordinates."""

    path: str
    notes: list[str] = field(default_factory=list)

    def refuse(self, text: str) -> ValueError:
        return ValueError(f"{self.path} {text}")


def mended(
    path: str,
    raw: RawSurface,
    notes: list[str],
    near: np.ndarray | None = None,
    invert: bool = False,
    holes: str = "refuse",
) -> tuple[Surface, list[Opening]]:
    """The surface closed and turned outwards, still in the file's unit, and its open ends.

    near : a point in or at the piece that is meant, where the file holds several of similar size
    invert : the file is the material about the lumen
    holes : "refuse" or "close" openings in the wall that are no ends

    Adds a sentence to `notes` for each thing put right. Raises `ValueError` naming the file, the fault and its place.
    """
    told = _Told(path, notes)
    vertices, faces = _welded(told, raw)
    vertices, faces = _one_piece(told, vertices, faces, near, invert)
    _refuse_fins(told, vertices, faces)
    faces = _turned_alike(told, vertices, faces)
    loops = boundary_loops(faces)
    openings = [_opening(vertices, loop) for loop in loops]
    closed_vertices, closed_faces = _capped(vertices, faces, openings)
    surface = Surface(closed_vertices, closed_faces)
    if surface.volume < 0:
        surface = Surface(closed_vertices, closed_faces[:, ::-1])
        openings = [Opening(o.loop[::-1], o.centre, -o.out, o.radius) for o in openings]
        if not invert:
            notes.append("its normals pointed inwards: they are turned")
    _refuse_crossings(told, vertices, faces)
    openings = _told_ends(told, surface, openings, holes)
    if not invert:
        _refuse_material(told, surface, openings)
    return surface, openings


def _at(point: np.ndarray) -> str:
    return "({:.6g}, {:.6g}, {:.6g})".format(*point)


def _welded(told: _Told, raw: RawSurface) -> tuple[np.ndarray, np.ndarray]:
    """Vertices at the same place made one; faces without an area and doubled ones dropped."""
    vertices, faces = np.asarray(raw.vertices, dtype=np.float64), np.asarray(raw.faces, dtype=np.int64)
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or faces.ndim != 2 or faces.shape[1:] != (3,):
        raise told.refuse("must hold triangles in space")
    if not len(faces):
        raise told.refuse("must hold faces, got none")
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = faces[(faces < 0) | (faces >= len(vertices))][0]
        raise told.refuse(f"must have faces of its vertices 0 to {len(vertices) - 1}, got {wrong}")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise told.refuse(f"must have finite vertices, got {vertices[bad[0]].tolist()} for vertex {bad[0]}")
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    size = float(np.ptp(vertices, axis=0).max())
    if size <= 0:
        raise told.refuse("must have an extent, but all its vertices lie at one place")
    if np.abs(vertices).max() > 1e12 * size:
        raise told.refuse(
            f"must lie nearer to its origin, got coordinates {np.abs(vertices).max() / size:.3g} times its size"
        )
    cell = 1e-7 * size
    _, first, same = np.unique(
        np.round(vertices / cell).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    vertices, faces = vertices[first], same.ravel()[faces]
    flat = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    faces = faces[~flat]
    if not len(faces):
        raise told.refuse("must hold faces with an area, got none")
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    doubled = len(faces) - len(kept)
    faces = faces[np.sort(kept)]
    if doubled:
        told.notes.append(f"dropped: {counted(doubled, 'doubled face')}")
    if flat.sum():
        told.notes.append(f"dropped: {counted(int(flat.sum()), 'face')} without an area")
    return vertices, faces


def _one_piece(
    told: _Told, vertices: np.ndarray, faces: np.ndarray, near: np.ndarray | None, invert: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The piece that is meant; a piece inside another means a wall with a thickness, so material."""
    count, label = pieces(faces, len(vertices))
    if count == 1:
        return vertices, faces
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    areas = np.bincount(label, weights=area)
    large = np.flatnonzero(areas >= _SPECK * areas.max())
    specks = count - len(large)
    if specks:
        where = corners[np.isin(label, large, invert=True)][0].mean(axis=0)
        told.notes.append(f"dropped: {counted(specks, 'small separate piece')}, the first at {_at(where)}")
    if len(large) > 1 and not invert:
        middles = [corners[label == k].reshape(-1, 3) for k in large]
        for i, inner in zip(large, middles, strict=True):
            for j in large:
                if (
                    i != j
                    and not len(boundary_loops(faces[label == j]))
                    and _lies_in(inner, vertices, faces[label == j])
                ):
                    raise told.refuse(
                        f"has a closed piece inside another, at {_at(inner[0])}: it is the material about the lumen; "
                        "pass invert=True"
                    )
        if near is None:
            shown = "; ".join(f"{len(m) // 3} faces about {_at(m.mean(axis=0))}" for m in middles[:6])
            raise told.refuse(
                f"holds {len(large)} separate pieces of similar size ({shown}); join them, or choose one with "
                "inlet=(x, y, z)"
            )
        apart = [np.linalg.norm(m - near, axis=1).min() for m in middles]
        large = large[[int(np.argmin(apart))]]
        told.notes.append(f"of {len(middles)} separate pieces the one nearest to the inlet is taken")
    faces = faces[np.isin(label, large)]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def _lies_in(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> bool:
    outer = Surface(vertices, faces)
    sample = points[:: max(1, len(points) // 50)]
    inside = outer.inside(sample) if outer.volume > 0 else Surface(vertices, faces[:, ::-1]).inside(sample)
    return bool(inside.all())


def _refuse_fins(told: _Told, vertices: np.ndarray, faces: np.ndarray) -> None:
    edges, uses = edge_uses(faces)
    many = np.flatnonzero(uses > 2)
    if many.size:
        where = vertices[edges[many[0]]].mean(axis=0)
        raise told.refuse(
            f"has {many.size} edges with more than two faces, the first at {_at(where)}: walls stand inside the lumen "
            "or touch; mend it in a mesh editor"
        )


def _turned_alike(told: _Told, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces turned so that neighbours run their common edge in opposite directions."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    key = directed[:, 0] * len(vertices) + directed[:, 1]
    if len(np.unique(key)) == len(key):
        return faces
    owner = np.repeat(np.arange(len(faces)), 3)
    ends = np.sort(directed, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    same = (ends[order][1:] == ends[order][:-1]).all(axis=1)
    a, b = order[:-1][same], order[1:][same]
    against = directed[a, 0] == directed[b, 0]  # both run the edge the same way
    neighbours: dict[int, list[tuple[int, bool]]] = {}
    for f, g, turned in zip(owner[a].tolist(), owner[b].tolist(), against.tolist(), strict=True):
        neighbours.setdefault(f, []).append((g, turned))
        neighbours.setdefault(g, []).append((f, turned))
    flip = np.full(len(faces), -1)
    for seed in range(len(faces)):
        if flip[seed] >= 0:
            continue
        flip[seed], waiting = 0, [seed]
        while waiting:
            f = waiting.pop()
            for g, turned in neighbours.get(f, ()):
                wanted = flip[f] ^ int(turned)
                if flip[g] < 0:
                    flip[g] = wanted
                    waiting.append(g)
                elif flip[g] != wanted:
                    raise told.refuse(f"cannot be oriented: it is one-sided at {_at(vertices[faces[g]].mean(axis=0))}")
    turned_faces = min(int(flip.sum()), int((1 - flip).sum()))
    told.notes.append(f"turned: {counted(turned_faces, 'face')} that pointed the other way than the neighbours")
    return np.where(flip[:, None] == 1, faces[:, ::-1], faces)


def _opening(vertices: np.ndarray, loop: np.ndarray) -> Opening:
    ring = vertices[loop]
    following = np.roll(ring, -1, axis=0)
    lengths = np.linalg.norm(following - ring, axis=1)
    centre = ((ring + following) / 2 * lengths[:, None]).sum(axis=0) / lengths.sum()
    area = np.cross(ring - centre, following - centre).sum(axis=0) / 2
    size = float(np.linalg.norm(area))
    # The faces run the loop with the lumen's wall on its left, so the cap runs it backwards and looks out of the end.
    out = -area / size if size > 0 else np.array([0.0, 0.0, 1.0])
    return Opening(loop, centre, out, float(np.sqrt(max(size, 1e-300) / np.pi)))


def _capped(vertices: np.ndarray, faces: np.ndarray, openings: list[Opening]) -> tuple[np.ndarray, np.ndarray]:
    """The surface with a fan of triangles in every opening."""
    caps = []
    for i, opening in enumerate(openings):
        ring, middle = opening.loop, len(vertices) + i
        caps.append(np.stack([np.roll(ring, -1), ring, np.full(len(ring), middle)], axis=1))
    middles = [o.centre[None] for o in openings]
    return np.concatenate([vertices, *middles]), np.concatenate([faces, *caps])


def _told_ends(told: _Told, surface: Surface, openings: list[Opening], holes: str) -> list[Opening]:
    """Which openings are ends; a hole in the wall is one that is much narrower than the lumen just beneath it."""
    ends = []
    for o in openings:
        depth = np.linspace(0.3, 4.0, 14) * o.radius
        beneath = o.centre - depth[:, None] * o.out
        wide = float(np.where(surface.inside(beneath), surface.closest(beneath)[0], 0.0).max())
        if o.radius >= _FLUSH * wide:
            ends.append(o)
        elif holes == "refuse":
            raise told.refuse(
                f"has a hole in its wall at {_at(o.centre)}, {2 * o.radius:.3g} wide where the lumen is "
                f"{2 * wide:.3g} wide or more: close it in a mesh editor, or pass holes='close'"
            )
        else:
            told.notes.append(f"a hole in the wall at {_at(o.centre)}, {2 * o.radius:.3g} wide, is closed")
    if ends:
        places = ", ".join(f"{_at(o.centre)} ({2 * o.radius:.3g} wide)" for o in ends[:12])
        told.notes.append(f"{len(ends)} open ends are capped: {places}{' …' if len(ends) > 12 else ''}")
    return ends


def _refuse_crossings(told: _Told, vertices: np.ndarray, faces: np.ndarray) -> None:
    pairs = crossing_faces(vertices, faces)
    if len(pairs):
        where = vertices[faces[pairs[0, 0]]].mean(axis=0)
        raise told.refuse(
            f"crosses itself: {len(np.unique(pairs))} of its {len(faces)} faces cut others, the first at "
            f"{_at(where)}, so "
            "that walls stand inside the lumen; join its parts (a boolean union, or a remesh) in a mesh editor"
        )


def _refuse_material(told: _Told, surface: Surface, openings: list[Opening]) -> None:
    """A closed surface that fills its convex hull and has holes through it is a block with channels."""
    if openings or surface.handles < 1:
        return
    try:
        hull = ConvexHull(surface.vertices[:: max(1, len(surface.vertices) // 20000)])
    except QhullError:
        return
    share = surface.volume / hull.volume
    if share > 0.5:
        raise told.refuse(
            f"looks like the material about the lumen: it fills {100 * share:.0f} % of its convex hull and has "
            f"{surface.handles} channels through it; pass invert=True to take the channels"
        )
