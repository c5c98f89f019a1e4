"""The free wire's speed beside the locked wire's, in one run, with the accuracy of the five scenes printed beside it.

`python -m tests.speed.free` prints everything as Markdown; `--only rates scaling` some. Cases run in turn, round after
round, so that a busy machine slows all of them alike.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from magwire_env import Scenario, Simulator
from tests.speed.bench import machine
from tests.speed.free_accuracy import Scene, errors, five_scenes, record, references
from tests.speed.measure import both_rates, rate, ratio, table, timed

Case = Callable[[], tuple[int, float]]
PERIODS = 20
BAR = 1 / 25
"""Of the locked wire's steps a second at 1024 lanes, at least."""


def replayed(
    scenario: Scenario, lanes: int, commands: np.ndarray, start: float | None = None, threads: int = 2
) -> Case:
    """A case that steps a batch through commands (periods, dof) from its start, all lanes with small differences."""
    sim = Simulator(scenario, lanes, threads=min(threads, max(1, lanes // 16)))
    rng = np.random.default_rng(0)
    spread = 1.0 + 0.05 * rng.standard_normal((lanes, commands.shape[1]))

    def case() -> tuple[int, float]:
        sim.reset(tip_arclength=start)
        began = time.perf_counter()
        for command in commands:
            sim.step(command * spread)
        return lanes * len(commands), time.perf_counter() - began

    return case


def locked_case(lanes: int) -> Case:
    """The paper's scenario with the locked wire, its magnet turning about the best angles."""
    commands = np.pi + 0.6 * np.sin(0.3 * np.arange(PERIODS))[:, None]
    return replayed(Scenario.paper(), lanes, commands, 0.1)


def accuracy() -> str:
    """Item 1: the scenes as they stand against a converged run."""
    rows = []
    for scene, commands, reference in references():
        found = errors(scene, commands, reference)
        rows.append(
            (found.scene, scene.scenario.wire.segments, scene.scenario.substeps, f"{1e3 * found.tip:.2f} mm",
             f"{found.force:.1%}", f"{1e3 * found.peak:.1f} mN", found.unconverged, "yes" if found.passes else "no")
        )  # fmt: skip
    return table(
        ("scene", "segments", "steps", "tip, max", "wall force, rms of peak", "peak", "failed", "passes"), rows
    )


def middle(scene: Scene) -> np.ndarray:
    """Commands of a scene's middle part, where the wire touches."""
    return record(scene)[:PERIODS]


def rates() -> str:
    """Item 2: batches of 1024, 8 and 1, and the locked wire in the same rounds."""
    fork, paper = five_scenes()[0], five_scenes()[1]
    told = {scene.name: middle(scene) for scene in (fork, paper)}
    cases: dict[str, Case] = {f"locked wire, {n} lanes": locked_case(n) for n in (1024, 8, 1)}
    for scene in (fork, paper):
        for n in (1024, 8, 1):
            cases[f"{scene.name}, {n} lanes"] = replayed(scene.scenario, n, told[scene.name], scene.start)
    found, busy = both_rates(cases, 3)
    rows = []
    for name in found:
        lanes = name.rpartition(", ")[2]
        over = "" if name.startswith("locked") else ratio(found, name, f"locked wire, {lanes}")
        rows.append((name, rate(found[name]), rate(busy[name]), over))
    head = ("case", "control periods/s, median (range)", "a second of processor time", "over the locked wire")
    return f"{table(head, rows)}\n\nWanted at 1024 lanes {BAR:g}, of one lane 1 k a second."


def rollout() -> str:
    """Item 3: 64 plans of 10 control periods."""
    scene = five_scenes()[0]
    sim, commands = Simulator(scene.scenario), record(scene)
    for command in commands[:15]:
        sim.step(command[None])
    rng = np.random.default_rng(0)
    plans = commands[15:25] * (1.0 + 0.05 * rng.standard_normal((64, 10, commands.shape[1])))
    state = sim.state()
    sim.rollout(state, plans)
    seconds = [timed(lambda: sim.rollout(state, plans)) for _ in range(7)]
    middle_ms, least = 1e3 * np.median(seconds), 1e3 * min(seconds)
    return f"64 plans × 10 periods: median {middle_ms:.1f} ms, least {least:.1f}; wanted 60 ms."


def scaling() -> str:
    """Item 4: cost of a lane and period against segments, contact points and lanes; and its memory."""
    scene = five_scenes()[0]
    commands, rows = middle(scene), []
    for label, scenario, lanes in (
        *((f"{n} segments", scene.scenario.replace(wire__segments=n), 64) for n in (20, 40, 80)),
        *((f"{k} points a segment", scene.scenario.replace(contact__per_segment=k), 64) for k in (1, 2, 4)),
        *((f"{n} lanes", scene.scenario, n) for n in (1, 16, 256)),
    ):
        steps, seconds = replayed(scenario, lanes, commands, threads=1)()
        steps, seconds = replayed(scenario, lanes, commands, threads=1)()
        rows.append((label, f"{1e6 * seconds / steps:.0f} µs"))
    sim = Simulator(scene.scenario, 1024)
    model = sim.model
    arrays = [getattr(model, f"_{name}") for name in ("par", "wire", "lane", "node", "foot")]
    lane = sum(a.nbytes for a in arrays) / 1024
    grid = model._own.walls.grid.nbytes
    count = scene.scenario.wire.segments
    memory = f"A lane of {count} segments takes {lane / 1e3:.1f} kB; the fork {grid / 1e6:.1f} MB once."
    return f"{table(('case', 'a lane and control period'), rows)}\n\n{memory}"


SECTIONS = {"accuracy": accuracy, "rates": rates, "rollout": rollout, "scaling": scaling}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    options = parser.parse_args()
    print(machine(), flush=True)
    for name in options.only:
        print(f"\n### {name}\n\n{SECTIONS[name]()}", flush=True)


if __name__ == "__main__":
    main()
