"""Trees that navigating tasks draw from: generated, certified by demonstrations in the simulator, and shipped.

A tree is a vessel-like one of `magwire_env.lumen.random_trees`, in one of the `FORESTS`. What was admitted stands in a
file beside this module: the generator's number of every tree, and for every dead end the actions of a run that brings
the tip there. The walls follow from the numbers. ``python -m agents.evaluation.certified_trees`` made the files, and
says what a tree must pass.

| forest | split | dead ends | trunk's radius | least radius | forks |
|---|---|---|---|---|---|
| Trees, TreesInField | train, test | 3–5 | 9–11 mm | 5 mm | in two, by Murray's law |
| Trees | ood | 5–6 | 8–9.5 mm | 4 mm | wider by a fifth to nearly half, a third of them in three; branches wind more |
| NarrowTrees | train, test | 3–5 | 6.5–8 mm | 4 mm | in two, by Murray's law |
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..lumen import Lumen
from ..lumen.generator import SPLITS
from ..lumen.random_trees import TreeBounds, grow
from ..physics.checks import one_of, whole
from ..scenario import Scenario
from .arenas import WIRE_IN_TREES, in_narrow_tree, in_tree, in_tree_with_coils

__all__ = [
    "FORESTS",
    "TREES",
    "Demonstration",
    "Forest",
    "Shipped",
    "candidate",
    "demonstrations",
    "load",
    "rounded",
    "save",
    "stored",
    "tree_pool",
]

_BOX = (0.26, 0.26, 0.09)
_WIDE = TreeBounds(leaves=(3, 5), radius=(9e-3, 11e-3), bend=4.0, box=_BOX, narrowest=5e-3, length=(5.0, 10.0))
_ODD = TreeBounds(leaves=(5, 6), radius=(8e-3, 9.5e-3), bend=6.0, box=_BOX, narrowest=4e-3, length=(6.0, 10.0))
_NARROW = TreeBounds(leaves=(3, 5), radius=(6.5e-3, 8e-3), bend=4.0, box=_BOX, narrowest=4e-3, length=(6.0, 12.0))


@dataclass(frozen=True)
class Forest:
    """A family of trees, and the rig that it is certified with.

    bounds : what the generator keeps to, by split; out of distribution bends may be twice as sharp as `bend` says
    arena : the scenario in a tree
    file : what was admitted
    """

    bounds: Mapping[str, TreeBounds]
    arena: Callable[[Lumen], Scenario]
    file: Path


_HERE = Path(__file__).parent

TREES = "Trees"
"""The forest of NavigateAny and Recover."""

FORESTS = {
    TREES: Forest({"train": _WIDE, "test": _WIDE, "ood": _ODD}, in_tree, _HERE / "trees.npz"),
    "NarrowTrees": Forest({"train": _NARROW, "test": _NARROW}, in_narrow_tree, _HERE / "narrow_trees.npz"),
    "TreesInField": Forest({"train": _WIDE, "test": _WIDE}, in_tree_with_coils, _HERE / "trees_in_field.npz"),
}
"""The forests by the name that a task's pool has."""

_PER_SEED = 1_000_000
"""Number of the generator's trees that belong to one seed of the pool."""

_SPARE = 0.02
"""m of wire that is left when the tip stands at the end of the farthest branch."""

_FULL = 127
"""What a number of an action is stored as, a whole number from −127 to 127, is this many times itself."""


@dataclass(frozen=True, eq=False)
class Demonstration:
    """A run that certifies a tree: from a start to the end of a branch.

    target : the branch
    start : "inlet", or (branch, arc length in m) where the tip lies at first
    actions : (steps, 4) float32 of the action mode "moment", one a control period
    """

    target: str
    start: str | tuple[str, float]
    actions: np.ndarray

    def options(self, scenario: Scenario) -> dict:
        """What `reset(options=…)` must be told for the actions to do in `scenario` what they did."""
        home = np.array([dof.home for dof in scenario.rig.dofs])
        return {"target": self.target, "start": self.start, "magnet_angle": home}


