"""Figures 3 and 4: the wire's model and the steering set-up, drawn from the objects that are simulated."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from ..physics import BlockMagnet, Tract
from ..plotting import BLACK, BLUE, GREEN, GREY, ORANGE, RED, blank
from ..scenario import ActuatedMagnet, Scenario
from ..simulation import Simulator, best_command
from .page import Page

__all__ = ["block_size", "setup", "wire_model"]

_TIP = 0.25
"""Where the wire's tip is drawn, m along the tract."""


def paper_simulator() -> Simulator:
    """The paper's wire with its tip at `_TIP`, under the magnet at the best angle there."""
    scenario = Scenario.paper()
    sim = Simulator(scenario)
    sim.reset(tip_arclength=_TIP, magnet=best_command(scenario, np.array([_TIP]))[0])
    return sim


def wire_model() -> Page:
    """Figure 3: nodes on the tract, segments as linear springs, joints as rotational springs, the tip magnet."""
    sim = paper_simulator()
    (scenario,) = sim.scenarios
    nodes, tract, wire = 1e3 * sim.positions[0], scenario.tract, scenario.wire
    figure, (left, right) = blank(1, 2, (9.5, 5.0))
    line = np.linspace(0, tract.length, 1200)
    for axes, s in ((left, line), (right, line[np.abs(line - _TIP + 0.014) < 0.021])):
        _draw_lumen(axes, tract, s)
    left.plot(nodes[:, 0], nodes[:, 1], color=BLUE, lw=2.2, label="guidewire")
    left.plot(nodes[-1:, 0], nodes[-1:, 1], "o", color=RED, ms=6, label="tip magnet")
    left.set_title(f"{wire.segments} segments, {wire.segments + 1} nodes on the tract, from above")
    head = nodes[-6:, :2]
    for i, (a, b) in enumerate(itertools.pairwise(head)):
        label = f"segment: linear spring, E·A/ℓ = {wire.axial_spring:.0f} N/m"
        right.plot(*_coil(a, b).T, color=BLUE, lw=1.3, label=label if i == 0 else None)
    for i, (before, node, after) in enumerate(zip(head[:-2], head[1:-1], head[2:], strict=True)):
        label = f"joint: rotational spring, E·I/ℓ = {1e3 * wire.bending_spring:.2f} mN·m/rad"
        right.plot(*_spiral(before, node, after).T, color=ORANGE, lw=1.6, label=label if i == 0 else None)
    right.plot(head[:-1, 0], head[:-1, 1], "o", color=BLACK, ms=4, label="node, locked to the centreline")
    height, reach = 1e3 * scenario.tip.height, sim.tip_tangent[0, :2]
    ends = head[-1] + np.outer([-0.5, 0.5], height * reach)
    right.plot(*ends.T, color=RED, lw=9, solid_capstyle="butt", label="tip magnet, along the tangent")
    right.annotate(
        "", head[-1] + 8 * reach, head[-1], arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 1.8}, zorder=4
    )
    named: dict[str, Any] = {}
    for axes in (left, right):
        named |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    named.pop("tip magnet")  # it stands twice: on the right with its direction
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=3)
    right.set_title("The head of the wire, enlarged")
    columns = {"node": np.arange(len(nodes)), "arclength_m": sim.state().arclengths[0]}
    return Page(figure, {"": columns | dict(zip(("x_m", "y_m", "z_m"), 1e-3 * nodes.T, strict=True))})


def _draw_lumen(axes, tract: Tract, s: np.ndarray) -> None:
    p, t = 1e3 * tract.position(s), tract.tangent(s)
    across = np.stack([-t[:, 1], t[:, 0]], axis=1)
    across *= 1e3 * tract.radius_at(s)[:, None] / np.linalg.norm(across, axis=1, keepdims=True)
    for side in (1, -1):
        axes.plot(*(p[:, :2] + side * across).T, color=GREY, lw=1, label="wall" if side == 1 else None)
    axes.plot(p[:, 0], p[:, 1], color=GREY, lw=0.8, ls=":", label="centreline")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    axes.grid(False)


