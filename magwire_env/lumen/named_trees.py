"""Lumens with a name: forks, a room, and anatomies from published dimensions. Lengths in m unless said otherwise.

Axes of the anatomies: x to the patient's left, y to the head, z to the front.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from ..physics.checks import in_range, one_of, positive, vector
from . import named
from .branch import Branch
from .curve import Tract
from .lumen import Lumen
from .rooms import BoxWall

__all__ = [
    "LUMENS",
    "aortic_arch",
    "box",
    "circle_of_willis",
    "fork",
    "helix",
    "left_bronchus",
    "paper",
    "straight",
    "two_forks",
]


def straight(length: float = 0.4, radius: float = 4e-3) -> Lumen:
    """A straight tube along x from the origin."""
    length, radius = positive("length", length, "m"), positive("radius", radius, "m")
    return Lumen.from_tract(Tract.from_points([(0, 0, 0), (length / 2, 0, 0), (length, 0, 0)], radius), "straight")


def helix(length: float = 0.8, radius: float = 7.5e-3) -> Lumen:
    """A helix that climbs along z: two and a half turns, bend radius 50 mm at 0.8 m (`named.helix`)."""
    return Lumen.from_tract(named.helix(length, radius), "helix")


def paper() -> Lumen:
    """The paper's tract: 0.8 m, 15 mm wide, two turns winding in (`named.paper_spiral`)."""
    return Lumen.from_tract(named.paper_spiral(), "paper")


def box(size: Sequence[float] = (0.1, 0.06, 0.06), opening: float = 4e-3) -> Lumen:
    """A closed room along x, for tests: size (3,) m. The wire comes in through the middle of the face at x = 0.

    opening : radius of the way in, m
    """
    size = [positive(f"size[{i}]", v, "m") for i, v in enumerate(vector("size", size, 3, "m"))]
    half = min(size[1:]) / 2
    opening = in_range("opening", opening, 1e-6, half, "m")
    points = [(0.0, 0.0, 0.0), (size[0] / 2, 0.0, 0.0), (size[0], 0.0, 0.0)]
    wall = BoxWall((0.0, -size[1] / 2, -size[2] / 2), (size[0], size[1] / 2, size[2] / 2))
    return Lumen((Branch("room", Tract.from_points(points, (opening, half, half))),), wall=wall, name="box")


def fork(angle: float = 35.0, radius: float = 4e-3, length: float = 0.06) -> Lumen:
    """A trunk along x that parts into "left" and "right", each turned by `angle` degrees, in the x–y plane.

    The two together carry what the trunk does (Murray 1926: the cubes of the radii add up), so each has 0.79 of
    `radius`. All three are `length` m long.
    """
    angle = in_range("angle", angle, 5.0, 85.0, "degrees")
    radius, length = positive("radius", radius, "m"), positive("length", length, "m")
    small = 0.5 ** (1 / 3) * radius
    turn = np.deg2rad(angle)
    lines: list[tuple] = [("trunk", _line((0, 0, 0), (length, 0, 0)), radius, None)]
    for name, side in (("left", 1.0), ("right", -1.0)):
        end = (length * (1 + np.cos(turn)), side * length * np.sin(turn), 0.0)
        lines.append((name, _line((length, 0, 0), end), small, "trunk"))
    return Lumen.from_lines(lines, "fork")


def two_forks(angle: float = 35.0, radius: float = 4e-3, length: float = 0.06) -> Lumen:
    """Two forks in series: the second, on the left branch, is turned into the x–z plane of that branch.

    Its ends are "right", "upper" and "lower"; radii by Murray's law at both forks, each branch `length` m long.
    """
    first = fork(angle, radius, length)
    turn = np.deg2rad(angle)
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    start = first.position("left")
    lines = [(b.name, np.array(b.curve.points), b.curve.radius, b.parent) for b in first.branches]
    for name, side in (("upper", 1.0), ("lower", -1.0)):
        end = start + length * (np.cos(turn) * along + side * np.sin(turn) * np.array([0.0, 0.0, 1.0]))
        lines.append((name, _line(start, end), 0.5 ** (2 / 3) * radius, "left"))
    return Lumen.from_lines(lines, "two forks")


