"""Shapes: bring a clamped wire into a shape that is wanted. Which shapes can be wanted, and how far off the wire is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ..scenario import Scenario
from ..simulation import Library, Places, Simulator
from ..simulation.readout import ROW
from .kernels import HOLD
from .kinds import Kind

if TYPE_CHECKING:
    from .task import Task

__all__ = ["Shape", "Shapes", "Wanted", "come_to_rest", "off", "reachable"]

_SEED = 20_140
"""Of the commands that make the shapes of a scenario."""

_PERIODS = 60
"""Control periods for which a wire may swing before it must be at rest."""

_STILL = 2e-5
"""m at most that a node of a wire at rest moves in a control period."""

_LEAST_BENT = 0.06
"""A wanted shape is at least this share of the wire's length off the straight one."""


class Wanted(NamedTuple):
    """Shapes that commands make of a wire at rest.

    commands : (k, dof) rad, m and A
    nodes : (k, nodes, 3) m
    """

    commands: np.ndarray
    nodes: np.ndarray


@dataclass(frozen=True)
class Shape(Kind):
    """Bring a clamped wire into a shape that is drawn for every episode, and hold it there.

    count : how many commands are drawn for a scenario; an episode wants the shape that one of them makes
    """

    name: ClassVar[str] = "shape"
    rule: ClassVar[int] = HOLD
    draws: ClassVar[int] = 1
    shapes: ClassVar[bool] = True
    takes: ClassVar[tuple[str, ...]] = ("target", "magnet_angle")
    count: int = 1024

    def begin(self, task: Task, library: Library, entries: np.ndarray, drawn: np.ndarray) -> tuple[Places, Places]:
        """As `Kind.begin`: the wire stands straight out of its clamp. The goal is a shape, and no place."""
        return Places(library.wire_length[entries]), Places(library.tract_length[entries])

    def starts(self, task: Task) -> str:
        """As `Kind.starts`."""
        return (
            f"The wire stands straight out of its clamp. The wanted shape is drawn from those that {self.count} commands, "
            "uniform in the rig's range, make of the wire at rest, without the nearly straight ones."
        )

    def ends(self, task: Task) -> str:
        """As `Kind.ends`."""
        return (
            f"Terminated when the root mean square distance of the nodes from those of the wanted shape has stayed below "
            f"{1e3 * task.tolerance:g} mm for {task.hold:g} s (`is_success`). That distance is `distance` in `info`; "
            '`summary["time"]` runs to the end of the holding.'
        )


