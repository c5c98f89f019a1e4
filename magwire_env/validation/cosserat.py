"""The free rod as a solver of cosseratbench, a public benchmark of rods (entry point ``cosseratbench.solvers``).

`FreeRodSolver` says a case of the benchmark in the terms of the free wire's own arrays, `FreeWires`, which is what
``Scenario(model="free")`` is moved by: a `Scenario` itself knows lumens, a tip magnet and a rig, and has no pins, no
obstacles and no start in a given shape. Nothing is fitted to a case. What the wire cannot do is raised as
`NotImplementedError`, which the benchmark prints as unsupported. It is imported only where the benchmark is installed.

Numerical choices, the same for every case (ω is the case's own estimate of its slowest frequency):

- backward Euler, at most 0.01/ω a step for an equilibrium, 2e-4/ω for a motion, whose damping this step sets;
- drag proportional to mass, at the rate 2 ω, for an equilibrium, and none for a motion;
- a wall as stiff as the rod's Young's modulus, a stick speed of 1e-6 rod lengths a second.
"""

from __future__ import annotations

import math
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

from ..simulation.free.layout import HELD
from ..simulation.free.tubes import Tube
from ..simulation.free.wires import FreeWires, Pieces
from ..words import counted
from .free.contact import Line

__all__ = ["FreeRodSolver"]

_STEP_AT_REST, _STEP_IN_MOTION = 1e-2, 2e-4  # of 1/ω
_STICK = 1e-6  # rod lengths a second
_ENDS = {"start": ("BASE", 0), "end": ("TIP", -1)}


class _Clamp(NamedTuple):
    """A clamped end of one rod.

    lane : of the rod; name, node : what the arrays call the end
    tangent, director : (3,) each, where it starts
    motion : the benchmark's `Motion`, or None for one that stands still
    """

    lane: int
    name: str
    node: int
    tangent: np.ndarray
    director: np.ndarray
    motion: Any

    @property
    def held(self) -> np.ndarray:
        """(3,) bool, the world axes along which the node is held."""
        if self.motion is None or self.motion.slides_along is None:
            return np.ones(3, dtype=bool)
        return np.abs(self.motion.axis) < 0.5


