"""Certify generated trees for the navigating tasks, and write down what is admitted with the runs that show it.

A tree is admitted if

1. the wire reaches the end of every branch, with 20 mm to spare;
2. from the inlet, a demonstration brings the tip to the end of every dead end;
3. from 30 mm inside every wrong branch of each of these ways, another one comes out and goes there;
4. no held command passes more than 40 % of its dead ends: the feed at full speed under each of the 14 directions of the
   moment of `agents.evaluation.directions`.

A demonstration is the first of the forest's `VARIANTS` of `FollowRoute` and `RecoverRoute` that gets there within the
task's time. In a task with a limit on the cost it must also stay below the limit if it starts at the inlet, as every
episode does. Its actions are rounded as they are stored and play in the simulator as they will be played back.

    python -m agents.evaluation.certified_trees --split test --size 100            # prints the rate of admission
    python -m agents.evaluation.certified_trees --split test --size 100 --write    # and puts them into the package
    python -m agents.evaluation.certified_trees --forest NarrowTrees --split test --size 40
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.envs import trees
from magwire_env.envs.navigation import end_of, inside, wrong_branches
from magwire_env.envs.task import TASKS
from magwire_env.lumen.generator import SPLITS
from magwire_env.progress import Progress
from magwire_env.scenario import Scenario

from ..controllers import FollowRoute, RecoverRoute
from .directions import DIRECTIONS

__all__ = ["VARIANTS", "Admission", "Run", "certify", "held_shares", "played", "task_of"]


def task_of(forest: str) -> str:
    """The id of the task that a forest is certified for: the first that draws from it."""
    return next(task.id for task in TASKS.values() if task.pool == forest)


_PLAIN: tuple[Callable[..., Any], ...] = (
    FollowRoute.from_env,
    RecoverRoute.from_env,
    partial(RecoverRoute.from_env, look=0.02, gain=4.0),
)

_SOFTER: tuple[Callable[..., Any], ...] = (
    *_PLAIN,
    partial(RecoverRoute.from_env, gain=1.0, press=0.1),
    partial(FollowRoute.from_env, gain=0.5, press=0.1),
)

VARIANTS = {"Trees": _PLAIN, "NarrowTrees": _SOFTER, "TreesInField": _SOFTER}
"""What demonstrates in a forest, tried in this order."""

MOST_HELD = 0.4
"""Share of a tree's dead ends that a held command may pass."""

_TOGETHER = 8
"""Candidates that are played side by side."""

_PATIENCE, _NEARER = 40, 1e-3
"""A run is given up after so many control periods in which the way left has not become less by so much, m."""

_HELD_PATIENCE = 12
"""The same of a held command, whose tip has not come farther."""


class Run(NamedTuple):
    """A run that is asked for: which of the scenarios, to which branch, from where ("inlet" or a branch's place)."""

    tree: int
    target: str
    start: str | tuple[str, float]


_Row = tuple[int, list[tuple[Run, np.ndarray]], Scenario]
"""A tree's number, its runs with their actions, and its scenario."""


@dataclass
class Admission:
    """What has become of the candidates.

    tried, fit, reached, recovered, steered : how many were played, and how many passed tests 1, 2, 3 and 4
    held : of the trees that passed the first three, the share of dead ends that the best held command passes, and that
        any of them passes
    """

    tried: int = 0
    fit: int = 0
    reached: int = 0
    recovered: int = 0
    steered: int = 0
    held: list[tuple[float, float]] = field(default_factory=list)

    def __str__(self) -> str:
        best, every = np.mean(self.held, axis=0) if self.held else (np.nan, np.nan)
        return (
            f"{self.tried} candidates; the wire is long enough in {self.fit}; every dead end demonstrated in "
            f"{self.reached}; and every recovery in {self.recovered}; no held command passes more than "
            f"{MOST_HELD:.0%} of the dead ends in {self.steered}: {self.steered / max(self.tried, 1):.0%} admitted. "
            f"The best held command passes {best:.0%} of a tree's dead ends in the mean, all {len(DIRECTIONS)} "
            f"together {every:.0%}"
        )


