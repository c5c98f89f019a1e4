"""Takes fluoroscopic images of a batch's lanes: the anatomy drawn once and kept, the wires drawn at every look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box

from ..lumen import Lumen
from ..simulation import Simulator
from ..simulation.threads import cores, share_out
from . import fluoroscopy_kernels as kernels
from .fluoroscopy import Fluoroscopy, Projection, projection

if TYPE_CHECKING:
    from .episodes import Episodes

__all__ = ["Fluoroscope", "roadmap"]

_BRIGHT = 0.85
"""Where nothing absorbs, as a share of white; the rest is kept for the target's ring."""

_LUMEN = 0.45
"""Share of the light that gets through a lumen much thicker than usual in its anatomy."""

_WIRE, _MAGNET = 0.35, 0.0
"""Shares of the light that get through the wire and through the magnet at its tip."""

_THIN = 0.5
"""px; half width that a wire is drawn with at least."""

_THICKER = 0.6
"""px by which the magnet's half width exceeds the wire's at least."""

_RING = 1.0 / 28
"""Radius of the target's ring over the image's side."""

_NO_SHAPE = np.zeros((0, 0, 3))

_FINE, _DEPTHS = 2, 256
"""Cells along a pixel and cells in depth in which the lumen's thickness is counted."""

_LARGE = 256
"""px; side of an image beyond which a pixel is one cell: it bounds the memory."""

_SLICES = 64
"""Depths at which a lumen with a wall of its own is looked at."""


class Fluoroscope:
    """What takes the images of a simulator's lanes.

    options : how they are taken
    space : of one lane's image
    """

    def __init__(self, sim: Simulator, episodes: Episodes, options: Fluoroscopy, threads: int | None = None) -> None:
        self.options, self._sim, self._episodes, self._threads = options, sim, episodes, threads
        size, n, entries = options.size, sim.num_envs, len(sim.library.scenarios)
        self.space = Box(0, 255, (1, size, size), dtype=np.uint8)
        self._projections = [projection(sc.tree, options) for sc in sim.library.scenarios]
        self._ways = np.array([_way(p) for p in self._projections])
        self._sizes = np.array(
            [_sizes(sc, p.pixel) for sc, p in zip(sim.library.scenarios, self._projections, strict=True)]
        )
        self._still, self._known = np.zeros((entries, size, size), dtype=np.uint8), np.zeros(entries, dtype=np.bool_)
        self._goals, self._aim = np.full((n, 2), np.nan), np.full((3, n), np.nan)
        self._keys = np.zeros((n, 2), dtype=np.uint32)
        self._left = np.array([_WIRE, _MAGNET])
        self._benches = [np.empty((size, size), dtype=np.float32) for _ in range(min(threads or cores(), n))]

    def projection_of(self, lane: int) -> Projection:
        """The projection that the lane's anatomy is seen by."""
        return self._projections[self._sim.lane_scenario[lane]]

    def begin(self, lanes: np.ndarray, rngs: Sequence[np.random.Generator]) -> None:
        """Draw what fixes the noise of the episodes that begin in `lanes` (n,), each from its own generator."""
        if self.options.noise:
            self._keys[lanes] = [rng.integers(1 << 32, size=2, dtype=np.uint32) for rng in rngs]

    def read(self) -> np.ndarray:
        """The images of all lanes as they are now, (n, 1, size, size) uint8. The same state gives the same images."""
        sim, options = self._sim, self.options
        entry = sim.lane_scenario
        if not self._known[entry].all():
            for e in np.unique(entry[~self._known[entry]]):
                self._still[e] = roadmap(sim.library.scenarios[e].tree, options)
                self._known[e] = True
        shapes, wanted = self._episodes.shapes, _NO_SHAPE
        if options.target and shapes is not None:
            wanted = shapes.wanted
        elif options.target:
            self._follow_goals(entry)
        out = np.empty((sim.num_envs, *self.space.shape), dtype=np.uint8)
        nodes, steps = np.ascontiguousarray(sim.positions), self._episodes.steps

        def run(lanes: np.ndarray, image: np.ndarray) -> None:
            kernels.draw(
                lanes, nodes, entry, self._ways, self._sizes, self._left, self._still, self._goals,
                _RING * options.size, wanted, options.noise, self._keys, steps, image, out,
            )  # fmt: skip

        share_out(run, np.arange(sim.num_envs), self._benches, self._threads)
        return out

    def _follow_goals(self, entry: np.ndarray) -> None:
        """Bring the targets' places in the image up to date."""
        goals = self._sim.goals()
        aim = np.stack([entry, goals.branch, goals.s])
        moved = np.flatnonzero((aim != self._aim).any(axis=0))
        for e, b in {(e, b) for e, b in aim[:2, moved].T.astype(np.int64).tolist()}:
            lanes = moved[(aim[0, moved] == e) & (aim[1, moved] == b)]
            curve = self._sim.library.scenarios[e].tree.branches[b].curve
            self._goals[lanes] = self._projections[e].place(curve.position(goals.s[lanes]))
        self._aim = aim


