"""Lines of a VTK XML PolyData file (``.vtp``), with NumPy and the standard library alone.

Format: VTK's own description, docs.vtk.org "XML File Formats", and the "VTK XML Formats" page of its wiki (how binary
data are laid out). Read are ascii, binary (base64 in place) and appended data (base64 or raw), of either byte order,
with 32- or 64-bit headers, plain or zlib-compressed: what VTK's writers produce, and so VMTK, ParaView and 3D Slicer.
"""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

__all__ = ["VtkLine", "read_vtk_lines"]

_TYPES = {
    **{f"Int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)},
    **{f"UInt{8 * size}": f"u{size}" for size in (1, 2, 4, 8)},
    **{f"Float{8 * size}": f"f{size}" for size in (4, 8)},
}
"""NumPy's code of each VTK number type."""

_ZLIB = "vtkZLibDataCompressor"

_MOST_BYTES = 1 << 30
"""Largest array that is read, compressed or not."""


@dataclass(frozen=True)
class VtkLine:
    """One polyline cell: its points (n, 3) in the file's unit, and the array asked for, (n,), if the file has it."""

    points: np.ndarray
    values: np.ndarray | None


def read_vtk_lines(path: Path, array: str) -> list[VtkLine]:
    """Every line of a PolyData file, with the point array named `array`.

    Raises `ValueError` naming the file, the element of it that is wrong, and what is allowed.
    """
    xml, appended = _split(path.read_bytes())
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} must be VTK XML; it is not well-formed XML (cut off?): {error}") from None
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        kind = f"type {root.get('type')!r}" if root.tag == "VTKFile" else f"a <{root.tag}> document"
        raise ValueError(f"{path} must be a VTKFile of type 'PolyData', got {kind}")
    if root.get("compressor", _ZLIB) != _ZLIB:
        raise ValueError(
            f"{path} is compressed with {root.get('compressor')!r}; save it again with {_ZLIB!r} or uncompressed"
        )
    reader = _Reader(path, root, appended)
    lines = [line for piece in root.iterfind("PolyData/Piece") for line in _lines_of(path, piece, reader, array)]
    if not lines:
        raise ValueError(f"{path} must hold lines, got none (of a surface, take its centreline first: vmtkcenterlines)")
    return lines


def _lines_of(path: Path, piece: ElementTree.Element, reader: _Reader, array: str) -> list[VtkLine]:
    points = reader.array(piece.find("Points/DataArray"), "Points")
    if points.size % 3:
        raise ValueError(f"{path} Points must hold three numbers a point, got {points.size} numbers")
    points = points.reshape(-1, 3).astype(np.float64)
    if piece.find("Lines") is None:
        return []
    connectivity = reader.array(piece.find("Lines/DataArray[@Name='connectivity']"), "Lines connectivity")
    offsets = reader.array(piece.find("Lines/DataArray[@Name='offsets']"), "Lines offsets")
    if connectivity.dtype.kind not in "iu" or offsets.dtype.kind not in "iu":
        raise ValueError(f"{path} Lines must hold whole numbers, got {connectivity.dtype} and {offsets.dtype}")
    if offsets.size and (np.diff(offsets, prepend=0).min() < 0 or offsets[-1] != connectivity.size):
        raise ValueError(
            f"{path} Lines offsets must rise to the {connectivity.size} entries of its connectivity, got {offsets}"
        )
    if connectivity.size and (connectivity.min() < 0 or connectivity.max() >= len(points)):
        wrong = connectivity[(connectivity < 0) | (connectivity >= len(points))][0]
        raise ValueError(f"{path} Lines connectivity must name points 0 to {len(points) - 1}, got {wrong}")
    element = piece.find(f"PointData/DataArray[@Name='{array}']")
    values = None if element is None else reader.array(element, array).astype(np.float64)
    if values is not None and len(values) != len(points):
        raise ValueError(f"{path} {array} must hold one number for each of the {len(points)} points, got {len(values)}")
    cells = np.split(connectivity, offsets[:-1]) if offsets.size else []
    return [VtkLine(points[cell], None if values is None else values[cell]) for cell in cells]


