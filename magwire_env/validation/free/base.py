"""The base of the free wire: F18 the sleeve, F19 whip."""

from __future__ import annotations

import math

import numpy as np

from ...simulation.free.wires import FreeWires, Pieces
from ..report import Row, Size, at_least, at_most
from ..rods import elastica
from .bench import come_to_rest, straight

__all__ = ["sleeve", "whip"]


# --- F18 --------------------------------------------------------------------------------------------------------------

BENDING = 5e-5


def sleeve(size: Size) -> list[Row]:
    """F18: a bent rod pushes itself out of its sleeve with M²/2EI: of a cantilever, F sin φ, φ its tip's angle."""
    n, loads = size.segments // 2, np.array([0.005, 0.01, 0.02, 0.03])
    rows, source = [], "M²/2EI, elliptic integrals"
    for twist in (False, True):
        for length in (0.1, 0.1037):
            wires = _fed(n, np.full(4, length), loads, twist)
            come_to_rest(wires, 1e-7, 200)
            push = _push(wires)
            for load, ours in zip(loads, push, strict=True):
                kind = ", wire that twists" if twist else ""
                name = f"F18 sleeve, {1e3 * length:g} mm out{kind}, {1e3 * load:g} mN across"
                rows += [
                    Row(
                        f"{name}: push at the base",
                        "mN",
                        1e3 * _expected(load, length),
                        source,
                        1e3 * float(ours),
                        2e-2,
                    )
                ]

    load, at = 0.01, np.linspace(0.06, 0.14, 33)
    wires = _fed(n, np.full(1, 0.05), np.array([load]), False)
    wires.par("FEED_SPEED", 2e-3)
    off = 0.0
    for goal in at:
        wires.lane_field("FEED_WANT", goal)
        for _ in range(60):
            wires.step()
            if abs(inserted(wires)[0] - goal) < 1e-5:
                break
        come_to_rest(wires, 1e-6, 100)
        off = max(off, abs(float(_push(wires)[0]) / _expected(load, goal) - 1.0))
    rows += [
        at_most(
            "F18 fed from 60 to 140 mm, 33 stops: push off M²/2EI, largest", "%", 2.0, "elliptic integrals", 100 * off
        )
    ]

    shares, length = np.array([0.95, 1.05]), 0.1
    wires = _fed(n, np.full(2, length), np.full(2, load), False)
    come_to_rest(wires, 1e-7, 200)
    wires.par("FEED_FORCE", shares * _expected(load, length))
    for _ in range(20):
        wires.step()
    out = 1e3 * (inserted(wires) - length)
    rows += [at_least("F18 drive that holds 0.95 of it, way of the wire out in 4 s", "mm", 1.0, source, float(out[0]))]
    rows += [at_most("F18 drive that holds 1.05 of it, way of the wire out in 4 s", "mm", 0.01, source, float(out[1]))]
    return rows


def inserted(wires: FreeWires) -> np.ndarray:
    """Wire outside the sleeve, m, (n,)."""
    return wires.lane("OUT") + wires.lane("CELL")


def _fed(n: int, length: np.ndarray, loads: np.ndarray, twist: bool) -> FreeWires:
    """Damped wires out of a sleeve along x by `length` (n,) m, loaded across at the tip by `loads` (n,) N."""
    pieces = straight(n, 0.4, BENDING, 100.0, mass=5e-3, drag=1.0, twisting=BENDING if twist else 0.0)
    wires = FreeWires(pieces, len(loads), step=0.02, twist=twist)
    for name, value in (("FEED_SPEED", 0.02), ("FEED_STIFFNESS", 1e4), ("FORCE_TOLERANCE", 1e-9)):
        wires.par(name, value)
    wires.feed(length, lambda s: np.stack([s, 0 * s, 0 * s], axis=-1))
    forces = np.zeros((len(loads), n + 1, 3))
    forces[:, -1, 2] = loads
    wires.loads(forces)
    return wires