def aortic_arch(kind: str = "I") -> Lumen:
    """An adult aortic arch of type "I", "II" or "III" with its three branches; the inlet is the descending aorta.

    Type: how far below the top of the arch the brachiocephalic trunk leaves it, in diameters of the left common
    carotid artery: up to one (I), one to two (II), more (III) (Madhwal et al. 2008, J Invasive Cardiol 20:200); here
    0.5, 1.5 and 2.5. Diameters of the aorta 29.5 mm ascending, 28.6, 27.1 and 25.3 at its branches, 23.9 descending,
    and 21.8 and 14.3 mm between the branches (Girsowicz et al. 2017, Ann Vasc Surg 44:61). Openings 12.5 mm
    (brachiocephalic trunk, BCT), 8.28 (left common carotid, LCCA), 10.41 (left subclavian, LSA) (Yan et al. 2017, 217
    CT angiographies); carotids 6.5 mm (Krejza et al. 2006, Stroke 37:1103). The courses are ours: an arch of 36 mm
    bend radius, whose plane turns backwards to the left.

    Ends: "aorta" (at the valve), "RSA", "RCCA", "LCCA", "LSA".
    """
    one_of("kind", kind, ("I", "II", "III"))
    bend, lcca = 36.0, 8.28
    drop = {"I": 0.5, "II": 1.5, "III": 2.5}[kind] * lcca
    outer = bend + 28.6 / 2
    at_bct = -np.arccos(1 - drop / outer)  # angle from the top of the arch, towards the heart negative
    at = {"BCT": at_bct, "LCCA": at_bct + 21.8 / bend, "LSA": at_bct + (21.8 + 14.3) / bend}
    plane = np.array([np.cos(np.deg2rad(35)), 0.0, -np.sin(np.deg2rad(35))])  # across the arch: to the left and back

    def arch(angle: np.ndarray | float) -> np.ndarray:
        angle = np.asarray(angle, dtype=np.float64)[..., None]
        return bend * (np.sin(angle) * plane + np.cos(angle) * np.array([0.0, 1.0, 0.0]))

    down = np.linspace(-150.0, 0.0, 16)[:-1, None] * np.array([0.02, 1.0, 0.0]) + arch(np.pi / 2)
    turns = np.linspace(np.pi / 2, -np.pi / 2, 13)
    fall = np.linspace(0.0, 1.0, 7)[1:, None]  # from the arch down to the valve, bending to the middle and forwards
    up = arch(-np.pi / 2) + fall * np.array([0.0, -55.0, 0.0]) + fall**2 * np.array([14.0, 0.0, 6.0])
    points = np.vstack([down, arch(turns), up])
    arc = np.r_[0.0, np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()]
    length_to = {name: arc[len(down)] + bend * (np.pi / 2 - angle) for name, angle in at.items()}
    stations = [0.0, length_to["LSA"] - 25, length_to["LSA"], length_to["LCCA"], length_to["BCT"], arc[-1]]
    radii = np.interp(arc, stations, np.array([23.9, 23.9, 25.3, 27.1, 28.6, 29.5]) / 2)
    lines: list[tuple] = [("aorta", 1e-3 * points, 1e-3 * radii, None)]

    def leave(name: str, way: Sequence[Sequence[float]], diameters: Sequence[float]) -> np.ndarray:
        origin = arch(at[name])
        out = origin / bend
        stations = [origin, origin + 12 * out, origin + 24 * out + (0, 3, 0)]
        stations += [stations[-1] + np.array(step) for step in way]
        lines.append((name, *_course(stations, diameters), "aorta"))
        return stations[-1]

    end = leave("BCT", [(-4, 12, 1), (-9, 24, 2)], (12.5, 12.5, 12.5, 12.2, 12.0))
    lines.append(
        ("RCCA", *_course([end, end + (-2, 14, 1), end + (0, 45, 4), end + (4, 80, 6)], (9, 7, 6.5, 6.5)), "BCT")
    )
    lines.append(
        ("RSA", *_course([end, end + (-13, 10, 0), end + (-35, 17, -4), end + (-62, 10, -4)], (10, 9, 8.5, 8)), "BCT")
    )
    leave("LCCA", [(1, 15, 0), (4, 50, 3), (2, 95, 6)], (8.28, 8.28, 8, 7.2, 6.5, 6.5))
    leave("LSA", [(3, 14, -3), (14, 34, -5), (45, 44, 0), (75, 34, 4)], (10.41, 10.41, 10.2, 10, 9, 8.5, 8))
    return Lumen.from_lines(lines, f"aortic arch, type {kind}")


