"""What a picture shows: one lane at one moment, as plain values."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..envs.core import SteeringCore
from ..physics.magnets import BlockMagnet, CylinderMagnet, Magnet
from ..rig import Slide, Turn
from ..scenario import Scenario

__all__ = [
    "Snapshot",
    "axis_rotation",
    "blend",
    "body_halves",
    "dof_texts",
    "force_scale",
    "magnet_rotations",
    "number",
    "snapshots",
]

_POINT_SIZE = 10e-3
"""m, edge of the cube that stands for a point dipole."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One lane at one moment, SI units.

    time : s since the episode's start
    tip_arclength, goal : m along the tract
    nodes : (k, 3) m, tail to tip
    contact : (k,) N, the force on the wall each node is shaded by; the tip's throughout, the only one that is known
    tip_position, tip_tangent, tip_force : (3,) m, unit vector, N
    drive_force, lateral_force, wall_force : N
    magnet : (dof,) rad or m
    magnet_positions : (magnets, 3) m
    """

    scenario: Scenario
    time: float
    tip_arclength: float
    goal: float
    nodes: np.ndarray
    contact: np.ndarray
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
    out = []
    for i in lanes:
        nodes = positions[i][~np.isnan(positions[i, :, 0])]
        out.append(
            Snapshot(
                sim.library.scenarios[sim.lane_scenario[i]],
                float(sim.time[i]), float(arclength[i]), float(core.goal[i]), nodes,
                np.full(len(nodes), wall[i]), tip[i], tangent[i] / np.linalg.norm(tangent[i]), force[i],
                float(drive[i]), float(lateral[i]), float(wall[i]), magnet[i], centres[i],
            )
        )  # fmt: skip
    return out


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


def force_scale(scenario: Scenario) -> float:
    """The order of the force on the tip, N: two dipoles in line at the rig's smallest distance from the tract."""
    course = scenario.tract.position(np.linspace(0.0, scenario.tract.length, 200))
    return max(6e-7 * m.magnet.moment * scenario.tip.moment / m.distance_to(course) ** 4 for m in scenario.rig.magnets)


def dof_texts(scenario: Scenario, magnet: np.ndarray) -> list[str]:
    """Each degree of freedom in words, such as "θ 187°" or "x −12 mm"; numbered where there are several magnets."""
    texts, at = [], 0
    several = len(scenario.rig.magnets) > 1
    lone = sum(isinstance(d, Turn) for d in scenario.rig.dofs) == 1
    for m, mount in enumerate(scenario.rig.magnets):
        for dof in mount.dofs:
            which = str(m + 1) if several else ""
            if isinstance(dof, Slide):
                texts.append(f"{dof.axis}{which} {number(1e3 * magnet[at])} mm")
            else:
                name = "θ" if lone else f"θ{dof.axis}{which}"
                texts.append(f"{name} {round(np.degrees(magnet[at])) % 360}°")
            at += 1
    return texts


def number(value: float, digits: int = 0) -> str:
    """A number with a true minus sign, and no minus before zero."""
    text = f"{value:.{digits}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")
