"""Random smooth tracts: seeded, bounded, and split into those to train on, to test on, and of other families.

``python -m magwire_env.lumen.generator --check 10000`` checks the first 10 000 tracts against their bounds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..physics.checks import non_negative, one_of, positive, vector
from .curve import Tract
from .named import planar_course

__all__ = ["SPLITS", "Bounds", "extent", "generate", "self_clearance", "sharpest_bend", "within_bounds"]

SPLITS = ("train", "test", "ood")
"""The order is the spawn key of each split's random stream, so it must never change."""

_TRIES = 20_000
"""Candidates looked at before the bounds are called too tight; the default bounds take about 60."""


@dataclass(frozen=True)
class Bounds:
    """What every generated tract keeps to.

    length : (least, most) m, of the centreline
    bend_radius : m; no bend is sharper
    lumen : (least, most) m, of the lumen's radius, which varies along the tract
    margin : m, from wall to wall of two parts that are not neighbours, at least (see `self_clearance`)
    box : m along x, y, z; the centreline stays inside this box about the origin, so that a magnet 7 cm above the plane
        z = box[2]/2 is 7 cm clear of it everywhere
    """

    length: tuple[float, float] = (0.7, 0.9)
    bend_radius: float = 0.03
    lumen: tuple[float, float] = (6.5e-3, 8.5e-3)
    margin: float = 3e-3
    box: tuple[float, float, float] = (0.24, 0.24, 0.05)

    def __post_init__(self) -> None:
        for name, size in (("length", 2), ("lumen", 2), ("box", 3)):
            values = vector(f"Bounds.{name}", getattr(self, name), size, "m")
            object.__setattr__(self, name, tuple(positive(f"Bounds.{name}[{i}]", v, "m") for i, v in enumerate(values)))
        object.__setattr__(self, "bend_radius", positive("Bounds.bend_radius", self.bend_radius, "m"))
        object.__setattr__(self, "margin", non_negative("Bounds.margin", self.margin, "m"))
        if self.length[1] < 1.02 * self.length[0]:
            raise ValueError(f"Bounds.length must span at least 2 % (in m), got {self.length}")
        if self.lumen[1] < self.lumen[0]:
            raise ValueError(f"Bounds.lumen must be (least, most) (in m), got {self.lumen}")
        if self.bend_radius <= self.lumen[1]:
            raise ValueError(
                f"Bounds.bend_radius must exceed the widest lumen radius {self.lumen[1]:g} m, got {self.bend_radius:g}"
            )


def generate(seed: int, split: str = "train", bounds: Bounds = Bounds()) -> Tract:
    """The tract of a seed: a value that depends on `split`, `seed` and `bounds` alone, on any machine.

    seed : whole number of at least 0
    split : ``"train"`` and ``"test"`` are the same kind of tract, a wander with random band-limited curvature that
        turns and crosses over itself in a flat box like bowel in the belly; ``"ood"`` draws from families the other
        two never show: helices, ranks of parallel bowel loops, and chains of straight runs and round arches
    bounds : what the tract keeps to

    Each split has random streams of its own (NumPy's `SeedSequence` with the split as its spawn key), so a seed gives
    unrelated tracts in two splits, and no seed of one split repeats a tract of another. Candidates are drawn until one
    is within bounds; control points are rounded to 1 µm, so that the last bit of a sine does not tell machines apart.

    Raises `ValueError` for an unknown split, a negative seed, and bounds that no candidate met.
    """
    return _search(seed, split, bounds)[0]


def within_bounds(tract: Tract, bounds: Bounds) -> None:
    """Raise `ValueError` naming the bound that `tract` breaks, its value and where; return if it keeps to all."""
    low, high = bounds.length
    if not low <= tract.length <= high:
        raise ValueError(f"length must lie in [{low:g}, {high:g}] m, got {tract.length:.4f} m")
    radii = tract.radius if isinstance(tract.radius, tuple) else (tract.radius,)
    if min(radii) < bounds.lumen[0] or max(radii) > bounds.lumen[1]:
        raise ValueError(f"lumen radius must lie in {bounds.lumen} m, got {min(radii):.4g} to {max(radii):.4g} m")
    points = tract.table[1:, 0:3]
    outside = np.abs(points) - np.array(bounds.box) / 2
    if outside.max() > 0:
        row, axis = np.unravel_index(outside.argmax(), outside.shape)
        raise ValueError(
            f"{'xyz'[axis]} must stay within ±{bounds.box[axis] / 2:g} m, "
            f"got {points[row, axis]:.4f} m at s = {row * tract.row_spacing:.3f} m"
        )
    bend, at = sharpest_bend(tract)
    if bend < bounds.bend_radius:
        raise ValueError(f"bend radius must be at least {bounds.bend_radius:g} m, got {bend:.4f} m at s = {at:.3f} m")
    gap, (one, other) = self_clearance(tract)
    if gap < bounds.margin:
        raise ValueError(
            f"walls of parts that are not neighbours must be at least {bounds.margin:g} m apart, "
            f"got {gap:.4f} m between s = {one:.3f} and {other:.3f} m"
        )


