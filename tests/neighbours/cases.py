"""What each solver is asked in each scene, at which resolutions, and how a case is timed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

from tests.neighbours import free_wire
from tests.neighbours.cylinder import Cylinder
from tests.neighbours.tube import Helix

__all__ = [
    "HEAD",
    "OURS",
    "PACKAGES",
    "PERIOD",
    "SCENES",
    "Answer",
    "Case",
    "answered",
    "at_equal_accuracy",
    "cases",
    "solvers",
]

HEAD = ("scene", "solver", "segments", "step, s", "error", "processor time, s", "control periods of 0.1 s a second")
OURS = "magwire"
PACKAGES = {"pyelastica": "pyelastica", "mujoco": "mujoco_cable"}
"""Neighbour → our module that speaks to it."""
PERIOD = 0.1
"""s, a control period, by which the speed of all solvers is told."""

Errors = dict[str, float]


@dataclass(frozen=True)
class Case:
    """A scene at a resolution, for one solver.

    seconds : that are simulated
    run : () → quantity and its relative error; warm : a short run, which compiles
    """

    scene: str
    solver: str
    segments: int
    step: float
    seconds: float
    run: Callable[[], Errors]
    warm: Callable[[], object]


@dataclass(frozen=True)
class Answer:
    """What a case gave. busy : s of processor time; failure : why there are no errors"""

    case: Case
    errors: Errors
    busy: float
    failure: str = ""

    @property
    def worst(self) -> float:
        """The largest relative error, infinite for a failure."""
        return max(map(abs, self.errors.values()), default=float("inf"))

    @property
    def rate(self) -> float:
        """Control periods a second of processor time."""
        return self.case.seconds / PERIOD / self.busy

    def row(self) -> tuple[str, ...]:
        """Of the table with `HEAD`."""
        case = self.case
        told = ", ".join(f"{name} {error:+.2%}" for name, error in self.errors.items()) or f"failed: {self.failure}"
        numbers = f"{case.step:g}", told, f"{self.busy:.2f}", f"{self.rate:.2g}"
        return (case.scene, case.solver, str(case.segments), *numbers)


def answered(case: Case) -> Answer:
    """Run a case after its short run, by processor time; a `RuntimeError` is an answer without errors."""
    case.warm()
    before = time.process_time()
    try:
        errors, failure = case.run(), ""
    except RuntimeError as error:
        errors, failure = {}, str(error)
    return Answer(case, errors, time.process_time() - before, failure)


def at_equal_accuracy(answers: list[Answer], bar: float) -> dict[str, Answer]:
    """Solver → its fastest answer whose errors are all within `bar`; solvers without one are left out."""
    best: dict[str, Answer] = {}
    for answer in answers:
        name = answer.case.solver
        if answer.worst <= bar and (name not in best or answer.rate > best[name].rate):
            best[name] = answer
    return best


def round_a_cylinder(solver: str, module: Any) -> list[Case]:
    """Row F13."""
    choices = {
        OURS: ((0.1, 1e-2), (0.05, 1e-2), (0.025, 1e-2)),
        "pyelastica": ((0.1, 5e-5), (0.05, 2.5e-5)),
        "mujoco": ((0.1, 1e-3), (0.05, 1e-3)),
    }[solver]
    return [_round_a_cylinder(solver, module, Cylinder(fine=fine), step) for fine, step in choices]


def _round_a_cylinder(solver: str, module: Any, scene: Cylinder, step: float) -> Case:
    def run() -> Errors:
        return {"pull": module.drawn_round(scene, step) / scene.expected - 1.0}

    def warm() -> object:
        return scene.start, module.drawn_round(replace(scene, travel=_WARM * step * scene.speed), step)

    return Case(scene.name, solver, len(scene.rest), step, scene.travel / scene.speed, run, warm)


def in_a_tube(solver: str, module: Any) -> list[Case]:
    """Row F16. PyElastica stretches and shears, so it is given an axial stiffness that costs it little, and the damping
    with which it settles in time; MuJoCo's tube has flat walls, so it is given more of them."""
    choices: tuple[tuple[int, float, dict[str, Any]], ...] = {
        OURS: ((50, 1e-3, {}), (100, 1e-3, {}), (200, 1e-3, {})),
        "pyelastica": ((50, 3e-6, {}), (100, 3e-6, {})),
        "mujoco": ((50, 1e-4, {"count": 96}), (50, 1e-4, {"count": 192}), (100, 5e-5, {"count": 192})),
    }[solver]
    own = {"axial": 250.0, "rate": 1000.0} if solver == "pyelastica" else {}
    return [_in_a_tube(solver, module, Helix(segments, **own), step, more) for segments, step, more in choices]


def _in_a_tube(solver: str, module: Any, scene: Helix, step: float, more: dict[str, Any]) -> Case:
    def run() -> Errors:
        found, theory = module.coiled(scene, step, **more), scene.expected
        return {"pitch": found.pitch / theory.pitch - 1.0, "load": found.load / theory.load - 1.0}

    def warm() -> object:
        return module.coiled(replace(scene, seconds=_WARM * step), step, **more)

    name = scene.name + "".join(f", {count} flat walls" for count in more.values())
    return Case(name, solver, scene.segments, step, scene.seconds, run, warm)


_WARM = 60  # steps
SCENES = {"cylinder": round_a_cylinder, "tube": in_a_tube}
"""By the name to ask for one: (solver, its module) → cases."""


def cases(scene: str, found: dict[str, Any]) -> list[Case]:
    """Of all solvers that `solvers` found, in one scene of `SCENES`."""
    return [case for solver, module in found.items() for case in SCENES[scene](solver, module)]


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
