"""Soft and stiff free wires at the steps that they choose by themselves, against converged ones.

`python -m tests.speed.free_stiff` prints a table: moduli from 1 kPa to 200 GPa of the paper's wire, dragged by its tip
through the paper's tract by a magnet that is led along it, and fed into a bend. A row has the steps a control period,
the largest distance of the tip from that of the converged run on the way, the largest wall force, the failed steps of
both, and with how many steps that distance is at most 1 mm; or the refusal. The converged run has the same mesh and the
same commands, `FINER` times the steps, and tolerances of a hundredth. `--finer` changes the former.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from magwire_env.lumen import Tract
from magwire_env.physics import BlockMagnet
from magwire_env.scenario import ActuatedMagnet, Feed, Rig, Scenario, Slide, Turn
from magwire_env.simulation import Simulator
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.lanes import LANES
from magwire_env.simulation.readout import ROW

MODULI = (1e3, 1e4, 1e5, 550e3, 1e6, 1e7, 1e8, 1e9, 1e10, 6e10, 2e11)
"""Pa, in bending; the paper's is 550 kPa."""

LIMIT = 1e-3
"""m, that the tip may be off."""

FINER, TIGHTER = 16, 0.01
PERIODS = 30

Command = Callable[[int, Simulator], np.ndarray]


@dataclass(frozen=True)
class Row:
    """Of a wire: largest distance of its tip from the converged one's, m; largest wall force, N; failed steps, and
    those of the converged run; steps a control period, and how many are enough for `LIMIT`, None if none that was
    tried."""

    modulus: float
    tip: float
    wall: float
    unconverged: int
    reference_unconverged: int
    substeps: int
    enough: int | None

    @property
    def passes(self) -> bool:
        return self.enough == self.substeps


def with_modulus(base: Scenario, modulus: float) -> Scenario:
    """`base` with another modulus; the axial one keeps the paper's ratio to it."""
    return base.replace(wire__bending_modulus=modulus, wire__axial_modulus=modulus * 12 / 11)


def dragged() -> tuple[Scenario, Command, float]:
    """The paper's wire, free, in the paper's tract; a magnet above it is led along at 30 mm/s, first 30 mm ahead."""
    paper = Scenario.paper()
    rides = replace(
        paper.rig.magnets[0], position=(0.0, 0.0, 0.08), dipoles=(),
        dofs=(Turn("y", home=math.pi), Slide("x", -0.1, 0.1), Slide("y", -0.1, 0.1)),
    )  # fmt: skip
    scenario = paper.replace(name="dragged", model="free", wire=replace(paper.wire, segments=24), rig=Rig((rides,)))

    def command(step: int, sim: Simulator) -> np.ndarray:
        place = scenario.tract.position(0.13 + 3e-3 * step)
        return np.broadcast_to([math.pi, *np.clip(place[:2], -0.1, 0.1)], (sim.num_envs, 3))

    return scenario, command, 0.10


def fed() -> tuple[Scenario, Command, None]:
    """The paper's wire fed at 20 mm/s into a bend of 60 mm radius, under a magnet that turns."""
    turn = np.linspace(-math.pi / 2, 0.0, 9)
    bend = [(0.06 + 0.06 * math.cos(a), 0.06 + 0.06 * math.sin(a), 0.0) for a in turn]
    tract = Tract.from_points([(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), *bend, (0.12, 0.10, 0.0)], 7.5e-3)
    mount = ActuatedMagnet(BlockMagnet((50.8e-3,) * 3, 1.3), (0.10, 0.02, 0.10), (Turn("z", home=0.0),))
    paper = Scenario.paper()
    wire = replace(paper.wire, length=0.16, segments=32)
    scenario = paper.replace(
        name="fed", model="free", tract=tract, wire=wire, rig=Rig((mount,), feed=Feed(0.02, home=0.04))
    )

    def command(step: int, sim: Simulator) -> np.ndarray:
        return np.broadcast_to([0.05 * step, 0.04 + 2e-3 * (step + 1)], (sim.num_envs, 2))

    return scenario, command, None


SCENES = {"dragged": dragged, "fed": fed}


def tightened(sim: Simulator, share: float) -> None:
    """Scale the tolerances at which a step of the free wire counts as converged."""
    rows = sim.model._par.reshape(-1, at.PAR_SIZE // LANES, LANES)  # type: ignore[attr-defined]
    for number in (at.FORCE_TOLERANCE, at.MOVE_TOLERANCE):
        rows[:, number // LANES] *= share
    rows[:, at.PATIENCE // LANES] *= 4


def run(sim: Simulator, start: float | None, command: Command, periods: int) -> tuple[np.ndarray, float, int]:
    """Places of the tip (periods, 3) m, the largest wall force, N, and failed steps, of a simulator of one wire."""
    if start is not None:
        sim.reset(tip_arclength=start)
    tips, wall, failed = [], 0.0, 0
    for step in range(periods):
        sim.step(command(step, sim))
        tips.append(sim.tip_position[0].copy())
        wall = max(wall, float(sim.readout[ROW.peak_wall, 0]))
        failed += int(sim.unconverged[0])
    return np.array(tips), wall, failed


def compared(name: str, moduli: Sequence[float], periods: int = PERIODS, finer: int = FINER) -> list[Row | str]:
    """A row for each modulus, or the sentence with which its scenario is refused."""
    base, command, start = SCENES[name]()
    found: list[Row | str] = []
    for modulus in moduli:
        try:
            scenario = with_modulus(base, modulus)
            own = scenario.substeps
        except ValueError as error:
            found.append(str(error))
            continue
        reference = Simulator(scenario.replace(timing__substeps=finer * own))
        tightened(reference, TIGHTER)
        true, _, missed = run(reference, start, command, periods)
        tips, wall, failed = run(Simulator(scenario), start, command, periods)
        off, enough = distance(tips, true), own
        worst, more = off, failed
        while (worst > LIMIT or more) and 4 * enough <= finer * own:
            enough *= 2
            tips, _, more = run(Simulator(scenario.replace(timing__substeps=enough)), start, command, periods)
            worst = distance(tips, true)
        reached = worst <= LIMIT and not more
        found.append(Row(modulus, off, wall, failed, missed, own, enough if reached else None))
    return found


def distance(tips: np.ndarray, true: np.ndarray) -> float:
    """The largest distance between two courses of a tip, m."""
    return float(np.linalg.norm(tips - true, axis=1).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moduli", type=float, nargs="+", default=MODULI, help="Pa")
    parser.add_argument("--finer", type=int, default=FINER, help="steps of the converged run over the wire's own")
    options = parser.parse_args()
    head = "| scene | modulus | steps a period | tip, max | wall force, most | failed steps | of the converged run "
    print(head + "| steps for 1 mm |")
    print("|---|---|---|---|---|---|---|---|")
    for name in SCENES:
        for modulus in options.moduli:
            row = compared(name, [modulus], finer=options.finer)[0]
            head = f"| {name} | {modulus:.2g} Pa |"
            if isinstance(row, str):
                print(head, f"refused: {row} | | | | | |")
                continue
            print(
                head, f"{row.substeps} | {1e3 * row.tip:.2f} mm | {row.wall:.3g} N | {row.unconverged} "
                f"| {row.reference_unconverged} | {row.enough or 'more'} |", flush=True,
            )  # fmt: skip


if __name__ == "__main__":
    main()