def sharpest_bend(tract: Tract) -> tuple[float, float]:
    """The smallest bend radius and its arc length, m, at the table's knots: within a row κ is largest at an end."""
    s = tract.row_spacing * np.arange(len(tract.table) - 1)
    curvature = tract.curvature(s)
    i = int(curvature.argmax())
    return 1 / max(float(curvature[i]), 1e-12), float(s[i])


def extent(tract: Tract) -> np.ndarray:
    """Size of the centreline's bounding box along x, y, z, (3,) m."""
    return np.ptp(tract.table[1:, 0:3], axis=0)


def self_clearance(tract: Tract) -> tuple[float, tuple[float, float]]:
    """The least distance from wall to wall of two parts that are not neighbours, and their arc lengths, m.

    Parts are neighbours up to four lumen radii apart along the tract, so a tract that stays clear of itself has about
    two radii. Taken between points 4 mm apart, so up to 0.15 mm too large; ∞ if no two parts are that far apart.
    """
    count = round((len(tract.table) - 2) / 2)
    h = tract.length / count
    count += not tract.closed
    points = tract.position(h * np.arange(count))
    radii = tract.radius_at(h * np.arange(count))
    gap = _distances(points)
    gap -= radii[:, None]
    gap -= radii
    gap += _neighbours(count, int(np.ceil(4 * tract.widest / h - 1e-6)), tract.closed)
    i, j = divmod(int(gap.argmin()), count)
    return float(gap[i, j]), (i * h, j * h)


def _distances(points: np.ndarray) -> np.ndarray:
    """Distances between points: (..., n, 3) → (..., n, n), by |a − b|² = a² + b² − 2 a·b: good to 1e-9 m in 1 m."""
    squares = np.einsum("...i,...i->...", points, points)
    apart = points @ (-2 * points).swapaxes(-1, -2)  # in place from here: this array is most of a tract's time
    apart += squares[..., :, None]
    apart += squares[..., None, :]
    np.maximum(apart, 0.0, out=apart)
    return np.sqrt(apart, out=apart)


@lru_cache(maxsize=256)
def _neighbours(count: int, apart: int, closed: bool) -> np.ndarray:
    """(count, count): ∞ for points fewer than `apart` rows apart along the tract, 0 for the others."""
    steps = np.abs(np.arange(count)[:, None] - np.arange(count))
    if closed:
        steps = np.minimum(steps, count - steps)
    mask = np.where(steps < apart, np.inf, 0.0)
    mask.flags.writeable = False
    return mask


# --- drawing ----------------------------------------------------------------------------------------------------------

_Draw = Callable[..., Any]
_Candidates = Iterator[tuple[int, np.ndarray]]


def _search(seed: int, split: str, bounds: Bounds) -> tuple[Tract, int]:
    """The tract of a seed, and how many candidates it took."""
    one_of("split", split, SPLITS)
    if isinstance(seed, bool) or int(seed) != seed or seed < 0:
        raise ValueError(f"seed must be a whole number of at least 0, got {seed!r}")
    draw = _uniforms(int(seed), SPLITS.index(split))
    candidates = _wanders(draw, bounds) if split != "ood" else _others(draw, bounds)
    why = "no candidate kept to the box and to itself"
    for tried, xyz in candidates:
        xyz = np.round(xyz, 6)
        tract = Tract.from_points(xyz, _lumen(draw, len(xyz), bounds))
        try:
            within_bounds(tract, bounds)
        except ValueError as error:
            why = str(error)
        else:
            return tract, tried
    raise ValueError(f"bounds must leave room for a tract; none of {_TRIES} candidates fits {bounds} (the last: {why})")


def _uniforms(seed: int, split: int) -> _Draw:
    """A function that draws the next uniforms in [0, 1) in a given shape.

    From the bit generator itself, whose stream NumPy keeps for ever, as it does not promise of `Generator`'s methods.
    """
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(split,)))
    return lambda *shape: (bits.random_raw(shape or None) >> np.uint64(11)) * 2.0**-53


def _lumen(draw: _Draw, count: int, bounds: Bounds) -> tuple[float, ...]:
    """Radii that swell and narrow once to twice along the tract."""
    low, high = bounds.lumen
    along = np.linspace(0.0, 1.0, count)
    wave = np.sin(2 * np.pi * ((1 + draw()) * along + draw()))
    return tuple(np.clip(np.round((low + high) / 2 + (high - low) / 2 * draw() * wave, 6), low, high).tolist())


