"""An equilibrium on the way of the search, with what is left to do and how it changes with the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..rod_energy import Load, LoadSlope, Shape
from .means import Apart, Means
from .response import Response, respond, softening, softest
from .targets import Aim, Fit

if TYPE_CHECKING:
    from ..rod import FreeRod

__all__ = ["SOFT", "Point", "Problem"]

SOFT = 0.1
"""Stiffness of the softest mode, of the straight rod's, below which the search shies away from the snap to come."""

_STEP = 1e-4
"""Of a parameter, in the differences that tell how the softest mode stiffens."""

_KEEP_OFF = 3.0
"""Weight of a magnet standing in the rod, against the same distance off the target."""


@dataclass(frozen=True)
class Point:
    """An equilibrium of the rod under the parameters `z`.

    off : (magnets,) by how much each is too near to the rod, over the target's tolerance
    residual : what the search makes least: of the fit, of `off`, and of the softness
    stiffness : of the softest mode, over the straight rod's; `mode` (3N,) is that mode
    """

    z: np.ndarray
    load: Load
    shape: Shape
    positions: np.ndarray
    fit: Fit
    off: np.ndarray
    residual: np.ndarray
    stiffness: float
    mode: np.ndarray

    @property
    def clear(self) -> bool:
        """No magnet stands in the rod."""
        return not self.off.any()


class Problem:
    """One target for one rod by one set of means."""

    def __init__(self, rod: FreeRod, aim: Aim, means: Means) -> None:
        self.rod, self.aim, self.means = rod, aim, means
        self.chain = rod._chain
        self.touched = False
        """Whether the last equilibrium asked for was lost in contact with a magnet."""
        self._straight, _ = softest(self.chain, rod._load().unloaded(), rod._rest)

    def load(self, z: np.ndarray) -> Load:
        return self.rod._load(**self.means.load(z))

    def rates(self, z: np.ndarray) -> list[LoadSlope]:
        """How each of z changes the load."""
        couple, strength = self.rod._units()
        rates = self.means.rates(z)
        return [LoadSlope(r.uniform * couple, r.positions / self.rod.wire.length, r.moments * strength) for r in rates]

    def at(self, z: np.ndarray, start: Shape) -> Point | None:
        """The equilibrium that the rod relaxes to from `start`; None if there is none."""
        load = self.load(z)
        found = self.rod._nearby(load, start)
        self.touched = found.touched
        if not found.converged:
            return None
        positions = self.rod._positions(found.shape)
        fit = self.aim.fit(positions)
        off = np.array([max(0.0, a.clear - _nearest(a, positions)[0]) for a in self.means.apart(z)]) / self.aim.within
        value, mode = softest(self.chain, load, found.shape)
        stiffness = value / self._straight
        residual = np.concatenate([fit.residual, _KEEP_OFF * off, [max(0.0, 1 - stiffness / SOFT)]])
        return Point(z, load, found.shape, positions, fit, off, residual, stiffness, mode)

    def response(self, point: Point) -> Response:
        """How the rod moves with z."""
        return respond(self.chain, point.load, point.shape, self.rates(point.z))

    def slopes(self, point: Point, response: Response) -> np.ndarray:
        """Of the residual by z, (r, P)."""
        moves = response.moves * self.rod.wire.length
        rows = [self.aim.slopes(moves, response.turns)]
        for apart, short in zip(self.means.apart(point.z), point.off, strict=True):
            _, node, towards = _nearest(apart, point.positions)
            slope = towards @ (moves[node] - apart.rates.T)
            rows.append(-_KEEP_OFF * (short > 0) * slope[None] / self.aim.within)
        soft = np.zeros((1, len(point.z)))
        if point.stiffness < SOFT:
            ends = [(self.load(point.z + step), self.load(point.z - step)) for step in _STEP * np.eye(len(point.z))]
            slope = softening(self.chain, ends, point.shape, point.mode, response, _STEP)
            soft -= slope / (SOFT * self._straight)
        return np.concatenate([*rows, soft])


def _nearest(apart: Apart, positions: np.ndarray) -> tuple[float, int, np.ndarray]:
    """Distance from a magnet's centre to the nearest node, m, that node, and the direction there."""
    away = positions - apart.centre
    far = np.linalg.norm(away, axis=1)
    node = int(far.argmin())
    return float(far[node]), node, away[node] / max(float(far[node]), 1e-12)
