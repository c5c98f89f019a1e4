"""The free wire alone in space: F1 rods at rest, F3 free flight, F4 static shape, F5 pendulum, F9 bend, F11 loop."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.special import j0

from ...simulation.free.wires import FreeWires, Pieces
from ..report import Row, Size, at_least, at_most
from ..rods import elastica, end_couple, random_turn
from .bench import clamped, come_to_rest, energy, growth, straight, threshold, tip_angle

__all__ = ["at_rest", "bend", "buckling", "flight", "loop", "pendulum", "static_shape"]

GRAVITY = 9.81


# --- F1 ---------------------------------------------------------------------------------------------------------------


def at_rest(size: Size) -> list[Row]:
    """F1: cantilever under a dead load, and a tip dipole in a uniform field, after damped motion has died down."""
    rows = []
    loads = np.array([1.0, 2.0, 5.0, 10.0])
    wires = clamped(straight(size.segments, drag=5.0), 4, step=0.05)
    forces = np.zeros((4, wires.nodes, 3))
    forces[:, -1, 2] = loads
    wires.loads(forces)
    come_to_rest(wires, 1e-6, 60)
    angles, deflections = tip_angle(wires), wires.positions[:, -1, 2]
    for load, angle, deflection in zip(loads, angles, deflections, strict=True):
        theirs = elastica(load)
        name = f"F1 free wire at rest, cantilever P = {load:g}"
        rows += [Row(f"{name}, tip angle", "°", theirs[0], "elliptic integrals", angle, 5e-3)]
        rows += [Row(f"{name}, deflection/L", "", theirs[1], "elliptic integrals", deflection, 5e-3)]

    fields = np.radians([30.0, 60.0, 90.0, 120.0, 150.0])
    across = np.stack([0 * fields, np.cos(fields), np.sin(fields)], axis=-1)
    pieces = straight(size.segments, drag=5.0).with_rigid_tip(1e-2, moment=1.0, mass=1e-3)
    wires = clamped(pieces, 5, step=0.05)
    wires.vector("FIELD_X", np.cos(fields)[:, None] * [1.0, 0, 0] + np.sin(fields)[:, None] * across)
    come_to_rest(wires, 1e-6, 60)
    end = wires.positions[:, -2]
    for k, angle in enumerate(tip_angle(wires)):
        phi, _, deflection = end_couple(1.0, math.degrees(fields[k]))
        name = f"F1 free wire at rest, tip dipole β = 1, field at {math.degrees(fields[k]):.0f}°"
        rows += [Row(f"{name}, tip angle", "°", phi, "arc of a circle", angle, 5e-3)]
        rows += [Row(f"{name}, deflection/L", "", deflection, "arc of a circle", float(end[k] @ across[k]), 5e-3)]
    return rows


def buckling(size: Size) -> list[Row]:
    """F1: a tip dipole in an antiparallel field, and a dead axial load, the rod free on both sides of the threshold."""
    factors, segments = np.linspace(0.97, 1.03, 7), size.segments
    rows = []
    for name, critical, source in (
        ("antiparallel field, β", 1.0, "φ = β sin φ"),
        ("axial load P", math.pi**2 / 4, "Euler"),
    ):
        pieces = straight(segments, drag=5.0)
        if critical == 1.0:
            pieces = pieces.with_rigid_tip(1e-3, moment=1.0)
        wires = clamped(pieces, len(factors), step=0.1)
        if critical == 1.0:
            wires.vector("FIELD_X", -factors[:, None] * [1.0, 0, 0])
        else:
            forces = np.zeros((len(factors), wires.nodes, 3))
            forces[:, -1, 0] = -critical * factors
            wires.loads(forces)
        disturb(wires, 1e-4)
        rows += threshold(f"F1 {name}", "", critical, source, factors, growth(wires, 8, 12), 1e-2)
    return rows


def disturb(wires: FreeWires, size: float) -> None:
    """Move the free nodes sideways, smoothly and in no special direction, by about `size` m."""
    s = np.linspace(0.0, 1.0, wires.nodes)
    x = wires.positions.copy()
    for k, (a, b) in enumerate(((0.8, 0.6), (-0.3, 0.9), (0.5, -0.7)), start=1):
        shape = size / k * (1.0 - np.cos(np.pi * k * s)) * (s > 0)
        x[..., 1] += a * shape
        x[..., 2] += b * shape
    wires.place(x)


# --- F4 ---------------------------------------------------------------------------------------------------------------


def static_shape(size: Size) -> list[Row]:
    """F4: where a rod comes to rest does not depend on drag, step or mesh."""
    tips = []
    for drag, step in ((2.0, 0.02), (20.0, 0.1), (5.0, 0.5)):
        wires = clamped(straight(40, drag=drag), step=step)
        wires.loads(np.outer(np.arange(41) == 40, [0.0, 3.0, 4.0]))
        come_to_rest(wires, 1e-10, 400)
        tips.append(wires.positions[0, -1])
    spread = max(float(np.linalg.norm(tip - tips[0])) for tip in tips)
    rows = [at_most("F4 tip of a rod at rest, spread over three drags and steps", "of L", 1e-6, "one minimum", spread)]

    deflection = elastica(5.0)[1]
    errors = [abs(_deflection(straight(n, axial=1e8)) / deflection - 1.0) for n in (8, 16, 32, 64, 128, 256)]
    source = "elliptic integrals"
    for n, error, most in zip((8, 16, 32, 256), errors[:3] + errors[-1:], (0.5, 0.1, 0.01, 0.001), strict=True):
        rows += [at_most(f"F4 cantilever P = 5, {n} segments, error of the deflection", "%", most, source, 100 * error)]
    order = 0.5 * math.log2(errors[3] / errors[5])
    rows += [at_least("F4 cantilever P = 5, order from 64 to 256 segments", "", 1.5, "2 in theory", order)]
    for n in (64, 128):
        rest = 5.0 ** np.linspace(0.0, 1.0, n)
        rest = rest[np.random.default_rng(n).permutation(n)] if n == 128 else rest
        rest /= rest.sum()
        name = "graded 5 : 1" if n == 64 else "of mixed lengths up to 5 : 1"
        ours = _deflection(Pieces.uniform(rest, 1.0, 1e8, 1.0, drag=5.0))
        rows += [Row(f"F4 cantilever P = 5, {n} segments {name}", "", deflection, source, ours, 5e-3)]
    return rows


def _deflection(pieces: Pieces) -> float:
    pieces.drag = 5.0 * np.asarray(pieces.mass)
    wires = clamped(pieces, step=0.1)
    wires.loads(np.outer(np.arange(wires.nodes) == wires.nodes - 1, [0.0, 0.0, 5.0]))
    come_to_rest(wires, 1e-8, 60)
    return float(wires.positions[0, -1, 2])


# --- F9 ---------------------------------------------------------------------------------------------------------------


def bend(size: Size) -> list[Row]:
    """F9: a cantilever of 45° of a circle, R 100, loaded across its plane by 600 (Bathe and Bolourchi 1979)."""
    radius, n, stiffness = 100.0, size.segments, 1e7 / 12
    step = math.pi / 4 / n
    chord = 2.0 * radius * math.sin(0.5 * step)
    pieces = Pieces.uniform(np.full(n, chord), stiffness, 1e7, 1.0, stiffness, drag=1.0)
    pieces.curl = np.array([2.0 * math.tan(0.5 * step) / chord, 0.0])
    wires = clamped(pieces, step=10.0, twist=True)
    # The clamp bends over half a segment: half a step from the base's direction to that of the first segment.
    pieces_curl = np.tile(pieces.curl, (n + 1, 1))
    pieces_curl[0, 0] = 2.0 * math.tan(0.25 * step) / (0.5 * chord)
    wires.wire("CURL_1", pieces_curl[:, 0])
    angle = step * np.arange(n + 1)
    start = radius * np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle], axis=-1)
    wires.place(start)
    wires.loads(np.outer(np.arange(n + 1) == n, [0.0, 0.0, 600.0]))
    come_to_rest(wires, 1e-6, 60)
    moved = wires.positions[0, -1] - start[-1]
    exact = bend_exactly(radius, stiffness, 600.0)
    printed = np.array([-23.5, -13.4, 53.4])
    off = 100 * float(np.linalg.norm(moved - printed) / np.linalg.norm(printed))
    return [
        Row(f"F9 45° bend, tip moves along {axis}", "", float(expected), "Kirchhoff rod by shooting", float(ours), 1e-3)
        for axis, expected, ours in zip("xyz", exact, moved, strict=True)
    ] + [at_most("F9 45° bend, tip off the published one, of its way", "%", 0.5, "Bathe and Bolourchi 1979", off)]


def bend_exactly(radius: float, stiffness: float, force: float) -> np.ndarray:
    """Way of the tip (3,) of an inextensible arc of 45° with E I = G J, loaded by `force` along z, by shooting.

    With equal stiffnesses the moment is E I times what the frame turns beyond its natural curvature, in space.
    """
    length = radius * math.pi / 4

    def along(moment: np.ndarray, load: np.ndarray) -> np.ndarray:
        def slope(_: float, y: np.ndarray) -> np.ndarray:
            r, frame = y[:3], y[3:].reshape(3, 3)  # rows: tangent, towards the centre, across
            m = moment - np.cross(r, load)
            spin = m / stiffness + frame[2] / radius
            return np.concatenate([frame[0], np.cross(spin, frame).ravel()])

        start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
        return solve_ivp(slope, (0.0, length), start, method="DOP853", rtol=1e-11, atol=1e-9).y[:, -1]

    moment = np.zeros(3)
    for share in np.linspace(0.1, 1.0, 10):
        load = np.array([0.0, 0.0, share * force])
        found = root(lambda m, f=load: (m - np.cross(along(m, f)[:3], f)) / stiffness, moment, tol=1e-10)
        moment = found.x
    if not found.success:
        raise RuntimeError(f"45° bend: shooting failed: {found.message}")
    natural = radius * np.array([math.sin(math.pi / 4), 1.0 - math.cos(math.pi / 4), 0.0])
    return along(moment, load)[:3] - natural


# --- F5, F3 -----------------------------------------------------------------------------------------------------------


def pendulum(size: Size) -> list[Row]:
    """F5: small swings of a rod hung from one end, L 1 m, radius 2 mm, 1000 kg/m³."""
    rows = []
    n, radius, density = size.segments // 2, 0.002, 1000.0
    area, inertia = math.pi * radius**2, math.pi * radius**4 / 4
    step = 1e-3 if size.segments >= 200 else 2e-3
    s = np.linspace(0.0, 1.0, n + 1)
    shape = j0(2.404825557695773 * np.sqrt(1.0 - s))
    for modulus, expected in ((1e6, 1.672846), (1e7, 1.667672), (1e8, 1.660661)):
        pieces = straight(n, 1.0, modulus * inertia, modulus * area, mass=density * area)
        wires = FreeWires(pieces, step=step, steps=5)
        wires.hold([0])
        wires.par("GX", GRAVITY)
        x = np.stack([s + density * GRAVITY / modulus * (s - s * s / 2), 1e-3 * shape, 0.0 * s], axis=-1)
        wires.place(x)
        swing = []
        for _ in range(round(5.5 / (5 * step))):
            wires.step()
            swing.append(float((wires.positions[0, :, 1] * shape) @ np.asarray(pieces.mass)))
        y = np.array(swing)
        i = np.flatnonzero(y[:-1] * y[1:] < 0)
        crossings = (i + y[i] / (y[i] - y[i + 1])) * 5 * step
        period = 2.0 * (crossings[-1] - crossings[0]) / (len(crossings) - 1)
        rows += [Row(f"F5 pendulum of a rod, E {modulus:.0e} Pa, period", "s", expected, "beam theory", period, 1e-2)]
    return rows


def flight(size: Size) -> list[Row]:
    """F3: ten bent rods of 0.5 m, 5 mm out of line, let go in space without drag: their energy never grows."""
    n = size.segments // 5
    pieces = straight(n, 0.5, 1e-4, 50.0, mass=0.01)
    wires = FreeWires(pieces, 10, step=1e-3, steps=1)
    s = np.linspace(0.0, 1.0, n + 1)
    bow = np.stack([0.5 * s, 5e-3 * np.sin(math.pi * s), 2e-3 * np.sin(2 * math.pi * s)], axis=-1)
    rng = np.random.default_rng(3)
    wires.place(np.stack([bow @ random_turn(rng).T for _ in range(10)]))
    wires.par("FORCE_TOLERANCE", 1e-10)
    before = start = energy(pieces, wires.positions, wires.velocities)
    grown, drift = 0.0, 0.0
    mass = np.asarray(pieces.mass)[:, None]
    for _ in range(round(200 * size.seconds)):
        wires.step()
        now = energy(pieces, wires.positions, wires.velocities)
        grown, before = max(grown, float(((now - before) / start).max())), now
        drift = max(drift, float(np.abs((mass * wires.velocities).sum(axis=1)).max()))
    share = "of the start"
    spread = float((before / start).max() - (before / start).min())
    return [
        at_most("F3 free flight, ten orientations, largest rise of energy in a step", share, 1e-9, "no drive", grown),
        at_most("F3 free flight, spread of the energy left over orientations", share, 1e-8, "isotropy", spread),
        at_most("F3 free flight, momentum gained", "kg·m/s", 1e-9, "no force", drift),
    ]  # fmt: skip


# --- F11 --------------------------------------------------------------------------------------------------------------


def hanging_loop(n: int, bending: float, mass: float, length: float, end: tuple[float, float]) -> FreeWires:
    """A heavy loop in the x–y plane, gravity along −y, both ends clamped along +x, the far one at `end` m, at rest."""
    middle = (np.arange(n) + 0.5) / n
    rest = 1.0 - 0.9 * (np.exp(-middle / 0.1) + np.exp((middle - 1.0) / 0.1))  # finer at the clamps
    rest *= length / rest.sum()
    wires = FreeWires(Pieces.uniform(rest, bending, 1e3, mass, drag=2.0 * mass), step=0.02)
    wires.par("BASE_CLAMPED", 1.0)
    wires.par("TIP_CLAMPED", 1.0)
    wires.hold([0, n])
    wires.par("GY", -GRAVITY)
    s = np.concatenate([[0.0], np.cumsum(rest)]) / length
    angle = -math.pi * (s[:-1] + s[1:])
    e = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1) * rest[:, None]
    x = np.concatenate([np.zeros((1, 3)), np.cumsum(e, axis=0)])
    wires.place(x + s[:, None] * (np.array([*end, 0.0]) - x[-1]))
    come_to_rest(wires, 1e-6, 400)
    wires.refresh()
    return wires


def loop(size: Size) -> list[Row]:
    """F11: a heavy loop with both ends in one clamp."""
    wires = hanging_loop(2 * size.segments, 8.08e-5, 0.0174, 1.5, (-0.123, 0.0))
    x, source = wires.positions[0], "planar heavy elastica"
    couple = abs(float(wires.lane("BASE_TQX", 3)[0, 2]))
    return [
        Row("F11 heavy loop, depth", "m", 0.6884, source, float(-x[:, 1].min()), 5e-3),
        Row("F11 heavy loop, widest to the right", "mm", 36.9, source, 1e3 * float(x[:, 0].max()), 5e-3),
        Row("F11 heavy loop, widest to the left", "mm", -159.9, source, 1e3 * float(x[:, 0].min()), 5e-3),
        Row("F11 heavy loop, moment at the base", "N·m", 4.49e-3, source, couple, 5e-3),
    ]