def _wanders(draw: _Draw, bounds: Bounds, batch: int = 48) -> _Candidates:
    """Wanders of random curvature that keep to the box and, coarsely, to themselves; with each, how many were drawn."""
    for first in range(0, _TRIES, batch):
        points = _wander(draw, bounds, batch)
        inside = np.flatnonzero((np.abs(points).max(axis=1) <= np.array(bounds.box) / 2).all(axis=1))
        if inside.size == 0:
            continue
        step = bounds.length[1] / (points.shape[1] - 1)
        apart = 2 * bounds.lumen[1] + bounds.margin
        neighbours = _neighbours(points.shape[1], int(np.ceil(4 * bounds.lumen[1] / step)) + 1, False)
        distances = _distances(points[inside])
        distances += neighbours
        for i in inside[distances.min(axis=(1, 2)) >= apart]:
            yield first + int(i) + 1, points[i]


def _wander(draw: _Draw, bounds: Bounds, n: int) -> np.ndarray:
    """n courses of equal steps, (n, points, 3) m: heading from a random band-limited curvature, height from waves."""
    steps = int(np.ceil(bounds.length[1] / (0.5 * bounds.bend_radius)))
    modes = int(np.clip(round(bounds.length[1] / (4.4 * bounds.bend_radius)), 2, 12))
    low, high = bounds.length
    h = (low + (0.995 * high - low) * draw(n, 1)) / steps
    curvature = _waves(draw, n, steps, np.arange(1, modes + 1) / 2) + 3 * draw(n, 1) - 1.5  # the last: a mean, to curl
    curvature *= (0.7 + 0.25 * draw(n, 1)) / bounds.bend_radius / np.abs(curvature).max(axis=1, keepdims=True)
    height = _waves(draw, n, steps + 1, np.arange(1, 4))
    height -= (height.max(axis=1, keepdims=True) + height.min(axis=1, keepdims=True)) / 2
    height *= np.sqrt(draw(n, 1)) * bounds.box[2] / 2 / np.abs(height).max(axis=1, keepdims=True)
    rise = np.diff(height, axis=1)
    rise *= np.minimum(1.0, 0.6 * h / np.abs(rise).max(axis=1, keepdims=True))  # a tall box must not make it a ladder
    heading = 2 * np.pi * draw(n, 1) + (curvature * h).cumsum(axis=1)
    flat = np.sqrt(h**2 - rise**2)
    points = np.zeros((n, steps + 1, 3))
    np.cumsum(np.stack([flat * np.cos(heading), flat * np.sin(heading), rise], axis=2), axis=1, out=points[:, 1:])
    return points - (points.max(axis=1, keepdims=True) + points.min(axis=1, keepdims=True)) / 2


def _waves(draw: _Draw, n: int, count: int, cycles: np.ndarray) -> np.ndarray:
    """n sums of waves with random amplitudes and phases, (n, count); `cycles` over the whole length."""
    angle = 2 * np.pi * cycles[:, None] * np.linspace(0.0, 1.0, count)
    amplitude, phase = draw(n, len(cycles)), 2 * np.pi * draw(n, len(cycles))
    return (amplitude * np.cos(phase)) @ np.cos(angle) - (amplitude * np.sin(phase)) @ np.sin(angle)


def _others(draw: _Draw, bounds: Bounds) -> _Candidates:
    """Candidates that keep to the box, of one family that training never shows; which one is the seed's first draw."""
    family = (_coil, _bowel, _arches)[int(3 * draw())]
    for tried in range(1, _TRIES // 10):
        low, high = bounds.length
        xyz = family(draw, bounds, low + (0.99 * high - low) * draw())
        turn, mirror = np.pi / 2 * int(4 * draw()) + 0.3 * (draw() - 0.5), 1.0 if draw() < 0.5 else -1.0
        x, y, z = xyz[:, 0] * mirror, xyz[:, 1], xyz[:, 2]
        xyz = np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z], axis=1)
        xyz -= (xyz.max(axis=0) + xyz.min(axis=0)) / 2
        if (xyz.max(axis=0) <= np.array(bounds.box) / 2).all():
            yield tried, xyz


def _coil(draw: _Draw, bounds: Bounds, length: float) -> np.ndarray:
    """A slightly conical helix about z."""
    turns = 1.5 + draw()
    pitch = (2 * bounds.lumen[1] + bounds.margin) * (1.02 + 0.3 * draw())
    mean = np.sqrt(max((length / turns) ** 2 - pitch**2, pitch**2)) / (2 * np.pi)
    along = np.linspace(0.0, 1.0, round(length / 0.012))
    radius = mean * (1 + 0.3 * (draw() - 0.5) * (2 * along - 1))
    turn = 2 * np.pi * turns * along
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), pitch * turns * along], axis=1)