class _Reader:
    """Decodes the file's DataArrays."""

    def __init__(self, path: Path, root: ElementTree.Element, appended: bytes) -> None:
        order = root.get("byte_order", "LittleEndian")
        header = root.get("header_type", "UInt32")
        if order not in ("LittleEndian", "BigEndian") or header not in ("UInt32", "UInt64"):
            raise ValueError(
                f"{path} must have byte_order LittleEndian or BigEndian and header_type UInt32 or UInt64, "
                f"got {order!r} and {header!r}"
            )
        self.path, self.order = path, "<" if order == "LittleEndian" else ">"
        self.header = np.dtype(self.order + _TYPES[header])
        self.compressed = root.get("compressor") is not None
        element = root.find("AppendedData")
        self.base64 = element is not None and element.get("encoding") == "base64"
        self.appended = appended

    def array(self, element: ElementTree.Element | None, name: str) -> np.ndarray:
        """The numbers of a DataArray, flat."""
        if element is None:
            raise ValueError(f"{self.path} lacks its data array {name}")
        kind, form = element.get("type", ""), element.get("format", "ascii")
        if kind not in _TYPES:
            raise ValueError(f"{self.path} {name} must be of type {', '.join(_TYPES)}, got {kind!r}")
        dtype = np.dtype(self.order + _TYPES[kind])
        text = (element.text or "").strip()
        try:
            if form == "ascii":
                return np.array(text.split(), dtype=dtype)
            if form == "binary":
                return np.frombuffer(self._decoded(text.encode(), True), dtype=dtype)
            if form == "appended":
                return np.frombuffer(self._decoded(self._from(element, name), self.base64), dtype=dtype)
        except (ValueError, OverflowError, zlib.error, binascii.Error, IndexError) as error:
            raise ValueError(
                f"{self.path} {name} cannot be read, its {form} data are damaged or cut off: {error}"
            ) from None
        raise ValueError(f"{self.path} {name} must have format ascii, binary or appended, got {form!r}")

    def _from(self, element: ElementTree.Element, name: str) -> bytes:
        offset = int(element.get("offset", "-1"))
        if not 0 <= offset < len(self.appended):
            raise ValueError(f"offset {offset} of {name} lies outside the {len(self.appended)} bytes of AppendedData")
        return self.appended[offset:]

    def _decoded(self, data: bytes, is_base64: bool) -> bytes:
        """The bytes of one array: a header of sizes, then the data, whole or in zlib blocks.

        In base64, header and plain data are one piece of text, but a compressed array's header is a piece of its own.
        """
        size = self.header.itemsize
        if not self.compressed:
            count = int(self._numbers(_unwrap(data, size, is_base64), 1)[0])
            return self._exactly(_unwrap(data, size + count, is_base64)[size:], count)
        blocks = int(self._numbers(_unwrap(data, size, is_base64), 1)[0])
        if not 0 <= blocks <= len(data):
            raise ValueError(f"{blocks} blocks announced in {len(data)} bytes")
        header = self._numbers(_unwrap(data, (3 + blocks) * size, is_base64), 3 + blocks)
        begin = _text_length((3 + blocks) * size) if is_base64 else (3 + blocks) * size
        packed = _unwrap(data[begin:], int(header[3:].sum()), is_base64)
        ends = header[3:].cumsum().astype(int)
        whole = int(blocks * header[1] if header[2] == 0 else (blocks - 1) * header[1] + header[2]) if blocks else 0
        if not 0 <= whole <= _MOST_BYTES:
            raise ValueError(f"{whole} bytes announced; at most {_MOST_BYTES} are read")
        plain = bytearray()
        for n, end in zip(header[3:], ends, strict=True):  # no block may hold more than what is still announced
            plain += zlib.decompressobj().decompress(packed[end - int(n) : end], whole - len(plain) + 1)
            if len(plain) > whole:
                raise ValueError(f"{whole} bytes announced, more found")
        return self._exactly(bytes(plain), whole)

    def _numbers(self, data: bytes, count: int) -> np.ndarray:
        return np.frombuffer(self._exactly(data, count * self.header.itemsize), dtype=self.header).astype(np.int64)

    @staticmethod
    def _exactly(data: bytes, count: int) -> bytes:
        if len(data) != count:
            raise ValueError(f"{count} bytes announced, {len(data)} found")
        return data


def _split(raw: bytes) -> tuple[bytes, bytes]:
    """The file's XML without its appended data, and those data: raw ones would break the XML."""
    opening = re.search(rb"<AppendedData[^>]*>\s*_", raw)
    closing = raw.rfind(b"</AppendedData>")
    if not opening or closing < opening.end():
        return raw, b""
    data = raw[opening.end() : closing]
    if b"base64" in opening[0]:
        data = data.strip()
    return raw[: opening.end() - 1] + raw[closing:], data


def _text_length(count: int) -> int:
    return -(-count // 3) * 4


def _unwrap(data: bytes, count: int, is_base64: bool) -> bytes:
    """The first `count` bytes of `data`, decoded if they are base64."""
    if is_base64:
        data = base64.b64decode(data[: _text_length(count)], validate=True)
    return data[:count]
