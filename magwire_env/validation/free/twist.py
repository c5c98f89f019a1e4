"""Rods that twist: F6 Greenhill, F7 Michell's ring, F8 localised buckling, F10 clamped helices."""

from __future__ import annotations

import math

import numpy as np

from ...simulation.free.wires import FreeWires, Pieces
from ..report import Row, Size, at_least, at_most
from .bench import growth, spun, straight, threshold

__all__ = ["departure", "greenhill", "helices", "helix", "localised", "ring"]


def held_at_both_ends(
    pieces: Pieces,
    positions: np.ndarray,
    directors: np.ndarray,
    base: tuple[np.ndarray, np.ndarray],
    tip: tuple[np.ndarray, np.ndarray],
    step: float,
    steps: int = 10,
) -> FreeWires:
    """Wires (n, nodes, 3) whose ends are clamped at tangents and directors `base` and `tip`, each (n, 3) or (3,)."""
    wires = FreeWires(pieces, len(positions), step=step, steps=steps, twist=True)
    for end, (tangent, director) in (("BASE", base), ("TIP", tip)):
        wires.par(f"{end}_CLAMPED", 1.0)
        wires.vector(f"{end}_TX", tangent)
        wires.vector(f"{end}_MX", director)
    wires.hold([0, wires.nodes - 1])
    wires.place(positions, 0.0, directors)
    wires.par("FORCE_TOLERANCE", 1e-8)
    return wires


def wobble(n: int, size: float, seed: int = 0) -> np.ndarray:
    """A smooth disturbance (nodes, 3), zero at both ends with its slope, without a special direction."""
    rng, s = np.random.default_rng(seed), np.linspace(0.0, 1.0, n + 1)
    modes = np.stack([np.sin(math.pi * s) * np.sin(math.pi * k * s) / k for k in range(1, 5)], axis=-1)
    return size * modes @ rng.normal(size=(4, 3))


