"""Figures 5, 6, 7: flux and force of the turning magnet; and an eighth, the drive the paper's projection leaves out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..physics import field, force
from ..plotting import BLACK, BLUE, GREEN, GREY, ORANGE, RED, SEQUENCE, blank, broken
from ..scenario import Rig, Scenario
from ..simulation import best_command, drive_at, force_map
from .drawings import block_size
from .page import Page

__all__ = ["against_angle", "best_angle", "coupling", "flux"]


def paper_of_2000() -> Scenario:
    """The paper's set-up with its own 2000 dipoles, 10 × 10 × 20."""
    paper = Scenario.paper()
    return paper.replace(rig=Rig((replace(paper.rig.magnets[0], dipoles=("grid", (10, 10, 20))),)))


def flux() -> Page:
    """Figure 5: the flux in the plane through the magnet, and the force on the tip with its projection on the tract."""
    scenario, angle = paper_of_2000(), math.radians(215)
    mount, tract = scenario.rig.magnets[0], scenario.tract
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    centre = np.array(mount.position)
    cloud = mount.magnet.dipoles(*mount.dipoles).moved(turn, centre)
    figure, (left, right) = blank(1, 2, (9.5, 4.6), width_ratios=(1.12, 1))
    x, z = np.linspace(-0.13, 0.13, 53), np.linspace(-0.03, 0.15, 37)
    grid = np.stack(np.meshgrid(x, [centre[1]], z, indexing="ij"), axis=-1).reshape(-1, 3)
    b = field(cloud, grid)
    _draw_flux(figure, left, x, z, b, centre, angle, block_size(mount)[0])
    at = np.linspace(0.1, 0.79, 19)
    push = force(cloud, tract.position(at), scenario.tip.moment * tract.tangent(at))
    along = np.einsum("ni,ni->n", push, tract.tangent(at))
    _draw_forces(right, tract, at, push, along, centre)
    right.set_title(f"Force on the tip at {math.degrees(angle):.0f}°, seen from above")
    place = tract.position(at)
    forces = {"tip_arclength_m": at, **dict(zip(("x_m", "y_m", "z_m"), place.T, strict=True))}
    forces |= dict(zip(("force_x_N", "force_y_N", "force_z_N"), push.T, strict=True)) | {"projected_N": along}
    fluxes = dict(zip(("x_m", "y_m", "z_m"), grid.T, strict=True)) | dict(
        zip(("bx_T", "by_T", "bz_T"), b.T, strict=True)
    )
    return Page(figure, {"force": forces, "flux": fluxes})


def _draw_flux(
    figure, axes, x: np.ndarray, z: np.ndarray, b: np.ndarray, centre: np.ndarray, angle: float, edge: float
) -> None:
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Polygon

    bx, bz = (b[:, i].reshape(len(x), len(z)).T for i in (0, 2))
    size = 1e3 * np.hypot(bx, bz)
    lines = axes.streamplot(
        1e3 * x, 1e3 * z, bx, bz, color=np.clip(size, 3, 300), cmap=SEQUENCE, norm=LogNorm(3, 300), density=1.5,
        linewidth=0.9, arrowsize=0.8,
    )  # fmt: skip
    figure.colorbar(lines.lines, ax=axes, label="flux density in the plane (mT)", shrink=0.8)
    corners = edge / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    c, s = math.cos(angle), math.sin(angle)
    body = np.array([[c, s], [-s, c]])
    block = 1e3 * (corners @ body.T + centre[[0, 2]])
    axes.add_patch(Polygon(block, closed=True, fc="#F2F2F2", ec=BLACK, lw=1.5, alpha=0.85, zorder=3))
    middle, tip = 1e3 * centre[[0, 2]], 1e3 * edge * 0.4 * np.array([s, c])
    axes.annotate("", middle + tip, middle - tip, arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 2.2}, zorder=4)
    axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal", xlim=1e3 * x[[0, -1]], ylim=1e3 * z[[0, -1]])
    axes.set_title(f"Flux of 2000 dipoles at {math.degrees(angle):.0f}°, moment in red")
    axes.grid(False)


def _draw_forces(axes, tract, at: np.ndarray, push: np.ndarray, along: np.ndarray, centre: np.ndarray) -> None:
    line, place, tangent = (
        1e3 * tract.position(np.linspace(0, tract.length, 800)),
        1e3 * tract.position(at),
        tract.tangent(at),
    )
    axes.plot(line[:, 0], line[:, 1], color=GREY, lw=1)
    scale = {"angles": "xy", "scale_units": "xy", "scale": 0.35e-3, "width": 0.006, "zorder": 3}
    first = axes.quiver(
        place[:, 0], place[:, 1], push[:, 0], push[:, 1], color=ORANGE, label="force F (x and y)", **scale
    )
    axes.quiver(
        place[:, 0], place[:, 1], *(along[:, None] * tangent)[:, :2].T, color=BLUE, label="projection (F·t) t", **scale
    )
    axes.plot(*(1e3 * centre[:2]), "s", color=BLACK, ms=5, label="magnet's centre")
    axes.plot(*line[0, :2], "o", color=GREEN, ms=5, label="entrance")
    axes.quiverkey(first, 0.83, 0.04, 10e-3, "10 mN", labelpos="E", coordinates="axes")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", xlim=(-105, 105), ylim=(-118, 100))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)