@dataclass(frozen=True, eq=False)
class Shipped:
    """The certified trees of one split and seed.

    numbers : (trees,) of the generator, ascending
    tried : how many candidates it took
    first : (trees + 1,) rows of the arrays below that are each tree's own
    target : (runs,) number of the branch; `start` (runs,) of the branch that the tip starts in, −1: the inlet
    depth : (runs,) mm, how far inside
    steps : (runs,) control periods
    actions : (all steps, 4) int8, `_FULL` times the action
    """

    numbers: np.ndarray
    tried: np.ndarray
    first: np.ndarray
    target: np.ndarray
    start: np.ndarray
    depth: np.ndarray
    steps: np.ndarray
    actions: np.ndarray

    def runs(self, tree: int) -> Iterator[tuple[int, int, float, np.ndarray]]:
        """Target, start, depth (m) and actions (steps, 4) float32 of a tree's runs."""
        ends = np.concatenate([[0], np.cumsum(self.steps)])
        for row in range(self.first[tree], self.first[tree + 1]):
            actions = self.actions[ends[row] : ends[row + 1]].astype(np.float32) / _FULL
            yield int(self.target[row]), int(self.start[row]), 1e-3 * float(self.depth[row]), actions


def rounded(action: np.ndarray) -> np.ndarray:
    """Actions as they can be stored: whole multiples of 1/127, float32."""
    return (np.rint(_FULL * np.clip(action, -1.0, 1.0)) / _FULL).astype(np.float32)


def stored(actions: np.ndarray) -> np.ndarray:
    """Rounded actions as whole numbers, int8."""
    return np.rint(_FULL * actions).astype(np.int8)


def candidate(split: str, number: int, seed: int = 0, forest: str = TREES) -> Scenario | None:
    """The scenario of a tree that may or may not be certified; None where the wire is too short for a branch.

    split : "train", "test" or, of `TREES`, "ood"
    number, seed : of the tree, and of the pool; pools of different seeds share no tree
    forest : of `FORESTS`
    """
    of = FORESTS[one_of("forest", forest, tuple(FORESTS))]
    bounds = of.bounds[one_of("split", split, tuple(of.bounds))]
    tree = grow(_PER_SEED * whole("seed", seed, 0) + whole("number", number, 0), split, "vessels", bounds)
    if max(tree.length_of(name) for name in tree.leaves) > WIRE_IN_TREES - _SPARE:
        return None
    return of.arena(tree)


@lru_cache(maxsize=16)
def tree_pool(split: str = "train", size: int = 64, seed: int = 0, forest: str = TREES) -> tuple[Scenario, ...]:
    """`size` certified scenarios; where fewer are shipped they come round again.

    split : "train", "test" or, of `TREES`, "ood"
    size : a smaller pool is the beginning of a larger one
    seed : 0, or 1 with the split "train": trees that choose among policies while they train
    forest : of `FORESTS`

    Raises `ValueError` for a split and seed of which none are shipped.
    """
    size, found = whole("size", size, 1), _shipped(split, seed, forest)
    once = [candidate(split, int(number), seed, forest) for number in found.numbers[:size]]
    made = [sc for sc in once if sc is not None]
    return tuple(made[i % len(made)] for i in range(size))


def demonstrations(
    split: str = "train", index: int = 0, seed: int = 0, forest: str = TREES
) -> tuple[Demonstration, ...]:
    """The runs that certify scenario `index` of `tree_pool`: from the inlet into every dead end, then from 30 mm inside
    every wrong branch of each of these ways.

    >>> [run.target for run in demonstrations("test", 0) if run.start == "inlet"]
    ['b3', 'b4', 'b6', 'b7', 'b8']
    """
    found = _shipped(split, seed, forest)
    scenario = tree_pool(split, 1 + whole("index", index, 0), seed, forest)[-1]
    names = [branch.name for branch in scenario.tree.branches]
    return tuple(
        Demonstration(names[target], "inlet" if start < 0 else (names[start], depth), actions)
        for target, start, depth, actions in found.runs(index % len(found.numbers))
    )


def load(file: Path = FORESTS[TREES].file) -> dict[str, Shipped]:
    """What a file holds, by "split-seed"."""
    with np.load(file, allow_pickle=False) as stored:
        names = sorted({key.partition("/")[0] for key in stored.files})
        return {
            name: Shipped(**{field: stored[f"{name}/{field}"] for field in Shipped.__dataclass_fields__})
            for name in names
        }


def save(sets: dict[str, Shipped], file: Path = FORESTS[TREES].file) -> None:
    """Write a file that `load` reads."""
    np.savez_compressed(
        file,
        **{f"{name}/{field}": getattr(found, field) for name, found in sets.items() for field in vars(found)},  # type: ignore[arg-type]
    )


_loaded = lru_cache(maxsize=len(FORESTS))(load)


def _shipped(split: str, seed: int, forest: str) -> Shipped:
    sets = _loaded(FORESTS[one_of("forest", forest, tuple(FORESTS))].file)
    name = f"{one_of('split', split, SPLITS)}-{whole('seed', seed, 0)}"
    if name not in sets:
        raise ValueError(f"split and seed must be of certified trees, {', '.join(sets)}; got {name}")
    return sets[name]