def circle_of_willis() -> Lumen:
    """The way to the circle of Willis through the left carotid artery: its front and its link to the back.

    The inlet is the common carotid (CCA) 60 mm below its fork. Diameters: CCA 6.5, internal carotid (ICA) 5.1 in the
    neck (Krejza et al. 2006, Stroke 37:1103), with a bulb of 7.6 (Medicina 2021, 57:870), 5.0 where it enters the
    siphon and 3.6 at its end; middle cerebral artery 3.1 to 2.4 mm over 22.5 mm (Rai et al. 2013, J Neurointerv Surg
    5:371); anterior cerebral 2.09 over 14 mm, posterior communicating 1.22 over 12.9 mm (Shatri et al. 2017, Open
    Access Maced J Med Sci). The siphon's course is ours. A tree: the communicating artery of the front is left out.

    Ends: "ECA", "PCOM" (posterior communicating), "A2", "M2 upper", "M2 lower".
    """
    neck = [(0, -60, 0), (0, -30, 1), (0, 0, 0), (2.5, 14, -3), (4, 30, -6), (4, 50, -7), (3, 70, -7)]
    petrous = [(3, 80, -6.5), (0.5, 87, -3), (-5, 90.5, 2), (-11, 92, 7), (-15, 95.5, 10.5)]
    siphon = [(-16.5, 101, 12), (-16.5, 105.5, 16), (-16, 107.5, 22), (-15, 110, 27.5), (-13.5, 115, 29),
              (-11.5, 119, 25), (-10, 121.5, 19.5), (-9, 125.5, 15.5), (-8.5, 131, 14.5)]  # fmt: skip
    across = [6.5, 6.5, 7.0, 7.6, 5.4, 5.1, 5.1, 5.1, 5.0, 5.0, 5.0, 5.0, 5.0, 4.9, 4.8, 4.6, 4.4, 4.2, 4.0, 3.8, 3.6]
    lines: list[tuple] = [("ICA", *_course(neck + petrous + siphon, across), None)]
    end, bifurcation = np.array(siphon[-1], dtype=float), np.array(neck[2], dtype=float)
    com = np.array(siphon[-2], dtype=float)
    grown: dict[str, tuple] = {
        "ECA": ("ICA", bifurcation, [(-4, 10, 6), (-6, 25, 10), (-5, 45, 10), (-2, 65, 8)], (5.5, 5, 4.5, 4, 3.5)),
        "PCOM": ("ICA", com, [(0.5, 1, -4), (1, 1, -9), (0, 0.5, -13)], (1.6, 1.3, 1.22, 1.22)),
        "ACA": ("ICA", end, [(-4.5, 1.5, 3.5), (-9, 1.5, 6), (-12.5, 2.5, 7.5)], (2.4, 2.1, 2.09, 2.09)),
        "MCA": ("ICA", end, [(5, 1.5, -1), (11, 2, -2.5), (17, 1, -3), (21.5, 0, -1.5)], (3.2, 3.1, 2.9, 2.7, 2.4)),
    }
    for name, (parent, start, way, diameters) in grown.items():
        lines.append((name, *_course([start, *(start + np.array(step) for step in way)], diameters), parent))
    a1, m1 = end + (-12.5, 2.5, 7.5), end + (21.5, 0, -1.5)
    ways: dict[str, tuple] = {
        "A2": ("ACA", a1, [(-1.5, 4, 3), (-2, 12, 7), (-2, 22, 6), (-2, 32, 0)], (2.0, 2.0, 1.9, 1.8, 1.7)),
        "M2 upper": ("MCA", m1, [(3, 4, 1), (5, 12, 0), (8, 22, -4)], (2.1, 2.0, 1.9, 1.8)),
        "M2 lower": ("MCA", m1, [(4, -1, -3), (7, 2, -10), (10, 8, -20)], (2.1, 2.0, 1.9, 1.8)),
    }
    for name, (parent, start, way, diameters) in ways.items():
        lines.append((name, *_course([start, *(start + np.array(step) for step in way)], diameters), parent))
    return Lumen.from_lines(lines, "circle of Willis")


