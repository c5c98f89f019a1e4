"""What a picture shows: one lane at one moment, as plain values."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..envs.core import SteeringCore
from ..physics.magnets import BlockMagnet, CylinderMagnet, Magnet
from ..scenario import Scenario
from ..scenario.rig import Turn
from ..simulation.model import supports

__all__ = [
    "SLEEVE",
    "Snapshot",
    "axis_rotation",
    "blend",
    "body_halves",
    "force_scale",
    "load_limit",
    "magnet_rotations",
    "snapshots",
]

SLEEVE = 30e-3
"""m of a fed wire that are drawn behind the inlet."""

_ROUTE_POINTS = 96

_POINT_SIZE = 10e-3
"""m, edge of the cube that stands for a point dipole."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One lane at one moment, SI units.

    time : s since the episode's start
    tip_arclength, goal : m from the inlet, along the tract or, of a tree, along the branches
    target, target_way, target_radius : the goal's point (3,) m, the direction of the way there, the lumen's radius, m
    route : (j, 3) m, of a tree the way from the inlet to the goal along centrelines; of a tract none; a wanted shape
    nodes : (k, 3) m, tail to tip; what a feed has not pushed out lies straight behind the inlet, a little of it
    contact : (k, 3) N, what the wall exerts on each node; of a wire whose contact forces are not known all zero
    load : (k,) N, the force on the wall each node is shaded by: of its contact, or the tip's throughout
    tip_position, tip_tangent, tip_force : (3,) m, unit vector, N
    drive_force, lateral_force, wall_force : N
    magnet : (dof,) rad or m
    magnet_positions : (magnets, 3) m
    """

    scenario: Scenario
    time: float
    tip_arclength: float
    goal: float
    target: np.ndarray
    target_way: np.ndarray
    target_radius: float
    route: np.ndarray
    nodes: np.ndarray
    contact: np.ndarray
    load: np.ndarray
    tip_position: np.ndarray
    tip_tangent: np.ndarray
    tip_force: np.ndarray
    drive_force: float
    lateral_force: float
    wall_force: float
    magnet: np.ndarray
    magnet_positions: np.ndarray


_BLENDED = tuple(f.name for f in dataclasses.fields(Snapshot) if f.name != "scenario")


def snapshots(core: SteeringCore, lanes: Sequence[int] | None = None) -> list[Snapshot]:
    """The present of `lanes`, all by default."""
    sim = core.sim
    lanes = range(sim.num_envs) if lanes is None else lanes
    positions, wall, centres = sim.positions, sim.wall_force, sim.magnet_positions
    arclength, drive, lateral = sim.tip_arclength, sim.drive_force, sim.lateral_force
    tip, tangent, force, magnet = sim.tip_position, sim.tip_tangent, sim.tip_force, sim.magnet
    goals = sim.goals()
    touches = sim.contact_forces if sim.supports("contact") else None
    inserted = sim.inserted_length if sim.supports("base") else np.zeros(sim.num_envs)
    out = []
    for i in lanes:
        scenario = sim.library.scenarios[sim.lane_scenario[i]]
        own = slice(len(positions[i]) - scenario.wire.segments - 1, None) if len(positions[i]) > 1 else slice(None)
        nodes = _with_sleeve(scenario, positions[i, own], float(inserted[i]))
        contact = np.zeros(nodes.shape) if touches is None else touches[i, own]
        load = np.full(len(nodes), wall[i]) if touches is None else np.linalg.norm(contact, axis=1)
        branch = scenario.tree.branches[goals.branch[i]]
        goal = float(goals.s[i])
        marked = (
            branch.curve.position(goal), branch.curve.tangent(goal), float(branch.radius(goal)),
            _route(scenario, branch.name, goal),
        )  # fmt: skip
        if core.shapes:
            marked = _of_shape(core.shapes.wanted[i], scenario.wire.radius)
        out.append(
            Snapshot(
                scenario, float(sim.time[i]), float(arclength[i]), _way_to(scenario, branch.name, goal), *marked,
                nodes, contact,
                load, tip[i], tangent[i] / np.linalg.norm(tangent[i]), force[i],
                float(drive[i]), float(lateral[i]), float(wall[i]), magnet[i], centres[i],
            )
        )  # fmt: skip
    return out


def _of_shape(wanted: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """A wanted shape, nodes (k, 3) m, as a route with its mark at the end."""
    end = wanted[-1] - wanted[-2]
    return wanted[-1], end / np.linalg.norm(end), 2.0 * radius, wanted.copy()


@lru_cache(maxsize=64)
def _way_to(scenario: Scenario, branch: str, s: float) -> float:
    """Length of the way from the inlet to a place, m."""
    return s if len(scenario.tree.branches) == 1 else scenario.tree.length_of((branch, s))


@lru_cache(maxsize=64)
def _route(scenario: Scenario, branch: str, s: float) -> np.ndarray:
    """Points of the way from the inlet of a tree to a place, `_ROUTE_POINTS` of them; none in a lumen of one branch."""
    if len(scenario.tree.branches) == 1:
        return np.zeros((0, 3))
    route = scenario.tree.route("inlet", (branch, s))
    return route.position(np.linspace(0.0, route.length, _ROUTE_POINTS))


def _with_sleeve(scenario: Scenario, nodes: np.ndarray, inserted: float) -> np.ndarray:
    """A wire's nodes with those that are still in the sleeve behind the inlet, as far as it is drawn."""
    missing = np.isnan(nodes[:, 0])
    if not missing.any():
        return nodes
    wire, trunk = scenario.wire, scenario.tree.trunk.curve
    behind = inserted - wire.segment_length * np.arange(wire.segments, -1, -1)
    behind = np.clip(behind, -SLEEVE, 0.0)[:, None]
    return np.where(missing[:, None], trunk.position(0.0) + behind * trunk.tangent(0.0), nodes)


