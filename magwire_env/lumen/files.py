"""Centrelines from other tools' files, made fit for a tract; `Tract.load` is the way in.

CSV
    A header line naming x, y and z, perhaps radius (or r), each with its unit: ``x [mm],y [mm],z [mm],radius [mm]``,
    ``x (m)`` or ``x_mm``; or bare names and the argument `unit`. Comma, semicolon or tab; other columns are ignored,
    with a warning where they look like radii.
VMTK, ``.vtp``
    VTK XML PolyData with polyline cells, as vmtkcenterlines writes; the lumen's radius from the point array
    ``MaximumInscribedSphereRadius``. VTK declares no unit, so `unit` is required.
3D Slicer, ``.mrk.json``
    Markups of type Curve or ClosedCurve, schema version 1; the unit is ``coordinateUnits``; points are kept in LPS
    (a RAS file is turned round z). The radius is the measurement named Radius, as SlicerVMTK stores it.

A unit is declared by the file or by the argument, never guessed, and the two must agree.
"""

from __future__ import annotations

import csv
import json
import math
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import splev, splprep
from scipy.spatial import KDTree

from ..physics.checks import non_negative, points_array, positive
from .curve import LONGEST
from .reading import reading
from .vtk_polydata import read_vtk_lines

__all__ = ["UNITS", "Centreline", "read_centreline"]

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
"""Metres in each unit that a file or the argument may declare."""

_RADIUS_ARRAY = "MaximumInscribedSphereRadius"
_DEFAULT_RADIUS = 7.5e-3

_SLENDEREST = 1e5
"""Largest length of a line, in radii of its lumen."""
_SHARPEST_CORNER = math.radians(75)


@dataclass(frozen=True, eq=False)
class Centreline:
    """A line in space and the lumen about it.

    points : (n, 3) m; a closed line does not repeat its first point
    radius : (n,) m
    closed : the line is a loop
    """

    points: np.ndarray
    radius: np.ndarray
    closed: bool = False


def read_centreline(
    path: str | Path,
    unit: str | None = None,
    *,
    line: int | None = None,
    smooth: float = 0.0,
    spacing: float = 5e-3,
    radius: float | None = None,
) -> Centreline:
    """The centreline in a file, cleaned of what is harmless and refused for what is not.

    unit : of the file's numbers, one of "m", "cm", "mm", "um", where the file declares none itself
    line : which line of the file, from 0; needed when it holds several
    smooth : m, root-mean-square deviation allowed from the file's points; 0 runs through them
    spacing : m; points closer than this are thinned (smoothed lines: resampled) to about this distance, since a spline
        through the jitter of points a fraction of a millimetre apart bends wildly
    radius : m, of the lumen, instead of the file's own; without either it is 7.5 mm

    Repeated points are dropped, and a line that ends where it began is a loop. Refused, with the place: a gap (a step
    ten times the median), a kink (a turn of more than 75° at a point), a line that comes back into its own lumen.
    Raises `ValueError` naming the file, the place and what is allowed; `FileNotFoundError` if there is no such file.
    """
    path = Path(path)
    if unit is not None and unit not in UNITS:
        raise ValueError(f"unit must be one of {_listed(UNITS)}, got {unit!r}")
    smooth, spacing = non_negative("smooth", smooth, "m"), positive("spacing", spacing, "m")
    reader = {".csv": _read_csv, ".vtp": _read_vtp, ".json": _read_markups}.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{path} must be a .csv, .vtp or .mrk.json file, got the ending {path.suffix!r}")
    with reading(path, "centrelines"):
        lines = reader(path, unit)
    found = _chosen(path, lines, line)
    if radius is not None or found.radius.size == 0:
        radius = _DEFAULT_RADIUS if radius is None else positive("radius", radius, "m")
        found = replace(found, radius=np.full(len(found.points), radius))
    found = _without_repeats(path, found)
    _refuse_endless(path, found)
    _refuse_gaps(path, found, spacing)
    found = _smoothed(path, found, smooth, spacing) if smooth else _thinned(found, spacing)
    _refuse_kinks(path, found)
    _refuse_crossings(path, found)
    return found


def _listed(names: Any) -> str:
    return ", ".join(map(repr, names))


def _scale(path: Path, what: str, declared: str | None, unit: str | None, how: str) -> float:
    """Metres in the unit that the file declared for `what` or the caller passed, whichever there is."""
    if declared is not None and declared not in UNITS:
        raise ValueError(f"{path} declares {what} in {declared!r}; the unit must be one of {_listed(UNITS)}")
    if declared is not None and unit is not None and declared != unit:
        raise ValueError(
            f"{path} declares {what} in {declared!r}, but unit={unit!r} was passed; leave unit out, or mend the file"
        )
    if declared is None and unit is None:
        raise ValueError(f"{path} declares no unit for {what}; {how}pass unit='mm' (or one of {_listed(UNITS)})")
    return UNITS[declared or unit or "m"]


