"""Checks of magnets and dipoles: literature values, conservation laws, and magpylib's exact block."""

from __future__ import annotations

import math

import numpy as np

from ..physics import BlockMagnet, CylinderMagnet, DipoleCloud, field, field_gradient, force, torque
from ..scenario import Scenario
from ..scenario.rig import cheapest_rule
from ..simulation import Simulator, best_command
from .report import Row, Size, at_most

__all__ = ["along_the_tract", "coaxial", "conservation", "exact_block", "printed_constants"]

BLOCK = BlockMagnet(size=(50.8e-3,) * 3, remanence=1.3)
TIP = CylinderMagnet(diameter=2e-3, height=3e-3, remanence=1.37, mass=7.2e-5)
_FINE = ("gauss", 16)


def directions(n: int) -> np.ndarray:
    """Unit vectors (n, 3) spread evenly over the sphere."""
    k = np.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, math.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def printed_constants(_: Size) -> list[Row]:
    """The paper's "spring constants" are E·A in newtons."""
    wire = Scenario.paper().wire
    rows = [
        ("E·A, rotational springs", 10.799, wire.bending_modulus * wire.area),
        ("E·A, linear springs", 11.781, wire.axial_rigidity),
    ]
    moments = [("moment of the block", 135.620, BLOCK.moment), ("moment of the tip", 0.010275, TIP.moment)]
    return [Row(name, "N", expected, "paper, Section IV", ours, 1e-4) for name, expected, ours in rows] + [
        Row(name, "A·m²", expected, "Br·V/μ0", ours, 1e-4) for name, expected, ours in moments
    ]


def coaxial(_: Size) -> list[Row]:
    """Force and field on the block's axis; the literature's tip is finite, ours a point."""
    cloud = BLOCK.dipoles(*_FINE)
    rows = []
    for distance, expected in ((0.05, 90.466), (0.07, 30.868), (0.15, 1.6412)):
        pull = -1e3 * force(cloud, np.array([[0, 0, distance]]), np.array([[0, 0, TIP.moment]]))[0, 2]
        rows.append(Row(f"coaxial force at {distance * 100:g} cm", "mN", expected, "magpylib, finite tip", pull, 1e-3))
    flux = 1e3 * field(cloud, np.array([[0, 0, 0.07]]))[0, 2]
    return [*rows, Row("field on the axis at 7 cm", "mT", 74.97, "exact cuboid", flux, 1e-4)]