def _way(projection: Projection) -> np.ndarray:
    """What `kernels.wire_on` turns a point into its place with, (2, 4)."""
    turn = np.stack([projection.across, projection.down]) / projection.pixel
    return np.column_stack([turn, projection.shift])


def _sizes(scenario: Any, pixel: float) -> tuple[float, float, float]:
    """Half width of the wire and of its tip's magnet, px, and the magnet's length, m."""
    wire = max(scenario.wire.radius / pixel, _THIN)
    return wire, max(scenario.tip.diameter / 2 / pixel, wire + _THICKER), scenario.tip.height


# --- the lumen --------------------------------------------------------------------------------------------------------


def roadmap(lumen: Lumen, options: Fluoroscopy) -> np.ndarray:
    """The image of an anatomy without a wire, (size, size) uint8: grey where contrast medium fills the lumen.

    It absorbs as 1 − exp(−thickness/d), with d the median diameter of the branches, so that thin vessels show beside
    thick ones.
    """
    if not options.lumen:
        return np.full((options.size, options.size), round(255 * _BRIGHT), dtype=np.uint8)
    # Noise and target do not matter here.
    return _filled(lumen, replace(options, noise=0.0, target=True))


@lru_cache(maxsize=1024)
def _filled(lumen: Lumen, options: Fluoroscopy) -> np.ndarray:
    seen = projection(lumen, options)
    thick = _thickness_of_tubes(lumen, seen, options.size) if lumen.wall is None else _thickness(lumen, seen, options)
    usual = 2 * float(np.median([b.radius(b.length / 2) for b in lumen.branches]))
    absorbed = (1.0 - _LUMEN) * (1.0 - np.exp(-thick / usual))
    return np.round(255 * _BRIGHT * (1.0 - absorbed)).astype(np.uint8)


def _thickness_of_tubes(lumen: Lumen, seen: Projection, size: int) -> np.ndarray:
    """How much lumen lies behind every pixel, (size, size) m: the cells of a grid that lie in the tubes' balls."""
    fine = _FINE if size <= _LARGE else 1
    cell = seen.pixel / fine
    points, radii = [], []
    for b in lumen.branches:
        s = np.linspace(0.0, b.length, max(2, int(np.ceil(b.length / min(cell, b.narrowest[0] / 4))) + 1))
        points.append(b.curve.position(s))
        radii.append(b.radius(s))
    xyz, r = np.concatenate(points), np.concatenate(radii)
    deep = xyz @ seen.depth
    first, last = (deep - r).min(), (deep + r).max()
    step = (last - first) / _DEPTHS
    balls = np.column_stack([fine * seen.place(xyz), (deep - first) / step, r / cell])
    occupied = np.zeros((size * fine, size * fine, _DEPTHS), dtype=np.uint8)
    kernels.fill(balls, cell / step, occupied)
    return step * occupied.sum(axis=2, dtype=np.int64).reshape(size, fine, size, fine).mean(axis=(1, 3))


def _thickness(lumen: Lumen, seen: Projection, options: Fluoroscopy) -> np.ndarray:
    """As `_thickness_of_tubes`, of a lumen whose wall is known better than by tubes: looked at slice by slice."""
    low, high = (np.array(corner) for corner in lumen.bounds)
    middle, size = (low + high) / 2, options.size
    reach = float(np.abs(high - low) @ np.abs(seen.depth)) / 2
    step = 2 * reach / _SLICES
    depths = (np.arange(_SLICES) + 0.5) * step - reach
    columns = (np.arange(size) + 0.5 - seen.shift[0]) * seen.pixel
    rows = (np.arange(size) + 0.5 - seen.shift[1]) * seen.pixel
    plane = columns[None, :, None] * seen.across + rows[:, None, None] * seen.down
    total = np.zeros((size, size))
    for depth in depths:
        distance = lumen.wall_distance(plane + (middle @ seen.depth + depth) * seen.depth)
        total += step * np.clip(0.5 + distance / step, 0.0, 1.0)
    return total
