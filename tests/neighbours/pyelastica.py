"""The scenes moved by PyElastica's Cosserat rods. Imported only where the package is installed."""

from __future__ import annotations

from typing import Any

import elastica as ea
import numpy as np

from .cylinder import Cylinder
from .tube import Found, Helix

__all__ = ["coiled", "drawn_round"]


class _World(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping, ea.Contact): ...


class _Drawn(ea.ConstraintBase):
    """The last node moves along −y at a speed that is reached within `ramp` s."""

    def __init__(self, speed: float, ramp: float, **options: Any) -> None:
        super().__init__(**options)
        self.speed, self.ramp = speed, ramp

    def constrain_values(self, system: Any, time: Any) -> None: ...

    def constrain_rates(self, system: Any, time: Any) -> None:
        system.velocity_collection[1, -1] = -self.speed * min(float(time) / self.ramp, 1.0)


class _Flat(ea.ConstraintBase):
    """All nodes stay in their plane."""

    def constrain_values(self, system: Any, time: Any) -> None: ...

    def constrain_rates(self, system: Any, time: Any) -> None:
        system.velocity_collection[2] = 0.0


class _HeldAlong(ea.ConstraintBase):
    """The first node does not move along x."""

    def constrain_values(self, system: Any, time: Any) -> None: ...

    def constrain_rates(self, system: Any, time: Any) -> None:
        system.velocity_collection[0, 0] = 0.0


class _InTube(ea.NoForces):
    """A tube about the x axis, which the package does not have: a spring and a damper along the radius at each node.

    gap : m; stiffness : N/m and damping : N·s/m, of a node; pressed : (n + 1,) N, where its force on each node is put
    """

    def __init__(self, gap: float, stiffness: float, damping: float, pressed: np.ndarray) -> None:
        super().__init__()
        self.gap, self.stiffness, self.damping, self.pressed = gap, stiffness, damping, pressed

    def apply_forces(self, system: Any, time: Any = 0.0) -> None:
        across, speed = system.position_collection[1:], system.velocity_collection[1:]
        off = np.sqrt(across[0] ** 2 + across[1] ** 2)
        outward = across / np.maximum(off, 1e-12)
        deep = off - self.gap
        force = self.stiffness * deep + self.damping * (outward[0] * speed[0] + outward[1] * speed[1])
        self.pressed[:] = np.where(deep > 0.0, np.maximum(force, 0.0), 0.0)
        system.external_forces[1:] -= self.pressed * outward


def rod_of(positions: np.ndarray, normal: np.ndarray, bending: float, axial: float, mass: float) -> Any:
    """A rod without natural curvature through positions (n + 1, 3) m; normal : (3,), across the first segment.

    bending : N·m²; axial : N; mass : kg/m. The radius is the one for which E I and E A are both right.
    """
    e = np.diff(positions, axis=0)
    radius = 2.0 * np.sqrt(bending / axial)
    area = np.pi * radius**2
    t = e / np.linalg.norm(e, axis=1, keepdims=True)
    first = np.tile(normal, (len(e), 1))
    for i in range(len(e)):
        d = first[max(i - 1, 0)] if i else normal
        first[i] = d - (d @ t[i]) * t[i]
        first[i] /= np.linalg.norm(first[i])
    directors = np.stack([first.T, np.cross(t, first).T, t.T])
    rod = ea.CosseratRod.straight_rod(
        len(e), positions[0], t[0], first[0], float(np.linalg.norm(e, axis=1).sum()), radius, mass / area,
        youngs_modulus=axial / area, shear_modulus=axial / area / 3, position=positions.T.copy(), directors=directors,
    )  # fmt: skip
    if np.abs(rod.rest_kappa).max() > 0.0:
        raise RuntimeError("the rod has a natural curvature")
    return rod


def drawn_round(scene: Cylinder, step: float, drag: float = 2.0) -> float:
    """T2/T1 over the last fifth of the travel. step : s; drag : 1/s, the rate of the damper.

    What the damper adds to the pull, drag × mass × speed of both arms, is taken off.
    """
    rod = rod_of(scene.start, np.array([0.0, 0.0, 1.0]), scene.bending, scene.axial, scene.mass)
    radius = float(rod.radius[0])
    if radius >= scene.radius:
        raise ValueError(f"the rod must be thinner than the cylinder, got {radius:g} and {scene.radius:g} m")
    x, _, z = np.eye(3)
    cylinder = ea.Cylinder(-z, z, x, 2.0, scene.radius - radius, 1e3)
    world = _World()
    world.append(rod)
    world.append(cylinder)
    world.constrain(cylinder).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    world.constrain(rod).using(_Drawn, speed=scene.speed, ramp=0.1)
    world.constrain(rod).using(_Flat)
    world.add_forcing_to(rod).using(ea.EndpointForces, scene.pull * scene.directions[0], np.zeros(3), ramp_up_time=1e-9)
    world.detect_contact_between(rod, cylinder).using(
        ea.RodCylinderContact, k=STIFFNESS, nu=DAMPING, velocity_damping_coefficient=1e2,
        friction_coefficient=scene.friction,
    )  # fmt: skip
    world.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=drag, time_step=step)
    world.dampen(rod).using(ea.LaplaceDissipationFilter, filter_order=5)
    world.finalize()
    stepper, at, pulls = ea.PositionVerlet(), np.float64(0.0), []
    steps = round(scene.travel / (scene.speed * step))
    for k in range(steps):
        at = stepper.step(world, at, np.float64(step))
        if k >= 0.8 * steps and k % 10 == 0:
            pulls.append(-(rod.director_collection[..., -1].T @ rod.internal_stress[:, -1])[1])
    if not np.isfinite(pulls).all():
        raise RuntimeError("the rod has blown up")
    s = np.concatenate([[0.0], np.cumsum(scene.rest)])
    touching = s[int(np.argmin(np.linalg.norm(rod.position_collection[:2], axis=0)))]
    slowed = drag * scene.mass * scene.speed
    return float((np.mean(pulls) - slowed * (s[-1] - touching)) / (scene.pull + slowed * touching))


def coiled(scene: Helix, step: float) -> Found:
    """The settled helix. step : s."""
    x, _, z = np.eye(3)
    rod = rod_of(scene.start, z, scene.bending, scene.axial, scene.mass)
    world, each = _World(), float(scene.rest[0])
    world.append(rod)
    world.constrain(rod).using(_HeldAlong)
    world.add_forcing_to(rod).using(ea.EndpointForces, np.zeros(3), -scene.thrust * x, ramp_up_time=1e-9)
    pressed_now = np.zeros(scene.segments + 1)
    world.add_forcing_to(rod).using(_InTube, scene.gap, 1e6 * each, 200.0 * scene.mass * each, pressed_now)
    world.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=scene.rate, time_step=step)
    world.dampen(rod).using(ea.LaplaceDissipationFilter, filter_order=5)
    world.finalize()
    stepper, at, places, pressed = ea.PositionVerlet(), np.float64(0.0), [], []
    steps = round(scene.seconds / step)
    for k in range(steps):
        at = stepper.step(world, at, np.float64(step))
        if k >= 0.8 * steps and k % 10 == 0:
            places.append(rod.position_collection.T.copy())
            pressed.append(pressed_now.copy())
    if not np.isfinite(places).all():
        raise RuntimeError("the rod has blown up")
    return scene.measured(np.mean(places, axis=0), np.mean(pressed, axis=0))


STIFFNESS, DAMPING = 1e4, 1.0
"""N/m and N·s/m of its contacts: 0.1 mm deep under the whole load."""
