"""Free wires under random, extreme and bang-bang commands in random lumens; counts what must not happen.

`python -m tests.fuzz.free_wire --steps 100000 [--seed N] [--lanes 64]` prints a line a batch and the totals: lane
steps, numbers that are not finite, nodes farther behind the wall than the wall's force on them and its stiffness
explain, forces larger than how deep the node is explains, steps that did not converge and their share, the deepest node
and the fastest tip. It ends with status 1 if a number is not finite, a node is too deep or a force is unexplained. A
lane step is one control period of one wire.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from functools import lru_cache

import numpy as np

from magwire_env.lumen import Lumen
from magwire_env.lumen.generator import generate
from magwire_env.lumen.named_trees import fork
from magwire_env.physics import BlockMagnet, CylinderMagnet, Guidewire, PointDipole
from magwire_env.scenario import ActuatedMagnet, Contact, Feed, Rig, Scenario, Slide, Timing, Turn, Twist
from magwire_env.simulation import Simulator
from magwire_env.simulation.free.walls import ROUNDED

STYLES = ("noise", "extremes", "bang-bang", "kept")
MOST_REFUSED = 100
"""Scenarios of a batch that may be refused before the fuzzer says that it cannot make one."""

ROUNDING = 2e-5
"""m by which a node may be deeper than the wall's force on it explains: the bricks' error, contact between nodes."""


def spread(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform."""
    return float(low * (high / low) ** rng.uniform())


@lru_cache
def forked(length: float) -> Lumen:
    """A fork with branches of `length` m: a wire that is not fed must lie in the trunk with all its length."""
    return fork(length=length)


def scenario(rng: np.random.Generator, fed: bool, twists: bool, tree: bool) -> Scenario:
    """A random wire with a random magnet in a random lumen; stiff and soft, slippery and rough."""
    radius = spread(rng, 0.15e-3, 1e-3)
    length, segments = float(rng.uniform(0.08, 0.16)), int(rng.integers(12, 24))
    area, second = math.pi * radius**2, math.pi * radius**4 / 4
    bending, axial = spread(rng, 1e-8, 1e-3), spread(rng, 1.0, 1e4)
    wire = Guidewire(
        length, radius, axial / area, bending / second, float(rng.uniform(1e3, 8e3)), segments,
        twisting=bending if twists else None, curl=float(rng.uniform(-20, 20)) if twists else None,
    )  # fmt: skip
    tip = CylinderMagnet(0.8e-3, 8e-3, float(rng.uniform(0.2, 1.4)))
    magnet = BlockMagnet((50.8e-3,) * 3, 1.3) if rng.random() < 0.5 else PointDipole(spread(rng, 1.0, 200.0))
    lumen = forked(0.06 if fed else 0.2) if tree else None
    tract = generate(int(rng.integers(10_000))) if not tree else lumen.trunk.curve
    middle = tract.position(float(rng.uniform(0.02, 0.2)))
    mount = ActuatedMagnet(
        magnet, (float(middle[0]), float(middle[1]), float(middle[2] + rng.uniform(0.08, 0.14))),
        (Turn("y"), Slide("x", -0.05, 0.05)),
    )  # fmt: skip
    base = {}
    if fed:
        base["feed"] = Feed(float(rng.uniform(0.01, 0.05)), home=3.5 * length / segments)
        if twists:
            base["twist"] = Twist(speed=float(rng.uniform(1.0, 12.0)))
    contact = Contact(
        friction=float(rng.choice([0.0, 0.05, 0.3])), drag=spread(rng, 0.05, 2.0), stiffness=spread(rng, 5e4, 1e6)
    )
    lumens = {"lumen": lumen} if tree else {"tract": tract}
    return Scenario(
        name="fuzz", **lumens, wire=wire, tip=tip, rig=Rig((mount,), **base), contact=contact, coupling="wrench",
        gravity=tuple(map(float, rng.normal(size=3) * rng.choice([0.0, 5.0]))), timing=Timing(0.1), model="free",
    )  # fmt: skip


