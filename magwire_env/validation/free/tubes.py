"""The free wire under thrust in a straight tube: F15 buckling on the floor, F16 the helix, F17 lock-up."""

from __future__ import annotations

import math

import numpy as np

from ...simulation.free.tubes import Tube
from ...simulation.free.wires import FreeWires
from ..report import Row, Size, at_least, at_most
from .bench import growth, straight, threshold
from .contact import GRAVITY, Line

__all__ = ["floor", "helix_in_a_tube", "lock_up", "passed_thrust"]

RADIUS, MODULUS, DENSITY = 0.2e-3, 60e9, 6450.0
AREA = math.pi * RADIUS**2
BENDING = MODULUS * math.pi * RADIUS**4 / 4
GAP = 2e-3 - RADIUS  # of nitinol 0.4 mm in a tube of 4 mm


def nitinol(segments: int, length: float, lanes: int, gap: float, points: int = 2, drag: float = 0.0) -> FreeWires:
    """Wires of nitinol, 0.4 mm, along the axis of a straight tube with `gap` m to spare all round; their base may
    not move along the tube."""
    pieces = straight(segments, length, BENDING, 0.1 * MODULUS * AREA, mass=DENSITY * AREA, drag=drag, radius=RADIUS)
    wall = Tube(Line((-1, 0, 0), (1 + length, 0, 0)), gap + RADIUS, "open", "open", spacing=0.1)
    wires = FreeWires(pieces, lanes, step=0.01, points=points, wall=wall)
    wires.hold([0], "X")
    for name, value in (("WALL", 1e6), ("FORCE_TOLERANCE", 1e-7), ("MOVE_TOLERANCE", 1e-10), ("PATIENCE", 100)):
        wires.par(name, value)
    wires.par("MOST_MOVE", 0.01)
    return wires


def thrust(wires: FreeWires, force: np.ndarray) -> None:
    """Push the tips back with `force` (n,) N."""
    forces = np.zeros((wires.n, wires.nodes, 3))
    forces[:, -1, 0] = -np.asarray(force)
    wires.loads(forces)


# --- F15 --------------------------------------------------------------------------------------------------------------


def floor(_: Size) -> list[Row]:
    """F15: a wire on the floor of a tube, without friction: when it winds to and fro, and when it coils up.

    The sinusoidal load is a threshold of small motions. The helical one, 2√2·√(EI w/r), is where a uniform helix costs
    as much as a straight wire; between the load at which a helix unwinds and the one at which a wave coils up, both can
    stand, and the rows show both sides of that range.
    """
    weight = DENSITY * AREA * GRAVITY
    critical = 2 * math.sqrt(BENDING * weight / GAP)
    factors = np.linspace(0.94, 1.06, 7)
    wires = _on_the_floor(200, factors * critical, drag=10.0)
    for name, value in (("STEP", 0.2), ("FORCE_TOLERANCE", 1e-11), ("BASE_CLAMPED", 1.0), ("TIP_CLAMPED", 1.0)):
        wires.par(name, value)
    _wind(wires, 1e-3 * _waves(wires.nodes))
    rates = growth(wires, 20, 30)
    rows = threshold("F15 wire on the floor of a tube", "N", critical, "2√(EI w/r)", factors, rates, 5e-2)

    source, factors = "2√2·√(EI w/r)", np.array([0.8, 0.9, 1.1, 1.2])
    load = math.sqrt(2) * critical * factors
    wires = _on_the_floor(200, load, drag=0.1)
    _wind(wires, 0.05 * _waves(wires.nodes))
    for _ in range(80):
        wires.step()
    x = wires.positions[:, 10:-10]
    height = np.degrees(np.abs(np.arctan2(x[..., 1], -x[..., 2])).max(axis=1))
    rows += [at_most("F15 wave under 0.9 of the helical load: climbs to", "°", 90.0, source, float(height[1]))]
    rows += [at_most("F15 wave under 1.1 of the helical load: climbs to", "°", 90.0, source, float(height[2]))]
    rows += [at_least("F15 wave under 1.2 of the helical load: climbs to", "°", 90.0, source, float(height[3]))]
    wires = _on_the_floor(200, load, drag=0.1)
    _wind(wires, np.sqrt(load / (2 * BENDING))[:, None] * np.linspace(0.0, LENGTH, wires.nodes))
    for _ in range(80):
        wires.step()
    turns = _turns(wires)
    rows += [at_most("F15 helix under 0.8 of the helical load: turns left", "", 0.5, source, float(turns[0]))]
    rows += [at_least("F15 helix under 0.9 of the helical load: turns left", "", 4.0, source, float(turns[1]))]
    return rows


LENGTH = 4.0


def _on_the_floor(segments: int, load: np.ndarray, drag: float) -> FreeWires:
    """Heavy wires of `LENGTH` m under thrusts `load` (n,) N in a tube; their ends stay where they are across it."""
    wires = nitinol(segments, LENGTH, len(load), GAP, drag=drag)
    for name, value in (("GZ", -GRAVITY), ("STEP", 0.05), ("FORCE_TOLERANCE", 1e-9)):
        wires.par(name, value)
    thrust(wires, load)
    wires.hold([0, segments], "YZ")
    return wires


def _wind(wires: FreeWires, angle: np.ndarray) -> None:
    """Place wires on the wall at angles (nodes,) or (n, nodes) rad from the floor."""
    slope = np.gradient(np.broadcast_to(angle, (wires.n, wires.nodes)), LENGTH / (wires.nodes - 1), axis=1)
    e = np.sqrt(1.0 - (GAP * slope) ** 2)
    x = wires.positions
    x[:, 1:, 0] = np.cumsum(0.5 * (e[:, 1:] + e[:, :-1]), axis=1) * LENGTH / (wires.nodes - 1)
    x[..., 1], x[..., 2] = GAP * np.sin(angle), -GAP * np.cos(angle)
    wires.place(x)


