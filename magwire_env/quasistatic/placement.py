"""Where to put a fixed magnet: the position with the greatest margin at the weakest place of the tract."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from ..physics.checks import positive
from ..scenario import Scenario
from ..scenario.rig import Rig, Slide, cheapest_rule
from .certificate import START_SPREAD, Certificate, certificate, certify

__all__ = ["best_placement"]

_ACROSS = 5
"""Positions tried along x and along y over the tract's extent; every round halves the distance between them."""

_HEIGHTS = (0.0, 0.02)
"""Heights tried, m above the lowest one that keeps the distance."""

_ROUNDS = 3


def best_placement(
    scenario: Scenario, magnet: int = 0, keep_out: float | None = None, direction: int = 1
) -> tuple[tuple[float, float, float], Certificate]:
    """The position above the tract with which a fixed magnet has the greatest margin at the weakest place.

    magnet : number of the magnet that is moved; the others stay
    keep_out : m, least distance of its centre from the centreline; by default its distance in `scenario`
    direction : +1 forward, −1 backward

    Returns the position, m, and the certificate of the scenario with the magnet there. The search tries a coarse grid
    over the tract's extent in x and y at two heights, then three finer rounds about the best position. The result is no
    worse than the given position. Raises `ValueError` for a magnet that slides, or a `keep_out` so small that the
    magnet would enter the tract.
    """
    mounts = scenario.rig.magnets
    if isinstance(magnet, bool) or not isinstance(magnet, int) or not 0 <= magnet < len(mounts):
        raise ValueError(f"magnet must be a whole number from 0 to {len(mounts) - 1}, got {magnet!r}")
    mount = mounts[magnet]
    if any(isinstance(d, Slide) for d in mount.dofs):
        raise ValueError(f"magnet {magnet} must be fixed for a placement, got one that slides: {mount.dofs}")
    centreline = scenario.tract.position(np.linspace(0.0, scenario.tract.length, 4 * len(scenario.tract.table)))
    own = mount.distance_to(centreline)
    if keep_out is None:
        keep_out = own
    elif positive("keep_out", keep_out, "m") < mount.magnet.reach + scenario.tract.widest:
        clear = mount.magnet.reach + scenario.tract.widest
        raise ValueError(
            f"keep_out must be at least {clear:.4g} m, or the turning magnet enters the tract, got {keep_out}"
        )
    dipoles = mount.dipoles if keep_out >= own else cheapest_rule(mount.magnet, keep_out)

    def moved(position: np.ndarray) -> Scenario:
        there = dataclasses.replace(mount, position=tuple(position.tolist()), dipoles=dipoles)
        return dataclasses.replace(
            scenario, rig=Rig((*mounts[:magnet], there, *mounts[magnet + 1 :]), scenario.rig.coils)
        )

    low, high = centreline[:, :2].min(axis=0), centreline[:, :2].max(axis=0)
    step = np.maximum((high - low) / (_ACROSS - 1), 1e-3)
    flat = [np.linspace(a, b, _ACROSS) for a, b in zip(low, high, strict=True)]
    tried = _positions_above(centreline, keep_out, np.array(list(itertools.product(*flat))))
    if own >= keep_out:
        tried = np.vstack([mount.position, tried])
    start = {"start": max(scenario.wire.length - START_SPREAD, 0.0)} if direction > 0 else {}
    best, most = tried[0], -np.inf
    for _ in range(1 + _ROUNDS):
        worst = [c.weakest[1] for c in certify([moved(p) for p in tried], direction, **start)]
        if max(worst) > most:
            best, most = tried[int(np.argmax(worst))], max(worst)
        step = step / 2
        around = np.array([m for m in itertools.product((-1.0, 0.0, 1.0), repeat=2) if any(m)])
        tried = _positions_above(centreline, keep_out, best[:2] + around * step)
    return tuple(best.tolist()), certificate(moved(best), direction)


def _positions_above(centreline: np.ndarray, distance: float, flat: np.ndarray) -> np.ndarray:
    """Points (k, 3) m above each of `flat` (n, 2) m, the lowest of them `distance` m away from the centreline."""
    points = []
    for x, y in flat:
        off = np.hypot(centreline[:, 0] - x, centreline[:, 1] - y)
        near = off < distance
        z = centreline[:, 2].mean() if not near.any() else 0.0
        if near.any():
            z = (centreline[near, 2] + np.sqrt(distance**2 - off[near] ** 2)).max() + 1e-9
        points += [(x, y, z + up) for up in _HEIGHTS]
    return np.array(points)
