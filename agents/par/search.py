"""An independent search for faster plans than the par: cross-entropy over rollouts.

``python -m agents.par.search --task MagWire/Chase-v0`` prints by how much it beats the par, episode by episode. It
shares nothing with the par's own refinement but the simulator and the env's verdict.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from magwire_env.envs.task import TASKS
from magwire_env.physics.checks import whole

from ..evaluation.episodes import EVALUATION_SEED
from .bracket import _batch
from .cache import Cache
from .planner import best_plans
from .refinement import Refinement
from .starts import Starts, actions_of, commands_of
from .trials import Trials

__all__ = ["CrossEntropy", "gains", "main"]


@dataclass(frozen=True)
class CrossEntropy:
    """Settings of the search.

    samples, elites : plans of a round, and how many of them the next round is drawn about
    rounds : at most
    knots : control periods between the points at which commands are moved; linear between them
    spread : first standard deviation, in servo travels of a control period
    seed : of the samples
    """

    samples: int = 64
    elites: int = 8
    rounds: int = 60
    knots: int = 5
    spread: float = 1.0
    seed: int = 1

    def __post_init__(self) -> None:
        for name, least in (("samples", 8), ("elites", 2), ("rounds", 1), ("knots", 1), ("seed", 0)):
            whole(f"CrossEntropy.{name}", getattr(self, name), least)


def searched(starts: Starts, actions: np.ndarray, settings: CrossEntropy) -> np.ndarray:
    """The least values (n,) found about plans (n, H, dof), see `Outcome.value`; never worse than the plans' own."""
    trials, rng, best = Trials(starts), np.random.default_rng(settings.seed), np.empty(len(starts))
    turns, pace = starts.library.is_turn, starts.library.limits.speed * starts.period
    for i in range(len(starts)):
        row = np.array([i])
        first = trials.run(row, actions[i : i + 1])
        horizon = int(first.steps[0])
        course = commands_of(starts.library, starts.entries[row], actions[i : i + 1, :horizon])[0]
        course[:, turns] = np.unwrap(course[:, turns], axis=0)
        count = horizon // settings.knots + 2
        at = np.arange(horizon) / settings.knots
        hats = np.maximum(1.0 - np.abs(at[:, None] - np.arange(count)), 0.0)
        mean = np.zeros((count, starts.library.dof))
        spread = np.broadcast_to(settings.spread * pace[starts.entries[i]], mean.shape).copy()
        best[i] = first.value[0]
        for _ in range(settings.rounds):
            moved = mean + spread * rng.standard_normal((settings.samples, *mean.shape))
            moved[0] = mean
            plans = course + np.einsum("hk,pkd->phd", hats, moved)
            many = np.repeat(row, settings.samples)
            value = trials.run(many, actions_of(starts.library, starts.entries[many], plans)).value
            order = value.argsort()[: settings.elites]
            best[i] = min(best[i], value[order[0]])
            mean, spread = 0.3 * mean + 0.7 * moved[order].mean(axis=0), 0.3 * spread + 0.7 * moved[order].std(axis=0)
    return best


def gains(
    task: str,
    episodes: int,
    settings: CrossEntropy | None = None,
    refinement: Refinement | None = None,
    cache: Cache | None = None,
) -> np.ndarray:
    """By what share the search beats the par of the evaluation's first episodes, (n,); 0 where it does not."""
    n = whole("episodes", episodes, 1)
    env = _batch(task, n, None)
    env.reset(seed=EVALUATION_SEED)
    starts = Starts.of(env.core, np.arange(n))
    plans = best_plans(starts, Refinement() if refinement is None else refinement, cache)
    par = Trials(starts).run(np.arange(n), plans.actions).value
    return 1.0 - searched(starts, plans.actions, CrossEntropy() if settings is None else settings) / par


def main() -> None:
    """Print by how much the search beats the par of a task's first evaluation episodes."""
    parser = argparse.ArgumentParser(prog="python -m agents.par.search", description=main.__doc__)
    parser.add_argument("--task", choices=list(TASKS), default="MagWire/Chase-v0")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=CrossEntropy.rounds)
    options = parser.parse_args()
    found = gains(options.task, options.episodes, CrossEntropy(rounds=options.rounds), cache=Cache())
    print(
        f"{options.task}: {(found > 3e-3).sum()} of {len(found)} pars beaten by more than 0.3 %, "
        f"{(found > 5e-3).sum()} by more than 0.5 %; largest {found.max():.2%}, mean {found.mean():.2%}"
    )


if __name__ == "__main__":
    main()