def _waves(nodes: int) -> np.ndarray:
    """A disturbance of many wavelengths, zero at both ends, (nodes,)."""
    rng, s = np.random.default_rng(5), np.linspace(0.0, 1.0, nodes)
    waves = sum(rng.normal() * np.sin(math.pi * k * s) for k in range(5, 40))
    return waves * np.sin(math.pi * s) / np.abs(waves).max()


def _turns(wires: FreeWires) -> np.ndarray:
    """Turns about the axis between the quarter points, (n,)."""
    x = wires.positions
    phase = np.unwrap(np.arctan2(x[..., 2], x[..., 1]), axis=1) / (2 * math.pi)
    n = wires.nodes
    return np.abs(phase[:, 3 * n // 4] - phase[:, n // 4])


# --- F16, F17 ---------------------------------------------------------------------------------------------------------


def coiled(wires: FreeWires, force: np.ndarray, gap: float) -> None:
    """Lay wires in the helices of theory under `force` (n,) N, push on them, and let them come to rest."""
    q = np.sqrt(force / (2 * BENDING))[:, None]
    s = np.concatenate([[0.0], np.cumsum(wires.rest[0])])
    along = np.sqrt(1.0 - (gap * q) ** 2) * s
    wires.place(np.stack([along, gap * np.cos(q * s), gap * np.sin(q * s)], axis=-1))
    thrust(wires, force)
    wires.wire("DRAG", 5.0 * float(wires.rest[0, 0]))
    wires.par("STEP", 0.05)
    for _ in range(60):
        wires.step()
    wires.wire("DRAG", 0.0)
    wires.par("STEP", 0.01)


def helix_in_a_tube(size: Size) -> list[Row]:
    """F16: the helix of a weightless wire under thrust in a tube without friction."""
    gap, force, length, n = 0.3e-3, 0.5, 0.6, size.segments
    wires = nitinol(n, length, 1, gap)
    coiled(wires, np.array([force]), gap)
    wires.refresh()
    x = wires.positions[0]
    middle = slice(n // 4, 3 * n // 4 + 1)
    phase = np.unwrap(np.arctan2(x[middle, 2], x[middle, 1]))
    pitch = 2 * math.pi / abs(float(np.polyfit(x[middle, 0], phase, 1)[0]))
    load = float(np.linalg.norm(wires.contact[0, middle], axis=1).mean()) / (length / n)
    return [
        Row("F16 helix in a tube, pitch", "m", 2 * math.pi * math.sqrt(2 * BENDING / force), "2π√(2EI/F)", pitch, 1e-2),
        Row("F16 helix in a tube, wall load", "N/m", gap * force**2 / (4 * BENDING), "r F²/(4EI)", load, 1e-2),
    ]


def passed_thrust(wires: FreeWires, speed: float, periods: int) -> np.ndarray:
    """Push the base on at `speed` m/s; thrust at every node, N, (n, nodes), the mean of the last half of `periods`."""
    pushed = wires.velocities.copy()
    rows = []
    for k in range(periods):
        pushed[:] = wires.velocities
        pushed[:, 0, 0] = speed
        wires.push(pushed)
        wires.step()
        if k >= periods // 2:
            wires.refresh()
            rubbed = -wires.contact[: wires.n, :, 0]
            beyond = np.cumsum(rubbed[:, ::-1], axis=1)[:, ::-1]
            rows.append(beyond)
    return np.mean(rows, axis=0)


def lock_up(size: Size) -> list[Row]:
    """F17: friction in the helix lets no more thrust through than 4EI/(μ r L)."""
    mu, n = 0.3, size.segments
    gap, length, out = 0.3e-3, 1.0, 0.5
    wires = nitinol(n, length, 1, gap)
    coiled(wires, np.array([out]), gap)
    wires.par("FRICTION", mu)
    inside = out + passed_thrust(wires, 0.02, 40)[0]
    q = slice(n // 4, 3 * n // 4 + 1)
    s = np.linspace(0.0, length, n + 1)[q]
    slope = float(np.polyfit(s, 1.0 / inside[q], 1)[0])
    expected = mu * gap / (4 * BENDING)
    rows = [Row("F17 pushed helix, growth of 1/F per length", "1/(N·m)", expected, "μ r/(4EI)", slope, 3e-2)]

    length = 0.5
    bound = 4 * BENDING / (mu * GAP * length)
    shares = np.array([0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1])
    wires = nitinol(n, length, len(shares), GAP)
    coiled(wires, bound * shares, GAP)
    wires.par("FRICTION", mu)
    before, hardest = wires.positions[:, -1, 0].copy(), np.zeros(len(shares))
    for _ in range(20):
        passed_thrust(wires, 0.02, 1)
        hardest = np.maximum(hardest, wires.gradient[: len(shares), 0, 0])
    came = (wires.positions[:, -1, 0] - before) / (0.02 * 20 * 0.1)
    passes = came > 0.5
    name = "F17 wire of 0.5 m, base pushed by 40 mm"
    rows += [
        at_most(
            f"{name}: largest load that the tip pushes on",
            "N",
            bound,
            "4EI/(μ r L)",
            float((bound * shares)[passes].max()),
        )
    ]
    rows += [at_least(f"{name}: the same", "N", 0.5 * bound, "half of it", float((bound * shares)[passes].max()))]
    rows += [at_most(f"{name}: way of the tip under 1.1 of the limit", "mm", 1.0, "locked", float(40 * came[-1]))]
    rows += [at_least(f"{name}: push at the base meanwhile", "N", 2 * bound, "hard enough", float(hardest[-1]))]
    return rows
