"""E6: a flexible instrument that is turned while it is pushed, against the free wire in a tube.

Khatait 2015 measured that turning lowers the axial friction by 84 %, and calculated 89 %. Friction points against the
velocity of the surface, so what is left along the axis is the share ζ = v/√(v² + (Rω)²). The speeds are not told: 89 %
calculated is Rω = 9.03 v, and 84 % would be 6.17 v.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ...plotting import BLACK, BLUE, GREY, ORANGE, blank, styled
from ..free.contact import RUBBING, turned_and_pushed
from ..report import Row
from .report import Outcome, published

__all__ = ["run"]

MEASURED, CALCULATED = 84.0, 89.0
"""%: by how much the axial friction is lowered."""

SOURCE = "Khatait 2015"


def run(_: Path | None = None) -> Outcome:
    """Friction of a wire that is pushed and turned at ratios up to that of the calculation."""
    pair = [_ratio(MEASURED), _ratio(CALCULATED)]
    ratios = np.array([0.0, 0.5, 1.0, 2.0, 4.0, *pair])
    axial, normal = turned_and_pushed(ratios)
    lowered = 100 * (1 - axial / (RUBBING * normal))
    rows = (
        Row(f"lowered at Rω/v = {pair[0]:.3g}", "%", MEASURED, f"{SOURCE}, measured", float(lowered[-2]), 5e-3),
        Row(f"lowered at Rω/v = {pair[1]:.3g}", "%", CALCULATED, f"{SOURCE}, calculated", float(lowered[-1]), 5e-3),
        published("≥", f"lowered at Rω/v = {pair[1]:.3g}", "%", MEASURED, f"{SOURCE}, measured", float(lowered[-1])),
    )
    force = 100 * (1 - axial / axial[0])
    return Outcome(
        rows,
        "Rω/v, which the source's two figures do not tell: it is taken as what lowers μ n by as much as they say",
        f"Lowered is the axial force over μ times the wall's force. The axial force itself falls by {force[-2]:.1f} % "
        f"and {force[-1]:.1f} %, since a turning wire climbs the tube's side and presses on it otherwise. So the pair "
        "tests the law of friction of a spinning surface in the simulation, and not the instrument.",
        {"ratio": ratios, "lowered_percent": lowered, "axial_N": axial, "wall_N": normal},
        lambda path: _draw(ratios, lowered, path),
    )


def _ratio(lowered: float) -> float:
    """Rω/v that lowers friction by `lowered` %."""
    return math.sqrt((1 - lowered / 100) ** -2 - 1)


def _draw(ratios: np.ndarray, lowered: np.ndarray, path: Path) -> None:
    with styled():
        figure, axis = blank(1, 1, (6.0, 3.8))
        along = np.linspace(0.0, 11.0, 200)
        axis.plot(along, 100 * (1 - 1 / np.hypot(1, along)), color=GREY, label="1 − ζ")
        for value, colour, name in ((MEASURED, BLACK, "measured"), (CALCULATED, ORANGE, "calculated")):
            axis.axhline(value, color=colour, linewidth=0.9, linestyle="--", label=f"{SOURCE}, {name}: {value:g} %")
        axis.plot(ratios, lowered, "o", color=BLUE, label="free wire in a tube")
        axis.set(xlabel="Rω/v", ylabel="axial friction lowered by [%]", ylim=(-3, 100))
        axis.legend(loc="lower right")
        figure.savefig(path)