def left_bronchus() -> Lumen:
    """The airway from the trachea to the segments of the left lung; the inlet is 60 mm above the carina.

    Diameters and lengths by generation of Weibel's model A (1963): trachea 18 mm; main bronchi 12.2 mm, 47.6 mm long;
    lobes 8.3 mm, 19 mm; then 5.6 mm and 4.5 mm, 12.7 mm. The directions are ours, with the left main bronchus 42°, the
    right 25° from the trachea's. The right main bronchus ("RMB") ends after 30 mm.

    Ends: "RMB", "LB1+2", "LB3", "LB4+5" (lingula), "LB6", "LB8", "LB9+10".
    """
    lines: list[tuple] = [("trachea", 1e-3 * _line((0, 60, 0), (0, 0, 0)), 9e-3, None)]
    ends: dict[str, np.ndarray] = {"trachea": np.zeros(3)}

    def grow(name: str, parent: str, way: Sequence[Sequence[float]], diameters: Sequence[float]) -> None:
        start = ends[parent]
        stations = [start, *(start + np.array(step, dtype=float) for step in way)]
        lines.append((name, *_course(stations, diameters), parent))
        ends[name] = stations[-1]

    grow("RMB", "trachea", [(-6, -13, -1), (-13, -28, -3)], (13, 12.2, 12.2))
    grow("LMB", "trachea", [(10, -11, -2), (21.5, -22, -5), (34, -32, -10)], (13, 12.2, 12.2, 12))
    grow("LUL", "LMB", [(6, -1, 3), (11, 1.5, 6)], (9, 8.3, 8.3))
    grow("LLL", "LMB", [(4, -7, -3.5), (8.5, -15.5, -7)], (10, 8.3, 8.3))
    grow("LB upper", "LUL", [(2, 5, 1.5), (3.5, 10, 2)], (6.5, 5.6, 5.6))
    grow("LB4+5", "LUL", [(5, -3, 5.5), (9, -10, 11)], (6, 5.6, 4.5))
    grow("LB1+2", "LB upper", [(2, 6, -2), (4, 13, -4)], (5, 4.5, 4.5))
    grow("LB3", "LB upper", [(2.5, 4, 5), (5, 7, 11)], (5, 4.5, 4.5))
    grow("LB6", "LLL", [(2, -2.5, -6), (5, -3, -13)], (6, 5.6, 4.5))
    grow("LB basal", "LLL", [(2, -6.5, 0.5), (4, -13, 1)], (6.5, 5.6, 5.6))
    grow("LB8", "LB basal", [(4, -5, 3), (8, -11, 6)], (5, 4.5, 4.5))
    grow("LB9+10", "LB basal", [(0.5, -6.5, -2.5), (2, -13, -5)], (5, 4.5, 4.5))
    return Lumen.from_lines(lines, "left bronchus")


LUMENS: dict[str, Callable[..., Lumen]] = {
    f.__name__: f for f in (straight, helix, paper, box, fork, two_forks, aortic_arch, circle_of_willis, left_bronchus)
}
"""Every named lumen by its name; each builds its own with the arguments it documents, all optional."""


def _line(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray, count: int = 9) -> np.ndarray:
    return np.linspace(np.asarray(a, dtype=float), np.asarray(b, dtype=float), count)


def _course(stations: Sequence, diameters: Sequence[float], spacing: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) m about `spacing` mm apart on a spline through stations (mm), and radii from the diameters (mm)."""
    xyz = np.array([np.asarray(p, dtype=float) for p in stations])
    chord = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
    u = np.linspace(0.0, chord[-1], max(5, round(chord[-1] / spacing) + 1))
    return 1e-3 * CubicSpline(chord, xyz, bc_type="natural")(u), 0.5e-3 * np.interp(u, chord, diameters)