def _chosen(path: Path, lines: list[Centreline], line: int | None) -> Centreline:
    if line is None and len(lines) > 1:
        shown = "; ".join(
            f"line {i}: {len(c.points)} points, {np.linalg.norm(np.diff(c.points, axis=0), axis=1).sum():.4f} m"
            for i, c in enumerate(lines[:12])
        )
        raise ValueError(f"{path} holds {len(lines)} lines; choose one with line=0 to {len(lines) - 1} ({shown})")
    if line is not None and not 0 <= line < len(lines):
        raise ValueError(f"line must lie in 0 to {len(lines) - 1} for {path}, got {line}")
    return lines[line or 0]


# --- formats ----------------------------------------------------------------------------------------------------------

_COLUMN = re.compile(rf"^(x|y|z|r|radius|{_RADIUS_ARRAY})\s*(?:[\[(]\s*([^\])]*?)\s*[\])]|_(\w+))?$", re.IGNORECASE)


_LIKE_A_RADIUS = re.compile(r"^(rad|diam|width|d\b|r_)", re.IGNORECASE)


def _read_csv(path: Path, unit: str | None) -> list[Centreline]:
    try:
        text = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} must be UTF-8 text, but byte {error.start} is not") from None
    rows = [(i, row) for i, row in enumerate(text, 1) if row.strip()]
    header = rows[0][1].lstrip("# ") if rows else ""
    delimiter = max(",;\t", key=header.count)
    columns: dict[str, tuple[int, str | None]] = {}
    for i, cell in enumerate(next(csv.reader([header], delimiter=delimiter), [])):
        if match := _COLUMN.match(cell.strip()):
            name = match[1].lower() if match[1].lower() in ("x", "y", "z") else "radius"
            if name in columns:
                raise ValueError(f"{path} line {rows[0][0]} must name {name} once, got {header[:80]!r}")
            columns[name] = (i, match[2] or match[3])
        elif _LIKE_A_RADIUS.match(cell.strip()):
            warnings.warn(
                f"{path} has a column {cell.strip()!r}, which is not read: a column of radii is called radius or r",
                stacklevel=4,
            )
    if not {"x", "y", "z"} <= set(columns):
        example = "'x [mm],y [mm],z [mm]'"
        raise ValueError(
            f"{path} must start with a header line naming x, y and z, such as {example}, got {header[:80]!r}"
        )
    scales = {}
    for name, (_, declared) in columns.items():
        scales[name] = _scale(path, name, declared, unit, f"write it in the header, as in '{name} [mm]', or ")
    if len({scales[c] for c in "xyz"}) > 1:
        raise ValueError(f"{path} must declare x, y and z in one unit, got {header[:80]!r}")
    numbers = np.array(
        [_csv_row(path, i, row, delimiter, columns) for i, row in rows[1:] if not row.startswith("#")], dtype=np.float64
    ).reshape(-1, len(columns)) * [scales[c] for c in columns]
    at = {c: k for k, c in enumerate(columns)}
    radius = numbers[:, at["radius"]] if "radius" in at else np.empty(0)
    return [_checked(path, numbers[:, [at["x"], at["y"], at["z"]]], radius)]


def _csv_row(
    path: Path, number: int, row: str, delimiter: str, columns: dict[str, tuple[int, str | None]]
) -> list[float]:
    cells = next(csv.reader([row], delimiter=delimiter))
    try:
        return [float(cells[i]) for i, _ in columns.values()]
    except (ValueError, IndexError):
        raise ValueError(f"{path} line {number} must hold numbers for {', '.join(columns)}, got {row!r}") from None


def _read_vtp(path: Path, unit: str | None) -> list[Centreline]:
    lines = read_vtk_lines(path, _RADIUS_ARRAY)
    scale = _scale(path, "its points (no .vtp file does)", None, unit, "")
    return [
        _checked(path, scale * v.points, np.empty(0) if v.values is None else scale * v.values, f"line {i} ")
        for i, v in enumerate(lines)
    ]


def _read_markups(path: Path, unit: str | None) -> list[Centreline]:
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:  # JSON or UTF-8
        raise ValueError(f"{path} must be JSON, as 3D Slicer writes it: {error}") from None
    markups = tree.get("markups") if isinstance(tree, dict) else None
    if not isinstance(markups, list) or not all(isinstance(m, dict) for m in markups):
        raise ValueError(f"{path} must hold a list 'markups', as 3D Slicer's markups files do")
    curves = [m for m in markups if m.get("type") in ("Curve", "ClosedCurve")]
    if not curves:
        kinds = _listed(sorted({str(m.get("type")) for m in markups})) or "none"
        raise ValueError(f"{path} must hold a markup of type 'Curve' or 'ClosedCurve', got {kinds}")
    return [_curve(path, m, unit) for m in curves]


