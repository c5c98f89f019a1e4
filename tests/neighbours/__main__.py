"""Our free wire and the neighbours' rods in the same scenes, in one run: error against the closed form, beside time.

`python -m tests.neighbours` prints one Markdown table; `--scenes cylinder tube` and `--solvers magwire pyelastica
mujoco` choose. A neighbour that is not installed, or a MuJoCo without the cable (4.0 dropped it), is named and left
out. Time is the processor's, of the process, after a short run that compiles; one thread. Each solver runs at two
resolutions or more.
"""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import version

from tests.neighbours.cases import HEAD, OURS, PACKAGES, SCENES, answered, cases, solvers
from tests.speed.bench import machine
from tests.speed.measure import table


def main(arguments: list[str] | None = None) -> int:
    """Status 1 if one of our own runs fails."""
    parser = argparse.ArgumentParser(prog="python -m tests.neighbours", description=__doc__)
    every = [OURS, *PACKAGES]
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--solvers", nargs="+", choices=every, default=every)
    chosen = parser.parse_args(arguments)
    found, missing = solvers(chosen.solvers)
    packages = ["magwire-env" if name == OURS else name for name in found]
    print(machine(), ", ".join(f"{name} {version(name)}" for name in packages) + ".", "", sep="\n")
    print(table(HEAD, []), flush=True)
    well = True
    for name in chosen.scenes:
        for case in cases(name, found):
            answer = answered(case)
            well &= case.solver != OURS or bool(answer.errors)
            print("| " + " | ".join(answer.row()) + " |", flush=True)  # each as it comes: some take a minute
    print("", *missing, sep="\n")
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
