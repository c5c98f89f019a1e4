"""Figures 1 and 2: the free rod beside a dipole that comes nearer, and before one that turns in place."""

from __future__ import annotations

import numpy as np

from ..physics import DipoleCloud, FreeRod, RodPath
from ..plotting import BLACK, GREY, ORANGE, RED, SEQUENCE, blank, broken
from ..scenario import Scenario
from .page import Page

__all__ = ["approaching", "turning"]

STRENGTH = 20.0
"""Of the free dipole, A·m²: a neodymium cube of 27 mm."""

_SHOWN = 9


def paper_rod(segments: int = 40) -> FreeRod:
    """The paper's wire and tip without a tract, clamped at its base."""
    scenario = Scenario.paper()
    return FreeRod(scenario.replace(wire__segments=segments).wire, scenario.tip)


def approaching() -> Page:
    """Figure 1: a dipole beside the tip, antiparallel to it, moves towards the wire until the tip snaps to it."""
    rod = paper_rod()
    length = rod.wire.length
    height = np.arange(0.16, 0.04, -1e-3)
    loads = [{"cloud": DipoleCloud(np.array([[length, 0, z]]), np.array([[-STRENGTH, 0, 0]]))} for z in height]
    path = rod.path(loads)
    figure, (left, right) = blank(1, 2, (7.5, 3.8), width_ratios=(1.25, 1))
    last = path.snap if path.snap is not None else len(height)
    shown = np.unique(np.searchsorted(-height[:last], -np.linspace(height[0], height[last - 1], _SHOWN)))
    colours = _draw_rods(left, path, shown, height * 1e3)
    left.scatter(np.full(len(shown), 1e3 * length), 1e3 * height[shown], c=colours, s=26, zorder=3)
    for z, colour in zip(height[shown], colours, strict=True):
        arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.3}
        left.annotate("", (1e3 * length - 11, 1e3 * z), (1e3 * length + 11, 1e3 * z), arrowprops=arrow)
    left.set(xlabel="x (mm)", ylabel="z (mm)", xlim=(-4, 120), ylim=(-22, 172), aspect="equal")
    left.set_title("Free dipole (arrows) moving towards the wire")
    left.text(42, 140, f"free dipole, {STRENGTH:g} A·m²,\nantiparallel to the tip", ha="center")
    tip = path.positions[:, -1]
    right.plot(1e3 * height, 1e3 * tip[:, 2], color=BLACK)
    _say_snap(right, path, (1e3 * height).round(1), 1e3 * tip[:, 2], "mm")
    right.invert_xaxis()
    right.set(xlabel="height of the dipole above the straight wire (mm)", ylabel="deflection of the tip (mm)")
    right.set_title("Deflection, up to the snap")
    return Page(figure, {"": _columns("dipole_height_m", height, path)})


def turning() -> Page:
    """Figure 2: a dipole ahead of the tip turns in place, and the tip turns after its field."""
    rod = paper_rod()
    length, ahead = rod.wire.length, 0.09
    angle = np.radians(np.arange(0.0, 361.0, 2.5))
    loads = [
        {"cloud": DipoleCloud(np.array([[length + ahead, 0, 0]]), STRENGTH * np.array([[np.cos(a), 0, np.sin(a)]]))}
        for a in angle
    ]
    path = rod.path(loads)
    figure, (left, right) = blank(2, 1, (7.0, 5.4), height_ratios=(1, 1.5))
    shown = np.arange(0, len(angle), 12)
    shown = shown[path.converged[shown]]
    colours = _draw_rods(left, path, shown, np.degrees(angle))
    for a, colour in zip(angle[shown], colours, strict=True):
        centre = np.array([1e3 * (length + ahead), 0.0])
        end = centre + 16 * np.array([np.cos(a), np.sin(a)])
        left.annotate("", end, centre, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.3})
    left.set(xlabel="x (mm)", ylabel="z (mm)", xlim=(-4, 212), ylim=(-36, 36), aspect="equal")
    left.set_title(f"Free dipole of {STRENGTH:g} A·m² (arrows) turning in place, {1e3 * ahead:g} mm ahead")
    tip = path.positions[:, -1]
    right.plot(np.degrees(angle), 1e3 * broken(tip[:, 2], 0.01), color=BLACK)
    _say_snap(right, path, np.degrees(angle).round(1), 1e3 * tip[:, 2], "°")
    right.set(
        xlabel="angle of the dipole from the wire's axis (°)", ylabel="deflection of the tip (mm)", ylim=(-32, 42)
    )
    right.set_xticks(np.arange(0, 361, 60))
    right.set_title("The tip turns after the field")
    return Page(figure, {"": _columns("dipole_angle_rad", angle, path)})


def _draw_rods(axes, path: RodPath, shown: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Rods of the loads `shown`, coloured by `by`; returns the colours."""
    import matplotlib as mpl

    place = (by[shown] - by[shown].min()) / np.ptp(by[shown])
    colours = mpl.colormaps[SEQUENCE](0.9 * place)
    for nodes, colour in zip(1e3 * path.positions[shown], colours, strict=True):
        axes.plot(nodes[:, 0], nodes[:, 2], color=colour)
        axes.plot(nodes[-2:, 0], nodes[-2:, 2], color=colour, lw=4, solid_capstyle="butt")
    axes.plot([0, 0], [-5, 5], color=GREY, lw=5, solid_capstyle="butt")
    axes.text(3, -8, "clamp", va="top")
    return colours


def _say_snap(axes, path: RodPath, at: np.ndarray, deflection: np.ndarray, unit: str) -> None:
    """Mark where the branch ends, and say whether the rod lands in another equilibrium or on the magnet."""
    if path.snap is None:
        axes.text(0.04, 0.05, "no snap: one branch all the way", transform=axes.transAxes, color=RED, fontsize=8.5)
        return
    before = path.snap - 1
    axes.plot(at[before], deflection[before], "o", color=RED, zorder=3)
    axes.axvline(at[path.snap], color=ORANGE, lw=1.2, ls="--")
    end = "to another equilibrium" if path.converged[path.snap] else "onto the magnet"
    axes.text(
        0.04,
        0.95,
        f"snap between {at[before]:g} and {at[path.snap]:g} {unit}:\nthe tip jumps {end}",
        transform=axes.transAxes,
        va="top",
        color=RED,
        fontsize=8.5,
    )


def _columns(name: str, at: np.ndarray, path: RodPath) -> dict[str, np.ndarray]:
    last = path.positions[:, -1] - path.positions[:, -2]
    return {
        name: at,
        "tip_x_m": path.positions[:, -1, 0],
        "tip_z_m": path.positions[:, -1, 2],
        "tip_angle_rad": np.arctan2(last[:, 2], last[:, 0]),
        "converged": path.converged.astype(float),
    }