def _bowel(draw: _Draw, bounds: Bounds, length: float) -> np.ndarray:
    """Parallel runs joined by bulging hairpins, to alternate sides."""
    hairpins = 2 + int(2 * draw())
    bulge = 15 * draw()
    legs: list[tuple[float, float]] = []
    for i in range(hairpins):
        turn = 180 + 2 * bulge - (bulge if i in (0, hairpins - 1) else 0)
        legs.append((np.deg2rad(turn) * bounds.bend_radius * (1.08 + 0.3 * draw()), turn if i % 2 == 0 else -turn))
    run = (length - sum(leg for leg, _ in legs)) / (hairpins + 1)
    ends, between = (run * (0.8 + 0.4 * draw()), 0.0), [(run, -np.sign(turn) * 2 * bulge) for _, turn in legs]
    course = [ends]
    for leg, gap in zip(legs, between, strict=True):
        course += [leg, gap]
    return _raised(draw, bounds, course, length, 2 + draw())


def _arches(draw: _Draw, bounds: Bounds, length: float) -> np.ndarray:
    """Straight runs and three round bends, as from the aorta's arch down and round to the iliac artery."""
    legs, runs = [], [0.5 + draw()]
    for _ in range(3):
        turn = (130 + 65 * draw()) * (1 if draw() < 0.5 else -1)
        legs.append((np.deg2rad(abs(turn)) * bounds.bend_radius * (1.15 + 0.65 * draw()), turn))
        runs.append(0.5 + draw())
    scale = (length - sum(leg for leg, _ in legs)) / sum(runs)
    course = [(runs[0] * scale, 0.0)]
    for leg, run in zip(legs, runs[1:], strict=True):
        course += [leg, (run * scale, 0.0)]
    return _raised(draw, bounds, course, length, 1.0)


def _raised(
    draw: _Draw, bounds: Bounds, legs: Sequence[tuple[float, float]], length: float, waves: float
) -> np.ndarray:
    """A planar course of `legs`, its height a wave along it, scaled to `length` m."""
    xy = planar_course([(max(leg, 1e-3), turn) for leg, turn in legs], spacing=0.012, ease=bounds.bend_radius)
    height = 0.9 * bounds.box[2] / 2 * draw() * np.sin(2 * np.pi * (waves * np.linspace(0.0, 1.0, len(xy)) + draw()))
    xyz = np.column_stack([xy, height])
    return xyz * length / np.linalg.norm(np.diff(xyz, axis=0), axis=1).sum()


# --- command ----------------------------------------------------------------------------------------------------------


def check(count: int, split: str = "train", bounds: Bounds = Bounds()) -> str:
    """Generate the first `count` tracts of a split and check each one; a summary in lines of text.

    Raises `ValueError` naming the first seed whose tract breaks a bound.
    """
    tried, seconds, figures = 0, 0.0, np.empty((count, 4))
    for seed in range(count):
        start = time.perf_counter()
        tract, candidates = _search(seed, split, bounds)
        seconds += time.perf_counter() - start
        tried += candidates
        try:
            within_bounds(tract, bounds)
        except ValueError as error:
            raise ValueError(f"seed {seed} of {split!r}: {error}") from error
        figures[seed] = sharpest_bend(tract)[0], self_clearance(tract)[0], tract.length, extent(tract).max()
    bend, gap, length, size = figures.T
    return "\n".join([
        f"{count} tracts of {split!r}, seeds 0 to {count - 1}, all within {bounds}",
        f"accepted       {count / tried:.2%} of {tried} candidates",
        f"bend radius    least {1e3 * bend.min():.2f} mm, median of the tracts' least {1e3 * np.median(bend):.2f} mm",
        f"wall to wall   least {1e3 * gap.min():.2f} mm, median of the tracts' least {1e3 * np.median(gap):.2f} mm",
        f"length         {length.min():.3f} to {length.max():.3f} m; longest side of the box {1e3 * size.max():.0f} mm",
        f"time           {1e3 * seconds / count:.2f} ms a tract, its table and the check of its bounds included",
    ])  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """The command: check the first tracts of a split and print a summary."""
    parser = argparse.ArgumentParser(prog="python -m magwire_env.lumen.generator", description=main.__doc__)
    parser.add_argument("--check", type=int, default=10_000, metavar="N", help="how many tracts (default 10000)")
    parser.add_argument("--split", choices=SPLITS, default="train")
    options = parser.parse_args(arguments)
    if options.check < 1:
        parser.error(f"--check must be at least 1, got {options.check}")
    print(check(options.check, options.split))


if __name__ == "__main__":
    main()
