"""The scenes moved by the free wire."""

from __future__ import annotations

import numpy as np

from magwire_env.simulation.free.tubes import Tube
from magwire_env.simulation.free.wires import FreeWires, Pieces
from magwire_env.validation.free.contact import Line

from .cylinder import Cylinder
from .tube import Found, Helix

__all__ = ["coiled", "drawn_round"]


def drawn_round(scene: Cylinder, step: float, points: int = 4) -> float:
    """T2/T1 over the last fifth of the travel. step : s; points : contact points a segment."""
    n = len(scene.rest)
    wall = Tube(Line((0, 0, -5), (0, 0, 5)), -scene.radius, "open", "open", spacing=1.0)
    pieces = Pieces.uniform(scene.rest, scene.bending, scene.axial, scene.mass, radius=0.0)
    wires = FreeWires(pieces, step=step, steps=1, points=points, wall=wall, threads=1)
    for name, value in (("WALL", 1e5), ("PATIENCE", 200), ("FORCE_TOLERANCE", 1e-6), ("MOVE_TOLERANCE", 1e-9)):
        wires.par(name, value)
    wires.par("FRICTION", scene.friction)
    wires.hold(list(range(n + 1)), "Z")
    wires.hold([n], "Y")
    wires.place(scene.start[None])
    forces, drawn = np.zeros((2, 1, n + 1, 3))
    forces[0, 0] = scene.pull * scene.directions[0]
    wires.loads(forces)
    pulls, steps = [], round(scene.travel / (scene.speed * step))
    for k in range(steps):
        drawn[0] = wires.velocities[0]
        drawn[0, n, 1] = -scene.speed
        wires.push(drawn)
        wires.step()
        if wires.lane("FAILED").any():
            raise RuntimeError(f"step {k} of {steps} did not converge")
        if k >= 0.8 * steps:
            wires.refresh()
            pulls.append(-wires.gradient[0, n, 1])
    return float(np.mean(pulls)) / scene.pull


def coiled(scene: Helix, step: float, points: int = 2) -> Found:
    """The settled helix. step : s; points : contact points a segment."""
    n = scene.segments
    pieces = Pieces.uniform(
        scene.rest, scene.bending, scene.axial, scene.mass, drag=scene.rate * scene.mass, radius=scene.radius
    )
    tube = scene.gap + scene.radius
    wall = Tube(Line((-1, 0, 0), (1 + scene.length, 0, 0)), tube, "open", "open", spacing=0.1)
    wires = FreeWires(pieces, step=step, steps=1, points=points, wall=wall, threads=1)
    for name, value in (("WALL", 1e6), ("FORCE_TOLERANCE", 1e-7), ("MOVE_TOLERANCE", 1e-10), ("PATIENCE", 100)):
        wires.par(name, value)
    wires.hold([0], "X")
    wires.place(scene.start[None])
    forces = np.zeros((1, n + 1, 3))
    forces[0, -1, 0] = -scene.thrust
    wires.loads(forces)
    steps, places, pressed = round(scene.seconds / step), [], []
    for k in range(steps):
        wires.step()
        if wires.lane("FAILED").any():
            raise RuntimeError(f"step {k} of {steps} did not converge")
        if k >= 0.8 * steps:
            wires.refresh()
            places.append(wires.positions[0].copy())
            pressed.append(np.linalg.norm(wires.contact[0], axis=1))
    return scene.measured(np.mean(places, axis=0), np.mean(pressed, axis=0))
