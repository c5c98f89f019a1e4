"""From the lines of a file to one tree: which line leaves which, from the inlet outwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from ..words import counted
from .tree_lines import TreeLine

__all__ = ["one_tree", "tidied"]

_ALONG = 0.25
"""A point of a line lies on another line within this share of its radius."""

_BLUR = 0.4
"""Width over which a line is averaged, in radii."""


@dataclass
class _Grown:
    line: TreeLine
    tree: KDTree


def one_tree(path: str, lines: list[TreeLine], inlet: str | np.ndarray | None, notes: list[str]) -> list[TreeLine]:
    """The lines turned outwards from the inlet and each attached to a parent before it; numbers in `parent`.

    inlet : a line's name, or a point (3,) in the file's coordinates; default the free end with the largest radius
    What of a line runs along the tree is dropped, and what ends where another begins is led on. Raises `ValueError`
    naming a line that touches no other, and the gap.
    """
    if all(line.parent is not None for line in lines[1:]) and inlet is None and lines[0].parent is None:
        return lines
    waiting = [TreeLine(line.name, line.points, line.radii) for line in lines]
    number, at_end = _beginning(path, waiting, inlet, notes)
    first = waiting.pop(number)
    grown: list[_Grown] = []
    _add(grown, _turned(first) if at_end else first, None)
    loops, doubled = [], []
    while waiting:
        found = _nearest_end(grown, waiting) or _nearest_middle(grown, waiting)
        if found is None:
            raise _apart(path, grown, waiting)
        number, turned, parent, middle = found
        line = waiting.pop(number)
        if middle is not None:  # an end of the tree meets the line half way: it goes on in both directions
            waiting.append(TreeLine(line.name, line.points[middle:], line.radii[middle:]))
            line = TreeLine(
                f"{line.name} back" if line.name else "", line.points[: middle + 1], line.radii[: middle + 1]
            )
            waiting.append(line)
            continue
        line = _turned(line) if turned else line
        rest, parent = _without_shared(grown, line, parent)
        if rest is None:
            doubled.append(line.name or "one without a name")
            continue
        if _touches(grown, rest.points[-1]) is not None:
            loops.append((rest.name or f"b{len(grown)}", rest.points[-1]))
        _add(grown, rest, parent)
    if doubled:
        notes.append(f"dropped, as along others: {counted(len(doubled), 'line')}, {', '.join(map(str, doubled[:6]))}")
    for name, place in loops:
        notes.append(
            f"line {name!r} ends in another one at ({place[0]:.6g}, {place[1]:.6g}, {place[2]:.6g}): a loop, which "
            "the tree opens there"
        )
    return [g.line for g in grown]


def _turned(line: TreeLine) -> TreeLine:
    return TreeLine(line.name, line.points[::-1], line.radii[::-1])


def _add(grown: list[_Grown], line: TreeLine, parent: int | None) -> None:
    line.parent = parent
    grown.append(_Grown(line, KDTree(line.points)))


def _beginning(path: str, lines: list[TreeLine], inlet: str | np.ndarray | None, notes: list[str]) -> tuple[int, bool]:
    """The line that begins at the inlet, and whether at its last point."""
    ends = [(i, e) for i in range(len(lines)) for e in (False, True)]
    places = np.array([lines[i].points[-1 if e else 0] for i, e in ends])
    radii = np.array([lines[i].radii[-1 if e else 0] for i, e in ends])
    free = np.array([not _met(lines, i, p) for (i, _), p in zip(ends, places, strict=True)])
    if isinstance(inlet, str):
        named = [k for k, (i, _) in enumerate(ends) if lines[i].name == inlet]
        if not named:
            known = ", ".join(sorted(repr(line.name) for line in lines if line.name)) or "none"
            raise ValueError(f"inlet must be a point, or the name of a line of {path} ({known}), got {inlet!r}")
        best = max(named, key=lambda k: (free[k], radii[k]))
        return ends[best]
    if inlet is not None:
        gap = np.linalg.norm(places - inlet, axis=1) - 1e-3 * radii * free  # of two ends at one place the free one
        best = int(gap.argmin())
        if gap[best] > 3 * radii[best]:
            raise ValueError(
                f"inlet must be near the end of a line of {path}, in the file's coordinates; the nearest end, "
                f"{places[best].tolist()}, is {gap[best]:.4g} away"
            )
        return ends[best]
    if not free.any():
        raise ValueError(f"{path} has no free end to come in at; choose one with inlet=")
    best = int(np.where(free, radii, -1.0).argmax())
    if len(lines) > 1:
        place = places[best]
        name = lines[ends[best][0]].name
        notes.append(
            f"the inlet is taken to be the widest free end, at ({place[0]:.6g}, {place[1]:.6g}, {place[2]:.6g})"
            f"{f' of {name!r}' if name else ''}; inlet= chooses another"
        )
    return ends[best]


def _met(lines: list[TreeLine], i: int, place: np.ndarray) -> bool:
    """Whether a line other than i comes within `_ALONG` of its radius of a place."""
    for j, other in enumerate(lines):
        if j != i:
            gap = np.linalg.norm(other.points - place, axis=1)
            if gap.min() <= _ALONG * other.radii[gap.argmin()]:
                return True
    return False


def _touches(grown: list[_Grown], place: np.ndarray) -> tuple[float, int] | None:
    """The line of the tree in whose lumen a place lies: how deep, in radii from the axis, and its number."""
    best = None
    for k, g in enumerate(grown):
        _gap, at = g.tree.query(place)
        share = _gap_to(g.line, place, int(at)) / g.line.radii[at]
        if share <= 1.0 and (best is None or share < best[0] - 1e-9):
            best = (float(share), k)
    return best


def _gap_to(line: TreeLine, place: np.ndarray, at: int) -> float:
    """Distance of a place from the line, whose nearest point is number `at`."""
    best = float(np.linalg.norm(line.points[at] - place))
    for a, b in ((at - 1, at), (at, at + 1)):
        if a >= 0 and b < len(line.points):
            along = line.points[b] - line.points[a]
            share = np.clip((place - line.points[a]) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
            best = min(best, float(np.linalg.norm(line.points[a] + share * along - place)))
    return best


def _nearest_end(grown: list[_Grown], waiting: list[TreeLine]) -> tuple[int, bool, int, None] | None:
    best, found = np.inf, None
    for number, line in enumerate(waiting):
        for turned in (False, True):
            touch = _touches(grown, line.points[-1 if turned else 0])
            if touch is not None and touch[0] < best:
                best, found = touch[0], (number, turned, touch[1], None)
    return found


def _nearest_middle(grown: list[_Grown], waiting: list[TreeLine]) -> tuple[int, bool, int, int] | None:
    """A line whose middle an end of the tree lies on."""
    for k, g in enumerate(grown):
        for number, line in enumerate(waiting):
            gap = np.linalg.norm(line.points - g.line.points[-1], axis=1)
            at = int(gap.argmin())
            if gap[at] <= max(line.radii[at], g.line.radii[-1]) and 0 < at < len(line.points) - 1:
                return number, False, k, at
    return None


def _without_shared(grown: list[_Grown], line: TreeLine, parent: int) -> tuple[TreeLine | None, int]:
    """The line less its first part that runs along lines of the tree, and the line it then leaves."""
    first = 0
    for i in range(len(line.points)):
        shares = []
        for k, g in enumerate(grown):
            gap, at = g.tree.query(line.points[i])
            if gap < 2.0 * g.line.radii[at]:
                shares.append((_gap_to(g.line, line.points[i], int(at)) / g.line.radii[at], k))
        if not shares or min(shares)[0] > _ALONG:
            break
        first, parent = i, min(shares)[1]
    if first == len(line.points) - 1:
        return None, parent
    return TreeLine(line.name, line.points[first:], line.radii[first:]), parent


def _apart(path: str, grown: list[_Grown], waiting: list[TreeLine]) -> ValueError:
    gaps = []
    for line in waiting:
        for end in (0, -1):
            gaps += [(float(g.tree.query(line.points[end])[0]), line.name, line.points[end].tolist()) for g in grown]
    gap, name, place = min(gaps, key=lambda g: g[0])
    return ValueError(
        f"{path} must be one tree, but {len(waiting)} of its lines touch no other; the nearest is {name!r}, whose end "
        f"{place} lies {gap:.4g} from it"
    )


def tidied(line: TreeLine) -> tuple[np.ndarray, np.ndarray]:
    """Points about half a radius apart on a smooth curve, and radii there; the ends stay where they are.

    The curve through the file's points is averaged over `_BLUR` radii of it (a Gaussian), since points a fraction of a
    radius apart jitter: at a bend of three radii that moves it by 0.03 of the radius. A step that is much longer than
    the others is taken straight.
    """
    step = np.linalg.norm(np.diff(line.points, axis=0), axis=1)
    keep = np.concatenate([[True], step > 1e-6 * max(float(step.sum()), 1e-300)])
    points, radii = line.points[keep], line.radii[keep]
    if len(points) < 2:
        raise ValueError(f"line {line.name!r} must have two different points at least")
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    usual = max(float(np.median(step)), float(step.max()) / 50)
    parts = [max(1, round(s / usual)) if s > 2.5 * usual else 1 for s in step.tolist()]
    at = np.concatenate([i + np.arange(k) / k for i, k in enumerate(parts)] + [[len(points) - 1.0]])
    numbers = np.arange(len(points))
    points = np.stack([np.interp(at, numbers, p) for p in points.T], axis=1)
    radii = np.interp(at, numbers, radii)
    arc = np.concatenate([[0.0], np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()])
    count = int(np.clip(np.ceil(4 * arc[-1] / np.median(radii)), 24, 1200))
    s = np.linspace(0.0, arc[-1], count + 1)
    if usual > 0.7 * float(np.median(radii)) and len(points) > 2:  # few points: a spline through them
        fine = CubicSpline(arc, points, bc_type="natural")(s)
    else:
        fine = np.stack([np.interp(s, arc, p) for p in points.T], axis=1)
    fine = _averaged(s, fine, _BLUR * np.interp(s, arc, radii))
    spacing = np.clip(0.5 * np.interp(s, arc, radii), arc[-1] / 400, arc[-1] / 6)
    along = np.concatenate([[0.0], np.cumsum(np.diff(s) / ((spacing[1:] + spacing[:-1]) / 2))])
    wanted = np.interp(np.linspace(0.0, along[-1], max(3, int(np.ceil(along[-1])) + 1)), along, s)
    return np.stack([np.interp(wanted, s, p) for p in fine.T], axis=1), np.interp(wanted, arc, radii)


def _averaged(s: np.ndarray, points: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Points at even arc lengths s averaged by a Gaussian of their own width; the line is mirrored in its ends."""
    before, after = 2 * points[0] - points[:0:-1], 2 * points[-1] - points[-2::-1]
    whole = np.concatenate([before, points, after])
    places = np.concatenate([2 * s[0] - s[:0:-1], s, 2 * s[-1] - s[-2::-1]])
    weights = np.exp(-0.5 * ((places - s[:, None]) / width[:, None]) ** 2)
    return (weights @ whole) / weights.sum(axis=1, keepdims=True)
