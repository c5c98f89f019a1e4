"""The free wire on surfaces: F12, F13 capstans, F14 point to line contact, F20 spin, F21 sliding, F22 contact load."""

from __future__ import annotations

import math

import numpy as np

from ...simulation.free.tubes import Tube
from ...simulation.free.wires import FreeWires, Pieces
from ..report import Row, Size, at_most
from .bench import come_to_rest, straight

__all__ = [
    "Bend",
    "Line",
    "capstan_of_a_rod",
    "capstan_of_a_string",
    "contact_load",
    "point_to_line",
    "pulled_over_a_cylinder",
    "sliding",
    "turning_while_pushing",
]

GRAVITY = 9.81


class Line:
    """A straight centreline from `start` to `end`, m."""

    def __init__(self, start: tuple[float, float, float], end: tuple[float, float, float]) -> None:
        self.start, self.way = np.asarray(start, dtype=np.float64), np.subtract(end, start)
        self.length = float(np.linalg.norm(self.way))

    def position(self, s: np.ndarray) -> np.ndarray:
        return self.start + np.asarray(s)[..., None] / self.length * self.way


def graded(fine: float, middle: float, arm: float, coarse: float) -> np.ndarray:
    """Segments of `fine` m over `middle` m, growing by 15 % each up to `coarse` m over an arm on both sides."""
    side = [fine]
    while sum(side) < arm:
        side.append(min(1.15 * side[-1], coarse))
    return np.array(side[::-1] + [fine] * round(middle / fine) + side)


