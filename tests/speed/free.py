"""The free wire's speed beside the locked wire's, in one run, with the accuracy of the five scenes printed beside it.

`python -m tests.speed.free` prints everything as Markdown; `--only rates scaling` some; `--quick` runs smaller cases
once, in a few minutes; `--write` puts what it prints into ``docs/speed.md``. Cases run in turn, round after round, so
that a busy machine slows all of them alike; on one, the rates by processor time count.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from magwire_env import Scenario, Simulator
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.lanes import LANES
from tests.neighbours.cases import HEAD, OURS, PACKAGES, SCENES, answered, at_equal_accuracy, cases, solvers
from tests.speed.bench import DOCS, machine
from tests.speed.free_accuracy import Scene, errors, five_scenes, record, references, refined
from tests.speed.measure import both_rates, rate, ratio, table, timed

Case = Callable[[], tuple[int, float]]
BAR = 1 / 25
"""Of the locked wire's steps a second at 1024 lanes, at least."""

BEGIN, END = "<!-- free wire: printed by tests.speed.free -->", "<!-- free wire: end -->"


@dataclass(frozen=True)
class Size:
    """How much is run: the largest batch, control periods a case, rounds, steps of the single env, rollouts timed."""

    lanes: int
    periods: int
    rounds: int
    single: int
    rollouts: int


WHOLE, QUICK = Size(1024, 20, 3, 300, 7), Size(256, 20, 1, 60, 2)


def lane_factors(lanes: int, dof: int) -> np.ndarray:
    """What each lane's commands are multiplied by, so that no two lanes do the same: (lanes, dof)."""
    return 1.0 + 0.05 * np.random.default_rng(0).standard_normal((lanes, dof))


