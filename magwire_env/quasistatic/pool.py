"""Pools of certified scenarios: generated tracts under the rigs of the tasks, only those that can be steered.

Kinds whose name ends in "v1" are those of the tasks' second versions: no held command crosses their tracts, see `held`.
``python -m magwire_env.quasistatic.pool`` prints how many of a kind's candidates are admitted.

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

import argparse
import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..lumen.curve import Tract
from ..lumen.generator import SPLITS, Bounds, generate
from ..physics.checks import one_of, whole
from ..progress import Progress
from ..scenario import Rig, Scenario
from ..words import counted
from .certificate import Certificate, certify
from .held import crossed_by_holding
from .kept_pools import name_of, read_pool, write_pool
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
    steered : only tracts that no held command crosses
    weakest : N; only tracts whose margin is somewhere less than this
    time_limit : s, of the certificates; that of the tasks
    harder : bounds of the split "ood": wanders like those of the other splits, but longer and with sharper bends. By
        default "ood" has the generator's own other families, which turned out to be easier than "test"
    """

    bounds: Bounds
    bending_modulus: float
    coupling: str
    rig: Callable[[Tract], Rig]
    steered: bool = False
    weakest: float = math.inf
    time_limit: float = 60.0
    harder: Bounds | None = None

    def scenario(self, name: str, tract: Tract) -> Scenario:
        """The scenario of a tract."""
        base = paper()
        wire = dataclasses.replace(base.wire, bending_modulus=self.bending_modulus)
        return Scenario(name, tract, wire, base.tip, self.rig(tract), base.contact, self.coupling)


@dataclass(frozen=True, eq=False)
class Pool:
    """Certified scenarios.

    scenarios, certificates : a certificate for each scenario
    tried, certified : number of candidates generated, and of those certified
    """

    scenarios: tuple[Scenario, ...]
    certificates: tuple[Certificate, ...]
    tried: int
    certified: int

    @property
    def acceptance(self) -> float:
        """Share of the candidates that are admitted."""
        return len(self.scenarios) / self.tried


@lru_cache(maxsize=16)
def scenario_pool(kind: str, split: str = "train", size: int = 100, seed: int = 0) -> tuple[Scenario, ...]:
    """`size` certified scenarios of a kind of task, see `build_pool`; they are kept on disk for the next process."""
    recipe, size = RECIPES[one_of("kind", kind, tuple(RECIPES))], whole("size", size, 1)
    found = read_pool(kind, recipe, one_of("split", split, SPLITS), size, whole("seed", seed, 0))
    if found is None:
        found = build_pool(kind, split, size, seed).scenarios
        write_pool(kind, recipe, split, size, seed, found)
    return found


@lru_cache(maxsize=16)
def build_pool(kind: str, split: str = "train", size: int = 100, seed: int = 0) -> Pool:
    """A pool of certified scenarios; a process builds each pool once.

    kind : one of `RECIPES`; see the table of this module
    split : "train", "test" or "ood", see `lumen.generator.generate`
    size : number of scenarios; a smaller pool is the beginning of a larger one
    seed : of the pool; pools of different seeds share no tract
    """
    size = whole("size", size, 1)
    scenarios: list[Scenario] = []
    certificates: list[Certificate] = []
    first = certified = 0
    with Progress(f"certifying {counted(size, 'scenario')} of {kind}, split {split}", size) as progress:
        while True:
            batch = candidates(kind, split, _TOGETHER, seed, first)
            every = certify(batch, time_limit=RECIPES[kind].time_limit)
            admitted = _admitted(RECIPES[kind], batch, every)
            for i, (sc, found) in enumerate(zip(batch, every, strict=True)):
                certified += found.solvable
                if admitted[i]:
                    scenarios.append(sc)
                    certificates.append(found)
                if len(scenarios) == size:
                    return Pool(tuple(scenarios), tuple(certificates), first + i + 1, certified)
            progress.done = len(scenarios)
            first += _TOGETHER
            if first > _MOST_TRIES * size + 1000:
                raise ValueError(
                    f"kind {kind!r} in split {split!r} gave {len(scenarios)} of {counted(size, 'scenario')} "
                    f"in {first} tries"
                )


def _admitted(recipe: Recipe, batch: list[Scenario], every: list[Certificate]) -> np.ndarray:
    """Which candidates a pool takes, (n,)."""
    admitted = np.array([found.solvable and found.weakest[1] < recipe.weakest for found in every])
    if recipe.steered and admitted.any():
        rows = np.flatnonzero(admitted)
        admitted[rows] = ~crossed_by_holding([batch[i] for i in rows], [every[i] for i in rows])
    return admitted


def candidates(kind: str, split: str, count: int, seed: int = 0, first: int = 0) -> list[Scenario]:
    """Scenarios that are not certified yet: `count` of a pool's candidates, from number `first` on."""
    made = RECIPES[one_of("kind", kind, tuple(RECIPES))]
    one_of("split", split, SPLITS)
    seed = whole("seed", seed, 0)
    found = []
    for number in range(first, first + count):
        if split == "ood" and made.harder is not None:
            tract = generate(_PER_SEED * seed + number, "test", made.harder)
        else:
            tract = generate(_PER_SEED * seed + number, split, made.bounds)
        found.append(made.scenario(name_of(kind, split, seed, number), tract))
    return found


_PER_SEED = 1_000_000
"""Number of the generator's tracts that belong to one seed of the pool."""


_SHORT = Bounds(length=(0.4, 0.6), bend_radius=0.04, box=(0.18, 0.18, 0.05))

_LONGER = Bounds(length=(0.6, 0.75), bend_radius=0.036, box=(0.2, 0.2, 0.05))

RECIPES: dict[str, Recipe] = {
    "SteerAny": Recipe(_SHORT, 275e3, "force", one_axis),
    "Orient": Recipe(Bounds(), 55e3, "wrench", two_axes),
    "Chase": Recipe(Bounds(), 275e3, "wrench", following),
    "Dual": Recipe(Bounds(), 55e3, "wrench", two_magnets),
    "SteerAny-v1": Recipe(_SHORT, 275e3, "force", one_axis, steered=True, time_limit=20.0, harder=_LONGER),
    "Hard-v1": Recipe(_SHORT, 275e3, "force", one_axis, steered=True, weakest=0.3e-3, time_limit=30.0, harder=_LONGER),
}  # fmt: skip


def main() -> None:
    """Print how many candidates of a kind are certified and how many are admitted."""
    parser = argparse.ArgumentParser(prog="python -m magwire_env.quasistatic.pool", description=main.__doc__)
    parser.add_argument("--kind", choices=list(RECIPES), default="SteerAny-v1")
    parser.add_argument("--split", choices=SPLITS, default="test")
    parser.add_argument("--size", type=int, default=100)
    options = parser.parse_args()
    pool = build_pool(options.kind, options.split, options.size)
    weakest = 1e3 * np.array([c.weakest[1] for c in pool.certificates])
    print(
        f"{options.kind}, {options.split}: {pool.tried} candidates, {pool.certified} certified "
        f"({pool.certified / pool.tried:.0%}), {len(pool.scenarios)} admitted ({pool.acceptance:.0%}); weakest margin "
        f"{np.median(weakest):.2f} mN in the median, {weakest.min():.2f} to {weakest.max():.2f}"
    )


if __name__ == "__main__":
    main()
