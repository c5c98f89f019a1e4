"""Centrelines and trees from other tools' files, every line of them: points, radii, names, in the file's own unit."""

from __future__ import annotations

import json
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from . import files as centreline_files
from .graph_files import read_graph, read_swc
from .polydata import PolyData, read_polydata
from .reading import decoded_text, reading
from .tree_lines import FoundLines, TreeLine

__all__ = ["TREE_ENDINGS", "read_folder", "read_lines"]

TREE_ENDINGS = (".csv", ".vtp", ".vtk", ".json", ".swc", ".pth", ".ctgr")

_RADIUS = "MaximumInscribedSphereRadius"


def read_lines(path: Path, unit: str | None = None, data: PolyData | None = None) -> FoundLines:
    """The lines of a file of centrelines. Raises `ValueError` naming the file and what is wrong in it."""
    ending = path.suffix.lower()
    with reading(path, ending.upper().lstrip(".") + " lines"):
        if ending == ".csv" or path.name.lower().endswith(".mrk.json"):
            found = _declared(path, unit)
        elif ending in (".vtp", ".vtk"):
            found = _vmtk(path, read_polydata(path) if data is None else data)
        elif ending == ".swc":
            found = read_swc(path)
        elif ending == ".pth":
            found = _simvascular_path(path)
        elif ending == ".ctgr":
            found = _simvascular_contours(path)
        else:
            found = _json(path)
    return _checked(path, found)


def read_folder(path: Path, unit: str | None = None) -> FoundLines:
    """The lines of all curve files in a folder, called by the files' names less what all of them begin with."""
    endings = (".mrk.json", ".csv", ".vtp", ".swc", ".ctgr", ".pth")
    files = sorted(f for f in path.iterdir() if f.is_file() and f.name.lower().endswith(endings))
    stems = {f: f.name[: -len(next(e for e in endings if f.name.lower().endswith(e)))] for f in files}
    contours = {stems[f] for f in files if f.name.lower().endswith(".ctgr")}
    files = [f for f in files if not (f.suffix.lower() == ".pth" and stems[f] in contours)]
    if not files:
        raise ValueError(f"{path} must hold curve files ({', '.join(endings)}), got none")
    if len(files) > 5000:
        raise ValueError(f"{path} must hold at most 5000 curve files, got {len(files)}")
    names = [stems[f] for f in files]
    shared = _shared_start(names)
    whole = FoundLines([])
    units, axes = set(), set()
    for f, stem in zip(files, names, strict=True):
        found = read_lines(f, unit)
        units.add(found.unit)
        axes.add(found.axes)
        name = stem[shared:] or stem
        for i, line in enumerate(found.lines):
            line.name, line.parent = name if len(found.lines) == 1 else f"{name}_{i}", None
            whole.lines.append(line)
    if len(units) > 1 or len(axes) > 1:
        raise ValueError(
            f"{path} must hold curves of one unit and one system of axes, got {sorted(units)} and {sorted(axes)}"
        )
    whole.unit, whole.axes = units.pop(), axes.pop()
    return whole


def _shared_start(names: list[str]) -> int:
    """How many characters all names share at their start, up to the last separator."""
    if len(names) < 2:
        return 0
    first, last = min(names), max(names)
    same = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(len(first), len(last)))
    return max((first.rfind(c, 0, same) + 1 for c in "_-. "), default=0)


def _checked(path: Path, found: FoundLines) -> FoundLines:
    kept = []
    for i, line in enumerate(found.lines):
        where = f"line {line.name or i}"
        bad = np.flatnonzero(~np.isfinite(line.points).all(axis=1))
        if bad.size:
            raise ValueError(f"{path} {where} points[{bad[0]}] must be finite, got {line.points[bad[0]].tolist()}")
        wrong = np.flatnonzero(~(np.isfinite(line.radii) & (line.radii > 0)))
        if wrong.size:
            at = line.points[wrong[0]].tolist()
            raise ValueError(
                f"{path} {where} radius[{wrong[0]}] must be greater than 0, got {line.radii[wrong[0]]:g} at {at}"
            )
        if len(line.points) >= 2:
            kept.append(line)
        elif any(other.parent == i for other in found.lines):
            raise ValueError(f"{path} {where} must hold two points at least")
    if not kept:
        raise ValueError(f"{path} must hold a line of two points at least, got none")
    if len(kept) < len(found.lines):  # single points, which no line leaves: their numbers go
        number = {id(line): k for k, line in enumerate(kept)}
        for line in kept:
            line.parent = None if line.parent is None else number[id(found.lines[line.parent])]
    return FoundLines(kept, found.unit, found.axes)


# --- CSV and Slicer ---------------------------------------------------------------------------------------------------


def _declared(path: Path, unit: str | None) -> FoundLines:
    """Files that declare their unit, or leave it to the argument."""
    is_csv = path.suffix.lower() == ".csv"
    lines = (centreline_files._read_csv if is_csv else centreline_files._read_markups)(path, unit)
    names = [""] * len(lines)
    if not is_csv:
        markups = json.loads(path.read_text(encoding="utf-8"))["markups"]
        curves = [m for m in markups if m.get("type") in ("Curve", "ClosedCurve")]
        names = [str(m.get("name") or "") for m in curves]
    unit = _declared_unit(path) or unit or "m"
    scale = centreline_files.UNITS[unit]
    made = []
    for name, line in zip(names, lines, strict=True):
        points, radii = line.points / scale, line.radius / scale
        if line.closed:
            points, radii = np.vstack([points, points[:1]]), np.concatenate([radii, radii[:1]])
        made.append(TreeLine(name, points, radii))
    return FoundLines(made, unit, "" if is_csv else "LPS")


