"""Wanted shapes of the free rod, and the fields that come nearest to making them: beside Figures 1 and 2."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..physics import FreeRod, field
from ..physics.inverse import Curve, ShapeSolution
from ..plotting import BLACK, BLUE, GREY, ORANGE, RED, SEQUENCE, blank
from ..scenario import ActuatedMagnet, Rig, Scenario, Slide, Turn
from .drawings import block_size
from .page import Page

__all__ = ["wanted_shapes"]

_SPAN = ((-0.06, 0.24), (-0.21, 0.21))
"""What a panel shows along x and z, m."""


class _Column(NamedTuple):
    """A rod and the rig beside it."""

    title: str
    rod: FreeRod
    rig: Rig


def columns(segments: int) -> dict[str, _Column]:
    """The paper's rod before one and before two of the paper's blocks, and a rod magnetised along its tip before one.

    A block turns about y and slides in the plane, its centre 3 to 17 cm above the rod's axis or below it.
    """
    paper = Scenario.paper()
    wire, block = paper.replace(wire__segments=segments).wire, paper.rig.magnets[0].magnet
    half = 0.5 * wire.length
    spread = FreeRod(wire, None, magnetisation=lambda s: np.where(s > half, paper.tip.moment / half, 0.0))
    tip = FreeRod(wire, paper.tip)

    def mount(z: float) -> ActuatedMagnet:
        slides = Slide("x", -0.11, 0.11), Slide("z", -0.07, 0.07)
        return ActuatedMagnet(block, (0.09, 0.0, z), (*slides, Turn("y")), ("fitted", 21))

    above, below = mount(0.1), mount(-0.1)
    return {
        "one_magnet": _Column("One magnet", tip, Rig((above,))),
        "two_magnets": _Column("Two magnets", tip, Rig((above, below))),
        "magnetised_tip": _Column("Rod magnetised along its tip", spread, Rig((above,))),
    }


def wanted(segments: int, length: float) -> dict[str, np.ndarray]:
    """The wanted courses in the x–z plane, (nodes, 3) m: a bend that eases towards the tip, and an S that ends as it
    began."""
    s = (np.arange(segments) + 0.5) / segments
    angles = {"bend": math.radians(45) * np.sin(0.5 * math.pi * s), "S": math.radians(30) * np.sin(math.pi * s)}
    out = {}
    for name, angle in angles.items():
        steps = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1) * length / segments
        out[name] = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return out


def wanted_shapes(segments: int = 16, starts: int = 3) -> Page:
    """Wanted and reached shapes, with the magnets and the field in the plane."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    cases = columns(segments)
    shapes = wanted(segments, Scenario.paper().wire.length)
    figure, axes = blank(len(shapes), len(cases), (7.8, 6.4), sharex=True, sharey=True)
    norm = LogNorm(1, 300)
    tables: dict[str, dict[str, Any]] = {}
    commands: dict[str, list[float]] = {}
    for row, (shape, points) in zip(axes, shapes.items(), strict=True):
        for panel, (name, case) in zip(row, cases.items(), strict=True):
            found = case.rod.rig_for(Curve(points), case.rig, starts=starts)
            _draw(panel, case, points, found, norm)
            tables[f"{name}_{shape}"] = _course(points, found)
            commands |= {f"{name}_{shape}_{k}".replace(" ", "_"): [v] for k, v in _settings(found).items()}
    for panel, case in zip(axes[0], cases.values(), strict=True):
        panel.set_title(f"{case.title}\n{panel.get_title()}")
    for panel in axes[-1]:
        panel.set_xlabel("x (mm)")
    for panel in axes[:, 0]:
        panel.set_ylabel("z (mm)")
    figure.colorbar(ScalarMappable(norm, SEQUENCE), ax=axes, label="flux density in the plane (mT)", shrink=0.7)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return Page(figure, {**tables, "commands": commands})


def _settings(found: ShapeSolution) -> dict[str, float]:
    units = ["m" if name.startswith("slide") else "rad" for name in found.names]
    values = {f"{n} {u}": float(v) for n, u, v in zip(found.names, units, found.parameters, strict=True)}
    return {**values, "distance m": found.distance, "reached": float(found.reached)}


def _course(points: np.ndarray, found: ShapeSolution) -> dict[str, np.ndarray]:
    got = found.positions
    return {"wanted_x_m": points[:, 0], "wanted_z_m": points[:, 2], "x_m": got[:, 0], "z_m": got[:, 2]}


def _draw(panel: Any, case: _Column, points: np.ndarray, found: ShapeSolution, norm: Any) -> None:
    (x0, x1), (z0, z1) = _SPAN
    x, z = np.linspace(x0, x1, 55), np.linspace(z0, z1, 79)
    grid = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    b = 1e3 * field(found.load["cloud"], grid)
    bx, bz = (b[:, i].reshape(len(x), len(z)).T for i in (0, 2))
    size = np.clip(np.hypot(bx, bz), norm.vmin, norm.vmax)
    panel.streamplot(
        1e3 * x, 1e3 * z, bx, bz, color=size, cmap=SEQUENCE, norm=norm, density=0.35, linewidth=0.6, arrowsize=0.6,
        zorder=1,
    )  # fmt: skip
    _draw_magnets(panel, case.rig, found)
    got = 1e3 * found.positions
    panel.plot([0, 0], [-7, 7], color=GREY, lw=5, solid_capstyle="butt", zorder=4)
    panel.plot(1e3 * points[:, 0], 1e3 * points[:, 2], color=ORANGE, lw=4, label="wanted", zorder=4)
    panel.plot(got[:, 0], got[:, 2], color=BLACK, lw=1.6, label="nearest found", zorder=5)
    held = np.flatnonzero(case.rod.segment_moments)
    first = held[0] if len(held) else case.rod.wire.segments - 1
    panel.plot(got[first:, 0], got[first:, 2], color=RED, lw=3, label="magnetised", zorder=5)
    verdict = "reached" if found.reached else f"not reached ({found.limit})"
    panel.set_title(f"{verdict}, {1e3 * found.distance:.2g} mm off")
    panel.set(xlim=(1e3 * x0, 1e3 * x1), ylim=(1e3 * z0, 1e3 * z1), aspect="equal")
    panel.grid(False)


def _draw_magnets(panel: Any, rig: Rig, found: ShapeSolution) -> None:
    """The blocks, with their moments."""
    from matplotlib.patches import FancyArrowPatch, Polygon

    for mount, (dx, dz, angle) in zip(rig.magnets, found.parameters.reshape(-1, 3), strict=True):
        c, s = math.cos(angle), math.sin(angle)
        middle = 1e3 * (np.array(mount.position)[[0, 2]] + [dx, dz])
        half = 500 * np.array(block_size(mount))[[0, 2]]
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half @ np.array([[c, -s], [s, c]]) + middle
        panel.add_patch(Polygon(corners, closed=True, fc="#F2F2F2", ec=BLACK, lw=1.2, zorder=2))
        arrow = 0.8 * half[1] * np.array([s, c])
        panel.add_patch(
            FancyArrowPatch(middle - arrow, middle + arrow, color=BLUE, arrowstyle="-|>", mutation_scale=9, zorder=3)
        )