def off(nodes: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Root mean square distance of nodes (…, nodes, 3) m from wanted ones, (…) m."""
    return np.sqrt(((nodes - wanted) ** 2).sum(axis=-1).mean(axis=-1))


def come_to_rest(scenario: Scenario, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The shapes (k, nodes, 3) m that held commands (k, dof) make of a wire that was straight, and which are at rest."""
    n = len(commands)
    sim = Simulator(scenario, n)
    sim.lay(np.arange(n), Places(np.full(n, scenario.wire.length)), commands, Places(np.full(n, scenario.tract.length)))
    bad = np.zeros(n, dtype=np.bool_)
    for _ in range(_PERIODS):
        before = sim.positions
        sim.step(commands)
        bad |= sim.unconverged > 0
    return sim.positions, ~bad & (np.abs(sim.positions - before).max(axis=(1, 2)) < _STILL)


@lru_cache(maxsize=16)
def reachable(scenario: Scenario, count: int) -> Wanted:
    """The shapes that `count` random commands of a scenario make, less those that swing on or are nearly straight.

    Raises `ValueError` if none is left.
    """
    _, low, high = Library([scenario]).limits.of(np.zeros(1, dtype=np.int64))
    commands = low + np.random.default_rng(_SEED).random((count, low.shape[1])) * (high - low)
    nodes, still = come_to_rest(scenario, commands)
    straight = np.zeros_like(nodes[0])
    along = np.linspace(0.0, 1.0, len(straight))[:, None] * scenario.wire.length
    straight[:] = scenario.tract.position(np.zeros(1)) + along * scenario.tract.tangent(np.zeros(1))
    kept = still & (off(nodes, straight) > _LEAST_BENT * scenario.wire.length)
    if not kept.any():
        raise ValueError(
            f"scenario {scenario.name!r} must have commands that bend its wire by more than {_LEAST_BENT:g} of its length "
            f"and let it come to rest, got none of {count}"
        )
    return Wanted(commands[kept], nodes[kept])


class Shapes:
    """The wanted shapes of a batch, and how far off the wires are.

    wanted : (n, nodes, 3) m
    commands : (n, dof), a command that makes it of a wire at rest: the demonstration

    Raises `ValueError` for a scenario whose wire is not clamped, and for wires of different numbers of segments.
    """

    def __init__(self, sim: Simulator, task: Task) -> None:
        self._sim, self._task = sim, task
        scenarios = sim.library.scenarios
        for i, sc in enumerate(scenarios):
            if not sc.rig.clamped:
                raise ValueError(f"scenario[{i}].rig.clamped must be True in the task {task.id}, got False")
            if sc.wire.segments != scenarios[0].wire.segments:
                raise ValueError(
                    f"scenario[{i}].wire.segments must be that of the batch, {scenarios[0].wire.segments}, "
                    f"got {sc.wire.segments}"
                )
        self.wanted = np.zeros((sim.num_envs, scenarios[0].wire.segments + 1, 3))
        self.commands = np.zeros((sim.num_envs, sim.dof))

    def choose(self, lanes: np.ndarray, entries: np.ndarray, drawn: np.ndarray, target: Any = None) -> None:
        """What the episodes beginning in `lanes` (n,) want, from uniform numbers `drawn` (n,).

        target : the command that makes the wanted shape, (dof,) or (lanes of the batch, dof), in place of what is drawn

        Raises `ValueError` for a target that is no such command, or beyond the rig's limits, or does not come to rest.
        """
        if target is not None:
            self._take(lanes, entries, target)
            return
        for entry in np.unique(entries).tolist():
            rows = np.flatnonzero(entries == entry)
            found = reachable(self._sim.library.scenarios[entry], self._task.kind.count)  # type: ignore[attr-defined]
            which = (drawn[rows] * len(found.commands)).astype(np.int64)
            self.wanted[lanes[rows]], self.commands[lanes[rows]] = found.nodes[which], found.commands[which]

    def _take(self, lanes: np.ndarray, entries: np.ndarray, target: Any) -> None:
        n, dof = self.commands.shape
        _, low, high = self._sim.library.limits.of(entries)
        try:
            commands = np.broadcast_to(np.asarray(target, dtype=np.float64), (n, dof))[lanes]
        except (TypeError, ValueError):
            raise ValueError(
                f"options['target'] must be a command of {dof} numbers (in rad, m and A), or {n} of them, got {target!r}"
            ) from None
        if not ((commands >= low - 1e-9) & (commands <= high + 1e-9)).all():
            raise ValueError(
                f"options['target'] must lie within the rig's limits, from {low[0].tolist()} to {high[0].tolist()}, "
                f"got {target!r}"
            )
        for entry in np.unique(entries).tolist():
            rows = np.flatnonzero(entries == entry)
            nodes, still = come_to_rest(self._sim.library.scenarios[entry], commands[rows])
            if not still.all():
                raise ValueError(f"options['target'] must let the wire come to rest, got {target!r}")
            self.wanted[lanes[rows]], self.commands[lanes[rows]] = nodes, commands[rows]

    def measure(self, lanes: np.ndarray | slice = slice(None)) -> None:
        """Put the distance from the wanted shape where the env reads the way left; after a lay or a control period."""
        sim, n = self._sim, self._sim.num_envs
        rows = np.arange(n)[lanes]
        distance = off(sim.positions[rows], self.wanted[rows])
        sim.readout[ROW.remaining, rows] = distance
        sim.trace[:, rows] = distance

    def held(self, shares: np.ndarray) -> np.ndarray:
        """How far off the wires come to rest under held commands, (k, n) m: shares (k, dof) of the rig's ranges."""
        found = np.full((len(shares), self._sim.num_envs), np.inf)
        entries = self._sim.lane_scenario
        for entry in np.unique(entries).tolist():
            lanes = np.flatnonzero(entries == entry)
            _, low, high = self._sim.library.limits.of(np.array([entry]))
            nodes, still = come_to_rest(self._sim.library.scenarios[entry], low + shares * (high - low))
            found[:, lanes] = np.where(still[:, None], off(nodes[:, None], self.wanted[lanes]), np.inf)
        return found

    def start_info(self, lane: int | None) -> dict[str, Any]:
        """`info` of a reset: the nodes that are wanted (m), and a command that brings the wire there."""
        found = {"target": self.wanted.copy(), "demonstration": self.commands.copy()}
        return found if lane is None else {name: value[lane] for name, value in found.items()}
