"""Voxel masks and level sets from NIfTI, MetaImage and NRRD files."""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .extra import anatomy_library
from .reading import MOST_BYTES, inflated, reading, whole_file

__all__ = ["VOLUME_ENDINGS", "Volume", "read_volume"]

VOLUME_ENDINGS = (".nii", ".nii.gz", ".mha", ".mhd", ".nrrd", ".nhdr")


@dataclass
class Volume:
    """A voxel array and where its voxels lie.

    values : (i, j, k)
    affine : (4, 4), from voxel numbers to the file's coordinates, directions and flips included
    unit : of the coordinates as the file declares it, "" if it does not
    axes : "RAS" or "LPS" … as the format or the file says
    """

    values: np.ndarray
    affine: np.ndarray
    unit: str
    axes: str


def read_volume(path: Path) -> Volume:
    """The voxels of a file. Raises `ValueError` naming the file and what is wrong in it."""
    name = path.name.lower()
    if name.endswith((".nii", ".nii.gz")):
        volume = _nifti(path)
    elif name.endswith((".mha", ".mhd")):
        volume = _meta_image(path)
    else:
        volume = _nrrd(path)
    if not np.isfinite(volume.affine).all():
        raise ValueError(f"{path} must have a finite origin, spacing and directions, got {volume.affine.tolist()}")
    if abs(np.linalg.det(volume.affine[:3, :3])) < 1e-12 * np.abs(volume.affine[:3, :3]).max() ** 3:
        raise ValueError(
            f"{path} must have three directions and spacings that span space, got {volume.affine[:3, :3].tolist()}"
        )
    return volume


def _check_size(path: Path, shape: tuple[int, ...], itemsize: int) -> int:
    """The bytes of the voxels; refuses what is no volume or too large."""
    if len(shape) != 3 or min(shape, default=0) < 1:
        raise ValueError(f"{path} must hold three dimensions of at least one voxel, got {shape}")
    count = 1
    for n in shape:
        count *= int(n)
    if count * itemsize > MOST_BYTES:
        raise ValueError(
            f"{path} announces {shape} voxels, {count * itemsize / 2**20:.0f} MiB; at most {MOST_BYTES >> 20} are read"
        )
    return count * itemsize


def _nifti(path: Path) -> Volume:
    nibabel = anatomy_library("nibabel")
    data = whole_file(path)
    with reading(path, "NIfTI"), nibabel.imageglobals.LoggingOutputSuppressor():
        head = inflated_start(path, data, 544) if data[:2] == b"\x1f\x8b" else data[:544]
        kind = (
            nibabel.Nifti2Header
            if int.from_bytes(head[:4], "little") == 540 or int.from_bytes(head[:4], "big") == 540
            else nibabel.Nifti1Header
        )
        header = kind(head[: kind.template_dtype.itemsize])
        shape = tuple(int(n) for n in header.get_data_shape())
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        dtype = header.get_data_dtype()
        if dtype.fields is not None or dtype.kind not in "iufb":
            raise ValueError(f"{path} must hold one number a voxel, got {dtype}")
        size = _check_size(path, shape, dtype.itemsize)
        offset = int(header.get_data_offset())
        if not 0 <= offset <= 1 << 24:
            raise ValueError(f"{path} must have its voxels near its start, got offset {offset}")
        if data[:2] == b"\x1f\x8b":
            raw = inflated_start(path, data, offset + size)
        else:
            raw = data
        if len(raw) < offset + size:
            raise ValueError(f"{path} is cut off: {offset + size} bytes announced, {len(raw)} found")
        values = np.frombuffer(raw, dtype, count=size // dtype.itemsize, offset=offset).reshape(shape, order="F")
        slope, shift = header.get_slope_inter()
        if slope not in (None, 1.0) or shift not in (None, 0.0):
            values = values.astype(np.float32) * np.float32(slope or 1.0) + np.float32(shift or 0.0)
        affine = np.asarray(header.get_best_affine(), dtype=np.float64)
        unit = {"meter": "m", "mm": "mm", "micron": "um"}.get(header.get_xyzt_units()[0], "")
    return Volume(values, affine, unit, "RAS")


def inflated_start(path: Path, data: bytes, count: int) -> bytes:
    """The first `count` bytes of gzip data, or fewer if they end before."""
    if count > MOST_BYTES + (1 << 24):
        raise ValueError(f"{path} announces {count} bytes; at most {MOST_BYTES} are read")
    try:
        return zlib.decompressobj(31).decompress(data, count)
    except zlib.error as error:
        raise ValueError(f"{path} has damaged gzip data: {error}") from None


_META_TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4", "MET_DOUBLE": "f8",
}  # fmt: skip


