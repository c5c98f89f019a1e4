"""VTK PolyData, in XML (``.vtp``) or the legacy format up to version 5.1 (``.vtk``): points, lines, faces, arrays."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from . import vtk_polydata as xml_format
from .reading import reading, whole_file

__all__ = ["PolyData", "read_polydata"]

_MOST_POINTS = 20_000_000

_LEGACY_TYPES = {
    "bit": None, "unsigned_char": "u1", "char": "i1", "unsigned_short": "u2", "short": "i2", "unsigned_int": "u4",
    "int": "i4", "unsigned_long": "u8", "long": "i8", "float": "f4", "double": "f8", "vtkidtype": "i8",
    "vtktypeint64": "i8", "vtktypeint32": "i4",
}  # fmt: skip


@dataclass
class PolyData:
    """Points (n, 3) in the file's unit, cells as lists of point numbers, and named arrays of points and of cells.

    cell_data counts the cells as VTK does: vertices first, then lines, then polygons, then strips; `first_line` is the
    number of the first line among them.
    """

    points: np.ndarray
    lines: list[np.ndarray] = field(default_factory=list)
    triangles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    point_data: dict[str, np.ndarray] = field(default_factory=dict)
    cell_data: dict[str, np.ndarray] = field(default_factory=dict)
    first_line: int = 0


def read_polydata(path: Path) -> PolyData:
    """The PolyData of a ``.vtp`` or ``.vtk`` file. Raises `ValueError` naming the file and what is wrong."""
    data = whole_file(path)
    with reading(path, "VTK PolyData"):
        found = _xml(path, data) if path.suffix.lower() == ".vtp" else _Legacy(path, data).read()
    if not np.isfinite(found.points).all():
        bad = int(np.flatnonzero(~np.isfinite(found.points).all(axis=1))[0])
        raise ValueError(f"{path} Points[{bad}] must be finite, got {found.points[bad].tolist()}")
    return found


def _triangles(cells: list[np.ndarray]) -> np.ndarray:
    sizes = np.array([len(c) for c in cells])
    if len(cells) and (sizes == 3).all():
        return np.array(cells, dtype=np.int64)
    fans = [np.stack([np.full(len(c) - 2, c[0]), c[1:-1], c[2:]], axis=1) for c in cells if len(c) > 2]
    return np.concatenate(fans) if fans else np.zeros((0, 3), dtype=np.int64)


def _strips(cells: list[np.ndarray]) -> np.ndarray:
    made = []
    for c in cells:
        three = np.stack([c[:-2], c[1:-1], c[2:]], axis=1)
        three[1::2] = three[1::2, ::-1]
        made.append(three)
    return np.concatenate(made) if made else np.zeros((0, 3), dtype=np.int64)


def _checked_cells(
    path: Path, what: str, connectivity: np.ndarray, offsets: np.ndarray, points: int
) -> list[np.ndarray]:
    """Cells from connectivity and the end of each cell in it."""
    connectivity, offsets = connectivity.astype(np.int64), offsets.astype(np.int64)
    if offsets.size and (np.diff(offsets, prepend=0).min() < 0 or offsets[-1] != connectivity.size):
        raise ValueError(f"{path} {what} offsets must rise to the {connectivity.size} entries of its connectivity")
    if connectivity.size and (connectivity.min() < 0 or connectivity.max() >= points):
        wrong = connectivity[(connectivity < 0) | (connectivity >= points)][0]
        raise ValueError(f"{path} {what} connectivity must name points 0 to {points - 1}, got {wrong}")
    return np.split(connectivity, offsets[:-1]) if offsets.size else []


# --- XML --------------------------------------------------------------------------------------------------------------


def _xml(path: Path, raw: bytes) -> PolyData:
    xml, appended = xml_format._split(raw)
    if b"<!DOCTYPE" in xml[:4096] or b"<!ENTITY" in xml:
        raise ValueError(f"{path} must not declare a document type or entities")
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} must be VTK XML; it is not well-formed XML (cut off?): {error}") from None
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        raise ValueError(f"{path} must be a VTKFile of type 'PolyData', got <{root.tag}> of type {root.get('type')!r}")
    if root.get("compressor", xml_format._ZLIB) != xml_format._ZLIB:
        raise ValueError(f"{path} is compressed with {root.get('compressor')!r}; save it with zlib or uncompressed")
    reader = xml_format._Reader(path, root, appended)
    whole = PolyData(np.zeros((0, 3)))
    pieces = list(root.iterfind("PolyData/Piece"))
    for piece in pieces:
        _add_piece(path, whole, piece, reader, arrays=len(pieces) == 1)
    return whole


def _add_piece(
    path: Path, whole: PolyData, piece: ElementTree.Element, reader: xml_format._Reader, arrays: bool
) -> None:
    points = reader.array(piece.find("Points/DataArray"), "Points").astype(np.float64)
    if points.size % 3:
        raise ValueError(f"{path} Points must hold three numbers a point, got {points.size} numbers")
    points, before = points.reshape(-1, 3), len(whole.points)
    cells: dict[str, Any] = {}
    for what in ("Verts", "Lines", "Polys", "Strips"):
        if piece.find(what) is None or piece.find(f"{what}/DataArray") is None:
            cells[what] = []
            continue
        connectivity = reader.array(piece.find(f"{what}/DataArray[@Name='connectivity']"), f"{what} connectivity")
        offsets = reader.array(piece.find(f"{what}/DataArray[@Name='offsets']"), f"{what} offsets")
        if connectivity.dtype.kind == "f" or offsets.dtype.kind == "f":
            raise ValueError(f"{path} {what} must hold whole numbers")
        cells[what] = _checked_cells(path, what, connectivity, offsets, len(points))
    whole.points = np.concatenate([whole.points, points])
    whole.lines += [c + before for c in cells["Lines"]]
    faces = np.concatenate([_triangles(cells["Polys"]), _strips(cells["Strips"])])
    whole.triangles = np.concatenate([whole.triangles, faces + before])
    if not arrays:
        return
    whole.first_line = len(cells["Verts"])
    for place, target in (("PointData", whole.point_data), ("CellData", whole.cell_data)):
        count = len(points) if place == "PointData" else sum(map(len, cells.values()))
        for element in piece.iterfind(f"{place}/DataArray"):
            if element.get("type") in xml_format._TYPES and element.get("NumberOfComponents", "1") in ("1", ""):
                name = element.get("Name", "")
                values = reader.array(element, name)
                if len(values) != count:
                    raise ValueError(f"{path} {name} must hold one number for each of {count}, got {len(values)}")
                target[name] = values.astype(np.float64)


# --- legacy -----------------------------------------------------------------------------------------------------------


class _Legacy:
    """Reads one file: words and blocks of numbers, in ascii or big-endian binary."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.data, self.at = path, data, 0
        first = self.line()
        if not first.startswith("# vtk DataFile Version"):
            raise ValueError(f"{path} must start with '# vtk DataFile Version', got {first[:40]!r}")
        self.version = float(first.split()[-1])
        if self.version > 5.1:
            raise ValueError(f"{path} must be of version 5.1 or older, got {self.version}")
        self.line()
        form = self.line().strip().upper()
        if form not in ("ASCII", "BINARY"):
            raise ValueError(f"{path} must be ASCII or BINARY, got {form[:20]!r}")
        self.binary = form == "BINARY"

    def line(self) -> str:
        end = self.data.find(b"\n", self.at)
        end = len(self.data) if end < 0 else end
        text, self.at = self.data[self.at : end], end + 1
        return text.decode("ascii", errors="replace").strip()

    def word_line(self) -> list[str]:
        """The words of the next line that is not empty; none at the end."""
        while self.at < len(self.data):
            if words := self.line().split():
                return words
        return []

    def numbers(self, count: int, kind: str) -> np.ndarray:
        """The next `count` numbers of VTK's type `kind`."""
        code = _LEGACY_TYPES.get(kind.lower())
        if code is None:
            raise ValueError(f"{self.path} must hold numbers of a known type, got {kind!r}")
        if count < 0 or count > 3 * _MOST_POINTS:
            raise ValueError(f"{self.path} announces {count} numbers; at most {3 * _MOST_POINTS} are read")
        if self.binary:
            size = count * np.dtype(code).itemsize
            block = self.data[self.at : self.at + size]
            if len(block) != size:
                raise ValueError(f"{self.path} is cut off: {size} bytes of {kind} announced, {len(block)} found")
            self.at += size
            if self.data[self.at : self.at + 1] == b"\n":
                self.at += 1
            return np.frombuffer(block, dtype=">" + code)
        if count > len(self.data):
            raise ValueError(f"{self.path} announces {count} numbers, more than its {len(self.data)} bytes can hold")
        found: list[bytes] = []
        pattern = re.compile(rb"\S+")
        while len(found) < count:
            match = pattern.search(self.data, self.at)
            if match is None:
                raise ValueError(f"{self.path} is cut off: {count} numbers announced, {len(found)} found")
            found.append(match[0])
            self.at = match.end()
        return np.array(found, dtype="S").astype(code)

    def cells(self, what: str, words: list[str], points: int) -> list[np.ndarray]:
        first, second = int(words[1]), int(words[2])
        if first < 0 or second < 0:
            raise ValueError(f"{self.path} {what} must hold counts of at least 0, got {words[1:3]}")
        if self.version >= 5.0:  # offsets (one more than the cells) and connectivity, each with its type
            head = self.word_line()
            if head[:1] != ["OFFSETS"]:
                raise ValueError(f"{self.path} {what} must have OFFSETS, got {' '.join(head)[:40]!r}")
            offsets = self.numbers(first, head[1]).astype(np.int64)
            head = self.word_line()
            if head[:1] != ["CONNECTIVITY"]:
                raise ValueError(f"{self.path} {what} must have CONNECTIVITY, got {' '.join(head)[:40]!r}")
            connectivity = self.numbers(second, head[1]).astype(np.int64)
            if offsets.size and offsets[0] != 0:
                raise ValueError(f"{self.path} {what} OFFSETS must start with 0, got {offsets[0]}")
            return _checked_cells(self.path, what, connectivity, offsets[1:], points)
        flat = self.numbers(second, "int").astype(np.int64)
        cells, at = [], 0
        for _ in range(first):
            if at >= len(flat) or flat[at] < 0 or at + 1 + flat[at] > len(flat):
                raise ValueError(f"{self.path} {what} must hold {first} cells in {second} numbers")
            cells.append(flat[at + 1 : at + 1 + flat[at]])
            at += 1 + int(flat[at])
        ends = np.cumsum([len(c) for c in cells])
        return _checked_cells(self.path, what, np.concatenate(cells) if cells else flat[:0], ends, points)

    def read(self) -> PolyData:
        head = self.word_line()
        if [w.upper() for w in head] != ["DATASET", "POLYDATA"]:
            raise ValueError(f"{self.path} must be a DATASET of POLYDATA, got {' '.join(head)[:40]!r}")
        found, cells, target, count = PolyData(np.zeros((0, 3))), {}, None, 0
        while words := self.word_line():
            key = words[0].upper()
            if key == "POINTS":
                found.points = self.numbers(3 * int(words[1]), words[2]).astype(np.float64).reshape(-1, 3)
            elif key in ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS"):
                cells[key] = self.cells(key, words, len(found.points))
            elif key == "METADATA":
                while self.at < len(self.data) and self.line():
                    pass
            elif key in ("POINT_DATA", "CELL_DATA"):
                target, count = (found.point_data if key == "POINT_DATA" else found.cell_data), int(words[1])
            elif target is not None:
                self.array(key, words, target, count)
            else:
                raise ValueError(f"{self.path} must hold POINTS, LINES, POLYGONS …, got {' '.join(words)[:40]!r}")
        found.first_line = len(cells.get("VERTICES", []))
        found.lines = cells.get("LINES", [])
        faces = _triangles(cells.get("POLYGONS", [])), _strips(cells.get("TRIANGLE_STRIPS", []))
        found.triangles = np.concatenate(faces)
        return found

    def array(self, key: str, words: list[str], target: dict[str, np.ndarray], count: int) -> None:
        """One attribute: scalars and fields of one component are kept, the others are passed over."""
        if key == "SCALARS":
            parts = int(words[3]) if len(words) > 3 else 1
            mark = self.at
            if self.word_line()[:1] != ["LOOKUP_TABLE"]:
                self.at = mark
            values = self.numbers(count * parts, words[2])
            if parts == 1:
                target[words[1]] = values.astype(np.float64)
        elif key in ("VECTORS", "NORMALS"):
            self.numbers(3 * count, words[2])
        elif key == "TENSORS":
            self.numbers(9 * count, words[2])
        elif key == "TEXTURE_COORDINATES":
            self.numbers(int(words[2]) * count, words[3])
        elif key == "COLOR_SCALARS":
            self.numbers(int(words[2]) * count, "unsigned_char" if self.binary else "float")
        elif key == "LOOKUP_TABLE":
            self.numbers(4 * int(words[2]), "unsigned_char" if self.binary else "float")
        elif key == "FIELD":
            for _ in range(int(words[2])):
                name, width, tuples, kind = self.word_line()
                if kind.lower() == "string":
                    raise ValueError(f"{self.path} array {name!r} must hold numbers, got strings")
                values = self.numbers(int(width) * int(tuples), kind)
                if int(width) == 1 and int(tuples) == count:
                    target[name] = values.astype(np.float64)
                mark = self.at
                if self.word_line()[:1] == ["METADATA"]:
                    while self.at < len(self.data) and self.line():
                        pass
                else:
                    self.at = mark
        else:
            raise ValueError(f"{self.path} must hold attributes of a known kind, got {key!r}")
