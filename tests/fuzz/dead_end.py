"""A wire pushed with all that its drive has against the closed end of a tube.

`python -m tests.fuzz.dead_end [--seconds 60]` prints a row a wire: how much deeper a node stood in the wall than the
wall's force there explains, the largest sum of the wall's forces, the largest push that the base read, what it reads
along the inlet at the end beside what the wall pushes back along it, and the steps that did not converge. It ends with
status 1 if a number is not finite, a node left the lumen, or the two differ.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace

import numpy as np

from magwire_env.lumen import Tract
from magwire_env.physics import BlockMagnet
from magwire_env.scenario import ActuatedMagnet, Feed, Rig, Scenario, Turn
from magwire_env.simulation import Simulator
from magwire_env.simulation.readout import ROW
from tests.fuzz.free_wire import ROUNDING
from tests.support.free import TIP, soft_wire

SAME = 0.01
"""By which share of it the base's reading may differ from the wall's push along the inlet."""

RIGIDITIES = (4e-7, 2e-5, 1e-3)
"""N·m²."""


@dataclass(frozen=True)
class Pushed:
    """What a wire went through: m; N, N, N, N; steps; whether every reading on the way was finite."""

    beyond: float
    wall: float
    most: float
    base: float
    against: float
    unconverged: int
    finite: bool

    @property
    def holds(self) -> bool:
        """Whether nothing left the lumen and the base reads what pushes back."""
        return self.finite and self.beyond <= 0.0 and abs(self.base - self.against) <= SAME * abs(self.against)


def dead_end(rigidity: float) -> Scenario:
    """A wire of 0.15 m and `rigidity` N·m² in a tube of 0.1 m and 4 mm radius that is closed; the magnet is far."""
    tract = Tract.from_points([(0, 0, 0), (0.05, 0, 0), (0.1, 0, 0)], 4e-3)
    mount = ActuatedMagnet(BlockMagnet((50.8e-3,) * 3, 1.3), (0.05, 0.0, 5.0), (Turn("y"),))
    wire = soft_wire(0.15, 30)
    wire = replace(wire, bending_modulus=rigidity / (math.pi * wire.radius**4 / 4))
    return Scenario(
        name="dead end", tract=tract, wire=wire, tip=TIP, rig=Rig((mount,), feed=Feed(0.03, home=0.06)), model="free"
    )


def pushed(rigidity: float, seconds: float) -> Pushed:
    """Ask the drive for the whole wire, for so long."""
    scenario = dead_end(rigidity)
    sim = Simulator(scenario)
    sim.reset()
    command = np.array([[d[2] for d in scenario.rig.limits]])
    beyond, wall, most, unconverged, finite = -math.inf, 0.0, 0.0, 0, True
    for _ in range(round(seconds / scenario.timing.control_period)):
        sim.step(command)
        unconverged += int(sim.unconverged[0])
        out = ~np.isnan(sim.positions[0, :, 0])  # those in the sleeve have no place
        x, push = sim.positions[0, out], np.linalg.norm(sim.contact_forces[0, out], axis=1)
        finite &= bool(out[-4:].all() and np.isfinite(sim.readout[:, 0]).all() and np.isfinite(push).all())
        inside = x[:, 0] > 0.0
        explained = push / (0.5 * scenario.contact.stiffness * scenario.wire.segment_length) + ROUNDING
        deep = scenario.wire.radius - scenario.tree.wall_distance(x)
        beyond = max(beyond, float((deep - explained)[inside].max()))
        wall, most = max(wall, float(sim.readout[ROW.wall, 0])), max(most, float(sim.base_force[0, 0]))
    along, against = float(sim.base_force[0, 0]), -float(np.nansum(sim.contact_forces[0, :, 0]))
    return Pushed(beyond, wall, most, along, against, unconverged, finite)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    print("| E I | too deep by | wall force, most | base, most | base, at the end | wall, against it | failed steps |")
    print("|---|---|---|---|---|---|---|")
    failed = False
    for rigidity in RIGIDITIES:
        found = pushed(rigidity, options.seconds)
        failed |= not found.holds
        print(
            f"| {rigidity:g} N·m² | {1e3 * found.beyond:.3f} mm | {found.wall:.3g} N | {found.most:.3g} N "
            f"| {found.base:.4g} N | {found.against:.4g} N | {found.unconverged} |",
            flush=True,
        )
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    main()
