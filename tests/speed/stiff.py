"""Soft and stiff wires at the substeps that they choose, against converged ones: error, load, steps/s, or the refusal.

`python -m tests.speed.stiff` prints a table: moduli from 1 kPa to 200 GPa, three wires, the five scenarios of
`tests.speed.accuracy`. The same mesh is replayed with at least eight times the substeps. The paper's policy commands.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from magwire_env.scenario import Scenario
from magwire_env.scenario.steps import MOST_SUBSTEPS, is_stiff
from magwire_env.simulation import Simulator, best_command

from .accuracy import GOAL, five_scenarios, replay

MODULI = (1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 6e10, 2e11)
WIRES = ((2.5e-3, 1100.0), (0.45e-3, 6450.0), (0.2e-3, 6450.0))
"""Radius (m) and density (kg/m³): the paper's, a nitinol guidewire's, and its core's."""

PERIODS = 60


def stiffened(base: Scenario, modulus: float, radius: float, density: float) -> Scenario:
    """`base` with another wire; the axial modulus keeps the paper's ratio to the other one."""
    return base.replace(
        wire__radius=radius, wire__density=density, wire__bending_modulus=modulus, wire__axial_modulus=modulus * 12 / 11
    )


def errors(scenario: Scenario, periods: int = PERIODS) -> tuple[float, float, float]:
    """Largest error of the tip's arc length (m), of the lateral load (share of its peak), and control steps/s."""
    fine = min(max(8 * scenario.substeps, 200), 2 * MOST_SUBSTEPS)
    reference = scenario.replace(timing__substeps=fine)
    commands = _commands(reference, periods)
    s_ref, load_ref = replay(reference, commands)
    began = time.perf_counter()
    s, load = replay(scenario, commands)
    rate = len(commands) / (time.perf_counter() - began)
    way = s_ref <= GOAL
    if not way.any():
        way[:] = True
    error = float(np.abs(s - s_ref)[way].max())
    return error, float(np.abs(load - load_ref)[way].max() / load_ref[way].max()), rate


def _commands(scenario: Scenario, periods: int) -> np.ndarray:
    """What the paper's policy commands, (steps, dof), until the goal, or until the wire has left the tract."""
    grid = np.linspace(0.0, scenario.tract.length, 401 if len(scenario.rig.dofs) == 1 else 101)
    best, _ = best_command(scenario, grid)
    sim = Simulator(scenario)
    sim.reset(tip_arclength=max(0.1, scenario.wire.length))
    commands = []
    while -0.5 < sim.tip_arclength[0] < GOAL and len(commands) < periods:
        commands.append([np.interp(sim.tip_arclength[0], grid, column) for column in best.T])
        sim.step(np.array(commands[-1:]))
    return np.array(commands)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moduli", type=float, nargs="+", default=MODULI, help="Pa")
    options = parser.parse_args()
    print("| scenario | radius | modulus | substeps, set by | arc length, max error | load, error of peak | steps/s |")
    print("|---|---|---|---|---|---|---|")
    for modulus in options.moduli:
        for radius, density in WIRES:
            for base in five_scenarios():
                head = f"| {base.name} | {radius * 1e3:g} mm | {modulus:.0e} Pa |"
                try:
                    scenario = stiffened(base, modulus, radius, density)
                except ValueError as error:
                    print(head, f"refused: {str(error).split(',', maxsplit=1)[0]} | | | |")
                    continue
                cause = "bending" if is_stiff(scenario) else "magnet"
                error, load, rate = errors(scenario)
                print(
                    head, f"{scenario.substeps}, {cause} | {error * 1e3:.2f} mm | {load:.1%} | {rate:.0f} |", flush=True
                )


if __name__ == "__main__":
    main()
