"""Surfaces from STL, OBJ, PLY, VTP and legacy VTK files: vertices and triangles, in the file's own unit."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from .extra import anatomy_library
from .mending import RawSurface
from .polydata import read_polydata
from .reading import decoded_text, reading, whole_file

__all__ = ["MOST_FACES", "SURFACE_ENDINGS", "read_surface"]

SURFACE_ENDINGS = (".stl", ".obj", ".ply", ".vtp", ".vtk")

MOST_FACES = 5_000_000
"""More triangles than this are refused."""


def read_surface(path: Path) -> RawSurface:
    """The triangles of a surface's file; polygons are cut into triangles.

    Raises `ValueError` naming the file and what is wrong in it.
    """
    ending = path.suffix.lower()
    if ending in (".vtp", ".vtk"):
        data = read_polydata(path)
        raw = RawSurface(data.points, data.triangles)
    elif ending == ".obj":
        raw = _obj(path)
    else:
        raw = _by_trimesh(path, ending[1:])
    if not len(raw.faces):
        raise ValueError(f"{path} must hold faces, got none")
    if len(raw.faces) > MOST_FACES:
        raise ValueError(f"{path} must hold at most {MOST_FACES} faces, got {len(raw.faces)}: decimate it first")
    return raw


def _by_trimesh(path: Path, kind: str) -> RawSurface:
    data = whole_file(path)
    _refuse_lying_header(path, kind, data)
    trimesh = anatomy_library("trimesh")
    with reading(path, kind.upper()):
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False)  # bytes alone: it opens no other file
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    if kind == "stl" and data[:5].lower() == b"solid" and b"facet" in data[:1000] and b"endsolid" not in data[-200:]:
        raise ValueError(f"{path} must end with 'endsolid': it is cut off")
    return RawSurface(vertices.reshape(-1, 3), faces.reshape(-1, 3))


def _refuse_lying_header(path: Path, kind: str, data: bytes) -> None:
    """Counts that the file's size cannot hold, before a library makes room for them."""
    if kind == "stl" and not (data[:5].lower() == b"solid" and b"facet" in data[:1000]):
        count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
        if len(data) != 84 + 50 * count:
            raise ValueError(
                f"{path} announces {count} faces, which take {84 + 50 * count} bytes; it holds {len(data)}"
            )
    if kind == "ply":
        head, found, _ = data[:65536].partition(b"end_header")
        if not data.startswith(b"ply") or not found:
            raise ValueError(f"{path} must start with a PLY header that ends with 'end_header'")
        rows = 0
        for line in head.splitlines():
            words = line.split()
            if words[:1] == [b"element"]:
                if len(words) != 3 or not words[2].isdigit() or int(words[2]) > len(data):
                    text = line[:60].decode(errors="replace")
                    raise ValueError(f"{path} announces {text!r}, more than its {len(data)} bytes hold")
                rows += int(words[2])
        if b"format ascii" in head and len(data.partition(b"end_header")[2].split(b"\n")) - 2 != rows:
            raise ValueError(f"{path} announces {rows} lines after its header, but holds another number")


def _obj(path: Path) -> RawSurface:
    """Wavefront OBJ: the positions and faces alone; materials, which name other files, are not looked at."""
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for number, line in enumerate(decoded_text(path).splitlines(), 1):
        words = line.split()
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                vertices.append([float(w) for w in words[1:4]])
                if len(words) < 4:
                    raise ValueError
            else:
                at = [int(w.partition("/")[0]) for w in words[1:]]
                at = [i - 1 if i > 0 else len(vertices) + i for i in at]
                if len(at) < 3 or min(at) < 0:
                    raise ValueError
                faces += [(at[0], at[i], at[i + 1]) for i in range(1, len(at) - 1)]
        except (ValueError, OverflowError):
            raise ValueError(
                f"{path} line {number} must be a vertex 'v x y z' or a face of vertices, got {line[:60]!r}"
            ) from None
        if len(faces) > MOST_FACES:
            raise ValueError(f"{path} must hold at most {MOST_FACES} faces: decimate it first")
    if faces and max(map(max, faces)) >= len(vertices):
        raise ValueError(
            f"{path} must have faces of its {len(vertices)} vertices, got vertex {max(map(max, faces)) + 1}"
        )
    return RawSurface(
        np.array(vertices, dtype=np.float64).reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 3)
    )
