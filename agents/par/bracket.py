"""The par as a bracket: for every episode a time that no policy beats, and the time of the best plan found."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from magwire_env.envs.task import TASKS, Task
from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.physics.checks import whole
from magwire_env.scenario import Scenario

from ..evaluation.episodes import EVALUATION_SEED
from .bound import Fastest
from .cache import Cache
from .planner import best_plans
from .refinement import Refinement
from .starts import Starts

__all__ = ["Bracket", "bracket", "brackets", "least_times", "main", "nominal"]


@dataclass(frozen=True, eq=False)
class Bracket:
    """Bounds on the least possible time of n episodes.

    lower : (n,) s, no policy is faster; 0 where nothing is known
    upper : (n,) s (in a tracking task m of RMS error), of the best plan found; NaN if no plan succeeds
    """

    lower: np.ndarray
    upper: np.ndarray

    @property
    def gap(self) -> np.ndarray:
        """upper / lower − 1, (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.upper / self.lower - 1.0


def least_times(starts: Starts) -> np.ndarray:
    """Times (n,) s in which no policy can finish these episodes; 0 in a tracking task.

    A target must be held within its tolerance at the end of every substep, for `Task.hold_periods` whole control
    periods on end. So the tip is within the near edge of the tolerance by the end of the first substep of the first of
    these periods, and the episode ends with the last of them (docs/par.md, equation 8). Where the tip must come back,
    the bounds of the two ways add up (9).
    """
    fastest: dict[tuple[int, int], Fastest] = {}
    least = np.zeros(len(starts))
    library, task = starts.library, starts.task
    for i in range(len(starts) if not task.kind.follows else 0):
        entry, tip, goal = int(starts.entries[i]), float(starts.tip[i]), float(starts.goal[i])
        direction = 1 if goal > tip else -1
        if task.kind.holds:
            goal -= direction * task.tolerance
        if (entry, direction) not in fastest:
            fastest[entry, direction] = Fastest(starts.library.scenarios[entry], direction)
        if direction * (goal - tip) > 0.0:
            magnet = float(starts.magnet[i, 0]) if starts.magnet.shape[1] == 1 else None
            least[i] = fastest[entry, direction].least(tip, goal, magnet)
        if task.kind.returns:
            # The tip passes the far goal forwards, so it sets off from rest on its way back, there or farther on.
            if (entry, -1) not in fastest:
                fastest[entry, -1] = Fastest(starts.library.scenarios[entry], -1)
            least[i] += fastest[entry, -1].least(goal, float(starts.final[i]))
        if task.kind.holds:
            period = library.control_period
            last = least[i] / period - 1.0 / library.substeps + task.hold_periods(period)
            least[i] = np.ceil(last - 1e-9) * period
    return least


def brackets(starts: Starts, settings: Refinement | None = None, cache: Cache | None = None) -> Bracket:
    """The bracket of each of these episodes."""
    plans = best_plans(starts, Refinement() if settings is None else settings, cache)
    return Bracket(least_times(starts), plans.time)


def nominal(
    scenario: Scenario, task: str | Task = "MagWire/Steer-v0", settings: Refinement | None = None,
    cache: Cache | None = None,
) -> Bracket:  # fmt: skip
    """The bracket of a steering task with the tip at the wire's length and the magnets at their best, then at home."""
    env = _batch(task, 2, [scenario, scenario])
    if not env.core.task.kind.passes:
        raise ValueError(f"task must be a steering task to have a nominal start, got {env.core.task.id!r}")
    fastest, tip = Fastest(scenario), scenario.wire.length
    best = fastest.commands[int(np.abs(fastest.places - tip).argmin())]
    home = np.array([dof.home for dof in scenario.rig.dofs])
    env.reset(seed=0, options={"tip_arclength": tip, "magnet_angle": np.stack([best, home])})
    return brackets(Starts.of(env.core, np.arange(2)), settings, cache)


def bracket(
    scenario: Scenario | str | Sequence[Scenario] | None = None, task: str | Task = "MagWire/Steer-v0",
    episodes: int = 200, seed: int = EVALUATION_SEED, settings: Refinement | None = None, cache: Cache | None = None,
) -> Bracket:  # fmt: skip
    """The bracket of the evaluation's first `episodes` starts.

    scenario : one for all episodes or one each; by default the task's, and in a generated task the first scenarios of
        the test split, each once
    """
    n = whole("episodes", episodes, 1)
    env = _batch(task, n, scenario)
    env.reset(seed=seed)
    return brackets(Starts.of(env.core, np.arange(n)), settings, cache)


def _batch(task: str | Task, n: int, scenario: Any) -> MagWireVectorEnv:
    named = TASKS.get(task) if isinstance(task, str) else task
    if scenario is None and named is not None and named.pool is not None:
        from magwire_env.quasistatic.pool import scenario_pool

        scenario = list(scenario_pool(named.pool, "test", n))
    return MagWireVectorEnv(n, task, scenario=scenario)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the bracket of a task, or of a scenario under it."""
    parser = argparse.ArgumentParser(prog="python -m agents.par", description=main.__doc__)
    parser.add_argument("--task", choices=list(TASKS), default="MagWire/Steer-v0")
    parser.add_argument("--scenario", help="TOML file or shipped name; by default the task's own")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=Refinement.rounds, help="of refinement")
    parser.add_argument("--cache", help="folder of plans; by default the user's")
    parser.add_argument("--no-cache", action="store_true")
    options = parser.parse_args(arguments)
    cache = None if options.no_cache else Cache(options.cache)
    settings, task = Refinement(rounds=options.rounds), TASKS[options.task]
    scenario = Scenario.load(options.scenario) if options.scenario else task.scenario() if task.scenario else None
    print(f"{options.task}, scenario {scenario.name if scenario else 'of the test split, one an episode'}")
    print(f"{'start':52} {'lower':>9} {'upper':>9} {'gap':>7}")
    unit = "m" if task.kind.follows else "s"
    if scenario is not None and task.kind.passes:
        found = nominal(scenario, task, settings, cache)
        for i, where in enumerate(("at their best", "at home")):
            _line(f"tip at {scenario.wire.length:.3f} m, magnets {where}", found.lower[i], found.upper[i], unit)
    found = bracket(scenario, task, options.episodes, settings=settings, cache=cache)
    reached = np.isfinite(found.upper)
    lower, upper = found.lower[reached], found.upper[reached]
    if reached.any():
        _line(
            f"mean of {options.episodes} evaluation starts, {reached.mean():.1%} reached",
            lower.mean(),
            upper.mean(),
            unit,
        )
    if reached.any() and not task.kind.follows:
        gaps = found.gap[reached]
        print(f"gap over these starts: mean {gaps.mean():.2%}, median {np.median(gaps):.2%}, largest {gaps.max():.2%}")


def _line(what: str, lower: float, upper: float, unit: str) -> None:
    gap = f"{upper / lower - 1.0:7.2%}" if lower > 0.0 else f"{'–':>7}"
    print(f"{what:52} {lower:7.4f} {unit} {upper:7.4f} {unit} {gap}")