def _curve(path: Path, markup: dict[str, Any], unit: str | None) -> Centreline:
    scale = _scale(path, "coordinateUnits", _code(markup.get("coordinateUnits")), unit, "")
    system = markup.get("coordinateSystem", "LPS")  # the schema's default
    if system not in ("LPS", "RAS"):
        raise ValueError(f"{path} coordinateSystem must be 'LPS' or 'RAS', got {system!r}")
    control = markup.get("controlPoints")
    if not isinstance(control, list) or not control:
        raise ValueError(
            f"{path} must hold a list 'controlPoints' in its curve, with two points at least, got {control!r}"
        )
    placed = [
        i for i, p in enumerate(control) if not isinstance(p, dict) or p.get("positionStatus", "defined") == "defined"
    ]
    points = []
    for i in placed:
        position = control[i].get("position") if isinstance(control[i], dict) else None
        if (
            not isinstance(position, list)
            or len(position) != 3
            or not all(isinstance(c, (int, float)) for c in position)
        ):
            raise ValueError(f"{path} controlPoints[{i}] must have a position of three numbers, got {position!r}")
        points.append(position)
    values, code = _measured_radius(path, markup, len(control))
    radius = values[placed] * _scale(path, "its measurement Radius", code, unit, "") if len(values) else values
    xyz = scale * np.array(points, dtype=np.float64).reshape(-1, 3)
    return _checked(path, xyz * (-1, -1, 1) if system == "RAS" else xyz, radius, closed=markup["type"] == "ClosedCurve")


def _measured_radius(path: Path, markup: dict[str, Any], count: int) -> tuple[np.ndarray, str | None]:
    """The values (count,) of a curve's measurement Radius and their unit; no values if it has none."""
    measurements = markup.get("measurements") or []
    if not isinstance(measurements, list):
        raise ValueError(f"{path} measurements must be a list, got {measurements!r:.60}")
    for m in measurements:
        if isinstance(m, dict) and str(m.get("name")).lower() == "radius" and m.get("controlPointValues"):
            values = m["controlPointValues"]
            if not isinstance(values, list) or not all(isinstance(v, (int, float)) for v in values):
                raise ValueError(f"{path} measurement Radius must hold a list of numbers, got {values!r:.60}")
            if len(values) != count:
                raise ValueError(
                    f"{path} measurement Radius must hold {count} values, one a control point, got {len(values)}"
                )
            return np.array(values, dtype=np.float64), _code(m.get("units"))
    return np.empty(0), None


def _code(units: Any) -> str | None:
    """A unit as Slicer writes it: "mm", or the coded entry ["mm", "UCUM", "millimeter"]."""
    if isinstance(units, list) and units:
        units = units[0]
    return None if units in (None, "") else str(units)


def _checked(path: Path, points: np.ndarray, radius: np.ndarray, where: str = "", closed: bool = False) -> Centreline:
    points_array(f"{path} {where}points", points, "m")
    bad = np.flatnonzero(~(np.isfinite(radius) & (radius > 0)))
    if bad.size:
        raise ValueError(
            f"{path} {where}radius[{bad[0]}] must be finite and greater than 0 (in m), got {radius[bad[0]]:g}"
        )
    return Centreline(points, radius, closed)


# --- cleaning ---------------------------------------------------------------------------------------------------------


def _loop(c: Centreline) -> np.ndarray:
    """The points, a closed line's first one again at its end."""
    return np.vstack([c.points, c.points[:1]]) if c.closed else c.points


def _arc(c: Centreline) -> np.ndarray:
    """Arc length of the points of `_loop` along the polyline, m."""
    return np.r_[0.0, np.linalg.norm(np.diff(_loop(c), axis=0), axis=1).cumsum()]


def _at(point: np.ndarray) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*point)


def _without_repeats(path: Path, c: Centreline) -> Centreline:
    steps = np.linalg.norm(np.diff(c.points, axis=0), axis=1)
    same = 1e-9 * max(steps.sum(), 1e-12)
    keep = np.r_[True, steps > same][: len(c.points)]
    c = replace(c, points=c.points[keep], radius=c.radius[keep])
    if len(c.points) > 3 and np.linalg.norm(c.points[-1] - c.points[0]) <= same:
        c = Centreline(c.points[:-1], c.radius[:-1], closed=True)
    fewest = 4 if c.closed else 2
    if len(c.points) < fewest:
        raise ValueError(f"{path} must hold at least {fewest} different points, got {len(c.points)}")
    return c


