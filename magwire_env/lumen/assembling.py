"""A lumen made of another tool's file: the readers, and what turns a surface, a mask or lines into a tree of branches.

`loading` imports this only for a file that it does not keep yet: the libraries of the readers take half a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .branch import Branch
from .joining import one_tree, tidied
from .joints import attached
from .lumen import Lumen
from .masks import surface_of
from .mending import mended
from .polydata import read_polydata
from .reading import naming
from .skeleton import Line, centrelines
from .solids import channels_of
from .surface import Surface
from .surface_files import SURFACE_ENDINGS, read_surface
from .tree_files import TREE_ENDINGS, read_folder, read_lines
from .tree_lines import FoundLines, TreeLine
from .units import settled_unit
from .volume_files import VOLUME_ENDINGS, read_volume

__all__ = ["Wish", "assembled"]

_SHARPEST_CORNER = math.radians(75)


@dataclass
class Wish:
    """The arguments of `Lumen.load`, checked, the notes to write to, and whom to tell how far it is."""

    path: Path
    unit: str | None
    inlet: Any
    invert: bool
    radius: float | None
    holes: str
    notes: list[str]
    progress: Callable[[float, str], None]


def assembled(wish: Wish) -> Lumen:
    """The lumen in the file or folder that is wished for. Raises `ValueError` as `Lumen.load` says."""
    name = wish.path.name.lower()
    if wish.path.is_dir():
        return _from_lines(wish, read_folder(wish.path, wish.unit))
    if name.endswith(VOLUME_ENDINGS):
        return _from_volume(wish)
    if name.endswith((".vtp", ".vtk")):
        data = read_polydata(wish.path)
        if not len(data.triangles):
            return _from_lines(wish, read_lines(wish.path, wish.unit, data))
        return _from_surface(wish)
    if name.endswith(SURFACE_ENDINGS):
        return _from_surface(wish)
    if name.endswith(TREE_ENDINGS):
        return _from_lines(wish, read_lines(wish.path, wish.unit))
    endings = sorted({*VOLUME_ENDINGS, *SURFACE_ENDINGS, *TREE_ENDINGS, ".lumen"})
    raise ValueError(f"{wish.path} must end with one of {', '.join(endings)}, or be a folder of curves")


# --- surfaces and masks -----------------------------------------------------------------------------------------------


def _from_volume(wish: Wish) -> Lumen:
    wish.progress(0.0, "reading")
    volume = read_volume(wish.path)
    near = None if isinstance(wish.inlet, str) else wish.inlet
    raw = surface_of(str(wish.path), volume, wish.notes, near, wish.invert)
    unit, axes = volume.unit, volume.axes
    del volume
    return _with_surface(wish, raw, unit, axes, invert=False)


def _from_surface(wish: Wish) -> Lumen:
    wish.progress(0.0, "reading")
    return _with_surface(wish, read_surface(wish.path), "", "", wish.invert)


def _with_surface(wish: Wish, raw: Any, unit: str, axes: str, invert: bool) -> Lumen:
    if isinstance(wish.inlet, str):
        raise ValueError(
            f"inlet must be a point (x, y, z) of {wish.path}, which has no named lines, got {wish.inlet!r}"
        )
    wish.progress(0.05, "checking")
    with naming(wish.path):
        surface, openings = mended(str(wish.path), raw, wish.notes, wish.inlet, invert, wish.holes)
        if invert:
            surface, openings = channels_of(str(wish.path), surface, wish.inlet, wish.notes), []
        if surface.handles > 0:
            wish.notes.append(f"the lumen has {surface.handles} loops, which the tree opens")
        lines = centrelines(surface, openings, wish.inlet, wish.notes, wish.progress)
    radius = float(np.median(np.concatenate([line.radii for line in lines])))
    size = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    scale = settled_unit(str(wish.path), unit, wish.unit, size, radius, wish.notes)
    branches = _branches(wish, [TreeLine("", line.points, line.radii, _parent(line)) for line in lines], scale)
    wall = Surface(surface.vertices * scale, surface.faces)
    wish.progress(1.0, "done")
    return Lumen(branches, wall, wish.path.name.split(".")[0], axes, tuple(wish.notes))


def _parent(line: Line) -> int | None:
    return None if line.parent < 0 else line.parent


# --- lines ------------------------------------------------------------------------------------------------------------


def _from_lines(wish: Wish, found: FoundLines) -> Lumen:
    wish.progress(0.1, "joining")
    lines = found.lines
    size = float(np.linalg.norm(np.ptp(np.concatenate([line.points for line in lines]), axis=0)))
    bare = [line for line in lines if not len(line.radii)]
    known = np.concatenate([line.radii for line in lines])
    if bare and wish.radius is None:
        raise ValueError(
            f"{wish.path} holds no radii{f' for line {bare[0].name!r}' if bare[0].name else ''}; pass radius= (in m)"
        )
    typical = float(np.median(known)) if len(known) else math.nan
    if not len(known):
        typical = 0.01 * size  # the unit is settled by the size alone
    scale = settled_unit(str(wish.path), found.unit, wish.unit, size, typical, wish.notes)
    for line in lines:
        if wish.radius is not None:
            line.radii = np.full(len(line.points), wish.radius / scale)
    with naming(wish.path):
        tree = one_tree(str(wish.path), lines, wish.inlet, wish.notes)
        for line in tree:  # few points: they mean what they say, and no smoothing may hide a kink
            if len(line.points) > 2 and np.median(_steps(line)) > 0.7 * np.median(line.radii):
                _refuse_kink(wish.path, line.name, line)
        wish.progress(0.6, "smoothing")
        branches = _branches(
            wish, [replace(line, points=p, radii=r) for line in tree for p, r in (tidied(line),)], scale
        )
    wish.progress(1.0, "done")
    return Lumen(branches, None, wish.path.name.split(".")[0], found.axes, tuple(wish.notes))


def _branches(wish: Wish, lines: list[TreeLine], scale: float) -> tuple[Branch, ...]:
    """The lines as branches, in m: each led to its parent's axis; kinks refused with their place."""
    taken = {line.name for line in lines if line.name}
    names: list[str] = []
    made: list[Any] = []
    for i, line in enumerate(lines):
        name = line.name or f"b{i}"
        while name in names or (not line.name and name in taken) or name == "inlet":
            name += "'"
        names.append(name)
        _refuse_kink(wish.path, name, line)
        parent = None if line.parent is None else made[line.parent]
        try:
            made.append(attached(name, line.points * scale, line.radii * scale, parent))
        except ValueError as error:
            raise ValueError(f"{wish.path} branch {name!r} cannot be a branch: {error}") from None
    return tuple(made)


def _steps(line: TreeLine) -> np.ndarray:
    return np.linalg.norm(np.diff(line.points, axis=0), axis=1)


def _refuse_kink(path: Path, name: str, line: TreeLine) -> None:
    step = np.diff(line.points, axis=0)
    unit = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-300)
    turn = np.arccos(np.clip((unit[:-1] * unit[1:]).sum(axis=1), -1.0, 1.0))
    if turn.size and turn.max() > _SHARPEST_CORNER:
        at = line.points[int(turn.argmax()) + 1]
        raise ValueError(
            f"{path} branch {name!r} has a kink of {math.degrees(turn.max()):.0f}° at ({at[0]:.6g}, {at[1]:.6g}, "
            f"{at[2]:.6g}); "
            f"at most {math.degrees(_SHARPEST_CORNER):.0f}° is allowed: give more points round the bend"
        )