def _meta_image(path: Path) -> Volume:
    data = whole_file(path)
    fields: dict[str, str] = {}
    at = 0
    while "ElementDataFile" not in fields:
        end = data.find(b"\n", at, at + 4096)
        if end < 0 or len(fields) > 200:
            raise ValueError(f"{path} must start with a MetaImage header that ends with ElementDataFile")
        key, equals, value = data[at:end].decode("latin-1").partition("=")
        if not equals:
            raise ValueError(f"{path} must have header lines 'key = value', got {key[:60]!r}")
        fields[key.strip()], at = value.strip(), end + 1
    with reading(path, "MetaImage"):
        if fields.get("NDims") != "3" or fields.get("ElementNumberOfChannels", "1") != "1":
            raise ValueError(f"{path} must have NDims = 3 and one channel, got {fields.get('NDims')!r}")
        kind = _META_TYPES.get(fields.get("ElementType", ""))
        if kind is None:
            raise ValueError(
                f"{path} ElementType must be one of {', '.join(_META_TYPES)}, got {fields.get('ElementType')!r}"
            )
        shape = tuple(int(n) for n in fields.get("DimSize", "").split())
        big = _truth(fields.get("ElementByteOrderMSB", fields.get("BinaryDataByteOrderMSB", "False")))
        dtype = np.dtype((">" if big else "<") + kind)
        size = _check_size(path, shape, dtype.itemsize)
        raw = data[at:] if fields["ElementDataFile"].upper() == "LOCAL" else _beside(path, fields["ElementDataFile"])
        if _truth(fields.get("CompressedData", "False")):
            raw = inflated(path, raw, size, "zlib")
        if len(raw) != size:
            raise ValueError(f"{path} announces {size} bytes of voxels, but holds {len(raw)}")
        spacing = _numbers(path, fields, ("ElementSpacing", "ElementSize"), 3, (1.0, 1.0, 1.0))
        origin = _numbers(path, fields, ("Offset", "Position", "Origin"), 3, (0.0, 0.0, 0.0))
        turn = _numbers(path, fields, ("TransformMatrix", "Rotation", "Orientation"), 9, tuple(np.eye(3).ravel()))
    affine = np.eye(4)
    affine[:3, :3] = turn.reshape(3, 3).T * spacing  # the file lists each axis' direction in turn
    affine[:3, 3] = origin
    values = np.frombuffer(raw, dtype).reshape(shape, order="F")
    return Volume(values, affine, "mm", "LPS")  # ITK's convention; the format declares neither


def _truth(text: str) -> bool:
    return text.strip().lower() in ("true", "1")


def _numbers(path: Path, fields: dict[str, str], names: tuple[str, ...], count: int, default: tuple) -> np.ndarray:
    for name in names:
        if name in fields:
            found = np.array([float(x) for x in fields[name].split()])
            if len(found) != count:
                raise ValueError(f"{path} {name} must hold {count} numbers, got {fields[name][:60]!r}")
            return found
    return np.array(default, dtype=np.float64)


def _beside(path: Path, name: str) -> bytes:
    """The bytes of a data file that a header names: only one in the same folder."""
    if not re.fullmatch(r"[\w\-. ]+", name) or name.startswith("."):
        raise ValueError(f"{path} must name a data file in its own folder, got {name[:80]!r}")
    other = path.parent / name
    if not other.is_file():
        raise ValueError(f"{path} names the data file {name!r}, which is not beside it")
    return whole_file(other)