def replayed(
    scenario: Scenario, lanes: int, commands: np.ndarray, start: float | None = None, threads: int = 2
) -> Case:
    """A case that steps a batch through commands (periods, dof) from its start, all lanes with small differences."""
    sim = Simulator(scenario, lanes, threads=min(threads, max(1, lanes // LANES)))
    spread = lane_factors(lanes, commands.shape[1])

    def case() -> tuple[int, float]:
        sim.reset(tip_arclength=start)
        began = time.perf_counter()
        for command in commands:
            sim.step(command * spread)
        return lanes * len(commands), time.perf_counter() - began

    return case


def locked_case(lanes: int, periods: int) -> Case:
    """The paper's scenario with the locked wire, its magnet turning about the best angles."""
    commands = np.pi + 0.6 * np.sin(0.3 * np.arange(periods))[:, None]
    return replayed(Scenario.paper(), lanes, commands, 0.1)


def accuracy(size: Size) -> str:
    """Item 1: the scenes as they stand against a converged run, and the evaluations that a step takes."""
    rows = []
    for scene, commands, reference in references():
        found = errors(scene, commands, reference)
        mean, worst = evaluations(scene, commands[: size.periods])
        rows.append(
            (found.scene, scene.scenario.wire.segments, scene.scenario.substeps, f"{1e3 * found.tip:.2f} mm",
             f"{found.force:.1%}", f"{1e3 * found.peak:.1f} mN", found.unconverged, "yes" if found.passes else "no",
             f"{mean:.1f}", f"{worst:.1f}")
        )  # fmt: skip
    return table(
        ("scene", "segments", "steps", "tip, max", "wall force, rms of peak", "peak", "failed", "passes",
         "evaluations a lane and period", f"of the slowest lane of {LANES}"), rows,
    )  # fmt: skip


def evaluations(scene: Scene, commands: np.ndarray, lanes: int = 64) -> tuple[float, float]:
    """Evaluations of the potential a lane and control period, mean over lanes, and mean over blocks of the most."""
    sim = Simulator(scene.scenario, lanes, threads=1)
    spread = lane_factors(lanes, commands.shape[1])
    sim.reset(tip_arclength=scene.start)
    counts = []
    for command in commands:
        sim.step(command * spread)
        counts.append(sim.model._lane.reshape(-1, at.LANE_SIZE // LANES, LANES)[:, at.EVALUATED // LANES].copy())
    found = np.array(counts)
    return float(found.mean()), float(found.max(axis=2).mean())


def rates_of(size: Size) -> str:
    """Item 2: batches of 1024, 8 and 1, and the locked wire in the same rounds."""
    batches = (size.lanes, 8, 1)
    cases: dict[str, Case] = {f"locked wire, {n} lanes": locked_case(n, size.periods) for n in batches}
    for scene in five_scenes():
        told = record(scene)[: size.periods]
        for n in batches:
            cases[f"{scene.name}, {n} lanes"] = replayed(scene.scenario, n, told, scene.start)
    found, busy = both_rates(cases, size.rounds)
    rows = []
    for name in found:
        lanes = name.rpartition(", ")[2]
        over = "" if name.startswith("locked") else ratio(busy, name, f"locked wire, {lanes}")
        rows.append((name, rate(found[name]), rate(busy[name]), over))
    head = ("case", "control periods/s, median (range)", "a second of processor time", "over the locked wire's")
    return f"{table(head, rows)}\n\nWanted at 1024 lanes {BAR:g} of the locked wire's."


def single(size: Size) -> str:
    """Item 3: one env behind Gymnasium."""
    rows = []
    for model in ("free", "locked"):
        env = gym.make("MagWire/Steer-v0", model=model)
        env.reset(seed=0)
        actions = [env.action_space.sample() for _ in range(size.single)]
        for _ in range(2):  # the first time compiles
            env.reset(seed=0)
            began, busy = time.perf_counter(), time.process_time()
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            seconds, busy = time.perf_counter() - began, time.process_time() - busy
        rows.append((model, f"{len(actions) / seconds:.0f}", f"{len(actions) / busy:.0f}"))
    head = ('`gym.make("MagWire/Steer-v0", model=…)`', "env steps/s", "a second of processor time")
    return f"{table(head, rows)}\n\nWanted of the free wire 1000."


def rollout(size: Size) -> str:
    """Item 4: 64 plans of 10 control periods."""
    scene = five_scenes()[0]
    sim, commands = Simulator(scene.scenario), record(scene)
    for command in commands[:15]:
        sim.step(command[None])
    rng = np.random.default_rng(0)
    plans = commands[15:25] * (1.0 + 0.05 * rng.standard_normal((64, 10, commands.shape[1])))
    state = sim.state()
    sim.rollout(state, plans)
    seconds = [timed(lambda: sim.rollout(state, plans)) for _ in range(size.rollouts)]
    middle_ms, least = 1e3 * np.median(seconds), 1e3 * min(seconds)
    return f"64 plans × 10 periods on the fork: median {middle_ms:.1f} ms, least {least:.1f}; wanted 60 ms."


def scaling(size: Size) -> str:
    """Item 5: cost of a lane and period against segments, contact points and lanes."""
    scene = five_scenes()[0]
    commands, rows = record(scene)[: size.periods], []
    count, step = scene.scenario.wire.segments, scene.scenario.timing.control_period / scene.scenario.substeps
    for label, scenario, lanes in (
        *((f"{n} segments", refined(scene, n / count, step).scenario, 64) for n in (20, 40, 80)),
        *((f"{k} points a segment", scene.scenario.replace(contact__per_segment=k), 64) for k in (1, 2, 4)),
        *((f"{n} lanes", scene.scenario, n) for n in (1, 16, 256)),
    ):
        case = replayed(scenario, lanes, commands, threads=1)
        case()
        began = time.process_time()
        steps, _ = case()
        rows.append((label, f"{1e6 * (time.process_time() - began) / steps:.0f} µs"))
    return table(("case", "processor time of a lane and control period"), rows)


def memory(_: Size) -> str:
    """Item 7: what a lane, an anatomy and a thread take."""
    rows, lanes = [], 64
    arch = gym.make_vec("MagWire/Navigate-v0", num_envs=1).unwrapped.core.sim.scenarios[0]
    cases = {scene.name: scene.scenario for scene in five_scenes()} | {"the aortic arch of Navigate": arch}
    for name, scenario in cases.items():
        model = Simulator(scenario, lanes, threads=1).model
        own = [getattr(model, f"_{part}") for part in ("par", "wire", "lane", "node", "spin", "foot")]
        walls, bench = model._own.walls, model._benches[0]
        rows.append(
            (name, scenario.wire.segments, scenario.contact.per_segment,
             f"{sum(a.nbytes for a in own if a is not None) / lanes / 1e3:.1f} kB",
             f"{(walls.table.nbytes + walls.grid.nbytes) / 1e3:.0f} kB", f"{sum(a.nbytes for a in bench) / 1e3:.0f} kB")
        )  # fmt: skip
    head = ("scene", "segments", "points a segment", "a lane", "the wall, once", f"a thread, {LANES} lanes at a time")
    return table(head, rows)


EQUAL = 0.01
"""Largest error against the closed form at which the neighbours' speed is told."""


def neighbours(_: Size) -> str:
    """Item 6: the neighbours' rods in the scenes of `tests.neighbours`, each at its fastest with the same accuracy."""
    found, missing = solvers([OURS, *PACKAGES])
    rows = []
    for scene in SCENES:
        answers = [answered(case) for case in cases(scene, found)]
        good = at_equal_accuracy(answers, EQUAL)
        for solver in found:
            own = [answer for answer in answers if answer.case.solver == solver]
            answer = good.get(solver) or min(own, key=lambda one: one.worst)
            over = f"{good[OURS].rate / answer.rate:.3g}" if solver in good and OURS in good else "not as accurate"
            rows.append((*answer.row(), over))
    text = table((*HEAD, "times by which ours is faster"), rows)
    return "\n\n".join([f"At most {EQUAL:.0%} off the closed form, else the nearest that was tried.", text, *missing])


SECTIONS = {
    "accuracy": accuracy, "rates": rates_of, "single": single, "rollout": rollout, "scaling": scaling,
    "memory": memory, "neighbours": neighbours,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--quick", action="store_true", help="smaller cases, once")
    parser.add_argument("--write", action="store_true", help="into docs/speed.md")
    options = parser.parse_args()
    size = QUICK if options.quick else WHOLE
    printed = [machine() + (" The quick form." if options.quick else "")]
    print(printed[0], flush=True)
    for name in options.only:
        printed.append(f"### The free wire: {name}\n\n{SECTIONS[name](size)}")
        print(f"\n{printed[-1]}", flush=True)
    if options.write:
        page = DOCS / "speed.md"
        before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
        after = rest.partition(END)[2]
        page.write_text(before + f"{BEGIN}\n\n" + "\n\n".join(printed) + f"\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
