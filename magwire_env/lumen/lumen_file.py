"""A lumen in a file that stands alone: the tree, and the surface if it has one, in one ``.lumen`` file."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from .branch import Branch
from .curve import Tract
from .lumen import Lumen
from .reading import MOST_BYTES, reading
from .rooms import BoxWall
from .surface import Surface

__all__ = ["FORMAT", "load_lumen", "save_lumen"]

FORMAT = 1
"""Version of the format; a newer one is refused."""

_ARRAYS = {"points": "<f8", "radii": "<f8", "vertices": "<f8", "faces": "<i8"}


def save_lumen(lumen: Lumen, path: str | Path) -> None:
    """Write a lumen to a ``.lumen`` file: a zip of a JSON description and arrays, without pickles."""
    path = Path(path)
    if path.suffix.lower() != ".lumen":
        raise ValueError(f"path must end with .lumen, got {path}")
    branches, points, radii = [], [], []
    for b in lumen.branches:
        own = b.curve.radius if isinstance(b.curve.radius, tuple) else (b.curve.radius,)
        branches.append({"name": b.name, "parent": b.parent, "start": b.start, "closed": b.curve.closed,
                         "points": len(b.curve.points), "radii": len(own)})  # fmt: skip
        points.append(np.array(b.curve.points))
        radii.append(np.array(own))
    about: dict[str, Any] = {
        "format": FORMAT,
        "name": lumen.name,
        "axes": lumen.axes,
        "notes": list(lumen.notes),
        "branches": branches,
    }
    arrays = {"points": np.concatenate(points), "radii": np.concatenate(radii)}
    if isinstance(lumen.wall, BoxWall):
        about["box"] = [list(lumen.wall.low), list(lumen.wall.high)]
    elif isinstance(lumen.wall, Surface):
        arrays |= {"vertices": lumen.wall.vertices, "faces": lumen.wall.faces}
    elif lumen.wall is not None:
        raise ValueError(f"Lumen.wall must be a Surface or a BoxWall to be saved, got {type(lumen.wall).__name__}")
    partial = path.with_suffix(".partial")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("lumen.json", json.dumps(about))
        for name, array in arrays.items():
            block = io.BytesIO()
            np.lib.format.write_array(block, np.ascontiguousarray(array.astype(_ARRAYS[name])), allow_pickle=False)
            archive.writestr(name + ".npy", block.getvalue())
    partial.replace(path)


def load_lumen(path: str | Path) -> Lumen:
    """The lumen of a ``.lumen`` file. Raises `ValueError` naming the file and what is wrong in it."""
    path = Path(path)
    with reading(path, "a lumen"):
        with zipfile.ZipFile(path) as archive:
            total = sum(i.file_size for i in archive.infolist())
            if total > MOST_BYTES or len(archive.infolist()) > 10:
                raise ValueError(f"{path} must hold less than {MOST_BYTES >> 20} MiB, announces {total >> 20}")
            names = set(archive.namelist())
            if not {"lumen.json", "points.npy", "radii.npy"} <= names:
                raise ValueError(f"{path} must hold lumen.json, points.npy and radii.npy, got {sorted(names)[:6]}")
            about = json.loads(_member(path, archive, "lumen.json"))
            if not isinstance(about, dict) or about.get("format") != FORMAT:
                raise ValueError(
                    f"{path} must be of format {FORMAT}, got "
                    f"{about.get('format') if isinstance(about, dict) else about!r}"
                )
            arrays = {n: _array(path, archive, n) for n in _ARRAYS if n + ".npy" in names}
        wall: Any = None
        if "box" in about:
            wall = BoxWall(*(tuple(corner) for corner in about["box"]))
        elif "vertices" in arrays:
            wall = Surface(arrays["vertices"], arrays["faces"])
        return Lumen(
            tuple(_branches(path, about["branches"], arrays)),
            wall,
            str(about["name"]),
            str(about["axes"]),
            tuple(about["notes"]),
        )


def _member(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    info = archive.getinfo(name)
    with archive.open(info) as stream:
        data = stream.read(info.file_size + 1)
    if len(data) != info.file_size:
        raise ValueError(f"{path} announces {info.file_size} bytes of {name}, but holds other")
    return data


def _array(path: Path, archive: zipfile.ZipFile, name: str) -> np.ndarray:
    block = io.BytesIO(_member(path, archive, name + ".npy"))
    array = np.lib.format.read_array(block, allow_pickle=False)
    width = 1 if name == "radii" else 3
    if (
        array.dtype != np.dtype(_ARRAYS[name])
        or array.ndim != (1 if width == 1 else 2)
        or (width == 3 and array.shape[1] != 3)
    ):
        raise ValueError(
            f"{path} {name} must be an array of {_ARRAYS[name]} of width {width}, got {array.dtype} {array.shape}"
        )
    return array


def _branches(path: Path, rows: list[dict[str, Any]], arrays: dict[str, np.ndarray]) -> list[Branch]:
    made, p, r = [], 0, 0
    for row in rows:
        points, radii = arrays["points"][p : p + row["points"]], arrays["radii"][r : r + row["radii"]]
        p, r = p + row["points"], r + row["radii"]
        if len(points) != row["points"] or len(radii) != row["radii"]:
            raise ValueError(f"{path} must hold the points and radii that its branches announce")
        radius: Any = float(radii[0]) if len(radii) == 1 else tuple(radii.tolist())
        made.append(Branch(row["name"], Tract(points, radius, bool(row["closed"])), row["parent"], row["start"]))  # type: ignore[arg-type]
    return made
