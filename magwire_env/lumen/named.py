"""Tracts with a name.

Every function takes `length`, the tract's arc length (the whole shape is scaled to it, so its bends scale with it) and
`radius`, that of the lumen, both in m. At their default sizes no tract bends more sharply than 30 mm, and parts that
are not neighbours stay at least two lumen radii and 3 mm apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from .curve import Tract

__all__ = [
    "NAMED",
    "aortic_arch",
    "circle",
    "colon_frame",
    "helix",
    "paper_spiral",
    "planar_course",
    "s_bend",
    "small_bowel_loops",
    "straight",
]


def paper_spiral(length: float = 0.8, radius: float = 7.5e-3) -> Tract:
    """The paper's tract as read here: two turns winding in from 90 mm to 40 mm radius, scaled to `length` m.

    The paper gives the tract's length and diameter (Section IV) but its curve only as a picture, so the curve is
    ours: a spiral in the x–y plane whose z ripples by 10 mm from crest to trough, twice a turn. Over its first and its
    last 20 mm the curvature goes to zero, so that it runs smoothly into its straight extensions.
    """
    turn = np.linspace(0.0, 4 * np.pi, 121)[2:-5]
    r = np.interp(turn, [0.0, 4 * np.pi], [0.09, 0.04])
    xyz = np.stack([r * np.cos(turn), r * np.sin(turn), 0.005 * np.sin(2 * turn)], axis=1)
    return _scaled(_eased(xyz), length, radius)


def straight(length: float = 0.8, radius: float = 7.5e-3) -> Tract:
    """A straight tract along x, centred on the origin."""
    return Tract.from_points([(-length / 2, 0.0, 0.0), (0.0, 0.0, 0.0), (length / 2, 0.0, 0.0)], radius)


def helix(length: float = 0.8, radius: float = 7.5e-3) -> Tract:
    """A helix climbing along z, as a coiled tube on a bench: two and a half turns, 25 mm a turn.

    Its bend radius is 50 mm at 0.8 m, but 40 mm in the last centimetre at each end, where the spline goes straight.
    """
    turn = np.linspace(0.0, 5 * np.pi, 81)
    xyz = np.stack([0.0507 * np.cos(turn), 0.0507 * np.sin(turn), 0.025 * (turn / (2 * np.pi) - 1.25)], axis=1)
    return _scaled(xyz, length, radius)


def colon_frame(length: float = 0.9, radius: float = 7.5e-3) -> Tract:
    """The frame of the large bowel, rectum to caecum, at about three fifths of an adult's size.

    Seen from the front (x to the patient's left, y to the head, z to the front): up the rectum, through the sigmoid
    loop, up the descending colon on the left, round the splenic flexure, along the transverse colon, which sags and
    hangs forward, round the hepatic flexure and down the ascending colon on the right. At 0.9 m the sharpest bend,
    the splenic flexure, has a radius of 35 mm.
    """
    legs = [
        (0.055, 0),
        (0.105, -165),
        (0.112, 170),
        (0.13, -6),
        (0.082, 128),
        (0.06, 4),
        (0.09, -76),
        (0.06, 2),
        (0.082, 120),
        (0.11, 3),
    ]
    xy = planar_course(legs)[:, ::-1] * (-1, 1)  # set out upwards
    depth = CubicSpline(np.linspace(0, 1, 10), [-22, -12, 12, 2, -14, -20, 6, 22, -8, -16], bc_type="natural")
    return _scaled(np.column_stack([xy, 1e-3 * depth(np.linspace(0, 1, len(xy)))]), length, radius)


def small_bowel_loops(length: float = 0.9, radius: float = 7.5e-3) -> Tract:
    """Loops of small bowel: four runs side by side, three bulging hairpins of unequal size, in a 40 mm deep slab.

    The sharpest bend, of 36 mm radius at 0.9 m, is the first hairpin.
    """
    legs = [(0.11, 8), (0.14, 198), (0.1, -18), (0.155, -204), (0.09, 20), (0.14, 200), (0.11, -20)]
    xy = planar_course(legs)
    along = np.linspace(0.0, 1.0, len(xy))
    z = 0.020 * np.sin(7 * np.pi * along + 0.6) * (1 - 0.3 * along)
    return _scaled(np.column_stack([xy, z]), length, radius)


def aortic_arch(length: float = 0.45, radius: float = 13e-3) -> Tract:
    """The main run of a human aorta: ascending from the valve, over the arch, down the descending aorta.

    Seen from the front (x to the patient's left, y to the head, z to the front), the arch also turns to the back, and
    the descending run comes forward again towards the diaphragm. `radius` is the lumen's at the valve; it tapers to
    two thirds of it at the far end. At 0.45 m the arch's smallest bend radius is 47 mm. The branches of the arch are
    left out.
    """
    stations = [  # mm
        (-20, -62, 24), (-26, -40, 25), (-28, -16, 24), (-22, 8, 19), (-6, 26, 10), (14, 33, -3), (33, 26, -16),
        (44, 8, -27), (47, -16, -34), (46, -48, -38), (43, -82, -38), (38, -118, -35), (32, -154, -29), (26, -190, -22),
    ]  # fmt: skip
    xyz = _through(stations)
    return _scaled(xyz, length, radius * np.linspace(1.0, 2 / 3, len(xyz)))


def s_bend(length: float = 0.4, radius: float = 7.5e-3) -> Tract:
    """Two opposite bends of 90° in the x–y plane with straight leads, the test shape of catheter benches.

    The bend radius is 73 mm at 0.4 m.
    """
    xy = planar_course([(0.08, 0), (0.12, 90), (0.12, -90), (0.08, 0)])
    return _scaled(np.column_stack([xy, np.zeros(len(xy))]), length, radius)


def circle(length: float = 0.4, radius: float = 7.5e-3) -> Tract:
    """A closed circle in the x–y plane about the origin, of bend radius `length`/2π: 64 mm at 0.4 m."""
    turn = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
    return _scaled(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), length, radius, closed=True)


NAMED: dict[str, Callable[..., Tract]] = {
    f.__name__: f for f in (paper_spiral, straight, helix, colon_frame, small_bowel_loops, aortic_arch, s_bend, circle)
}
"""Every named tract by its name; each is called with `length` and `radius` in m, both optional."""


def planar_course(legs: Sequence[tuple[float, float]], spacing: float = 0.01, ease: float = 0.03) -> np.ndarray:
    """A course in the plane, from its legs: a leg is its length (m) and its turn to the left (degrees).

    legs : [(length, turn), …], in order along the course, which sets out from the origin along +x
    spacing : m, between the points returned
    ease : m; curvature passes from leg to leg over this length, so that a spline can follow it

    Returns points (n, 2) m, their bounding box centred on the origin.
    """
    lengths, turns = np.array(legs).T
    fine = 1e-3
    counts = np.maximum(1, np.rint(lengths / fine).astype(int))
    curvature = np.repeat(np.deg2rad(turns) / (counts * fine), counts)
    width = max(1, round(ease / fine))
    curvature = np.convolve(np.pad(curvature, width, mode="edge"), np.full(width, 1 / width), mode="same")[width:-width]
    heading = np.cumsum(curvature) * fine - curvature * fine / 2
    course = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0) * fine
    at = np.linspace(0, len(course) - 1, max(4, round(len(course) * fine / spacing) + 1))
    points = np.stack([np.interp(at, np.arange(len(course)), c) for c in course.T], axis=1)
    return points - (points.max(axis=0) + points.min(axis=0)) / 2


def _through(stations: Sequence[tuple[float, float, float]], spacing: float = 0.01) -> np.ndarray:
    """Points (n, 3) m about `spacing` m apart on a spline through `stations` (mm), their bounding box centred on 0."""
    xyz = np.array(stations, dtype=np.float64) * 1e-3
    chord = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
    points = CubicSpline(chord, xyz)(np.linspace(0.0, chord[-1], round(chord[-1] / spacing) + 1))
    return points - (points.max(axis=0) + points.min(axis=0)) / 2


def _eased(xyz: np.ndarray, ease: float = 0.02, points: int = 4) -> np.ndarray:
    """`xyz` (n, 3) m with `ease` m added at both ends over which the curvature falls linearly to zero."""
    chord = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
    curve = CubicSpline(chord, xyz)
    u = ease * np.arange(1, points + 1)[:, None] / points
    tails = []
    for end, sign in ((chord[0], -1.0), (chord[-1], 1.0)):
        speed = np.linalg.norm(curve(end, 1))
        tangent = sign * curve(end, 1) / speed
        bend = curve(end, 2) / speed**2
        bend = bend - (bend @ tangent) * tangent
        tails.append(curve(end) + tangent * u + bend * (u**2 / 2 - u**3 / (6 * ease)))
    return np.vstack([tails[0][::-1], xyz, tails[1]])


def _scaled(xyz: np.ndarray, length: float, radius: float | np.ndarray, closed: bool = False) -> Tract:
    factor = length / Tract.from_points(xyz, closed=closed).length
    return Tract.from_points(xyz * factor, radius, closed)
