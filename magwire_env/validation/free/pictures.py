"""Four pictures of the free wire: a fork, the whip, the helix, lock-up.

`python -m magwire_env.validation.free.pictures` writes docs/figures/figure11_free_wire.png, which docs/physics.md
shows, or the file that is named.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...lumen.named_trees import fork
from ...physics import BlockMagnet, CylinderMagnet, Guidewire
from ...plotting import BLACK, BLUE, GREEN, GREY, ORANGE, blank, broken, styled
from ...scenario import ActuatedMagnet, Feed, Rig, Scenario, Slide, Turn
from ...simulation import Simulator
from .base import turned
from .tubes import BENDING, GAP, coiled, nitinol, passed_thrust

__all__ = ["draw", "in_the_fork"]


def draw(file: Path, segments: int = 100) -> Path:
    """Write the figure, of wires in `segments` pieces, and return its name."""
    with styled():
        figure, ((first, second), (third, fourth)) = blank(2, 2, (9.4, 6.6))
        _fork(first)
        _whip(second, segments // 2)
        _helix(third, segments)
        _lock_up(fourth, segments)
        figure.savefig(file)
    return file


def in_the_fork(turn: float) -> np.ndarray:
    """Nodes (n, 3) m of a wire that was fed 0.1 m into a fork under a magnet above it, turned by `turn` rad."""
    radius = 0.45e-3
    wire = Guidewire(0.2, radius, 600.0 / (math.pi * radius**2), 2e-6 / (math.pi * radius**4 / 4), 1100.0, 40)
    block, tip = BlockMagnet((50.8e-3,) * 3, 1.3), CylinderMagnet(0.8e-3, 8e-3, 1.35)
    dofs = (Turn("y", home=math.pi / 2), Turn("z"), Slide("x", -0.06, 0.06, speed=0.03))
    rig = Rig((ActuatedMagnet(block, (0.06, 0.0, 0.08), dofs),), feed=Feed(0.02, home=0.03))
    contact = replace(Scenario.paper().contact, friction=0.02)
    scenario = Scenario(name="fork", lumen=fork(), wire=wire, tip=tip, rig=rig, model="free", contact=contact)
    sim = Simulator([scenario], 1)
    sim.reset()
    for step in range(40):
        along = float(np.clip(sim.tip_position[0, 0] - 0.06, -0.06, 0.06))
        sim.step(np.array([[math.pi / 2, turn if step >= 8 else 0.0, along, min(0.03 + 2e-3 * (step + 1), 0.10)]]))
    return sim.positions[0]


def _fork(axis: Any) -> None:
    lumen = fork()
    for branch in lumen.branches:
        line = branch.curve.position(np.linspace(0.0, branch.curve.length, 60))
        along = np.gradient(line[:, :2], axis=0)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
        radius = float(np.max(branch.curve.radius))
        for side in (-radius, radius):
            wall = 1e3 * (line[:, :2] + side * across)
            axis.plot(wall[:, 0], wall[:, 1], color=GREY, linewidth=0.8)
    for turn, colour in ((0.9, BLUE), (-0.9, ORANGE)):
        nodes = 1e3 * in_the_fork(turn)
        axis.plot(nodes[:, 0], nodes[:, 1], color=colour, linewidth=2.0, label=f"magnet turned by {turn:+g} rad")
    axis.set(title="The same feed, two fields: a fork", xlabel="x (mm)", ylabel="y (mm)", xlim=(0, 112), ylim=(-45, 45))
    axis.set_aspect("equal")
    axis.legend(loc="upper left")


def _whip(axis: Any, segments: int) -> None:
    for a, colour in ((1.0, GREEN), (1.5, BLUE), (2.0, ORANGE)):
        base, tip = turned(segments, a, np.arange(0.0, 360.0, 1.0))
        axis.plot(base, broken(tip, 40.0), color=colour, label=f"a = {a:g}")
    axis.plot([0, 360], [0, 360], color=GREY, linewidth=0.8, linestyle="--", label="stiff in torsion")
    axis.set(title="Whip: a pre-curved wire turned in a curved lumen", xlabel="base (°)", ylabel="tip (°)")
    axis.legend(loc="upper left")


def _helix(axis: Any, segments: int) -> None:
    gap, force, length = 0.3e-3, 0.5, 0.6
    wires = nitinol(segments, length, 1, gap)
    coiled(wires, np.array([force]), gap)
    x = wires.positions[0]
    axis.plot(1e3 * x[:, 0], 1e3 * x[:, 1], color=BLUE, label="y")
    axis.plot(1e3 * x[:, 0], 1e3 * x[:, 2], color=ORANGE, label="z")
    pitch = 1e3 * 2 * math.pi * math.sqrt(2 * BENDING / force)
    axis.axvspan(300, 300 + pitch, color=GREY, alpha=0.25, linewidth=0, label="pitch 2π√(2EI/F)")
    axis.set(title="A wire under 0.5 N in a tube: a helix", xlabel="along the tube (mm)", ylabel="off its axis (mm)")
    axis.set_ylim(-0.36, 0.5)
    axis.legend(loc="upper right", ncols=3)


def _lock_up(axis: Any, segments: int) -> None:
    friction, length = 0.3, 0.5
    bound = 4 * BENDING / (friction * GAP * length)
    out = bound * np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    wires = nitinol(segments, length, len(out), GAP)
    coiled(wires, out, GAP)
    wires.par("FRICTION", friction)
    push = out + passed_thrust(wires, 0.02, 40)[:, 0]
    most = np.linspace(0.0, 0.97 * bound, 200)[1:]
    axis.plot(1.0 / (1.0 / most - 1.0 / bound), most, color=BLACK, linewidth=1.0, label="1/F out = 1/F in + μ r L/4EI")
    axis.axhline(bound, color=GREY, linestyle="--", linewidth=0.9, label="4EI/(μ r L): no more comes through")
    axis.plot(push, out, "o", color=BLUE, label="free wire, pushed on")
    axis.set(
        title="Lock-up: 0.5 m of wire in a tube of 4 mm", xlabel="push at the base (N)", ylabel="thrust at the tip (N)"
    )
    axis.set(xlim=(0, 5), ylim=(0, 1.5))
    axis.legend(loc="upper left")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("file", type=Path, nargs="?", default=Path("docs/figures/figure11_free_wire.png"))
    print(draw(parser.parse_args().file))


if __name__ == "__main__":
    main()
