"""Our free wire and the neighbours' rods in the same scenes, in one run: error against the closed form, beside time.

`python -m tests.neighbours` prints one Markdown table; `--scenes cylinder tube` and `--solvers magwire pyelastica
mujoco` choose. A neighbour that is not installed, or a MuJoCo without the cable (4.0 dropped it), is named and left
out. Time is the processor's, of the process, after a short run that compiles; one thread. Each solver runs at two
resolutions or more.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from tests.neighbours import free_wire
from tests.neighbours.cylinder import Cylinder
from tests.neighbours.tube import Helix
from tests.speed.bench import machine
from tests.speed.measure import table

HEAD = (
    "scene",
    "solver",
    "segments",
    "step, s",
    "error",
    "processor time, s",
    "control periods of 0.1 s a second of it",
)
OURS = "magwire"
PACKAGES = {"pyelastica": "pyelastica", "mujoco": "mujoco_cable"}
"""Neighbour → our module that speaks to it."""
PERIOD = 0.1


@dataclass(frozen=True)
class Case:
    """A scene with a resolution, for one solver. run : () → the errors, in words"""

    scene: str
    solver: str
    segments: int
    step: float
    seconds: float
    run: Callable[[], str]
    warm: Callable[[], object]


def round_a_cylinder(solver: str, drawn_round: Callable[..., float]) -> list[Case]:
    """Row F13, for a solver's own choice of steps."""
    steps = {
        OURS: ((0.1, 1e-2), (0.05, 1e-2), (0.025, 1e-2)),
        "pyelastica": ((0.1, 5e-5), (0.05, 2.5e-5)),
        "mujoco": ((0.1, 1e-3), (0.05, 5e-4)),
    }[solver]
    cases = []
    for fine, step in steps:
        scene = Cylinder(fine=fine)

        def run(scene: Cylinder = scene, step: float = step) -> str:
            return f"pull {drawn_round(scene, step) / scene.expected - 1.0:+.2%}"

        def warm(scene: Cylinder = scene, step: float = step) -> float:
            _ = scene.start
            return drawn_round(replace(scene, travel=60 * step * scene.speed), step)

        seconds = scene.travel / scene.speed
        cases.append(Case(scene.name, solver, len(scene.rest), step, seconds, run, warm))
    return cases


def in_a_tube(solver: str, coiled: Callable[..., Any]) -> list[Case]:
    """Row F16, for a solver's own choice of steps."""
    more: dict[str, Any]
    choices: tuple[tuple[int, float, dict[str, Any]], ...] = {
        OURS: ((50, 1e-3, {}), (100, 1e-3, {}), (200, 1e-3, {})),
        "pyelastica": ((50, 3e-6, {}), (100, 3e-6, {})),
        "mujoco": ((50, 1e-4, {"count": 96}), (50, 1e-4, {"count": 192}), (100, 5e-5, {"count": 192})),
    }[solver]
    cases = []
    for segments, step, more in choices:
        scene = Helix(segments, axial=250.0, rate=1000.0) if solver == "pyelastica" else Helix(segments)

        def run(scene: Helix = scene, step: float = step, more: dict[str, Any] = more) -> str:
            found, theory = coiled(scene, step, **more), scene.expected
            return f"pitch {found.pitch / theory.pitch - 1.0:+.2%}, load {found.load / theory.load - 1.0:+.2%}"

        def warm(scene: Helix = scene, step: float = step, more: dict[str, Any] = more) -> object:
            return coiled(replace(scene, seconds=60 * step), step, **more)

        name = scene.name + "".join(f", {count} flat walls" for count in more.values())
        cases.append(Case(name, solver, segments, step, scene.seconds, run, warm))
    return cases


SCENES = {"cylinder": round_a_cylinder, "tube": in_a_tube}


def solvers(names: list[str]) -> tuple[dict[str, Any], list[str]]:
    """Solver → its module, and a sentence for each that cannot be run."""
    found: dict[str, Any] = {}
    missing = []
    for name in names:
        if name == OURS:
            found[name] = free_wire
            continue
        try:
            found[name] = import_module(f"tests.neighbours.{PACKAGES[name]}")
        except ImportError as error:
            missing.append(f"{name} was not run: {error}.")
    return found, missing


def timed(case: Case) -> tuple[str, ...]:
    """A row of the table."""
    case.warm()
    before = time.process_time()
    try:
        errors = case.run()
    except RuntimeError as error:
        errors = f"failed: {error}"
    busy = time.process_time() - before
    periods = case.seconds / PERIOD / busy
    return (case.scene, case.solver, str(case.segments), f"{case.step:g}", errors, f"{busy:.2f}", f"{periods:.2g}")


def main(arguments: list[str] | None = None) -> int:
    """Status 1 if one of our own runs fails."""
    parser = argparse.ArgumentParser(prog="python -m tests.neighbours", description=__doc__)
    every = [OURS, *PACKAGES]
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--solvers", nargs="+", choices=every, default=every)
    chosen = parser.parse_args(arguments)
    found, missing = solvers(chosen.solvers)
    print(machine(), versions(list(found)), "", sep="\n")
    print(table(HEAD, []), flush=True)
    well = True
    for name in chosen.scenes:
        for solver, module in found.items():
            moved = module.drawn_round if name == "cylinder" else module.coiled
            for case in SCENES[name](solver, moved):
                row = timed(case)
                well &= solver != OURS or not row[4].startswith("failed")
                print("| " + " | ".join(row) + " |", flush=True)
    print("", *missing, sep="\n")
    return 0 if well else 1


def versions(names: list[str]) -> str:
    """Of the solvers that run."""
    told = []
    for name in names:
        try:
            told.append(f"{name} {version('magwire-env' if name == OURS else name)}")
        except PackageNotFoundError:
            told.append(f"{name} from its source")
    return ", ".join(told) + "."


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