def about(axis: np.ndarray, m: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The directors m (3,), turned about a unit axis across them by each of the angles, (n, 3)."""
    a = np.asarray(angle)[:, None]
    return np.cos(a) * m + np.sin(a) * np.cross(axis, m)


# --- F6 ---------------------------------------------------------------------------------------------------------------


def greenhill(size: Size) -> list[Row]:
    """F6: a clamped rod under end tension τ = T L²/EI and twist; the critical moment M L/EI, the rod free."""
    rows = []
    for tension, critical in ((0, 8.988), (1, 9.13473), (10, 10.42886), (30, 13.11350)):
        factors = np.array([0.96, 0.98, 0.99, 1.0, 1.01, 1.02, 1.04])
        wires = _pulled_and_twisted(size, tension, critical * factors, drag=100.0)
        source = "clamped rod, Greenhill"
        rows += threshold(f"F6 τ = {tension}, M L/EI", "", critical, source, factors, growth(wires, 4, 8), 1e-2)
        wires = _pulled_and_twisted(size, tension, critical * np.array([0.96, 1.06]), drag=5.0)
        most = _most_of(wires, 20, slice(1, 3))
        name = f"F6 τ = {tension}, 1e-4 L out of line"
        rows += [at_most(f"{name} at 0.96 of it: largest bow in 10 s", "of L", 1e-3, "holds", most[0])]
        rows += [at_least(f"{name} at 1.06 of it: largest bow in 10 s", "of L", 0.1, "goes", most[1])]
    return rows


def _pulled_and_twisted(size: Size, tension: float, twist: np.ndarray, drag: float) -> FreeWires:
    """Straight wires of E I = G J = 1, L = 1, a little bent, whose far end slides along x."""
    n, x_axis, y_axis = size.segments // 2, np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    x = np.stack([np.linspace(0.0, 1.0, n + 1), np.zeros(n + 1), np.zeros(n + 1)], axis=-1) + wobble(n, 1e-4)
    x = np.tile(x, (len(twist), 1, 1))
    directors = spun(x, y_axis, twist)
    pieces = straight(n, twisting=1.0, drag=drag, radius=1e-2)
    tip = (x_axis, about(x_axis, y_axis, twist))
    wires = held_at_both_ends(pieces, x, directors, (x_axis, y_axis), tip, step=0.05)
    wires.hold([n], "X", held=False)
    wires.loads(np.outer(np.arange(n + 1) == n, [float(tension), 0.0, 0.0]))
    return wires


def _most_of(wires: FreeWires, periods: int, axes: slice) -> np.ndarray:
    """The largest coordinate along `axes` that any node has had after each of `periods`, m, (n,)."""
    most = np.zeros(wires.n)
    for _ in range(periods):
        wires.step()
        most = np.maximum(most, np.abs(wires.positions[..., axes]).max(axis=(1, 2)))
    return most


# --- F7 ---------------------------------------------------------------------------------------------------------------


def ring(size: Size) -> list[Row]:
    """F7: a ring closed with a twist leaves its plane at 2π√3 EI/GJ (Michell 1889), the ring free."""
    rows = []
    for ratio in (1.25, 1.0, 0.75, 0.5):
        critical = 2 * math.pi * math.sqrt(3) / ratio
        factors = np.array([0.97, 0.98, 0.99, 1.0, 1.01, 1.02, 1.03])
        name, source = f"F7 ring, G J/E I = {ratio:g}", "Michell 1889"
        rates = growth(_ring(size, ratio, critical * factors, drag=3.0), 8, 12)
        rows += threshold(f"{name}, twist", "rad", critical, source, factors, rates, 1e-2)
        wires = _ring(size, ratio, critical * np.array([0.97, 1.03]), drag=0.5)
        most = _most_of(wires, 100, slice(2, 3))
        rows += [at_most(f"{name}, at 0.97 of it: farthest out of plane in 400 s", "of R", 0.02, "stays", most[0])]
        rows += [at_least(f"{name}, at 1.03 of it: farthest out of plane in 400 s", "of R", 0.1, "leaves", most[1])]
    return rows


def _ring(size: Size, ratio: float, twist: np.ndarray, drag: float) -> FreeWires:
    """Rings of radius 1 m and E I = 1 closed with a twist; both ends clamped at the same place and tangent."""
    n, z_axis, x_axis = size.segments, np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    phi = 2 * math.pi * np.arange(n + 1) / n
    x = np.stack([np.sin(phi), 1.0 - np.cos(phi), 0.0 * phi], axis=-1)
    x[-1] = x[0]
    x = np.tile(x + wobble(n, 1e-4, 1), (len(twist), 1, 1))
    pieces = straight(n, 2 * n * math.sin(math.pi / n), twisting=ratio, drag=drag, radius=1e-2)
    tip = (x_axis, about(x_axis, z_axis, twist))
    return held_at_both_ends(pieces, x, spun(x, z_axis, twist), (x_axis, z_axis), tip, step=0.4)


# --- F10 --------------------------------------------------------------------------------------------------------------

NEAR = np.linspace(0.94, 1.06, 16)
"""Of an expected value: where a threshold is looked for."""


def helices(size: Size) -> list[Row]:
    """F10: a rod held at both ends along helices of growing curvature, and when it leaves them."""
    rows = []
    for c1, expected in ((1.0, 5.2705), (1e-3, 2 * math.pi)):
        ours = departure(c1, 0.0, expected, size.segments)
        name = f"F10 clamped helix, τ/κ = {c1:g}, axial moment 0, leaves at κL"
        rows += [Row(name, "", expected, "conjugate points", ours, 1e-2)]
    return rows


def departure(
    c1: float, c2: float, guess: float, segments: int, ratio: float = 2 / 3, factors: np.ndarray = NEAR
) -> float:
    """κL at which a clamped helix of τ/κ = c1 and axial moment c2 EI κ is left: where small motions begin to grow.

    ratio : G J/E I; it does not matter to the helix itself, which stays one under any
    factors : of the guess, rising, that are tried; NaN if motions grow at the first or at none of them

    The growth is read off late, when the slowest motion alone is left: read between the third and the fifth period, it
    put departures at c1 1.1, c2 −1.2 more than 6 % too far. Far beyond the departure rods have come to rest elsewhere
    by then, so only the first place counts from which motions grow.
    """
    rates = growth(helix(c1, c2, factors * guess, segments, ratio), 8, 12)
    k = int((rates > 0.0).argmax())
    if k == 0:
        return float("nan")
    share = rates[k - 1] / (rates[k - 1] - rates[k])
    return float(guess * (factors[k - 1] + share * (factors[k] - factors[k - 1])))


def helix(c1: float, c2: float, bends: np.ndarray, segments: int, ratio: float) -> FreeWires:
    """Rods of length 1 and E I = 1 along helices of κL = `bends`, a little disturbed; see `departure`."""
    k = np.asarray(bends)[:, None]
    omega = k * math.hypot(1.0, c1)
    radius, pitch = k / omega**2, c1 * k / omega**2

    def frame(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        sin, cos, one = np.sin(omega * s), np.cos(omega * s), np.ones_like(omega * s)
        place = np.stack([radius * cos, radius * sin, pitch * omega * s], axis=-1)
        tangent = np.stack([-radius * omega * sin, radius * omega * cos, pitch * omega * one], axis=-1)
        normal = np.stack([-cos, -sin, 0.0 * one], axis=-1)
        psi = ((c2 / ratio - c1) * k * s)[..., None]  # the material turns against the normal
        return place, tangent, normal * np.cos(psi) + np.cross(tangent, normal) * np.sin(psi)

    s = np.linspace(0.0, 1.0, segments + 1)
    x, tangent, director = frame(s)
    middle = frame(0.5 * (s[:-1] + s[1:]))[2]
    e = np.diff(x, axis=1)
    chord = np.linalg.norm(e, axis=-1)
    e /= chord[..., None]
    middle -= (middle * e).sum(axis=-1, keepdims=True) * e
    middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
    pieces = straight(segments, twisting=ratio, drag=100.0, radius=1e-2)
    base, tip = ((tangent[:, i], director[:, i]) for i in (0, -1))
    wires = held_at_both_ends(pieces, x + wobble(segments, 1e-5), middle, base, tip, step=0.05)
    wires.wire("REST", np.concatenate([chord, chord[:, -1:]], axis=1))
    return wires


# --- F8 ---------------------------------------------------------------------------------------------------------------


def localised(_: Size) -> list[Row]:
    """F8: a long rod, twisted by 27 turns and shortened, buckles in one place (Bergou et al. 2008)."""
    n = 180
    length, bending, twisting, turns, shorter = 9.29, 1.345, 0.789, 27, 0.3
    twist = np.array([2 * math.pi * turns])
    x_axis, y_axis = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    s = np.linspace(0.0, length, n + 1)
    bump = 0.02 * np.exp(-((s - length / 2) ** 2))
    x = np.stack([s, bump * np.cos(3 * s), bump * np.sin(3 * s)], axis=-1)[None]
    pieces = straight(n, length, bending, 1e4, mass=0.1, twisting=twisting, drag=0.3, radius=0.05)
    tip = (x_axis, about(x_axis, y_axis, twist))
    wires = held_at_both_ends(pieces, x, spun(x, y_axis, twist), (x_axis, y_axis), tip, step=0.1)
    wires.par("FORCE_TOLERANCE", 1e-7)
    speed = np.zeros((1, n + 1, 3))
    for k in range(300):
        speed[:] = wires.velocities
        speed[0, 0], speed[0, -1] = 0.0, [-shorter / 100.0 if k < 100 else 0.0, 0.0, 0.0]
        wires.push(speed)
        wires.step()
    wires.refresh()
    e = np.diff(wires.positions[0], axis=0)
    c = e[:, 0] / np.linalg.norm(e, axis=1)
    i = int(c.argmin())
    below, least, above = c[i - 1 : i + 2]
    off = 0.5 * (below - above) / (below - 2 * least + above)
    lowest = least - 0.25 * (below - above) * off
    centre = (i + 0.5 + off) * length / n
    moment = abs(float(wires.lane("BASE_TQX", 3)[0, 0]))
    scale = moment / (2 * bending) * math.sqrt((1 - lowest) / (1 + lowest))
    envelope = np.tanh(((np.arange(n) + 0.5) * length / n - centre) * scale) ** 2
    error = float(np.abs((c - lowest) / (1 - lowest) - envelope).max())
    left = float(np.abs(wires.velocities[0]).max())
    return [
        at_most(f"F8 localised buckling, {n} pieces, error of the envelope", "", 0.044, "tanh², Bergou 2008", error),
        at_most("F8 localised buckling, speed left", "m/s", 1e-4, "at rest", left),
    ]
