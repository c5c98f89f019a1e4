"""F2: in a lumen without clearance the free wire is the locked one under `wrench`."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...lumen.curve import Tract
from ...scenario import Rig, Scenario, Timing
from ...simulation import Simulator
from ..report import Row, Size, at_most

__all__ = ["without_clearance"]

PERIODS = 40


def without_clearance(size: Size) -> list[Row]:
    """F2: one magnet, turned steadily, moves both wires without friction; tip, speed and lateral load for 4 s."""
    n = 4 * size.segments // 5
    locked = _moved(_scenario("locked", 5e-3, n, 1e6))
    peak = np.abs(locked).max(axis=0)
    off = {}
    for clearance, stiffness in ((1e-3, 1e7), (1e-4, 3e7), (1e-5, 1e8), (1e-6, 3e8)):
        off[clearance] = np.abs(_moved(_scenario("free", clearance, n, stiffness)) - locked).max(axis=0)
    source = "locked wire under wrench"
    rows = [
        at_most(
            f"F2 clearance {1e3 * c:g} mm: tip off the locked wire, largest", "mm", most, source, 1e3 * float(off[c][0])
        )
        for c, most in ((1e-3, 25.0), (1e-4, 8.0), (1e-5, 2.5), (1e-6, 1.0))
    ]
    for column, name in ((1, "speed"), (2, "lateral load")):
        share = 100 * float(off[1e-6][column] / peak[column])
        rows += [
            at_most(f"F2 clearance 0.001 mm: {name} off the locked wire, largest, of its peak", "%", 5.0, source, share)
        ]
    return rows


def _scenario(model: str, clearance: float, segments: int, stiffness: float) -> Scenario:
    paper = Scenario.paper()
    tract = Tract(paper.tract.points, paper.wire.radius + clearance, paper.tract.closed)
    above = paper.tract.position(0.22) + [0.0, 0.0, 0.08]
    magnet = dataclasses.replace(paper.rig.magnets[0], position=tuple(map(float, above)))
    return paper.replace(
        tract=tract, model=model, coupling="wrench", wire__segments=segments, rig=Rig((magnet,)),
        contact__friction=0.0, contact__stiffness=stiffness, timing=Timing(0.1, 10, 2e-3),
    )  # fmt: skip


def _moved(scenario: Scenario) -> np.ndarray:
    """Way (m), speed (m/s) of the tip and lateral load (N) after every period, (periods, 3)."""
    simulator = Simulator([scenario], 1)
    simulator.reset()
    rows = []
    for k in range(PERIODS):
        simulator.step(np.array([[math.pi + 0.15 * k]]))
        if simulator.unconverged.any():
            raise RuntimeError(f"F2: {simulator.unconverged.sum():.0f} steps did not converge")
        rows.append([simulator.travelled[0], simulator.tip_velocity[0], simulator.lateral_force[0]])
    return np.array(rows)