def blend(before: Snapshot, after: Snapshot, share: float) -> Snapshot:
    """The moment between two steps of one episode, `share` in [0, 1] of the way: what a smooth picture shows."""
    mixed = {k: (1 - share) * getattr(before, k) + share * getattr(after, k) for k in _BLENDED}
    return dataclasses.replace(after, **mixed)


def magnet_rotations(scenario: Scenario, magnet: np.ndarray) -> np.ndarray:
    """Orientations of the rig's magnets with its degrees of freedom at `magnet` (dof,): (magnets, 3, 3).

    The first turn of a magnet is done first, the second about its own world axis after it.
    """
    out, at = np.empty((len(scenario.rig.magnets), 3, 3)), 0
    for m, mount in enumerate(scenario.rig.magnets):
        out[m] = np.eye(3)
        for dof in mount.dofs:
            if isinstance(dof, Turn):
                out[m] = axis_rotation(dof.axis, magnet[at]) @ out[m]
            at += 1
    return out


def axis_rotation(axis: str, angle: float) -> np.ndarray:
    """The rotation (3, 3) by `angle` (rad) about a world axis."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out = np.eye(3)
    out[j, j] = out[k, k] = c
    out[j, k], out[k, j] = -s, s
    return out


def body_halves(magnet: Magnet) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a magnet's north and south half in its own frame, (k, 3) m each; a point dipole as a small cube."""
    if isinstance(magnet, CylinderMagnet):
        angle = np.arange(24) * np.pi / 12
        rim = magnet.diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        height = magnet.height
    else:
        size = magnet.size if isinstance(magnet, BlockMagnet) else (_POINT_SIZE,) * 3
        rim = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array(size[:2]) / 2
        height = size[2]
    middle = np.column_stack([rim, np.zeros(len(rim))])
    shift = np.array([0.0, 0.0, height / 2])
    return np.vstack([middle, middle + shift]), np.vstack([middle, middle - shift])


def load_limit(scenario: Scenario) -> float:
    """N, of the load at which a wire is shaded brightest: the limit of the wall force; for one node a fifth of it."""
    limit = scenario.contact.wall_force_limit
    return 0.2 * limit if supports(scenario, "contact") else limit


def force_scale(scenario: Scenario) -> float:
    """The order of the force on the tip, N.

    Of a magnet: two dipoles in line at the rig's smallest distance from the tract. Of a coil: its gradient at its
    largest current, and its uniform field in the tract's sharpest bend.
    """
    moment, curves = scenario.tip.moment, [branch.curve for branch in scenario.tree.branches]
    course = np.concatenate([c.position(np.linspace(0.0, c.length, 200)) for c in curves])
    bend = max(float(c.curvature(np.linspace(0.0, c.length, 200)).max()) for c in curves)
    sizes = [6e-7 * m.magnet.moment * moment / m.distance_to(course) ** 4 for m in scenario.rig.magnets]
    for coil in scenario.rig.coils:
        current = max(abs(coil.current.low), abs(coil.current.high))
        sizes.append(current * moment * (abs(coil.gradient) + abs(coil.uniform) * bend))
    # A uniform field pulls at no straight wire: its couple, borne over the wire's length.
    return max(sizes) or max(25e-3 * moment / scenario.wire.length, 1e-6)