def _coil(a: np.ndarray, b: np.ndarray, teeth: int = 5, width: float = 0.9) -> np.ndarray:
    """A zigzag from `a` to `b`, (points, 2)."""
    along = (b - a) / np.linalg.norm(b - a)
    at = np.r_[0, 0.2, np.linspace(0.2, 0.8, 2 * teeth + 1)[1:-1], 0.8, 1]
    side = np.zeros(len(at))
    side[2:-2] = width * (-1.0) ** np.arange(len(at) - 4)
    return a + np.outer(at, b - a) + np.outer(side, [-along[1], along[0]])


def _spiral(before: np.ndarray, node: np.ndarray, after: np.ndarray) -> np.ndarray:
    """A clock spring round `node`, from the segment behind it to the one ahead, (points, 2)."""
    start = math.atan2(*(before - node)[::-1])
    end = math.atan2(*(after - node)[::-1])
    sweep = (end - start) % (2 * math.pi) + 2 * math.pi
    angle = np.linspace(start, start + sweep, 80)
    radius = np.linspace(0.8, 1.7, 80)[:, None]
    return node + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def setup() -> Page:
    """Figure 4: the external magnet above the tract, its axis of rotation, and the guidewire on its way."""
    sim = paper_simulator()
    (scenario,) = sim.scenarios
    mount, tract = scenario.rig.magnets[0], scenario.tract
    line, nodes = 1e3 * tract.position(np.linspace(0, tract.length, 800)), 1e3 * sim.positions[0]
    centre, angle = 1e3 * np.array(mount.position), float(sim.magnet[0, 0])
    nearest = line[np.linalg.norm(line - centre, axis=1).argmin()]
    figure, flat = blank(1, 1, (7.5, 5.4))
    flat.remove()
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.plot(*line.T, color=GREY, lw=5, alpha=0.35, solid_capstyle="butt", label="tract")
    axes.plot(*nodes.T, color=BLUE, lw=2.4, label="guidewire")
    axes.plot(*nodes[-1:].T, "o", color=RED, ms=5, label="tip magnet")
    _draw_block(axes, centre, angle, 1e3 * np.array(block_size(mount)) / 2)
    moment = 48 * np.array([math.sin(angle), 0, math.cos(angle)])
    turned = f"moment, {math.degrees(angle):.0f}° about y"
    axes.quiver(*centre, *moment, color=RED, lw=2, arrow_length_ratio=0.2, label=turned)
    axes.plot(
        *np.stack([centre + [0, -70, 0], centre + [0, 70, 0]]).T,
        color=BLACK,
        lw=1.2,
        ls="-.",
        label="axis of rotation, y",
    )
    distance = float(np.linalg.norm(nearest - centre))
    axes.plot(*np.stack([centre, nearest]).T, color=GREEN, lw=1.6, label=f"smallest distance, {distance:.0f} mm")
    axes.plot(*line[:1].T, "^", color=BLACK, ms=6, label="entrance")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)", xlim=(-100, 100), ylim=(-100, 100), zlim=(-20, 100))
    axes.set(xticks=[-80, -40, 0, 40, 80], yticks=[-80, -40, 0, 40, 80], zticks=[0, 40, 80])
    axes.set_box_aspect((200, 200, 120), zoom=1.1)
    axes.view_init(elev=24, azim=-74)
    figure.legend(loc="outside lower center", ncols=4)
    columns = {"s_m": np.linspace(0, tract.length, 800)}
    magnet = {"x_m": [centre[0] / 1e3], "y_m": [centre[1] / 1e3], "z_m": [centre[2] / 1e3], "angle_rad": [angle]}
    return Page(
        figure, {"tract": columns | dict(zip(("x_m", "y_m", "z_m"), 1e-3 * line.T, strict=True)), "magnet": magnet}
    )


def block_size(mount: ActuatedMagnet) -> tuple[float, float, float]:
    """Edges of a mounted block, m; `ValueError` for another kind of magnet."""
    if not isinstance(mount.magnet, BlockMagnet):
        raise ValueError(f"the magnet must be a BlockMagnet to be drawn, got {mount.magnet!r}")
    return mount.magnet.size


def _draw_block(axes, centre: np.ndarray, angle: float, half: np.ndarray) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    faces = []
    for axis in range(3):
        for side in (-1, 1):
            face = np.zeros((4, 3))
            face[:, axis] = side
            face[:, [i for i in range(3) if i != axis]] = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
            faces.append(centre + (face * half) @ turn.T)
    axes.add_collection3d(Poly3DCollection(faces, fc="#D9D9D9", ec=BLACK, lw=0.9, alpha=0.55))