def _refuse_endless(path: Path, c: Centreline) -> None:
    """Refuse what would take a table without end: a line much too long, or much too thin for its length."""
    length, widest = float(_arc(c)[-1]), float(c.radius.max())
    if length > LONGEST:
        raise ValueError(f"{path} must hold a line of at most {LONGEST:g} m, got {length:.4g} m: is its unit right?")
    if length > _SLENDEREST * widest:
        raise ValueError(
            f"{path} must hold a lumen of at least {length / _SLENDEREST:.2g} m radius for its {length:.4g} m, "
            f"got {widest:.3g} m: is its unit right?"
        )


def _refuse_gaps(path: Path, c: Centreline, spacing: float) -> None:
    steps = np.diff(_arc(c))
    allowed = max(10 * float(np.median(steps)), 2 * spacing)
    if steps.max() > allowed:
        i = int(steps.argmax())
        raise ValueError(
            f"{path} has a gap of {steps[i]:.4g} m after point {i} (from 0) at {_at(c.points[i])}; a step may be "
            f"at most {allowed:.4g} m, ten times the median: add the missing points, or keep one side of the gap"
        )


def _thinned(c: Centreline, spacing: float) -> Centreline:
    """Some of the file's own points, at least `spacing` apart along the line; a line with wider steps keeps all."""
    arc = _arc(c)
    spacing = min(spacing, arc[-1] / 8)
    keep = [0]
    for i in range(1, len(c.points)):
        if arc[i] - arc[keep[-1]] >= 0.999 * spacing:
            keep.append(i)
    last = len(c.points) - 1
    if not c.closed and keep[-1] != last:
        keep = [k for k in keep if k == 0 or arc[last] - arc[k] >= spacing / 2] + [last]
    if c.closed and len(keep) > 4 and arc[-1] - arc[keep[-1]] < spacing / 2:
        keep.pop()
    return replace(c, points=c.points[keep], radius=c.radius[keep])


def _smoothed(path: Path, c: Centreline, smooth: float, spacing: float) -> Centreline:
    """A smoothing spline's points about `spacing` apart; FITPACK's s is the sum of the squared deviations."""
    if len(c.points) < 4:
        raise ValueError(f"smooth needs at least 4 points (in m; 0 for none), but {path} holds {len(c.points)}")
    arc, points = _arc(c), _loop(c)
    tck, _ = splprep(points.T, u=arc, s=len(points) * smooth**2, per=c.closed, quiet=2)
    count = max(8, round(arc[-1] / spacing))
    u = np.linspace(0.0, arc[-1], count + 1)[: count if c.closed else None]
    return replace(
        c, points=np.stack(splev(u, tck), axis=1), radius=np.interp(u, arc, np.r_[c.radius, c.radius[:1]][: len(arc)])
    )


def _refuse_kinks(path: Path, c: Centreline) -> None:
    points = np.vstack([_loop(c), c.points[1:2]]) if c.closed else c.points
    steps = np.diff(points, axis=0)
    unit = steps / np.linalg.norm(steps, axis=1)[:, None]
    turn = np.arccos(np.clip((unit[:-1] * unit[1:]).sum(axis=1), -1.0, 1.0))
    if turn.size and turn.max() > _SHARPEST_CORNER:
        i = int(turn.argmax()) + 1
        raise ValueError(
            f"{path} has a kink of {math.degrees(turn.max()):.0f}° at {_at(points[i])}, {_arc(c)[i]:.4g} m along; at "
            f"most {math.degrees(_SHARPEST_CORNER):.0f}° is allowed: give more points round the bend, or smooth= (in m)"
        )


def _refuse_crossings(path: Path, c: Centreline) -> None:
    """Refuse a line one part of which lies in the lumen of another, more than four radii away along it."""
    arc, points = _arc(c), _loop(c)
    widest = float(c.radius.max())
    s = np.linspace(0.0, arc[-1], max(2, math.ceil(3 * arc[-1] / widest)) + 1)
    fine = np.stack([np.interp(s, arc, x) for x in points.T], axis=1)
    radius = np.interp(s, arc, np.r_[c.radius, c.radius[:1]][: len(arc)])
    pairs = KDTree(fine).query_pairs(widest, output_type="ndarray")
    along = np.abs(s[pairs[:, 0]] - s[pairs[:, 1]])
    along = np.minimum(along, arc[-1] - along) if c.closed else along
    apart = np.linalg.norm(fine[pairs[:, 0]] - fine[pairs[:, 1]], axis=1)
    bad = np.flatnonzero((along > 4 * widest) & (apart < radius[pairs].max(axis=1)))
    if bad.size:
        i, j = pairs[bad[apart[bad].argmin()]]
        raise ValueError(
            f"{path} comes back into its own lumen: {s[i]:.4g} m and {s[j]:.4g} m along, near {_at(fine[i])}, it has "
            f"parts {apart[bad].min():.4g} m apart in a lumen of {radius[i]:.4g} m radius: "
            f"cut the loop out, or pass a smaller radius="
        )
