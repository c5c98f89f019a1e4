"""How far the paper's claim reaches: other tracts, two readings of 7 cm, both couplings, more magnets.

"One magnet and one axis of rotation move the tip in any direction" (Section V). On a tract this holds where, at every
place from the whole wire just inside to 10 mm before the end, some command's drive exceeds the resistance, forwards and
backwards (`magwire_env.quasistatic.certificate`). Wire, tip, magnet and friction are the paper's. Only the tract is
another: the generator's, of 0.7 to 0.9 m with bends of at least 30 mm, or gentle ones with bends of at least 40 mm.

`python -m magwire_env.quasistatic.reach` counts again, in a quarter of an hour, and writes the record `reach.csv`, from
which docs/physics.md has its table and `magwire figures` its picture.
"""

from __future__ import annotations

import argparse
import csv
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from ..lumen.curve import Tract
from ..lumen.generator import Bounds, generate
from ..physics import BlockMagnet
from ..physics.checks import one_of
from ..scenario import Scenario
from ..scenario.scenario import COUPLINGS
from ..simulation import Library, Simulator
from .certificate import certify
from .forcemap import best_command
from .net_force import FINE, search
from .rigs import DISTANCE, RIGS, paper

__all__ = ["TRACTS", "Drive", "Reach", "drives", "reach", "recorded"]

TRACTS = 500
"""Number of tracts of the record."""

KINDS = {"bends of 30 mm or more": Bounds(), "bends of 40 mm or more": Bounds(bend_radius=0.04)}
"""The generator's bounds by name."""

RECORD = Path(__file__).with_name("reach.csv")

FIRST = 10
"""Of them, so many at the beginning are counted by themselves: a sample that a test can count again."""

READINGS = ("centre", "face")
"""Where on the magnet the paper's 7 cm may end."""

_TOGETHER = 50

_EQUAL = 0.99
"""Share of the first rig's drive that counts as the same drive."""


def distance(reading: str) -> float:
    """The least distance of the magnet's centre from the tract, m, in one of `READINGS`."""
    block = cast(BlockMagnet, paper().rig.magnets[0].magnet)
    return DISTANCE + (block.size[2] / 2 if one_of("reading", reading, READINGS) == "face" else 0.0)


class Reach(NamedTuple):
    """On how many tracts the claim holds, and why it fails on the others.

    tracts, reading, rig, coupling : what was tried
    number : of tracts
    forward, back, both : tracts on which the drive exceeds the resistance everywhere, that way or both ways
    first : of the first `FIRST` tracts, those on which it does forwards
    weakest : N, the least margin of a tract, forwards, median over the tracts
    """

    tracts: str
    reading: str
    rig: str
    coupling: str
    number: int
    forward: int
    back: int
    both: int
    first: int
    weakest: float


class Drive(NamedTuple):
    """What a rig does along the paper's own tract.

    least, median : N, of the greatest drive at each place
    torque : N·m, median of the size of the magnetic torque on the tip under the commands of greatest drive
    spared : N·m, median of the least torque found at each place by commands whose drive is that of the first of `RIGS`
        (within 1 %)
    """

    rig: str
    coupling: str
    least: float
    median: float
    torque: float
    spared: float


def scenario_of(tract: Tract, rig: str, reading: str, coupling: str) -> Scenario:
    """The paper's scenario on another tract, with one of `RIGS` at one of `READINGS`."""
    base = paper()
    made = RIGS[rig](tract, distance(reading))
    return Scenario(f"{rig}, {coupling}", tract, base.wire, base.tip, made, base.contact, coupling)


def reach(tracts: str, reading: str, rig: str, coupling: str, count: int = TRACTS) -> Reach:
    """Count on the first `count` tracts of the generator's split "test"."""
    margins: dict[int, list[float]] = {1: [], -1: []}
    for first in range(0, count, _TOGETHER):
        numbers = range(first, min(first + _TOGETHER, count))
        made = [scenario_of(generate(i, "test", KINDS[tracts]), rig, reading, coupling) for i in numbers]
        start = paper().wire.length
        for direction, found in margins.items():
            ends = {"start": start} if direction > 0 else {"goal": start}
            found += [c.weakest[1] for c in certify(made, direction, **ends)]
    forward, back = (np.array(margins[d]) for d in (1, -1))
    ways = [int(np.sum(way > 0)) for way in (forward, back, np.minimum(forward, back))]
    first = int(np.sum(forward[:FIRST] > 0))
    return Reach(tracts, reading, rig, coupling, count, *ways, first, float(np.median(forward)))  # type: ignore[call-arg]


def recorded() -> list[Reach]:
    """The counts of the record."""
    with RECORD.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names, numbers = Reach._fields[:4], Reach._fields[4:-1]
    return [Reach(*[r[n] for n in names], *[int(r[n]) for n in numbers], float(r["weakest"])) for r in rows]  # type: ignore[arg-type, call-arg]


@lru_cache(maxsize=4)
def drives(places: int = 161) -> tuple[Drive, ...]:
    """The greatest drive along the paper's tract, and the torque that comes with it or that could be had instead."""
    tract, found = paper().tract, list[Drive]()
    s = np.linspace(paper().wire.length, tract.length - 0.01, places)
    entries = np.zeros(places, dtype=np.int64)
    for coupling in COUPLINGS:
        floor = None
        for rig in RIGS:
            scenario = scenario_of(tract, rig, "centre", coupling)
            command, drive = best_command(scenario, s)
            floor = _EQUAL * drive if floor is None else floor
            quiet, _ = search(Library([scenario]), entries, s, 1.0, "torque", FINE, floor)
            torques = (float(np.median(_torque(scenario, s, c))) for c in (command, quiet))
            found.append(Drive(rig, coupling, float(drive.min()), float(np.median(drive)), *torques))
    return tuple(found)


def _torque(scenario: Scenario, s: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Size of the magnetic torque on tips at `s` (n,) m under `command` (n, dof), (n,) N·m."""
    sim = Simulator(scenario, num_envs=len(s))
    sim.reset(tip_arclength=s, magnet=command)
    return sim.tip_torque


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--tracts", type=int, default=TRACTS, help="number of generated tracts of each kind")
    parser.add_argument("--out", type=Path, default=RECORD, help="the record to write")
    options = parser.parse_args()
    found = []
    for tracts in KINDS:
        for reading in READINGS:
            for coupling in COUPLINGS:
                for rig in RIGS:
                    found.append(reach(tracts, reading, rig, coupling, options.tracts))
                    print(f"{len(found)} of {4 * len(KINDS) * len(RIGS)}: {found[-1]}", flush=True)
    with options.out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Reach._fields)
        writer.writerows([*row[:-1], f"{row.weakest:.4g}"] for row in found)


if __name__ == "__main__":
    main()