def played(
    scenarios: Sequence[Scenario],
    runs: Sequence[Run],
    variant: Callable[..., Any],
    most: int | None = None,
    forest: str = trees.TREES,
) -> list[np.ndarray | None]:
    """The actions (steps, 4) by which `variant` does each of the runs, side by side; None where it does not.

    most : control periods; by default the task's
    """
    env = _batch(scenarios, runs, forest)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    observation, _ = env.reset(seed=0, options=_options(scenarios, runs))
    policy, state = variant(env), None
    recovers = np.array([run.start != "inlet" for run in runs])
    n, begins = len(runs), np.ones(len(runs), dtype=np.bool_)
    over, done = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.int64)
    least, waited = np.full(n, np.inf), np.zeros(n)
    taken: list[np.ndarray] = []
    for step in range(1, (most or core.step_limit) + 1):
        action, state = policy.predict(observation, state, begins)
        begins = np.zeros(n, dtype=np.bool_)
        action = trees.rounded(np.where(over[:, None], 0.0, action))
        taken.append(action)
        info = core.step(action)[3]
        observation = core.observe()
        done[info["is_success"] & (core.navigation.within_limit | recovers) & ~over] = step
        left = core.sim.remaining
        nearer = left < least - _NEARER
        least, waited = np.where(nearer, left, least), np.where(nearer, 0, waited + 1)
        over |= info["is_success"] | (waited >= _PATIENCE)
        if over.all():
            break
    every = np.array(taken)
    return [every[:steps, i] if steps else None for i, steps in enumerate(done)]


def held_shares(scenarios: Sequence[Scenario], forest: str = trees.TREES) -> np.ndarray:
    """Dead ends that each held command passes on its way, (trees, commands, dead ends) padded with False."""
    lumens = [sc.tree for sc in scenarios]
    runs = [Run(i, tree.leaves[0], "inlet") for i, tree in enumerate(lumens) for _ in DIRECTIONS]
    env = _batch(scenarios, runs, forest)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    env.reset(seed=0, options=_options(scenarios, runs))
    action = np.zeros((len(runs), 4), dtype=np.float32)
    action[:, :3] = np.tile(np.array(DIRECTIONS), (len(lumens), 1))
    action[:, 3] = 1.0
    passed = np.zeros((len(lumens), len(DIRECTIONS), max(len(tree.leaves) for tree in lumens)), dtype=np.bool_)
    farthest, waited = np.zeros(len(runs)), np.zeros(len(runs))
    for _ in range(core.step_limit):
        core.step(np.where((waited < _HELD_PATIENCE)[:, None], action, 0.0).astype(np.float32))
        way = np.empty(len(runs))
        tips = core.sim.tip_position.reshape(len(lumens), len(DIRECTIONS), 3)
        for i, tree in enumerate(lumens):
            branch, s, _ = tree.project(tips[i])
            begins = np.array([tree.length_of((b.name, 0.0)) for b in tree.branches])
            way.reshape(len(lumens), -1)[i] = begins[branch] + s
            for k, name in enumerate(tree.leaves):
                number, goal = end_of(core.task, tree, name)
                passed[i, :, k] |= (branch == number) & (s >= goal)
        farther = way > farthest + _NEARER
        farthest, waited = np.where(farther, way, farthest), np.where(farther, 0, waited + 1)
        if (waited >= _HELD_PATIENCE).all():
            break
    return passed


def certify(split: str, size: int, seed: int = 0, forest: str = trees.TREES) -> tuple[trees.Shipped, Admission]:
    """The first `size` trees of a split and seed that pass, and what has become of the candidates."""
    rows: list[_Row] = []
    told, number = Admission(), 0
    with Progress(f"certifying {size} trees, split {split}", size) as progress:
        while len(rows) < size:
            made = [(k, trees.candidate(split, k, seed, forest)) for k in range(number, number + _TOGETHER)]
            told.tried += len(made)
            rows += _certified([(k, sc) for k, sc in made if sc is not None], told, forest)
            number += _TOGETHER
            progress.done = len(rows)
    return _shipped(rows[:size], told), told