def draped(
    wraps: np.ndarray, rest: np.ndarray, bending: float, radius: float, points: int, lean: np.ndarray
) -> tuple[FreeWires, np.ndarray]:
    """Wires laid over cylinders along z, pulled by 1 N at both ends; also the directions of both pulls, (n, 2, 3).

    wraps : (n,) rad from arm to arm; rest : (N,) m; bending : N·m²; radius : of the cylinder, m
    lean : (n,) rad by which all is turned about z from where the arms hang to both sides alike
    """
    n, segments = len(wraps), len(rest)
    wall = Tube(Line((0, 0, -5), (0, 0, 5)), -radius, "open", "open", spacing=1.0)
    pieces = Pieces.uniform(rest, bending, 1e4, 1e-7, radius=0.0)
    wires = FreeWires(pieces, n, step=1e2, steps=1, points=points, wall=wall)

    def along(angle: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)

    s = np.concatenate([[0.0], np.cumsum(rest)]) - 0.5 * rest.sum()
    turned = np.clip(0.5 * (s[1:] + s[:-1]) / max(radius, 0.3), -0.5 * wraps[:, None], 0.5 * wraps[:, None])
    e = along(lean[:, None] - turned) * rest[:, None]
    x = np.concatenate([np.zeros((n, 1, 3)), np.cumsum(e, axis=1)], axis=1)
    wires.place(x + (radius * along(lean + 0.5 * math.pi) - x[:, segments // 2])[:, None])
    for name, value in (("WALL", 1e5), ("MEMORY", 0.0), ("PATIENCE", 200), ("FORCE_TOLERANCE", 1e-6)):
        wires.par(name, value)
    wires.par("MOVE_TOLERANCE", 1e-9)
    wires.hold(list(range(segments + 1)), "Z")
    pulls = np.stack([-along(lean + 0.5 * wraps), along(lean - 0.5 * wraps)], axis=1)
    forces = np.zeros((n, segments + 1, 3))
    forces[:, [0, -1]] = pulls
    wires.loads(forces)
    return wires, pulls


def pulled_over_a_cylinder(
    wraps: np.ndarray,
    frictions: np.ndarray,
    rest: np.ndarray,
    bending: float,
    radius: float,
    points: int,
    travel: float,
) -> np.ndarray:
    """Pull T2, N, (periods, n), on wires drawn over cylinders against 1 N, over the last fifth of `travel` m.

    See `draped`; frictions : (n,) Coulomb's coefficients. The far arm hangs along −y and is drawn that way.
    """
    segments, speed, step = len(rest), 0.05, 0.03
    wires, pulls = draped(wraps, rest, bending, radius, points, 0.5 * (wraps - math.pi))
    wires.hold([segments], "Y")
    for _ in range(3):
        wires.step()
    forces = np.zeros((len(wraps), segments + 1, 3))
    forces[:, 0] = pulls[:, 0]
    wires.loads(forces)
    wires.par("FRICTION", frictions)
    wires.par("STEP", step)
    drawn = np.zeros((len(wraps), segments + 1, 3))
    drawn[:, -1, 1] = -speed
    out = []
    periods = round(travel / (speed * step))
    for k in range(periods):
        wires.push(drawn)
        wires.step()
        if wires.lane("FAILED").any():
            raise RuntimeError(f"capstan: {wires.lane('FAILED').sum():.0f} steps did not converge")
        if k > 0.8 * periods:
            wires.refresh()
            out.append(-wires.gradient[: len(wraps), -1, 1])
    return np.array(out)


def capstan_of_a_rod(size: Size) -> list[Row]:
    """F13: a stiff rod drawn over a thin cylinder, which it touches at one point."""
    cases = [
        (180, 0.1, 1.2210), (180, 0.2, 1.4879), (180, 0.3, 1.8064), (180, 0.5, 2.6180),
        (90, 0.1, 1.15177), (90, 0.2, 1.32566), (90, 0.3, 1.52370), (90, 0.5, 2.00000),
    ]  # fmt: skip
    fine = 4.0 / size.segments
    wraps, frictions, expected = (np.array(column) for column in zip(*cases, strict=True))
    rest = graded(fine, 2.4, 7.0, 0.3)
    pulls = pulled_over_a_cylinder(np.radians(wraps), frictions, rest, 1.0, 0.3, 4, 1.0).mean(axis=0)
    return [
        Row(
            f"F13 stiff rod over a cylinder, {wrap:g}°, μ {mu:g}: T2/T1",
            "",
            ratio,
            "M² = 4 EI T sin²(θ/2)",
            float(ours),
            1e-2,
        )
        for wrap, mu, ratio, ours in zip(wraps, frictions, expected, pulls, strict=True)
    ]


def capstan_of_a_string(size: Size) -> list[Row]:
    """F12: the same for a string, which lies on the cylinder all along."""
    cases = [(180, 0.1), (180, 0.3), (90, 0.1), (90, 0.3)]
    wraps, frictions = np.radians([c[0] for c in cases]), np.array([c[1] for c in cases])
    rest = np.full(size.segments, 6.0 / size.segments)
    pulls = pulled_over_a_cylinder(wraps, frictions, rest, 1e-4, 1.0, 2, 0.4).mean(axis=0)
    return [
        Row(
            f"F12 string over a cylinder, {wrap:g}°, μ {mu:g}: T2/T1",
            "",
            math.exp(mu * math.radians(wrap)),
            "e^μφ",
            float(ours),
            1e-2,
        )
        for (wrap, mu), ours in zip(cases, pulls, strict=True)
    ]


# --- F14 --------------------------------------------------------------------------------------------------------------


def point_to_line(_: Size) -> list[Row]:
    """F14: a rod bent over a cylinder without friction touches it at a point up to T*, then along a line."""
    rows, radius, source = [], 0.3, "EI/(4ρ² sin²(φ/4))"
    factors = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.5, 1.6, 1.8, 2.0])
    below, above, n = slice(0, 5), slice(5, 9), 9
    for wrap in (180, 90):
        phi = math.radians(wrap)
        critical = 1.0 / (4 * radius**2 * math.sin(0.25 * phi) ** 2)
        rest = graded(5e-3, 0.6, 5.0, 0.3)
        wires, pulls = draped(np.full(n, phi), rest, 1.0, radius, 4, np.zeros(n))
        middle = len(rest) // 2
        wires.hold([middle], "X")
        forces = np.zeros((n, wires.nodes, 3))
        forces[:, [0, -1]] = pulls * (critical * factors)[:, None, None]
        wires.loads(forces)
        for stiffness in (1e5, 1e6, 1e7, 1e8):
            wires.par("WALL", stiffness)
            for _k in range(3):
                wires.step()
        if wires.lane("FAILED").any():
            raise RuntimeError("point to line: a rod has not come to rest")
        wires.refresh()
        force = wires.contact[:n, :, 1].sum(axis=1)
        load = float((force[below] / (critical * factors[below])).mean())
        bend = curvature(wires)
        beside = bend[below, middle + 1 : middle + 4]  # from the node next but one on; extrapolated to the contact
        under = beside @ [6.0, -8.0, 3.0]
        slope = float((under**2 / factors[below]).mean())
        found = critical * float((bend[above, middle - 1] ** 2).mean()) / slope
        name = f"F14 rod over a cylinder, {wrap}°"
        rows += [Row(f"{name}: tension at which the point becomes a line", "N", critical, source, found, 5e-3)]
        rows += [Row(f"{name}: contact force/T below it", "", 2 * math.sin(0.5 * phi), "2 sin(φ/2)", load, 5e-3)]
    return rows


def curvature(wires: FreeWires) -> np.ndarray:
    """Curvature at the inner nodes, 1/m, (n, nodes − 2)."""
    e = np.diff(wires.positions, axis=1)
    length = np.linalg.norm(e, axis=-1)
    t = e / length[..., None]
    c = np.minimum((t[:, 1:] * t[:, :-1]).sum(axis=-1), 1.0)
    return 4.0 * np.sqrt((1.0 - c) / (1.0 + c)) / (length[:, 1:] + length[:, :-1])


# --- F20, F21 ---------------------------------------------------------------------------------------------------------


def lying(pieces: Pieces, lanes: int, tube: float, twist: bool, step: float) -> FreeWires:
    """Wires that lie along x on the floor of a straight tube of radius `tube` m, pressed in by their own weight."""
    wall = Tube(Line((-100, 0, 0), (100, 0, 0)), tube, "open", "open", spacing=10.0)
    wires = FreeWires(pieces, lanes, step=step, points=1, twist=twist, wall=wall)
    stiffness = 1e5
    radius, length = float(np.max(pieces.radius)), float(np.sum(pieces.rest))
    sunk = float(np.sum(pieces.mass)) * GRAVITY / (stiffness * length)
    x = wires.positions
    x[..., 2] = -tube + radius - sunk
    wires.place(x)
    for name, value in (("WALL", stiffness), ("GZ", -GRAVITY), ("FORCE_TOLERANCE", 1e-7), ("STICK", 1e-4)):
        wires.par(name, value)
    return wires


def sliding(_: Size) -> list[Row]:
    """F21: a rod of 1 kg pushed from rest on a plane for 1 s."""
    rows = []
    cases = [(0.2, 1.0), (0.2, 1.9), (0.2, 2.5), (0.2, 5.0), (0.5, 4.0), (0.5, 6.0), (0.5, 20.0)]
    pieces = straight(10, 1.0, 1.0, 1e5)
    wires = lying(pieces, len(cases), 1.0, False, 0.01)
    friction, push = (np.array(column) for column in zip(*cases, strict=True))
    wires.par("FRICTION", friction)
    wires.wire("FORCE_X", push[:, None] * np.asarray(pieces.mass))
    for _k in range(10):
        wires.step()
    speed = wires.velocities[:, :, 0]
    kinetic = 0.5 * (speed**2 * np.asarray(pieces.mass)).sum(axis=1)
    for mu, force, ours in zip(friction, push, kinetic, strict=True):
        expected = 0.5 * max(force - mu * GRAVITY, 0.0) ** 2
        name = f"F21 1 kg on a plane, μ {mu:g}, {force:g} N for 1 s, energy"
        if expected > 0:
            rows += [Row(name, "J", expected, "½ (F − μ m g)² t²/m", float(ours), 5e-3)]
        else:
            rows += [at_most(name, "J", 1e-6, "sticks", float(ours))]
    return rows


def turned_and_pushed(ratios: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axial friction and normal force, N, each (n,), of wires pushed along a tube and turned at Rω = `ratios` v, μ 0.3.

    Their side friction lets them climb the tube until their weight holds them back.
    """
    n, speed, radius = len(ratios), 0.02, 1e-3
    pieces = straight(20, 1.0, 1.0, 1e5, twisting=10.0, radius=radius, mass=0.1)
    wires = lying(pieces, n, 5e-3, True, 2e-3)
    wires.par("FRICTION", RUBBING)
    wires.par("BASE_CLAMPED", 1.0)
    wires.par("BASE_Z", wires.positions[:, 0, 2])
    wires.hold([0], "X")
    wires.par("TWIST_SPEED", np.asarray(ratios) * speed / radius)
    wires.lane_field("TWIST_WANT", 1e9)
    drawn = np.zeros((n, wires.nodes, 3))
    axial, normal = [], []
    for k in range(100):
        drawn[:] = wires.velocities
        drawn[:, 0, 0] = speed
        wires.push(drawn)
        wires.step()
        if k >= 50:
            wires.refresh()
            axial.append(wires.gradient[:n, 0, 0].copy())
            normal.append(wires.lane("SUM_WALL") / (10 * 64))
    return np.mean(axial, axis=0), np.mean(normal, axis=0)


RUBBING = 0.3
"""Friction coefficient of `turned_and_pushed`."""


def turning_while_pushing(_: Size) -> list[Row]:
    """F20: a wire turned about itself while it is pushed along a tube: its axial friction is ζ μ n."""
    ratios = np.array([0.0, 1.0, 2.0, math.sqrt(24)])
    axial, normal = turned_and_pushed(ratios)
    return [
        Row(
            f"F20 turned while pushed, Rω/v = {ratio:.4g}: axial friction/μ n",
            "",
            1 / math.hypot(1, ratio),
            "ζ",
            float(zeta),
            5e-3,
        )
        for ratio, zeta in zip(ratios, axial / (RUBBING * normal), strict=True)
    ]


# --- F22 --------------------------------------------------------------------------------------------------------------


class Bend:
    """A straight lead along +x, then an arc of `radius` m towards +y."""

    def __init__(self, radius: float, angle: float, lead: float) -> None:
        self.radius, self.lead, self.length = radius, lead, lead + radius * angle

    def position(self, s: np.ndarray) -> np.ndarray:
        s = np.asarray(s)
        a = np.clip(s - self.lead, 0.0, None) / self.radius
        x = np.minimum(s, self.lead) + self.radius * np.sin(a)
        return np.stack([x, self.radius * (1.0 - np.cos(a)), 0.0 * s], axis=-1)


def bent_in_a_tube(segments: int, points: int) -> np.ndarray:
    """Wall forces on the nodes (nodes, 3) N of a straight nitinol wire of 0.1 m that lies in a tube bent by 90°."""
    bend, radius = Bend(0.04, math.radians(90), 0.03), 0.18e-3
    bending = 60e9 * math.pi * radius**4 / 4
    pieces = Pieces.uniform(np.full(segments, 0.1 / segments), bending, 1e3, 1e-3, drag=1.0, radius=radius)
    wires = FreeWires(pieces, step=0.02, points=points, wall=Tube(bend, 2e-3, "open", "open", spacing=1e-3))
    wires.par("WALL", 1e5)
    wires.par("FORCE_TOLERANCE", 1e-8)
    wires.par("BASE_CLAMPED", 1.0)
    wires.hold([0])
    wires.place(bend.position(np.linspace(0.0, 0.1, segments + 1)))
    come_to_rest(wires, 1e-6, 100)
    wires.refresh()
    return wires.contact[0]


def contact_load(size: Size) -> list[Row]:
    """F22: the wall's load does not depend on how many contact points or segments carry it."""
    most = 160 if size.segments >= 200 else 80

    def load(segments: int, points: int) -> float:
        return float(np.linalg.norm(bent_in_a_tube(segments, points), axis=1).sum())

    finest, coarse = load(most, 4), load(20, 16)
    source = "converged"
    rows = [
        Row(
            f"F22 wire in a bend, 20 segments, {k} contact points each: wall load",
            "N",
            coarse,
            source,
            load(20, k),
            1e-2,
        )
        for k in (4, 8)
    ]
    rows += [
        Row(
            f"F22 wire in a bend, {n} segments, 4 contact points each: wall load", "N", finest, source, load(n, 4), 2e-2
        )
        for n in (20, 40)
    ]
    return rows
