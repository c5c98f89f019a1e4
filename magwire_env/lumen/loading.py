"""Reading a lumen from other tools' files: `Lumen.load` is the way in."""

from __future__ import annotations

import hashlib
import math
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.checks import one_of, positive, vector
from .branch import Branch
from .joining import one_tree, tidied
from .joints import attached
from .lumen import Lumen
from .lumen_file import load_lumen, save_lumen
from .masks import surface_of
from .mending import mended
from .polydata import read_polydata
from .reading import naming
from .skeleton import Line, centrelines
from .solids import channels_of
from .surface import Surface
from .surface_files import SURFACE_ENDINGS, read_surface
from .tree_files import TREE_ENDINGS, FoundLines, TreeLine, read_folder, read_lines
from .units import settled_unit
from .volume_files import VOLUME_ENDINGS, read_volume

__all__ = ["LumenNote", "load"]

_VERSION = 1
"""Goes up when the same file gives another lumen: it is part of the cache's key."""

_SHARPEST_CORNER = math.radians(75)


class LumenNote(UserWarning):
    """What was guessed, turned, capped or dropped when a lumen was read."""


@dataclass
class _Wish:
    """The arguments of a call, checked."""

    path: Path
    unit: str | None
    inlet: Any
    invert: bool
    radius: float | None
    holes: str
    notes: list[str]
    progress: Callable[[float, str], None]


def load(
    path: str | Path,
    unit: str | None = None,
    inlet: Any = None,
    invert: bool = False,
    radius: float | None = None,
    holes: str = "refuse",
    progress: bool | None = None,
    cache: bool = True,
) -> Lumen:
    """The lumen in a file or folder; see `Lumen.load`."""
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no such file or folder: {path}")
    one_of("holes", holes, ("refuse", "close"))
    if radius is not None:
        radius = positive("radius", radius, "m")
    if inlet is not None and not isinstance(inlet, str):
        inlet = np.array(vector("inlet", inlet, 3, "the file's unit"))
    if path.suffix.lower() == ".lumen":
        return load_lumen(path)
    kept = _kept(
        path, (unit, inlet if inlet is None or isinstance(inlet, str) else inlet.tolist(), bool(invert), radius, holes)
    )
    if cache and kept.exists():
        try:
            lumen = load_lumen(kept)
        except ValueError:
            kept.unlink(missing_ok=True)  # a damaged copy: read the file itself
        else:
            _tell(path, lumen)
            return lumen
    with _bar(progress, path.name) as advance:
        lumen = _read(_Wish(path, unit, inlet, bool(invert), radius, holes, [], advance))
    if cache:
        _keep(lumen, kept)
    _tell(path, lumen)
    return lumen


def _tell(path: Path, lumen: Lumen) -> None:
    if lumen.notes:
        warnings.warn(LumenNote(f"{path}: {'; '.join(lumen.notes)}"), stacklevel=4)


def _read(wish: _Wish) -> Lumen:
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


def _from_volume(wish: _Wish) -> Lumen:
    wish.progress(0.0, "reading")
    volume = read_volume(wish.path)
    near = None if isinstance(wish.inlet, str) else wish.inlet
    raw = surface_of(str(wish.path), volume, wish.notes, near, wish.invert)
    unit, axes = volume.unit, volume.axes
    del volume
    return _with_surface(wish, raw, unit, axes, invert=False)


def _from_surface(wish: _Wish) -> Lumen:
    wish.progress(0.0, "reading")
    return _with_surface(wish, read_surface(wish.path), "", "", wish.invert)


def _with_surface(wish: _Wish, raw: Any, unit: str, axes: str, invert: bool) -> Lumen:
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


def _from_lines(wish: _Wish, found: FoundLines) -> Lumen:
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


def _branches(wish: _Wish, lines: list[TreeLine], scale: float) -> tuple[Branch, ...]:
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


# --- cache and bar ----------------------------------------------------------------------------------------------------


def _kept(path: Path, arguments: tuple) -> Path:
    """Where the lumen of this content and these arguments is kept."""
    whole = hashlib.sha256(repr((_VERSION, path.suffix.lower(), arguments)).encode())
    files = sorted(f for f in path.iterdir() if f.is_file()) if path.is_dir() else [path]
    if path.suffix.lower() in (".mhd", ".nhdr"):
        files = [path, *sorted(f for f in path.parent.iterdir() if f.is_file() and f.stem == path.stem and f != path)]
    for f in files:
        whole.update(f.name.encode() if path.is_dir() else b"")
        with f.open("rb") as stream:
            while block := stream.read(1 << 20):
                whole.update(block)
    folder = Path(os.environ.get("MAGWIRE_CACHE") or Path.home() / ".cache" / "magwire")
    return folder / "lumens" / f"{whole.hexdigest()[:32]}.lumen"


def _keep(lumen: Lumen, kept: Path) -> None:
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        save_lumen(lumen, kept)
    except OSError:  # a home that cannot be written to: it is read anew next time
        return


class _bar:
    """A progress bar on the terminal, or none."""

    def __init__(self, wanted: bool | None, name: str) -> None:
        self.bar: Any = None
        try:
            from tqdm import tqdm
        except ImportError:
            return
        self.bar = tqdm(
            total=100,
            desc=name,
            leave=False,
            disable=None if wanted is None else not wanted,
            bar_format="{l_bar}{bar}| {postfix}",
        )

    def __enter__(self) -> Callable[[float, str], None]:
        return self._advance

    def _advance(self, share: float, what: str) -> None:
        if self.bar is not None:
            self.bar.set_postfix_str(what, refresh=False)
            self.bar.update(round(100 * share) - self.bar.n)

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.close()
