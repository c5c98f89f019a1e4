"""What the lock hid: the paper's policy on the paper's tract with a wire that is free to leave the centreline.

The policy turns the magnet, at every control period, to the command of greatest drive at the tip's place. The magnet is
the paper's, fixed above the tract, or one that slides above the tip. The wire is the locked one under either coupling,
or the free one in a lumen with a clearance from 0.1 to 5 mm around it; it has the paper's friction and stiffness.

`python -m magwire_env.validation.page` prints the table in docs/physics.md, `crossings` is it as numbers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..lumen.curve import Tract
from ..quasistatic.forcemap import best_command
from ..quasistatic.rigs import following
from ..scenario import Scenario
from ..simulation import Simulator
from ..simulation.readout import ROW
from .report import format_table

__all__ = ["CLEARANCES", "POLICIES", "Crossing", "Policy", "crossings", "table", "with_clearance"]

CLEARANCES = (0.1e-3, 0.3e-3, 1e-3, 2e-3, 5e-3)
"""m, between the wire's surface and the wall."""

GOAL = 0.79
"""m, where the tip has arrived."""

SECONDS = 30.0
"""How long the tip has for the way; the locked wire of the paper needs 7.5 s."""

_SPACING = 2e-3


class Policy(NamedTuple):
    """A magnet and the drive that its commands make greatest.

    follows : the magnet slides above the tip; otherwise it is the paper's
    coupling : of the drive: "force", the paper's F·t, or "wrench", what a tip held to the tract's direction feels
    """

    follows: bool
    coupling: str

    @property
    def text(self) -> str:
        """In words."""
        drive = "F·t" if self.coupling == "force" else "Q"
        return f"{'a magnet that follows the tip' if self.follows else 'fixed magnet'}, greatest {drive}"


POLICIES = (Policy(False, "force"), Policy(False, "wrench"), Policy(True, "force"), Policy(True, "wrench"))
"""The first is the paper's."""


class Crossing(NamedTuple):
    """How far a wire came.

    policy : of `POLICIES`
    wire : in words
    time : s until the tip was at `GOAL`; NaN if it never was
    farthest : m, of the tip
    speed : m/s, mean over its way to the farthest place
    wall, peak : N, force on the wall, mean over that way and largest
    unconverged : steps whose motion is not to be trusted
    """

    policy: Policy
    wire: str
    time: float
    farthest: float
    speed: float
    wall: float
    peak: float
    unconverged: int


def with_clearance(scenario: Scenario, clearance: float) -> Scenario:
    """The scenario with the free wire in a lumen that leaves it `clearance` m."""
    tract = scenario.tract
    return scenario.replace(
        tract=Tract(tract.points, scenario.wire.radius + clearance, tract.closed), model="free"
    )  # fmt: skip


def crossings(
    policies: Sequence[Policy] = POLICIES,
    clearances: Sequence[float] = CLEARANCES,
    seconds: float = SECONDS,
    friction: float | None = None,
    segments: int | None = None,
    start: float | None = None,
) -> list[Crossing]:
    """Every policy with the locked wire under both couplings, then with the free one at every clearance (m).

    friction, segments : other than the paper scenario's
    start : m, where the tips lie at first, by default the wire's length: the whole wire just inside
    """
    found, paper = [], Scenario.paper()
    if friction is not None:
        paper = paper.replace(contact__friction=friction)
    if segments is not None:
        paper = paper.replace(wire__segments=segments)
    for policy in policies:
        scenario = paper.replace(rig=following(paper.tract)) if policy.follows else paper
        commands = _commands(scenario, policy.coupling)
        locked = [scenario.replace(coupling=coupling) for coupling in ("force", "wrench")]
        free = [with_clearance(scenario, clearance) for clearance in clearances]
        found += _moved(locked, commands, policy, ("locked, driven by F·t", "locked, driven by Q"), seconds, start)
        if free:
            names = [f"free, clearance {1e3 * c:g} mm" for c in clearances]
            found += _moved(free, commands, policy, names, seconds, start)
    return found


def table(found: Sequence[Crossing]) -> str:
    """Crossings as Markdown."""
    head = ("magnet, command of", "wire", "at 0.79 m after", "farthest", "force on the wall, mean", "largest")
    lines: list[tuple[str, ...]] = [
        (c.policy.text, c.wire, "never" if math.isnan(c.time) else f"{c.time:.1f} s", f"{c.farthest:.2f} m",
         f"{1e3 * c.wall:.0f} mN", f"{1e3 * c.peak:.0f} mN")
        for c in found
    ]  # fmt: skip
    return format_table(head, lines, markdown=True)


def _commands(scenario: Scenario, coupling: str) -> np.ndarray:
    """(places, dof) the commands of greatest drive every `_SPACING` along the tract."""
    places = np.arange(0.0, scenario.tract.length, _SPACING)
    return best_command(dataclasses.replace(scenario, coupling=coupling), places)[0]


def _moved(
    scenarios: Sequence[Scenario],
    commands: np.ndarray,
    policy: Policy,
    names: Sequence[str],
    seconds: float,
    start: float | None,
) -> list[Crossing]:
    """One wire of each of the scenarios, all at once."""
    n = len(scenarios)
    sim = Simulator(list(scenarios), n, lane_scenario=np.arange(n))
    start = scenarios[0].wire.length if start is None else start
    sim.reset(tip_arclength=start, magnet=np.tile(commands[_row(commands, np.array([start]))], (n, 1)))
    tips, walls, peaks, bad = [], [], [], np.zeros(n, dtype=np.int64)
    for _ in range(round(seconds / sim.control_period)):
        sim.step(commands[_row(commands, sim.travelled)])
        tips.append(sim.travelled.copy())
        walls.append(sim.readout[ROW.mean_wall].copy())
        peaks.append(sim.readout[ROW.peak_wall].copy())
        bad += (sim.unconverged > 0).astype(np.int64)
        if (np.max(tips, axis=0) >= GOAL).all():
            break
    return [
        _described(policy, names[i], np.array(tips)[:, i], np.array(walls)[:, i], np.array(peaks)[:, i], int(bad[i]),
                   start, sim.control_period)
        for i in range(n)
    ]  # fmt: skip


def _row(commands: np.ndarray, travelled: np.ndarray) -> np.ndarray:
    return np.clip(np.round(travelled / _SPACING), 0, len(commands) - 1).astype(np.int64)


def _described(
    policy: Policy, wire: str, tip: np.ndarray, wall: np.ndarray, peak: np.ndarray, bad: int, start: float,
    period: float,
) -> Crossing:  # fmt: skip
    arrived = tip >= GOAL
    last = int(arrived.argmax()) if arrived.any() else int(tip.argmax())
    way, time = max(float(tip[last]) - start, 0.0), (last + 1) * period
    return Crossing(
        policy, wire, time if arrived.any() else math.nan, float(tip[: last + 1].max()), way / time,
        float(wall[: last + 1].mean()), float(peak[: last + 1].max()), bad,
    )  # fmt: skip
