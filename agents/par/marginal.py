"""A search for counterexamples to the bound: rides of marginal scenarios, held against the least times.

``python -m agents.par.marginal --scenarios 500`` draws scenarios whose friction is such that the wire barely gets
through, or barely does not, finds fast rides through them, and counts the rides that are faster than the bound allows.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from magwire_env.envs.vector_env import MagWireVectorEnv
from magwire_env.physics.checks import whole
from magwire_env.progress import Progress
from magwire_env.quasistatic.certificate import certify
from magwire_env.quasistatic.pool import candidates
from magwire_env.scenario import Scenario

from ..controllers import MaxForce, NetForce
from ..evaluation.episodes import EVALUATION_SEED
from .bracket import least_times
from .refinement import Refinement, refine
from .seeds import by_controller, by_dynamic_programming
from .starts import Starts
from .trials import Trials

__all__ = ["Marginal", "compare", "main", "marginal_scenarios"]

_MARGINS = (-450e-6, 200e-6)
"""The weakest margin of a certificate lies between these, N: the range in which pars once lay below the bound."""

_MOST_FRICTION = 0.25
_HALVINGS = 12
_TOGETHER = 32
_TIME_LIMIT = 120.0
"""s; a wire that creeps where the balance says that it is held needs long."""

_REFINED = Refinement(samples=12, rounds=20, patience=20)


@dataclass(frozen=True, eq=False)
class Marginal:
    """Rides of n marginal scenarios beside their bounds.

    friction : (n,); margin : (n,) N, the weakest of the certificate, with which the scenario was drawn
    bound : (n,) s, in which no policy can arrive
    time : (n,) s, of the fastest ride found; NaN where none arrives
    """

    friction: np.ndarray
    margin: np.ndarray
    bound: np.ndarray
    time: np.ndarray

    @property
    def below(self) -> np.ndarray:
        """Where a ride is faster than its bound (n,): a counterexample."""
        return self.time < self.bound


def marginal_scenarios(count: int, seed: int = 0) -> tuple[list[Scenario], np.ndarray]:
    """Scenarios with the weakest margins drawn from a range about 0, and these margins (count,) N.

    Half of those drawn are the paper's with its magnet moved by up to 5 mm along each axis. The others are candidates
    of SteerAny's pool, certified or not. Friction is what brings the margin to the value drawn; a scenario that no
    friction from 0 to 0.25 brings there is left out, and the next one is tried.
    """
    rng = np.random.default_rng([whole("seed", seed, 0), 19])
    found: list[Scenario] = []
    margins: list[float] = []
    number, each = 0, min(_TOGETHER, count)
    while len(found) < count:
        drawn = _paper_variants(rng, each) + candidates("SteerAny", "test", each, seed, number)
        number += each
        wanted = rng.uniform(*_MARGINS, len(drawn))
        low, high = np.zeros(len(drawn)), np.full(len(drawn), _MOST_FRICTION)
        bracketed = (_weakest(drawn, low) > wanted) & (_weakest(drawn, high) < wanted)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            above = _weakest(drawn, middle) > wanted
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        at = 0.5 * (low + high)
        met = _weakest(drawn, at)
        for i in np.flatnonzero(bracketed):
            found.append(drawn[i].replace(contact__friction=float(at[i])))
            margins.append(float(met[i]))
    return found[:count], np.array(margins[:count])


def _paper_variants(rng: np.random.Generator, count: int) -> list[Scenario]:
    paper = Scenario.paper()
    place = np.array(paper.rig.magnets[0].position)
    return [paper.replace(rig=paper.rig.moved(tuple(place + rng.uniform(-5e-3, 5e-3, 3)))) for _ in range(count)]


def _weakest(scenarios: Sequence[Scenario], friction: np.ndarray) -> np.ndarray:
    """The weakest margin of every scenario (n,) N at these frictions (n,), from 0.1 m on."""
    rubbed = [sc.replace(contact__friction=float(mu)) for sc, mu in zip(scenarios, friction, strict=True)]
    return np.array([c.weakest[1] for c in certify(rubbed, start=0.1)])


def compare(scenarios: Sequence[Scenario], margin: np.ndarray, settings: Refinement = _REFINED) -> Marginal:
    """Fast rides of these scenarios (dynamic programming, NetForce, MaxForce, then refinement) beside the bounds."""
    n = len(scenarios)
    bound, time = np.empty(n), np.full(n, np.nan)
    with Progress("rides of marginal scenarios", n) as progress:
        for first in range(0, n, _TOGETHER):
            part = slice(first, min(first + _TOGETHER, n))
            envs = MagWireVectorEnv(
                part.stop - first, "MagWire/Steer-v0", scenario=list(scenarios[part]), time_limit=_TIME_LIMIT
            )
            envs.reset(seed=EVALUATION_SEED + first)
            starts = Starts.of(envs.core, np.arange(envs.num_envs))
            bound[part] = least_times(starts)
            time[part] = _fastest(starts, settings)
            progress.done += envs.num_envs
    friction = np.array([sc.contact.friction for sc in scenarios])
    return Marginal(friction, np.asarray(margin), bound, time)


def _fastest(starts: Starts, settings: Refinement) -> np.ndarray:
    """Time of the best ride of every episode (n,) s; NaN where none arrives."""
    trials, rows = Trials(starts), np.arange(len(starts))
    plans = [by_dynamic_programming(trials), *(by_controller(starts, c.from_env) for c in (NetForce, MaxForce))]
    values = np.stack([trials.run(rows, actions).value for actions in plans])
    best = np.stack(plans)[values.argmin(axis=0), rows]
    arrived = np.flatnonzero(np.isfinite(trials.run(rows, best).time))
    if arrived.size:  # a ride that never arrives is no counterexample, and costs the whole time limit to refine
        best[arrived] = refine(Trials(starts[arrived]), best[arrived], settings)[0]
    return trials.run(rows, best).time


def main() -> None:
    """Draw marginal scenarios, and print how many rides are faster than the bound allows."""
    parser = argparse.ArgumentParser(prog="python -m agents.par.marginal", description=main.__doc__)
    parser.add_argument("--scenarios", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    found = compare(*marginal_scenarios(whole("scenarios", options.scenarios, 1), options.seed))
    arrived = np.isfinite(found.time)
    print(
        f"{len(found.time)} marginal scenarios: friction {found.friction.min():.3f} to {found.friction.max():.3f}, "
        f"weakest margin {1e6 * found.margin.min():.0f} to {1e6 * found.margin.max():.0f} µN"
    )
    blocked = arrived & (found.margin < 0.0)
    print(f"{arrived.sum()} rides arrive, {blocked.sum()} of them where the balance lacks force somewhere")
    if arrived.any():
        gaps = found.time[arrived] / found.bound[arrived] - 1.0
        print(f"time over bound: least {gaps.min():+.2%}, median {np.median(gaps):+.2%}, largest {gaps.max():+.2%}")
    print(f"{found.below.sum()} rides are faster than their bound")
    for i in np.flatnonzero(found.below):
        print(
            f"  number {i}: friction {found.friction[i]:.4f}, margin {1e6 * found.margin[i]:.0f} µN, "
            f"ride {found.time[i]:.3f} s, bound {found.bound[i]:.3f} s"
        )


if __name__ == "__main__":
    main()