_NRRD_TYPES = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **dict.fromkeys(("short", "short int", "signed short", "int16", "int16_t"), "i2"),
    **dict.fromkeys(("ushort", "unsigned short", "uint16", "uint16_t"), "u2"),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t"), "i4"),
    **dict.fromkeys(("uint", "unsigned int", "uint32", "uint32_t"), "u4"),
    **dict.fromkeys(("longlong", "long long", "int64", "int64_t"), "i8"),
    **dict.fromkeys(("ulonglong", "uint64", "uint64_t"), "u8"),
    "float": "f4", "double": "f8",
}  # fmt: skip

_SPACES = {
    "right-anterior-superior": "RAS", "ras": "RAS", "left-posterior-superior": "LPS", "lps": "LPS",
    "left-anterior-superior": "LAS", "las": "LAS",
}  # fmt: skip


def _nrrd(path: Path) -> Volume:
    nrrd = anatomy_library("nrrd")
    data = whole_file(path)
    if not data.startswith(b"NRRD"):
        raise ValueError(f"{path} must start with 'NRRD'")
    with reading(path, "NRRD"):
        end = data.find(b"\n\n")
        crlf = data.find(b"\r\n\r\n")
        if crlf >= 0 and (end < 0 or crlf < end):
            end, skip = crlf, 4
        else:
            skip = 2
        text = data if end < 0 else data[:end]
        if len(text) > 1 << 20:
            raise ValueError(f"{path} must have a header of less than 1 MiB")
        header: dict[str, Any] = nrrd.read_header(
            iter([line + "\n" for line in text.decode("latin-1").splitlines()] + ["\n"])
        )
        shape = tuple(int(n) for n in header["sizes"])
        kind = _NRRD_TYPES.get(str(header["type"]).lower())
        if kind is None:
            raise ValueError(f"{path} type must be a number, got {header['type']!r}")
        dtype = np.dtype((">" if header.get("endian") == "big" else "<") + kind)
        size = _check_size(path, shape, dtype.itemsize)
        detached = header.get("data file") or header.get("datafile")
        raw = _beside(path, str(detached)) if detached else (data[end + skip :] if end >= 0 else b"")
        values = _nrrd_values(path, header, raw, size, dtype, shape)
        affine = np.eye(4)
        directions = header.get("space directions")
        if directions is not None:
            affine[:3, :3] = np.asarray(directions, dtype=np.float64).reshape(3, 3).T
        elif "spacings" in header:
            affine[:3, :3] = np.diag(np.asarray(header["spacings"], dtype=np.float64))
        if "space origin" in header:
            affine[:3, 3] = np.asarray(header["space origin"], dtype=np.float64)
        units = header.get("space units") or header.get("units") or []
        declared = {str(u).strip().strip('"') for u in units} - {"", "???"}
        unit = declared.pop() if len(declared) == 1 else ""
    space = str(header.get("space", "")).lower()
    return Volume(values, affine, unit if unit in ("m", "cm", "mm", "um") else "", _SPACES.get(space, ""))


def _nrrd_values(
    path: Path, header: dict[str, Any], raw: bytes, size: int, dtype: np.dtype, shape: tuple
) -> np.ndarray:
    if int(header.get("line skip", 0)) or int(header.get("byte skip", 0)):
        raise ValueError(f"{path} must have no skipped lines or bytes before its voxels")
    encoding = str(header.get("encoding", "raw")).lower()
    if encoding in ("ascii", "text", "txt"):
        words = raw.split(None, size // dtype.itemsize)[: size // dtype.itemsize]
        if len(words) * dtype.itemsize != size:
            raise ValueError(f"{path} announces {size // dtype.itemsize} voxels, but holds {len(words)}")
        return np.array(words, dtype="S").astype(dtype).reshape(shape, order="F")
    if encoding in ("gzip", "gz", "bzip2", "bz2"):
        raw = inflated(path, raw, size, "gzip" if encoding.startswith("g") else "bzip2")
    elif encoding != "raw":
        raise ValueError(f"{path} encoding must be raw, ascii, gzip or bzip2, got {encoding!r}")
    if len(raw) != size:
        raise ValueError(f"{path} announces {size} bytes of voxels, but holds {len(raw)}")
    return np.frombuffer(raw, dtype).reshape(shape, order="F")
