"""Pools of certified scenarios: generated tracts under the rigs of the tasks, only those that can be steered.

The scenarios of a pool depend on its kind, split, size and seed alone. A kind is a `Recipe`:

| kind | tracts | wire | rig | coupling | solvable |
|---|---|---|---|---|---|
| SteerAny | 0.4–0.6 m, bends ≥ 40 mm, 180 mm wide | 275 kPa | fixed above, one axis | force | 55 % |
| Orient | the generator's: 0.7–0.9 m, bends ≥ 30 mm, 240 mm wide | 55 kPa | fixed above, two axes | wrench | 69 % |
| Chase | the generator's | 275 kPa | slides in x and y 7 cm above the tract, one axis | wrench | 62 % |
| Dual | the generator's | 55 kPa | one fixed above turning about y, one below about x | wrench | 69 % |

All of them have the paper's magnet, tip and contact, and magnets at least 7 cm from the centreline. The paper's wire
(550 kPa) is too stiff for most of these tracts: to enter a bend of 30 mm radius it needs 9.4 mN, more than the magnet
gives over much of such a tract. It passes 2 % of the generator's own tracts under the fixed one-axis magnet. So the
kinds have a wire of half or a tenth of that stiffness, like soft catheters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from ..lumen.curve import Tract
from ..lumen.generator import SPLITS, Bounds, generate
from ..physics.checks import one_of, whole
from ..progress import Progress
from ..scenario import Rig, Scenario
from .certificate import Certificate, certify
from .rigs import following, one_axis, paper, two_axes, two_magnets

__all__ = ["RECIPES", "Pool", "Recipe", "build_pool", "candidates", "scenario_pool"]

_TOGETHER = 32
"""Number of candidates certified side by side."""

_MOST_TRIES = 100
"""Number of candidates for each scenario of the pool before the kind is called unsolvable."""


@dataclass(frozen=True)
class Recipe:
    """What a kind of task's scenarios are made of.

    bounds : of the generated tracts
    bending_modulus : Pa, of the wire
    coupling : "force" or "wrench"
    rig : makes the rig for a tract
    """

    bounds: Bounds
    bending_modulus: float
    coupling: str
    rig: Callable[[Tract], Rig]

    def scenario(self, name: str, tract: Tract) -> Scenario:
        """The scenario of a tract."""
        base = paper()
        wire = dataclasses.replace(base.wire, bending_modulus=self.bending_modulus)
        return Scenario(name, tract, wire, base.tip, self.rig(tract), base.contact, self.coupling)


@dataclass(frozen=True, eq=False)
class Pool:
    """Certified scenarios.

    scenarios, certificates : a certificate for each scenario
    tried : number of candidates generated
    """

    scenarios: tuple[Scenario, ...]
    certificates: tuple[Certificate, ...]
    tried: int

    @property
    def acceptance(self) -> float:
        """Share of the candidates that are certified."""
        return len(self.scenarios) / self.tried


def scenario_pool(kind: str, split: str = "train", size: int = 100, seed: int = 0) -> tuple[Scenario, ...]:
    """`size` certified scenarios of a kind of task, see `build_pool`."""
    return build_pool(kind, split, size, seed).scenarios


@lru_cache(maxsize=16)
def build_pool(kind: str, split: str = "train", size: int = 100, seed: int = 0, time_limit: float = 60.0) -> Pool:
    """A pool of certified scenarios; a process builds each pool once.

    kind : "SteerAny", "Orient", "Chase" or "Dual"; see the table of this module
    split : "train", "test" or "ood", see `lumen.generator.generate`
    size : number of scenarios; a smaller pool is the beginning of a larger one
    seed : of the pool; pools of different seeds share no tract
    time_limit : s, of the certificates
    """
    size = whole("size", size, 1)
    scenarios: list[Scenario] = []
    certificates: list[Certificate] = []
    first = 0
    with Progress(f"certifying {size} scenarios of {kind}, split {split}", size) as progress:
        while True:
            batch = candidates(kind, split, _TOGETHER, seed, first)
            for i, (sc, found) in enumerate(zip(batch, certify(batch, time_limit=time_limit), strict=True)):
                if found.solvable:
                    scenarios.append(sc)
                    certificates.append(found)
                if len(scenarios) == size:
                    return Pool(tuple(scenarios), tuple(certificates), first + i + 1)
            progress.done = len(scenarios)
            first += _TOGETHER
            if first > _MOST_TRIES * size + 1000:
                raise ValueError(
                    f"kind {kind!r} in split {split!r} gave {len(scenarios)} of {size} scenarios in {first} tries"
                )


def candidates(kind: str, split: str, count: int, seed: int = 0, first: int = 0) -> list[Scenario]:
    """Scenarios that are not certified yet: `count` of a pool's candidates, from number `first` on."""
    made = RECIPES[one_of("kind", kind, tuple(RECIPES))]
    one_of("split", split, SPLITS)
    seed = whole("seed", seed, 0)
    found = []
    for number in range(first, first + count):
        tract = generate(_PER_SEED * seed + number, split, made.bounds)
        found.append(made.scenario(f"{kind}-{split}-{seed}-{number}", tract))
    return found


_PER_SEED = 1_000_000
"""Number of the generator's tracts that belong to one seed of the pool."""


RECIPES: dict[str, Recipe] = {
    "SteerAny": Recipe(
        Bounds(length=(0.4, 0.6), bend_radius=0.04, box=(0.18, 0.18, 0.05)), 275e3, "force", one_axis
    ),
    "Orient": Recipe(Bounds(), 55e3, "wrench", two_axes),
    "Chase": Recipe(Bounds(), 275e3, "wrench", following),
    "Dual": Recipe(Bounds(), 55e3, "wrench", two_magnets),
}  # fmt: skip
