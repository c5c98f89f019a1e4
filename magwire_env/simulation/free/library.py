"""The scenarios of a batch of free wires as rows of kernel parameters, one an entry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...lumen.curve import Tract
from ...lumen.lumen import Lumen
from ...scenario import Scenario
from ...scenario.steps import common_substeps
from .. import centreline
from ..lanes import LANES
from . import layout as at
from .pieces import pieces_of, wire_rows
from .walls import Walls
from .ways import Ways

__all__ = ["FreeLibrary", "LayingCurve"]

_FORCE_TOLERANCE = 0.1
"""Largest imbalance of a node after a step, in units of the smallest E I over the wire's length squared."""

_MOVE_TOLERANCE = 1e-4
"""Largest correction that is no longer made, in segment lengths."""

_DRIFT = 2e-5
"""m/s. Nor is any imbalance left that would set a free node in motion at this speed against its inertia and drag."""

_FEED_STIFFNESS = 1e5
"""N/m, of the drive behind the wire."""

_PATIENCE = 40
"""Evaluations of a step before it is halved."""


class LayingCurve:
    """A smooth curve from the inlet through a branch, to lay a wire along.

    course, table : see `magwire_env.simulation.centreline`
    """

    def __init__(self, lumen: Lumen, branch: int) -> None:
        self._lumen, self._branch = lumen, lumen.branches[branch]
        if branch == 0:
            curve, self._ways, self._arcs = lumen.trunk.curve, np.zeros(1), np.zeros(1)
        else:
            route = lumen.route("inlet", (self._branch.name, self._branch.length))
            curve = route.tract()
            self._ways = np.linspace(0.0, self._branch.length, 33)
            points = self._branch.curve.position(self._ways)
            self._arcs = np.maximum.accumulate(curve.project(points))
        self.table, courses = centreline.tables([curve])
        self.course = courses[0]
        self._trunk = branch == 0

    def arc(self, s: np.ndarray) -> np.ndarray:
        """Arc lengths on the curve of places `s` m along the branch."""
        return s if self._trunk else np.interp(s, self._ways, self._arcs)


