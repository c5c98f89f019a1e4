"""Pools of certified scenarios, kept on disk: to draw and certify 1024 of them takes a minute or two.

Disk: ``$MAGWIRE_CACHE/pools`` or ``~/.cache/magwire/pools``, a file a pool, by the digest of the pool's recipe and of
the code that draws and certifies. A file holds the numbers and the control points of the tracts that were admitted. One
that cannot be read or written costs the making, and never an error.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..kept import kept_folder, read_arrays, write_arrays
from ..lumen.curve import Tract
from ..scenario import Scenario

if TYPE_CHECKING:
    from .pool import Recipe

__all__ = ["kept_pools", "read_pool", "write_pool"]

_CODE = ("quasistatic", "lumen", "physics", "scenario", "simulation")
"""Folders of the package that a pool follows from."""


def kept_pools() -> Path:
    """The folder of the kept pools."""
    return kept_folder("pools")


@lru_cache
def _code() -> bytes:
    """A digest of the code that pools follow from."""
    digest, package = hashlib.sha256(), Path(__file__).parents[1]
    for folder in _CODE:
        for file in sorted((package / folder).rglob("*.py")):
            digest.update(file.relative_to(package).as_posix().encode() + file.read_bytes())
    return digest.digest()


def _file(kind: str, recipe: Recipe, split: str, size: int, seed: int) -> Path:
    about = repr((kind, recipe.bounds, recipe.harder, recipe.bending_modulus, recipe.coupling, recipe.rig.__qualname__,
                  recipe.steered, recipe.weakest, recipe.time_limit, split, size, seed))  # fmt: skip
    return kept_pools() / f"{hashlib.sha256(_code() + about.encode()).hexdigest()[:32]}.npz"


def read_pool(kind: str, recipe: Recipe, split: str, size: int, seed: int) -> tuple[Scenario, ...] | None:
    """The scenarios of a pool as `write_pool` stored them, bit for bit; None if they are not kept, or not readable."""
    stored = read_arrays(_file(kind, recipe, split, size, seed)) or {}
    try:
        numbers, counts, points, radii = (stored[name] for name in ("numbers", "counts", "points", "radii"))
        if len(numbers) != size or points.shape != (counts.sum(), 3) or radii.shape != (counts.sum(),):
            return None
        ends = np.cumsum(counts)
        return tuple(
            recipe.scenario(
                name_of(kind, split, seed, int(number)), Tract.from_points(points[a:b], radii[a:b].tolist())
            )
            for number, a, b in zip(numbers, ends - counts, ends, strict=True)
        )
    except (KeyError, ValueError, TypeError):
        return None


def write_pool(kind: str, recipe: Recipe, split: str, size: int, seed: int, scenarios: tuple[Scenario, ...]) -> None:
    """Keep the scenarios of a pool for the next process."""
    tracts = [sc.tract for sc in scenarios]
    counts = np.array([len(tract.points) for tract in tracts])
    write_arrays(
        _file(kind, recipe, split, size, seed),
        numbers=np.array([int(sc.name.rpartition("-")[2]) for sc in scenarios]),
        counts=counts,
        points=np.concatenate([np.array(tract.points) for tract in tracts]),
        radii=np.concatenate([np.broadcast_to(tract.radius, n) for tract, n in zip(tracts, counts, strict=True)]),
    )


def name_of(kind: str, split: str, seed: int, number: int) -> str:
    """The name of a pool's candidate."""
    return f"{kind}-{split}-{seed}-{number}"
