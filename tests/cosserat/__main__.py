"""Errors and times of our free rod and of the other solvers of cosseratbench, in one Markdown table.

`python -m tests.cosserat` runs five cases for every solver that is installed; `--cases` and `--solvers` some of them.
The cases, their references and measures are the benchmark's own. A time is the benchmark's too: that of the run after a
short one that compiles. A failed or unsupported run is a row with its reason.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any

from tests.speed.bench import machine
from tests.speed.measure import table

OURS = "magwire"
CASES = ("cantilever", "catenary", "pendulum", "twist", "capstan")
HEAD = ("case", "solver", "segments", "step, s", "outcome", "measures", "time, s")


def main(arguments: list[str] | None = None) -> int:
    """Status 1 if one of our runs has not completed, 2 without the benchmark."""
    try:
        from cosseratbench import registry, run
    except ModuleNotFoundError:
        print("cosseratbench is not installed; it comes with the extra test: pip install magwire-env[test]")
        return 2
    parser = argparse.ArgumentParser(prog="python -m tests.cosserat", description=__doc__)
    parser.add_argument("--cases", nargs="+", choices=registry.names(registry.EXPERIMENTS), default=CASES)
    parser.add_argument("--solvers", nargs="+", choices=known(registry), default=known(registry))
    chosen = parser.parse_args(arguments)
    print(machine(), flush=True)
    solvers, missing = loaded(registry, chosen.solvers)
    all_well = True
    print("", table(HEAD, []), sep="\n", flush=True)
    for case in chosen.cases:
        for solver in solvers:
            result = run(registry.load_experiment(case), solver)
            all_well &= solver.name != OURS or result.outcome == "completed"
            print("| " + " | ".join(row(result)) + " |", flush=True)  # each as it comes: some take minutes
    print("", *missing, sep="\n")
    return 0 if all_well else 1


def known(registry: Any) -> list[str]:
    """Names of all solvers, ours first."""
    return [OURS, *(name for name in registry.names(registry.SOLVERS) if name != OURS)]


def loaded(registry: Any, names: list[str]) -> tuple[list[Any], list[str]]:
    """The solvers that can be loaded, and a sentence for each that cannot."""
    from magwire_env.validation.cosserat import FreeRodSolver

    solvers, missing = [], []
    for name in names:
        try:
            solvers.append(FreeRodSolver() if name == OURS else registry.load_solver(name))
        except ImportError as error:
            missing.append(f"{name} was not run: {error}.")
    return solvers, missing


def row(result: Any) -> tuple[str, ...]:
    """A row of the table: the benchmark's metrics, and what it saw of contact where there was any."""
    seen = {name: value for name, value in result.observations.items() if name != "max_strain" and value > 0.0}
    measures = ", ".join(f"{name} {value:.2e}" for name, value in {**result.metrics, **seen}.items())
    reason = result.failure or ", ".join(result.missing)
    outcome = f"{result.outcome}: {reason}" if reason else result.outcome
    step, time = result.settings.get("time_step", math.nan), result.wall_time
    shown = ("–" if value is None or math.isnan(value) else f"{value:.3g}" for value in (step, time))
    step_shown, time_shown = shown
    return result.experiment, result.solver, str(result.n_elements), step_shown, outcome, measures or "–", time_shown


if __name__ == "__main__":
    sys.exit(main())