class FreeRodSolver:
    """Solver of cosseratbench, see `cosseratbench.Solver`.

    time_step_scale : multiplies the longest step
    """

    name = "magwire"
    backend_version = version("magwire-env")

    def __init__(self, time_step_scale: float = 1.0) -> None:
        self.time_step_scale = time_step_scale

    @property
    def capabilities(self) -> frozenset:
        """Stretch, and contact with a cylinder; no shear, no rod that touches a rod, no plane."""
        from cosseratbench import Capability

        return frozenset({Capability.STRETCH, Capability.CYLINDER_CONTACT})

    def settings(self, scenario: Any, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """The numerical choices of a run, as the benchmark prints them."""
        step, rate = self._steps(scenario, n_frames)[0], _rate(scenario)
        own: dict[str, Any] = {"integrator": "backward Euler, Newton", "time_step": step, "damping_rate": rate}
        if scenario.obstacles:
            own["contact_stiffness"] = [rod.material.youngs_modulus for rod in scenario.rods]
            own["stick_speed"] = [_STICK * rod.length for rod in scenario.rods]
        return own

    def run(self, scenario: Any, *, n_elements: int, n_frames: int) -> Any:
        """Positions and directors of all rods at `n_frames` times; see `cosseratbench.Solver.run`.

        Raises `NotImplementedError` for what the free wire does not know, and the benchmark's `Diverged` where a step
        does not converge.
        """
        from cosseratbench import Diverged, Trajectory

        step, between = self._steps(scenario, n_frames)
        clamps = [clamp for lane, rod in enumerate(scenario.rods) for clamp in _clamps(lane, rod, n_elements)]
        driven = [clamp for clamp in clamps if clamp.motion is not None]
        wires = _wires(scenario, n_elements, step, 1 if driven else between, clamps)
        positions, directors = [wires.positions.copy()], [wires.directors.copy()]
        for frame in range(n_frames - 1):
            for k in range(between if driven else 1):
                _drive(wires, driven, (frame * between + k) * step, step)
                wires.step()
                failed = int(wires.lane("FAILED").sum())
                if failed:
                    raise Diverged(f"{counted(failed, 'step')} did not converge", time=(frame * between + k) * step)
            positions.append(wires.positions.copy())
            directors.append(wires.directors.copy())
        _check_beside(scenario, np.stack(positions))
        times = np.linspace(0.0, scenario.duration, n_frames)
        shapes = np.stack(positions, axis=1), np.stack(directors, axis=1)
        return Trajectory(times, *(tuple(every) for every in shapes))

    def _steps(self, scenario: Any, n_frames: int) -> tuple[float, int]:
        """The step, s, and how many of them lie between two frames."""
        share = _STEP_AT_REST if scenario.quasi_static else _STEP_IN_MOTION
        longest = self.time_step_scale * share / scenario.slowest_frequency()
        frame = scenario.duration / (n_frames - 1)
        between = max(1, math.ceil(frame / longest))
        return frame / between, between


def _rate(scenario: Any) -> float:
    """Drag over mass, 1/s: critical for the slowest motion where an equilibrium is asked for."""
    return 2.0 * scenario.slowest_frequency() if scenario.quasi_static else 0.0


def _pieces(rod: Any, n: int, rate: float) -> Pieces:
    """A rod of the benchmark in n equal segments."""
    line, inertia = rod.material.density * rod.area, rod.second_moment_of_area
    return Pieces.uniform(
        np.full(n, rod.length / n),
        bending=rod.material.youngs_modulus * inertia,
        axial=rod.material.youngs_modulus * rod.area,
        mass=line,
        twisting=2.0 * rod.material.shear_modulus * inertia,
        drag=rate * line,
        radius=rod.radius,
    )


def _clamps(lane: int, rod: Any, n: int) -> list[_Clamp]:
    """The clamped ends of a rod; their directions are those of the given centreline's first and last piece."""
    points, found = np.asarray(rod.centerline, dtype=np.float64), []
    for end, motion, piece in (("start", rod.start_motion, points[:2]), ("end", rod.end_motion, points[-2:])):
        if getattr(rod, end).value != "clamped":
            continue
        name, node = _ENDS[end]
        tangent = _unit(piece[1] - piece[0])
        director = rod.directors(n)[node]
        director = _unit(director - (director @ tangent) * tangent)
        if motion is not None and motion.slides_along is not None and np.abs(motion.axis).max() < 1.0 - 1e-12:
            raise NotImplementedError(f"a clamp that slides along {motion.slides_along}, which is no axis of the world")
        found.append(_Clamp(lane, name, node, tangent, director, motion))
    return found


def _wires(scenario: Any, n: int, step: float, steps: int, clamps: list[_Clamp]) -> FreeWires:
    """All rods of a case as lanes of one batch, where they start."""
    rods, rate = scenario.rods, _rate(scenario)
    wires = FreeWires(
        _pieces(rods[0], n, rate), len(rods), step=step, steps=steps, twist=True, threads=1, wall=_wall(scenario)
    )
    for lane, rod in enumerate(rods):
        wires.take(np.array([lane]), _pieces(rod, n, rate))
    for axis, value in zip("XYZ", scenario.gravity, strict=True):
        wires.par(f"G{axis}", value)
    if scenario.obstacles:
        wires.par("FRICTION", np.array([max(rod.friction, scenario.obstacles[0].friction) for rod in rods]))
        wires.par("STICK", np.array([_STICK * rod.length for rod in rods]))
        wires.par("WALL", np.array([rod.material.youngs_modulus for rod in rods]))
        wires.par("MOST_MOVE", np.array([rod.length / n for rod in rods]))
    held: np.ndarray = np.zeros((len(rods), n + 1, 3), dtype=bool)
    forces = np.zeros(held.shape)
    for lane, rod in enumerate(rods):
        for end, (_, node) in _ENDS.items():
            held[lane, node] = getattr(rod, end).value != "free"
        for load in rod.loads:
            forces[lane, _ENDS[load.at.value][1]] += load.force
    for clamp in clamps:
        held[clamp.lane, clamp.node] = clamp.held
        lanes = np.array([clamp.lane])
        wires.par(f"{clamp.name}_CLAMPED", np.ones(1), lanes)
        wires.vector(f"{clamp.name}_TX", clamp.tangent[None], lanes)
        wires.vector(f"{clamp.name}_MX", clamp.director[None], lanes)
    for k, axis in enumerate("XYZ"):
        wires.wire(f"HOLD_{axis}", np.where(held[..., k], HELD, 0.0))
    wires.loads(forces)
    nodes, directors = (np.stack([getattr(rod, what)(n) for rod in rods]) for what in ("nodes", "directors"))
    wires.place(nodes, 0.0, directors)
    return wires


def _wall(scenario: Any) -> Tube | None:
    """The case's cylinder, taken to go on beyond its ends; `_check_beside` sees to it that nothing is there."""
    if not scenario.obstacles:
        return None
    kinds = [obstacle.kind for obstacle in scenario.obstacles]
    if kinds != ["cylinder"]:
        raise NotImplementedError(f"obstacles other than one cylinder: {', '.join(kinds)}")
    cylinder = scenario.obstacles[0]
    centre, half = np.asarray(cylinder.center, dtype=np.float64), 0.5 * cylinder.length * cylinder.unit_axis
    axis = Line(tuple(centre - half), tuple(centre + half))
    return Tube(axis, -cylinder.radius, "open", "open", spacing=cylinder.length)


def _check_beside(scenario: Any, positions: np.ndarray) -> None:
    """Raise `NotImplementedError` if a node was ever past an end of the cylinder, where it goes on here."""
    for cylinder in scenario.obstacles:
        along = (positions - np.asarray(cylinder.center)) @ cylinder.unit_axis
        if np.abs(along).max() > 0.5 * cylinder.length:
            raise NotImplementedError("a rod that passes an end of a cylinder")


def _drive(wires: FreeWires, driven: list[_Clamp], time: float, step: float) -> None:
    """Send the driven clamps to where they are at the end of the step that begins at `time`."""
    if not driven:
        return
    speed = wires.velocities.copy()
    for clamp in driven:
        before, _ = clamp.motion.pose(time)
        after, turn = clamp.motion.pose(time + step)
        speed[clamp.lane, clamp.node, clamp.held] = ((after - before) / step)[clamp.held]
        lanes = np.array([clamp.lane])
        wires.vector(f"{clamp.name}_TX", (turn @ clamp.tangent)[None], lanes)
        wires.vector(f"{clamp.name}_MX", (turn @ clamp.director)[None], lanes)
    wires.push(speed)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