def exact_block(size: Size) -> list[Row]:
    """Clouds against magpylib: worst of many directions and of three tip orientations at each.

    Errors are shares of the greatest force, torque or field over the tip's orientations at the same point: a force
    may vanish for one orientation, and its relative error then means nothing.
    """
    worst = {
        d: block_errors(cheapest_rule(BLOCK, d), d, size.directions) for d in (0.06, 0.065, 0.07, 0.08, 0.1, 0.15, 0.2)
    }
    rows = []
    for d, errors in worst.items():
        points = len(BLOCK.dipoles(*cheapest_rule(BLOCK, d)))
        for name, error in errors.items():
            rows.append(
                at_most(
                    f"{name} at {d * 100:g} cm, the scenario's rule ({points} dipoles), worst",
                    "%",
                    0.5,
                    "magpylib",
                    100 * error,
                )
            )
    fine = block_errors(("gauss", 5), 0.07, size.directions)
    grid = block_errors(("grid", (10, 10, 20)), 0.07, size.directions // 4)
    for name, error in fine.items():
        rows.append(at_most(f"{name} at 7 cm, 125 Gauss points, worst", "%", 0.05, "magpylib", 100 * error))
    for name, error in grid.items():
        rows.append(at_most(f"{name} at 7 cm, the paper's 2000 dipoles, worst", "%", 0.5, "magpylib", 100 * error))
    return rows


def block_errors(rule: tuple, distance: float, count: int) -> dict[str, float]:
    """Largest error of force, torque and field of the block's cloud, `distance` m from its centre."""
    points = np.repeat(distance * directions(count), 3, axis=0)
    moments = TIP.moment * np.tile(np.eye(3), (count, 1))
    exact_force, exact_torque = magpylib_wrench(points, moments)
    cloud = BLOCK.dipoles(*rule)
    pairs = {
        "force": (force(cloud, points, moments), exact_force),
        "torque": (torque(cloud, points, moments), exact_torque),
        "field": (field(cloud, points), magpylib_block().getB(points)),
    }
    errors = {}
    for name, (ours, exact) in pairs.items():
        # Largest over all orientations at a point: the spectral norm of what maps the moment to force or torque.
        greatest = np.linalg.norm(exact.reshape(count, 3, 3), ord=2, axis=(1, 2)) / (
            math.sqrt(3) if name == "field" else 1
        )
        error = np.linalg.norm(ours - exact, axis=1).reshape(count, 3).max(axis=1)
        errors[name] = float((error / greatest).max())
    return errors


def magpylib_block():
    """The block as magpylib's exact cuboid, moment along z, at the origin."""
    import magpylib

    return magpylib.magnet.Cuboid(dimension=BLOCK.size, polarization=(0, 0, BLOCK.remanence))


def magpylib_wrench(points: np.ndarray, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque, (n, 3) N and N·m, of the exact block on dipoles, by magpylib's own force function."""
    import magpylib

    tips = [magpylib.misc.Dipole(moment=m, position=p) for p, m in zip(points, moments, strict=True)]
    pull, turn = magpylib.getFT(magpylib_block(), tips)
    return np.reshape(pull, (-1, 3)), np.reshape(turn, (-1, 3))


def along_the_tract(size: Size) -> list[Row]:
    """What the simulator itself feels at the tip, along the paper's tract, against the exact block."""
    scenario = Scenario.paper()
    s = np.linspace(0, scenario.tract.length, size.places // 4)
    angles, _ = best_command(scenario, s)
    sim = Simulator(scenario, num_envs=len(s))
    sim.reset(tip_arclength=s, magnet=angles)
    turn = np.array([[[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]] for a in angles[:, 0]])
    place = np.einsum("nji,nj->ni", turn, scenario.tract.position(s) - scenario.rig.magnets[0].position)
    moment = np.einsum("nji,nj->ni", turn, TIP.moment * scenario.tract.tangent(s))
    exact = np.einsum("nij,nj->ni", turn, magpylib_wrench(place, moment)[0])
    error = np.linalg.norm(sim.tip_force - exact, axis=1) / np.linalg.norm(exact, axis=1)
    projected = np.abs(sim.drive_force - np.einsum("ni,ni->n", exact, scenario.tract.tangent(s)))
    where = "along the paper's tract, best angles, worst"
    return [
        at_most(f"simulator's tip force {where}", "%", 0.5, "magpylib", float(100 * error.max())),
        at_most(
            f"simulator's F·t {where}",
            "%",
            0.5,
            "magpylib",
            float(100 * (projected / sim.drive_force).max()),
        ),
    ]


def conservation(size: Size) -> list[Row]:
    """F = ∇(μ·B) by fourth-order differences; action = reaction; no torque left over; ∇·B = 0; all to rounding."""
    rng = np.random.default_rng(7)
    gradient, reaction, couple, trace = 0.0, 0.0, 0.0, 0.0
    for _ in range(size.samples):
        one, two = _cloud(rng, 6, (0, 0, 0)), _cloud(rng, 4, (0.04, -0.02, 0.03))
        columns = []
        for e in 5e-5 * np.eye(3):
            near = field(one, two.positions + e) - field(one, two.positions - e)
            far = field(one, two.positions + 2 * e) - field(one, two.positions - 2 * e)
            columns.append((8 * near - far) / 6e-4)
        by_difference = np.einsum("ni,nij->nj", two.moments, np.stack(columns, axis=2))
        on_two, on_one = force(one, two.positions, two.moments), force(two, one.positions, one.moments)
        scale = np.abs(on_two).sum() + np.abs(on_one).sum()
        total = np.zeros(3)
        for source, body, forces in ((one, two, on_two), (two, one, on_one)):
            total += torque(source, body.positions, body.moments).sum(axis=0) + np.cross(body.positions, forces).sum(
                axis=0
            )
        gradient = max(gradient, np.abs(by_difference - on_two).max() / np.abs(on_two).max())
        reaction = max(reaction, np.abs(on_two.sum(axis=0) + on_one.sum(axis=0)).max() / scale)
        couple = max(couple, np.abs(total).max() / (0.05 * scale))
        jacobian = field_gradient(one, two.positions)
        trace = max(trace, np.abs(np.trace(jacobian, axis1=1, axis2=2)).max() / np.abs(jacobian).max())
    return [
        at_most("force less the gradient of μ·B, share of it", "", 1e-9, "finite differences", float(gradient)),
        at_most("action plus reaction, share of them", "", 1e-13, "Newton's third law", float(reaction)),
        at_most("total torque r × F + μ × B of a pair, share", "", 1e-13, "conservation", float(couple)),
        at_most("divergence of B, share of its gradient", "", 1e-13, "∇·B = 0", float(trace)),
    ]


def _cloud(rng: np.random.Generator, n: int, centre: tuple[float, float, float]) -> DipoleCloud:
    return DipoleCloud(np.asarray(centre) + rng.uniform(-5e-3, 5e-3, (n, 3)), rng.normal(size=(n, 3)))