def _certified(made: list[tuple[int, Scenario]], told: Admission, forest: str) -> list[_Row]:
    """Those of the numbered scenarios that pass tests 2, 3 and 4, with their runs."""
    told.fit += len(made)
    kept = _shown(made, lambda sc: [(name, "inlet") for name in sc.tree.leaves], forest)
    told.reached += len(kept)
    again = _shown([(k, sc) for k, _, sc in kept], _recoveries, forest)
    told.recovered += len(again)
    if not again:
        return []
    first = {k: runs for k, runs, _ in kept}
    passed = held_shares([sc for _, _, sc in again], forest)
    out = []
    for (k, runs, sc), by in zip(again, passed, strict=True):
        best, every = by.sum(axis=1).max() / len(sc.tree.leaves), by.any(axis=0).sum() / len(sc.tree.leaves)
        told.held.append((best, every))
        if best <= MOST_HELD:
            told.steered += 1
            out.append((k, first[k] + runs, sc))
    return out


def _recoveries(scenario: Scenario) -> list[tuple[str, Any]]:
    """Targets and starts, 30 mm inside each wrong branch of each target."""
    tree = scenario.tree
    return [
        (name, (tree.branches[wrong].name, round(inside(tree, wrong), 3)))
        for name in tree.leaves
        for wrong in wrong_branches(tree, name)
    ]


def _shown(
    made: list[tuple[int, Scenario]], asked: Callable[[Scenario], list[tuple[str, Any]]], forest: str
) -> list[_Row]:
    """The scenarios in which a demonstration does all that is asked, with the runs."""
    scenarios = [sc for _, sc in made]
    runs = [Run(i, *each) for i, sc in enumerate(scenarios) for each in asked(sc)]
    shown: dict[Run, np.ndarray] = {}
    for variant in VARIANTS[forest]:
        left = [run for run in runs if run not in shown]
        if not left:
            break
        found = played(scenarios, left, variant, forest=forest)
        shown |= {r: a for r, a in zip(left, found, strict=True) if a is not None}
    whole = [i for i in range(len(made)) if all(run in shown for run in runs if run.tree == i)]
    return [(made[i][0], [(run, shown[run]) for run in runs if run.tree == i], scenarios[i]) for i in whole]


def _batch(scenarios: Sequence[Scenario], runs: Sequence[Run], forest: str) -> gym.vector.VectorEnv:
    every = [scenarios[run.tree] for run in runs]
    return gym.make_vec(task_of(forest), num_envs=len(runs), scenario=every, autoreset_mode="Disabled")


def _options(scenarios: Sequence[Scenario], runs: Sequence[Run]) -> dict[str, Any]:
    home = [[dof.home for dof in scenarios[run.tree].rig.dofs] for run in runs]
    return {
        "target": [run.target for run in runs], "start": [run.start for run in runs], "magnet_angle": np.array(home),
    }  # fmt: skip


def _shipped(rows: list[_Row], told: Admission) -> trees.Shipped:
    runs = [(run, actions, sc.tree) for _, every, sc in rows for run, actions in every]
    starts = [(-1, 0.0) if run.start == "inlet" else (tree.index(run.start[0]), run.start[1]) for run, _, tree in runs]
    return trees.Shipped(
        numbers=np.array([number for number, _, _ in rows], dtype=np.int32),
        tried=np.array(told.tried),
        first=np.cumsum([0, *(len(every) for _, every, _ in rows)]).astype(np.int32),
        target=np.array([tree.index(run.target) for run, _, tree in runs], dtype=np.int8),
        start=np.array([branch for branch, _ in starts], dtype=np.int8),
        depth=np.array([round(1e3 * float(s)) for _, s in starts], dtype=np.int8),
        steps=np.array([len(actions) for _, actions, _ in runs], dtype=np.int16),
        actions=np.concatenate([trees.stored(actions) for _, actions, _ in runs]),
    )


def main() -> None:
    """Print the rate of admission."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.evaluation.certified_trees", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--forest", choices=tuple(trees.FORESTS), default=trees.TREES)
    parser.add_argument("--split", choices=SPLITS, default="test")
    parser.add_argument("--size", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="put the trees into the package, in place of this split's")
    options = parser.parse_args()
    found, told = certify(options.split, options.size, options.seed, options.forest)
    runs = f"{len(found.steps)} runs of {found.steps.sum()} control periods"
    print(f"{options.forest}, {options.split}, seed {options.seed}: {told}; {runs}")
    if options.write:
        file = trees.FORESTS[options.forest].file
        sets = trees.load(file) if file.exists() else {}
        trees.save({**sets, f"{options.split}-{options.seed}": found}, file)


if __name__ == "__main__":
    main()
