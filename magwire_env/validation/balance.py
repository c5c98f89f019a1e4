"""The static balance of a sliding wire, plainly: what simulator and claim are held against."""

from __future__ import annotations

import numpy as np

from ..scenario import Scenario

__all__ = ["resistance"]


def resistance(scenario: Scenario, tip: float, direction: float, speed: float = 0.0, cells: int = 400) -> float:
    """Force at the tip, N along the travel, that a sliding wire needs; without the tip's own friction, and no weight.

    Let T be the springs' tension. The joints' energy ½ E I κ² a metre gives the tension E I κ² to be held against
    (a bent wire shortens its springs, since that straightens it) and a push d(½ E I κ²)/ds along the tract. With
    N = T + ½ E I κ² the balance is dN/ds = ± μ κ |T| ± c v, N = −½ E I κ² at the free tail, and the tip must hold
    N + ½ E I κ²: without friction ½ E I (κ_tip² − κ_tail²), without stiffness the capstan's e^{μφ}.
    """
    wire, contact = scenario.wire, scenario.contact
    s = np.linspace(tip - wire.length, tip, 2 * cells + 1)  # with the middles of the cells, for the midpoint rule
    kappa = scenario.tract.curvature(s)
    bend = 0.5 * wire.bending_rigidity * kappa**2
    step = wire.length / cells

    def slope(n: float, i: int) -> float:
        return direction * (contact.friction * kappa[i] * abs(n - bend[i]) + contact.drag * speed)

    n = -float(bend[0])
    for i in range(0, 2 * cells, 2):
        n += step * slope(n + 0.5 * step * slope(n, i), i + 1)
    return direction * (n + float(bend[-1]))