class FreeLibrary:
    """Wires and lumens of a batch's scenarios, sized to the longest wire.

    nodes : of the longest wire; the others' spare first nodes idle
    first_node : (entries,), each wire's own first one
    points : contact points a segment; twist : whether the wires twist: both must be those of all scenarios
    steps : of the integration in a control period
    par : (entries, parameters), wire : (entries, nodes, fields), see `layout`
    walls, ways : the lumens
    fed : (entries,)
    low, high, home : (entries,) m of wire that a feed may and does insert; of a free base 0, ∞ and its length

    Raises `ValueError` if the scenarios differ in contact points, or in whether their wires twist.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self.points, self.twist = scenarios[0].contact.per_segment, scenarios[0].wire.twisting is not None
        for i, sc in enumerate(scenarios):
            if sc.contact.per_segment != self.points:
                raise ValueError(
                    f"scenario[{i}].contact.per_segment must be that of the batch, {self.points}, "
                    f"got {sc.contact.per_segment}"
                )
            if (sc.wire.twisting is not None) != self.twist:
                raise ValueError(
                    f"scenario[{i}].wire.twisting must be given (in N·m²) in all scenarios of a batch or in none, "
                    f"got {sc.wire.twisting}"
                )
        self._scenarios = scenarios
        self.nodes = max(sc.wire.segments for sc in scenarios) + 1
        self.first_node = self.nodes - 1 - np.array([sc.wire.segments for sc in scenarios])
        self.steps = common_substeps(scenarios)
        self.walls = Walls(scenarios)
        self.par = np.array([_parameters(sc, self.steps) for sc in scenarios])
        known = ~np.isnan(self.walls.fields)
        self.par[known] = self.walls.fields[known]
        self.wire = np.array([wire_rows(pieces_of(sc), self.nodes) for sc in scenarios])
        held = np.flatnonzero([sc.rig.clamped for sc in scenarios])
        for hold in (at.HOLD_X, at.HOLD_Y, at.HOLD_Z):
            self.wire[held, self.first_node[held], hold // LANES] = at.HELD
        self.length = np.array([sc.wire.length for sc in scenarios])
        feeds = [sc.rig.feed for sc in scenarios]
        self.fed = np.array([f is not None for f in feeds])
        self.low = np.array([0.0 if f is None else f.low for f in feeds], dtype=np.float64)
        self.high = np.array([np.inf if f is None else f.high for f in feeds], dtype=np.float64)
        self.home = np.array([sc.wire.length if f is None else f.home for sc, f in zip(scenarios, feeds, strict=True)])
        self.ways = _ways([sc.tree for sc in scenarios])
        self._curves: dict[tuple[Lumen, int], LayingCurve] = {}

    def laying_curve(self, entry: int, branch: int) -> LayingCurve:
        """The curve along which a wire is laid whose tip is in a branch."""
        lumen = self._scenarios[entry].tree
        key = (lumen, branch)
        if key not in self._curves:
            self._curves[key] = LayingCurve(lumen, branch)
        return self._curves[key]


def _parameters(sc: Scenario, steps: int) -> np.ndarray:
    """A lane's parameters, those of the wall left out."""
    wire, contact, feed = sc.wire, sc.contact, sc.rig.feed
    softest = wire.bending_rigidity if wire.bending is None else wire.bending.least
    trunk = sc.tree.trunk.curve
    inlet, along = trunk.position(0.0), trunk.tangent(0.0)
    narrowest = sc.tree.narrowest[0]
    step, piece = sc.timing.control_period / steps, wire.segment_length
    line = wire.density * wire.area if wire.mass_per_length is None else wire.mass_per_length.least
    drift = _DRIFT * piece * (line / step + contact.drag)
    fields = {
        "GX": sc.gravity[0], "GY": sc.gravity[1], "GZ": sc.gravity[2],
        "STEP": step, "STEPS": steps, "FRICTION": contact.friction,
        "STICK": contact.stick_speed, "WALL": contact.stiffness, "TIP_CAP": wire.radius,
        "MOST_MOVE": min(2.0 * narrowest, wire.segment_length), "PATIENCE": _PATIENCE, "MEMORY": 1.0,
        "FORCE_TOLERANCE": min(_FORCE_TOLERANCE * softest / wire.length**2, drift),
        "MOVE_TOLERANCE": _MOVE_TOLERANCE * wire.segment_length,
        "BASE_X": inlet[0], "BASE_Y": inlet[1], "BASE_Z": inlet[2],
        "BASE_TX": along[0], "BASE_TY": along[1], "BASE_TZ": along[2], "TIP_TX": 1.0,
        "BASE_CLAMPED": float(feed is not None or sc.rig.clamped), "FED": float(feed is not None),
        "FEED_SPEED": feed.speed if feed else 0.0, "FEED_FORCE": feed.force if feed else 1.0,
        "FEED_STIFFNESS": _FEED_STIFFNESS, "TWIST_SPEED": sc.rig.twist.speed if sc.rig.twist else 0.0,
    }  # fmt: skip
    row = np.zeros(at.PAR_SIZE // LANES)
    for name, value in fields.items():
        row[getattr(at, name) // LANES] = value
    return row


def _ways(lumens: Sequence[Lumen]) -> Ways:
    """The trees, each different one once."""
    first: dict[Lumen, int] = {}
    tracts: list[Tract] = []
    columns: dict[str, list] = {name: [] for name in ("parent", "start", "begin", "length")}
    tables: list[list[np.ndarray]] = [[] for _ in range(6)]
    rows = chunks = 0
    for lumen in lumens:
        if lumen in first:
            continue
        first[lumen] = len(tracts)
        begins: list[float] = []
        for branch, parent in zip(lumen.branches, lumen.parents, strict=True):
            begins.append(0.0 if parent < 0 else begins[parent] + branch.start)
            for name, value in (("parent", parent), ("start", branch.start), ("length", branch.length)):
                columns[name].append(value)
            tracts.append(branch.curve)
        columns["begin"] += begins
        curve, radius, own, spacing, balls, parts = lumen.tubes.tables
        own, parts = own.copy(), parts.copy()
        own[:, 0] += rows
        own[:, 2] += chunks
        parts[:, 0] += rows
        rows, chunks = rows + len(curve), chunks + len(balls)
        for kept, array in zip(tables, (curve, radius, own, spacing, balls, parts), strict=True):
            kept.append(array)
    table, course = centreline.tables(tracts)
    joined = [np.ascontiguousarray(np.concatenate(kept)) for kept in tables]
    return Ways._make(
        [
            np.array([first[lumen] for lumen in lumens]),
            np.array([len(lumen.branches) for lumen in lumens]),
            np.array(columns["parent"], dtype=np.int64),
            *(np.array(columns[name], dtype=np.float64) for name in ("start", "begin", "length")),
            np.ascontiguousarray(course, dtype=np.float64),
            table,
            *joined,
        ]
    )