def _declared_unit(path: Path) -> str | None:
    """The unit that a Slicer file, or the header of a CSV, declares."""
    if path.name.lower().endswith(".mrk.json"):
        markups = json.loads(path.read_text(encoding="utf-8"))["markups"]
        return centreline_files._code(markups[0].get("coordinateUnits"))
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    header = next((line for line in lines if line.strip()), "").lstrip("# ").replace(";", ",").replace("\t", ",")
    found = [centreline_files._COLUMN.match(cell.strip()) for cell in header.split(",")]
    return next((m[2] or m[3] for m in found if m and m[1].lower() == "x"), None)


def _json(path: Path) -> FoundLines:
    """A JSON graph, or a Slicer file that is not called one."""
    try:
        tree = json.loads(decoded_text(path))
    except RecursionError:
        raise ValueError(f"{path} must be JSON of a reasonable depth") from None
    except ValueError as error:
        raise ValueError(f"{path} must be JSON: {error}") from None
    return _declared(path, None) if isinstance(tree, dict) and "markups" in tree else read_graph(path, tree)


# --- VMTK -------------------------------------------------------------------------------------------------------------


def _vmtk(path: Path, data: PolyData) -> FoundLines:
    """VMTK's lines; those that were split into tracts are put together again by CenterlineIds and TractIds."""
    if not data.lines:
        raise ValueError(f"{path} must hold lines, got none")
    radii = data.point_data.get(_RADIUS)
    cells = range(data.first_line, data.first_line + len(data.lines))
    ids, tracts = data.cell_data.get("CenterlineIds"), data.cell_data.get("TractIds")
    groups: dict[float, list[int]] = {}
    for cell in cells:
        groups.setdefault(float(ids[cell]) if ids is not None else float(cell), []).append(cell)
    lines = []
    for members in groups.values():
        if ids is not None and tracts is not None:
            members = sorted(members, key=lambda c: float(tracts[c]))
        parts = [data.lines[c - data.first_line] for c in members]
        numbers = np.concatenate(parts)
        points = data.points[numbers]
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        keep = np.concatenate([[True], step > 0]) if len(points) else np.zeros(0, dtype=bool)
        lines.append(TreeLine("", points[keep], np.zeros(0) if radii is None else radii[numbers][keep]))
    return FoundLines(lines)


# --- SimVascular ------------------------------------------------------------------------------------------------------


def _simvascular(path: Path) -> ElementTree.Element:
    """The XML of a SimVascular file, which has two roots (<format/> and the data): put under one."""
    text = decoded_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError(f"{path} must not declare a document type or entities")
    begin = text.find("?>") + 2 if text.lstrip().startswith("<?xml") else 0
    try:
        return ElementTree.fromstring(f"<both>{text[begin:]}</both>")
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} must be SimVascular XML; it is not well-formed (cut off?): {error}") from None


def _xyz(path: Path, element: ElementTree.Element) -> list[float]:
    try:
        return [float(element.attrib[k]) for k in "xyz"]
    except (KeyError, ValueError):
        raise ValueError(
            f"{path} must give x, y and z of <{element.tag}> as numbers, got {dict(element.attrib)}"
        ) from None


def _simvascular_path(path: Path) -> FoundLines:
    root = _simvascular(path)
    found = root.find("path")
    if found is None:
        raise ValueError(f"{path} must hold a <path>")
    places = [_xyz(path, e) for e in found.iterfind("timestep/path_element/path_points/path_point/pos")]
    places = places or [_xyz(path, e) for e in found.iterfind("timestep/path_element/control_points/point")]
    if len(places) < 2:
        raise ValueError(f"{path} must hold path points or control points, two at least, got {len(places)}")
    return FoundLines([TreeLine(found.get("name") or path.stem, np.array(places), np.zeros(0))])


def _simvascular_contours(path: Path) -> FoundLines:
    """Contours along a vessel: their middles make the line, circles of their areas the radii."""
    root = _simvascular(path)
    group = root.find("contourgroup")
    if group is None:
        raise ValueError(f"{path} must hold a <contourgroup>")
    middles, radii = [], []
    for contour in group.iterfind("timestep/contour"):
        ring = np.array([_xyz(path, e) for e in contour.iterfind("contour_points/point")]).reshape(-1, 3)
        if len(ring) < 3:
            continue
        following = np.roll(ring, -1, axis=0)
        lengths = np.linalg.norm(following - ring, axis=1)
        if not lengths.sum() > 0:
            raise ValueError(f"{path} contour {contour.get('id')} must have an extent")
        centre = ((ring + following) / 2 * lengths[:, None]).sum(axis=0) / lengths.sum()
        area = np.linalg.norm(np.cross(ring - centre, following - centre).sum(axis=0)) / 2
        middles.append(centre)
        radii.append(math.sqrt(float(area) / math.pi))
    if len(middles) < 2:
        raise ValueError(f"{path} must hold two contours of three points at least, got {len(middles)}")
    name = group.get("path_name") or path.stem
    return FoundLines([TreeLine(name, np.array(middles), np.array(radii))])