def _push(wires: FreeWires) -> np.ndarray:
    """What the wire pushes out with and the drive holds, N, (n,)."""
    return 1e4 * (wires.lane("CELL") - wires.lane("FEED_GOAL"))


def _expected(load: float, length: float) -> float:
    return load * math.sin(math.radians(elastica(load * length**2 / BENDING)[0]))


# --- F19 --------------------------------------------------------------------------------------------------------------


def whip(size: Size) -> list[Row]:
    """F19: a pre-curved wire turned in a curved lumen without clearance; a = L √(EI κ κ0/GJ)."""
    rows, source = [], "pendulum equation"
    base, tip = turned(size.segments // 2, 1.0, np.arange(0.0, 130.0, 2.0))
    for angle, expected in ((30, 45.353), (60, 85.692), (90, 118.412)):
        ours = float(np.interp(angle, tip, base))
        rows += [Row(f"F19 whip, a = 1, tip at {angle}°: base", "°", expected, source, ours, 5e-3)]
    steps = np.concatenate([np.arange(0.0, 190.0, 5.0), np.arange(190.0, 202.0, 0.1)])
    base, tip = turned(size.segments // 2, 2.0, steps)
    k = int(np.diff(tip).argmax())
    bend, slope, _ = np.polyfit(tip[k - 9 : k + 1] - tip[k], base[k - 9 : k + 1], 2)
    before = tip[k] - slope / (2 * bend)  # where base(tip) turns round
    for name, expected, ours in (
        ("snaps at base", 197.79, base[k]),
        ("tip before", 116.72, before),
        ("tip after", 301.61, tip[k + 1]),
    ):
        rows += [Row(f"F19 whip, a = 2, {name}", "°", expected, source, float(ours), 1.0 / expected)]
    for a, word in ((1.5, "smooth"), (1.65, "snaps")):
        base, tip = turned(size.segments // 2, a, np.arange(160.0, 220.0, 0.25))
        largest = float(np.diff(tip).max())
        name, source = f"F19 whip, a = {a:g}: most that the tip turns for 0.25° of the base", "snaps beyond π/2"
        rows += [
            at_most(name, "°", 5.0, source, largest) if word == "smooth" else at_least(name, "°", 20.0, source, largest)
        ]
    return rows


def turned(n: int, a: float, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Base and tip angles, degrees, of a wire of 1 m in an arc of 1 m radius whose base is turned slowly to `angles`.

    The nodes stay on the arc, which is what a lumen without clearance makes them do; the twist is free. A chain bends
    at its joints, so half of its last segment cannot; it is that much longer.
    """
    twisting, curl, step = 0.5, 0.5 * a * a, 1.0 / (n - 0.5)
    chord = 2 * math.sin(0.5 * step)
    pieces = Pieces.uniform(np.full(n, chord), 1.0, 1e5, 1.0, twisting=twisting, radius=1e-2)
    pieces.curl = np.array([curl, 0.0])
    wires = FreeWires(pieces, step=1e3, steps=1, twist=True)
    phi = step * np.arange(n + 1)
    wires.par("BASE_CLAMPED", 1.0)
    wires.par("MEMORY", 0.0)
    wires.par("FORCE_TOLERANCE", 1e-9)
    wires.hold(list(range(n + 1)))
    wires.place(np.stack([np.sin(phi), 1.0 - np.cos(phi), 0.0 * phi], axis=-1))
    wires.par("TWIST_SPEED", 1.0)
    inward = np.array([-math.sin(1.0), math.cos(1.0), 0.0])
    tip = []
    for angle in angles:
        wires.lane_field("TWIST_WANT", math.radians(angle))
        wires.step()
        wires.step()
        m = wires.directors[0, -1]
        behind = math.radians(angle) - math.atan2(m[2], float(m @ inward))
        tip.append(angle - math.degrees(math.remainder(behind, 2 * math.pi)))
    return angles, np.array(tip)
