"""Scenes of free wires that are small enough for tests."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from magwire_env import Scenario
from magwire_env.lumen.named_trees import fork
from magwire_env.physics import BlockMagnet, CylinderMagnet, Guidewire
from magwire_env.scenario import ActuatedMagnet, Feed, Rig, Slide, Turn, Twist

TIP = CylinderMagnet(0.8e-3, 8e-3, 1.35)
"""4.3 mA·m²."""


def paper_free(**changes: Any) -> Scenario:
    """The paper's scenario with the free wire, dragged by its tip."""
    return Scenario.paper().replace(name="paper, free", model="free", **changes)


def soft_wire(length: float = 0.12, segments: int = 24, **changes: Any) -> Guidewire:
    """Radius 0.45 mm, E I 2e-6 N·m², E A 600 N."""
    radius = 0.45e-3
    wire = Guidewire(length, radius, 600.0 / (math.pi * radius**2), 2e-6 / (math.pi * radius**4 / 4), 1100.0, segments)
    return replace(wire, **changes)


def fed_fork(twist: bool = False, **changes: Any) -> Scenario:
    """A wire fed into a fork under a magnet that turns and slides; with `twist` its base turns too."""
    mount = ActuatedMagnet(
        BlockMagnet((50.8e-3,) * 3, 1.3), (0.06, 0.0, 0.08),
        (Turn("y", home=math.pi / 2), Turn("z"), Slide("x", -0.06, 0.06)),
    )  # fmt: skip
    rig = Rig((mount,), feed=Feed(0.04, home=0.04), twist=Twist() if twist else None)
    wire = soft_wire(twisting=1.5e-6) if twist else soft_wire()
    return Scenario(name="fork", lumen=fork(), wire=wire, tip=TIP, rig=rig, model="free", **changes)