def commands(rng: np.random.Generator, step: int, style: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """A command a lane, (n, dof), by its style."""
    noise = rng.uniform(low, high)
    extremes = np.where(rng.random(low.shape) < 0.5, low, high)
    bang = np.where((step // 7) % 2 == 0, low, high) + 0.0 * noise
    kept = 0.3 * low + 0.7 * high
    return np.choose(style[:, None], [noise, extremes, bang, kept])


def batch(rng: np.random.Generator, count: int) -> tuple[list[Scenario], int]:
    """`count` random scenarios that may share a batch, and how many were refused on the way."""
    fed, twists, tree = rng.random(3) < [0.7, 0.4, 0.3]
    found: list[Scenario] = []
    refused = 0
    while len(found) < count:
        try:
            found.append(scenario(rng, bool(fed), bool(fed and twists), bool(tree)))
        except ValueError as error:
            refused += 1
            if refused > MOST_REFUSED:
                raise RuntimeError(f"of this kind {refused} scenarios were refused, the last one: {error}") from error
    return found, refused


def play(rng: np.random.Generator, lanes: int, steps: int) -> tuple[Counter, float, float]:
    """One batch: counts, how much deeper a node is than the wall's force on it explains (m), the fastest tip (m/s)."""
    scenarios, refused = batch(rng, 4)
    seen: Counter = Counter(refused=refused)
    tree = len(scenarios[0].tree.branches) > 1
    sim = Simulator(scenarios, lane_scenario=np.arange(lanes) % len(scenarios))
    sim.reset()
    which = sim.lane_scenario
    limits = np.array([[d[1:] for d in sc.rig.limits] for sc in sim.scenarios])[which]
    style = rng.integers(len(STYLES), size=lanes)
    deepest, fastest = -math.inf, 0.0
    for step in range(steps):
        sim.step(commands(rng, step, style, limits[..., 0], limits[..., 1]))
        seen["lane steps"] += lanes
        seen["unconverged"] += int(sim.unconverged.sum())
        seen["integration steps"] += int(sum(sim.scenarios[i].substeps for i in which))
        finite = np.isfinite(sim.readout[:, :lanes]).all(axis=0)
        seen["not finite"] += int((~finite).sum())
        if step % 5:
            continue
        x, push = sim.positions, np.linalg.norm(sim.contact_forces, axis=2)
        for i, sc in enumerate(sim.scenarios):
            nodes, force = x[which == i].reshape(-1, 3), push[which == i].reshape(-1)
            there = np.isfinite(nodes).all(axis=1)
            nodes, force = nodes[there], force[there]
            depth = sc.tree.tubes.distance(nodes)[0]
            allowance = ROUNDING + (ROUNDED * sc.tree.narrowest[0] / 4 if tree else 0.0)  # creases are rounded
            inside = (nodes - sc.tract.position(0.0)) @ sc.tract.tangent(0.0) > 0.0  # not still before the inlet
            explained = force[inside] / (0.5 * sc.contact.stiffness * sc.wire.segment_length) + allowance
            over = (sc.wire.radius - depth[inside]) - explained
            point = sc.contact.stiffness * (sc.wire.segment_length + sc.wire.radius)
            most = point * np.maximum(sc.wire.radius - depth + allowance, 0.0) + 1e-9
            seen["unexplained forces"] += int((force > math.hypot(1.0, sc.contact.friction) * most).sum())
            if there.all():
                whole = most.reshape(-1, x.shape[1]).sum(axis=1)
                seen["unexplained forces"] += int((sim.wall_force[which == i] > whole).sum())
            if over.size:
                deepest = max(deepest, float(over.max()))
                seen["too deep"] += int((over > 0).sum())
        fastest = max(fastest, float(np.abs(sim.tip_velocity).max()))
    return seen, deepest, fastest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100_000, help="lane steps at least")
    parser.add_argument("--lanes", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng, total, start = np.random.default_rng(options.seed), Counter(), time.perf_counter()
    while total["lane steps"] < options.steps:
        seen, deepest, fastest = play(rng, options.lanes, 100)
        total += seen
        print(
            f"{total['lane steps']} lane steps, {time.perf_counter() - start:.0f} s: {dict(seen)}, deepest beyond what "
            f"is explained {1e3 * deepest:.3f} mm, fastest tip {fastest:.2f} m/s",
            flush=True,
        )
    share = total["unconverged"] / max(total["integration steps"], 1)
    print(f"total: {dict(total)}; share of steps that did not converge {share:.1e}")
    if total["not finite"] or total["too deep"] or total["unexplained forces"]:
        sys.exit(1)


if __name__ == "__main__":
    main()