def against_angle() -> Page:
    """Figure 6: projected force against the magnet's angle for many places; its maximum is the solid black curve."""
    scenario = paper_of_2000()
    s = np.linspace(0.0, scenario.tract.length, 801)
    angle = np.radians(np.arange(0, 360.1, 2.0))
    newton = force_map(scenario, angle, s[::5])
    best, most = best_command(scenario, s)
    best = best[:, 0] % (2 * math.pi)
    figure, (left, right) = blank(1, 2, (9.5, 4.0))
    import matplotlib as mpl

    shade = mpl.colormaps[SEQUENCE]
    for i in range(0, newton.shape[1], 4):
        left.plot(np.degrees(angle), 1e3 * newton[:, i], color=shade(s[5 * i] / s[-1]), lw=0.8)
    line = broken(np.degrees(best), 10.0)
    left.plot(line, 1e3 * most, color=BLACK, lw=2.2, label="maximum at each place")
    left.axhline(0, color=GREY, lw=0.8)
    left.set(xlabel="magnet angle θ (°)", ylabel="projected force F·t (mN)", ylim=(-16.5, 19))
    left.legend(loc="upper left")
    left.set_title("One curve a place, every 20 mm")
    places = mpl.cm.ScalarMappable(mpl.colors.Normalize(0, 1e3 * s[-1]), shade)
    figure.colorbar(places, ax=left, label="tip's arc length s (mm)")
    limit = 1e3 * np.abs(newton).max()
    shading = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "shading": "gouraud", "rasterized": True}
    mesh = right.pcolormesh(np.degrees(angle), 1e3 * s[::5], 1e3 * newton.T, **shading)
    right.plot(line, 1e3 * s, color=BLACK, lw=2.2)
    figure.colorbar(mesh, ax=right, label="projected force F·t (mN)")
    right.set(xlabel="magnet angle θ (°)", ylabel="tip's arc length s (mm)")
    right.set_title("The same as a map; black: the best angle")
    right.grid(False)
    for axes in (left, right):
        axes.set_xticks(np.arange(0, 361, 60))
        axes.set_xlim(0, 360)
    columns = {"angle_rad": angle} | {f"force_N_at_s_{1e3 * x:.0f}_mm": newton[:, i] for i, x in enumerate(s[::5])}
    return Page(figure, {"map": columns, "maximum": {"tip_arclength_m": s, "angle_rad": best, "force_N": most}})


def best_angle() -> Page:
    """Figure 7: the greatest projected force at each place of the tract, and the angle that gives it."""
    scenario = paper_of_2000()
    s = np.linspace(0.0, scenario.tract.length, 801)
    best, most = best_command(scenario, s)
    figure, (upper, lower) = blank(2, 1, (7.0, 4.6), sharex=True)
    upper.plot(1e3 * s, 1e3 * most, color=BLACK)
    for i, name, shift, side in ((most.argmin(), "least", -14, "left"), (most.argmax(), "greatest", 7, "right")):
        upper.plot(1e3 * s[i], 1e3 * most[i], "o", color=RED, clip_on=False)
        text = f"{name}: {1e3 * most[i]:.2f} mN at s = {1e3 * s[i]:.0f} mm"
        at = (1e3 * s[i], 1e3 * most[i])
        upper.annotate(text, at, (0, shift), textcoords="offset points", color=RED, ha=side, fontsize=8.5)
    upper.set(ylabel="greatest F·t (mN)", ylim=(0, 17), xlim=(0, 1e3 * s[-1]))
    lower.plot(1e3 * s, broken(np.degrees(best[:, 0]), 10.0), color=BLUE)
    lower.set(xlabel="tip's arc length s (mm)", ylabel="magnet angle (°)")
    upper.set_title("Greatest projected force along the tract, and the angle that gives it")
    return Page(figure, {"": {"tip_arclength_m": s, "angle_rad": best[:, 0], "force_N": most}})


def coupling() -> Page:
    """Figure 8: F·t and Q along the tract at the paper's best angle; where Q < 0 a real tip would be pushed back."""
    scenario = Scenario.paper()
    s = np.linspace(scenario.wire.length, scenario.tract.length, 701)
    best, most = best_command(scenario, s)
    wrench = scenario.replace(coupling="wrench")
    q, most_q = drive_at(wrench, best, s), best_command(wrench, s)[1]
    figure, axes = blank(1, 1, (7.5, 4.2))
    axes.plot(1e3 * s, 1e3 * most, color=BLACK, label="F·t at the angle best for F·t (the paper)")
    axes.plot(1e3 * s, 1e3 * q, color=BLUE, label="Q = F·t + m κ n·B at the same angle")
    axes.plot(1e3 * s, 1e3 * most_q, color=ORANGE, ls="--", label="Q at the angle best for Q")
    axes.fill_between(1e3 * s, 1e3 * np.minimum(q, 0), 0, color=RED, alpha=0.35, lw=0, label="Q pushes backwards")
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set(
        xlabel="tip's arc length s (mm)",
        ylabel="drive along the tract (mN)",
        xlim=(1e3 * s[0], 1e3 * s[-1]),
        ylim=(-7, 22),
    )
    axes.legend(loc="upper left", ncols=2)
    share = 100 * float((q < 0).mean())
    axes.set_title(f"The paper's best angle pushes backwards under Q at {share:.1f} % of the places")
    columns = {"tip_arclength_m": s, "angle_rad": best[:, 0], "force_N": most, "wrench_N": q, "best_wrench_N": most_q}
    return Page(figure, {"": columns})
