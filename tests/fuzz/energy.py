"""No energy from nowhere: random free wires, every integration step held against an account of its own.

`python -m tests.fuzz.energy --steps 20000 [--seed N] [--lanes 32]` prints a line a batch and the totals, and ends with
status 1 if a step made energy.

A control period is one integration step here. The energy before it is that of the wire where it stood, at its speed,
with magnets, base and feed where the step has them: so what they did to the wire is counted as work done. From there on
no step may leave more energy than it found, but for

- the work of what the solver leaves unbalanced, at most `RESIDUAL` along the way of every node, and rounding;
- what implicit Euler itself makes where a wire snaps from one shape to another: with the curvature −k of the potential
  along the way Δx of the step, ½ k Δx². It is measured as V(x₁) − V(x₀) − ∇V(x₁)·Δx, and counted where it is needed.

That residual is of the last evaluation, and so more than what the last correction leaves. The solver runs at a
hundredth of its tolerances, so that the first of the two is small; `--tolerance 1` takes them as they are.

Commands come and are held by turns. A step that was halved is judged while nothing that drives the wire moves, since
the work done within it is not seen; and one that brings a node out of the sleeve or into it is not judged: what it
changes is printed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from magwire_env.scenario import Scenario
from magwire_env.simulation import Simulator
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.lanes import LANES
from tests.fuzz.free_wire import STYLES, batch, commands
from tests.reference.free_energy import Wires
from tests.speed.free_stiff import tightened

STEP = 0.02
"""s; that of the free wire by default."""

ROUNDING = 1e-11
"""Share of the energies that make up the account."""

MOVING, HELD = 3, 5
"""Steps for which a command is followed, and steps for which the rig is then held still."""


@dataclass
class Found:
    """What a batch showed: counts; the largest gain beyond the tolerance (J), by curvature and unexplained; over the
    largest kinetic energy that was seen; the largest change by a node that came out or went in (J)."""

    seen: Counter = field(default_factory=Counter)
    by_curvature: float = 0.0
    unexplained: float = 0.0
    kinetic: float = 0.0
    regrid: float = 0.0

    def add(self, other: Found) -> None:
        """Join another batch's."""
        self.seen += other.seen
        for name in ("by_curvature", "unexplained", "kinetic", "regrid"):
            setattr(self, name, max(getattr(self, name), getattr(other, name)))

    def __str__(self) -> str:
        return (
            f"{dict(self.seen)}; largest gain by curvature {self.by_curvature:.1e} J, unexplained "
            f"{self.unexplained:.1e} J, kinetic energy up to {self.kinetic:.1e} J; a node that came out or went in "
            f"changed {self.regrid:.1e} J at most"
        )


def kept(model: object, array: str, size: int, number: int) -> np.ndarray:
    """(lanes,) one number of each lane of the free wires' packed arrays, a view where it may be."""
    rows = getattr(model, array).reshape(-1, size // LANES, LANES)
    return rows[:, number // LANES].reshape(-1)


def judge(sim: Simulator, entry: int, before: Wires, now: Wires) -> Found:
    """Hold one step of the lanes that run the scenario `entry` against the account."""
    mine = sim.lane_scenario == entry
    failed = sim.unconverged[mine] > 0
    halved = kept(sim.model, "_lane", at.LANE_SIZE, at.STEPPED)[: len(mine)][mine] > 1.0
    still = (before.rig == now.rig).all(axis=1) & (before.goal == now.goal) & (before.clamp == now.clamp).all(axis=1)
    still &= np.maximum(before.slack, now.slack) < 0.9
    regrid = before.first != now.first
    judged = ~failed & ~regrid & (still | ~halved)
    driven = before.under(now)
    start, end = driven.account(), now.account()
    gain = end.kinetic + end.potential - start.kinetic - start.potential
    tolerance = kept(sim.model, "_lane", at.LANE_SIZE, at.RESIDUAL)[: len(mine)][mine] * now.path(before, STEP)
    tolerance += ROUNDING * (start.scale + end.scale)
    share = 1e-4
    slope = now.moved(driven, share).account().potential - now.moved(driven, -share).account().potential
    curvature = np.maximum(end.potential - start.potential - slope / (2.0 * share), 0.0)
    found = Found()
    found.seen.update(
        steps=len(gain), judged=int(judged.sum()), failed=int(failed.sum()), regrid=int(regrid.sum()),
        held=int((judged & still).sum()), curved=int((judged & (gain > tolerance)).sum()),
        unexplained=int((judged & (gain > tolerance + curvature)).sum()),
    )  # fmt: skip
    if judged.any():
        found.by_curvature = float(np.minimum(gain - tolerance, curvature)[judged].max(initial=0.0))
        found.unexplained = float((gain - tolerance - curvature)[judged].max(initial=0.0))
    found.kinetic = float(end.kinetic.max())
    if (regrid & ~failed).any():
        found.regrid = float(gain[regrid & ~failed].max(initial=0.0))
    return found


def play(
    scenarios: list[Scenario], rng: np.random.Generator, lanes: int, steps: int, tolerance: float = 0.01,
    change: Callable[[Simulator], None] = lambda sim: None,
) -> Found:  # fmt: skip
    """One batch of `steps` steps.

    tolerance : of the solver, over its own
    change : what is done to the simulator first, for a test that makes it wrong
    """
    own = [sc.replace(timing__control_period=STEP, timing__substeps=1) for sc in scenarios]
    sim = Simulator(own, lane_scenario=np.arange(lanes) % len(own), threads=1)
    sim.reset()
    tightened(sim, tolerance)
    change(sim)
    limits = np.array([[d[1:] for d in sc.rig.limits] for sc in sim.scenarios])[sim.lane_scenario]
    style, total = rng.integers(len(STYLES), size=lanes), Found()
    command = commands(rng, 0, style, limits[..., 0], limits[..., 1])
    for step in range(steps):
        phase = step % (MOVING + HELD)
        if phase == 0:
            command = commands(rng, step, style, limits[..., 0], limits[..., 1])
        elif phase == MOVING:
            command = sim.magnet.copy()
        before = [Wires.of(sim, i) for i in range(len(own))]
        sim.step(command)
        for entry, was in enumerate(before):
            total.add(judge(sim, entry, was, Wires.of(sim, entry)))
    return total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20_000, help="lane steps at least")
    parser.add_argument("--lanes", type=int, default=32)
    parser.add_argument("--tolerance", type=float, default=0.01, help="of the solver, over its own")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng, total, start = np.random.default_rng(options.seed), Found(), time.perf_counter()
    while total.seen["steps"] < options.steps:
        total.add(play(batch(rng, 2)[0], rng, options.lanes, 80, options.tolerance))
        print(f"{time.perf_counter() - start:.0f} s: {total}", flush=True)
    if total.seen["unexplained"]:
        sys.exit(1)


if __name__ == "__main__":
    main()
