"""An experiment on certificates: do certified wires reach their goals, and do refused ones stop where they should?

``python -m agents.benchmark.certificates`` prints it at full size: 500 certified and 200 refused scenarios of the test
split.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.quasistatic.pool import RECIPES, candidates
from magwire_env.scenario import Scenario
from magwire_env.simulation import Certificate, certify

from ..catalogue import CONTROLLERS
from ..controllers import Controller, MaxForce, NetForce
from ..evaluation.episodes import EVALUATION_SEED, built, episodes

__all__ = ["Ride", "main", "ride", "ride_certified", "ride_refused", "sorted_candidates", "stops_near"]

NEAR = 0.02
"""A refused wire should stop within this distance of the first blocked place, m."""


@dataclass(frozen=True)
class Ride:
    """One episode in each of n scenarios, (n,) each.

    success : reached the goal
    furthest : m, largest arc length of the tip
    time : s to the goal; NaN where it was not reached
    """

    success: np.ndarray
    furthest: np.ndarray
    time: np.ndarray


def ride(
    policy: Callable[[Any], Any],
    kind: str,
    scenarios: Sequence[Scenario],
    options: dict[str, Any] | None = None,
    seed: int = EVALUATION_SEED,
) -> Ride:
    """One episode of the kind's task in every scenario, side by side; `policy` makes the policy for the batch."""
    n = len(scenarios)
    task = f"MagWire/{kind}" if kind.rpartition("-v")[0] else f"MagWire/{kind}-v0"
    env = gym.make_vec(task, num_envs=n, scenario=list(scenarios), autoreset_mode="NextStep")
    actor = built(policy, env)
    observation, _ = env.reset(seed=seed, options=options)
    sim = env.unwrapped.core.sim  # type: ignore[attr-defined]
    success, finish, furthest = np.zeros(n, dtype=np.bool_), np.full(n, np.nan), sim.tip_arclength
    for step in episodes(env, actor, observation):
        reached = (sim.goals().s[:, None] - sim.remaining_trace).max(axis=1)
        furthest = np.where(step.running, np.maximum(furthest, reached), furthest)
        if step.ended.any():
            success[step.ended] = step.info["is_success"][step.ended]
            finish[step.ended] = step.info["summary"]["time"][step.ended]
    env.close()
    return Ride(success, furthest, np.where(success, finish, np.nan))


def ride_certified(
    policy: Callable[[Any], Any], kind: str, found: Sequence[tuple[Scenario, Certificate]], seed: int = EVALUATION_SEED
) -> Ride:
    """Episodes that start as in the task, with tip and magnet anywhere in their ranges."""
    return ride(policy, kind, [sc for sc, _ in found], seed=seed)


def ride_refused(policy: Callable[[Any], Any], kind: str, found: Sequence[tuple[Scenario, Certificate]]) -> Ride:
    """Episodes from the start of each certificate, under its first command, so before the blocked place."""
    options = {
        "tip_arclength": np.array([c.arclengths[0] for _, c in found]),
        "magnet_angle": np.array([c.commands[0] for _, c in found]),
    }
    return ride(policy, kind, [sc for sc, _ in found], options)


Found = list[tuple[Scenario, Certificate]]


def sorted_candidates(kind: str, certified: int, refused: int, split: str = "test", seed: int = 0) -> dict[str, Found]:
    """The first `certified` solvable and `refused` blocked candidates of a pool, and all that were tried."""
    found: dict[str, Found] = {"certified": [], "refused": [], "tried": []}
    while len(found["certified"]) < certified or len(found["refused"]) < refused:
        batch = candidates(kind, split, 64, seed, len(found["tried"]))
        for pair in zip(batch, certify(batch), strict=True):
            found["tried"].append(pair)
            if pair[1].solvable:
                found["certified"].append(pair)
            elif pair[1].blocked is not None:
                found["refused"].append(pair)
        if len(found["tried"]) > 100 * (certified + refused + 10):
            raise ValueError(f"kind {kind!r} gave {[len(v) for v in found.values()]} certified, refused and tried")
    return found | {"certified": found["certified"][:certified], "refused": found["refused"][:refused]}


def stops_near(result: Ride, found: Found) -> np.ndarray:
    """Which refused wires stopped within `NEAR` of their first blocked place, (n,)."""
    blocked = np.array([c.blocked for _, c in found], dtype=np.float64)
    return ~result.success & (np.abs(result.furthest - blocked) < NEAR)


def report(
    kind: str,
    certified: int,
    refused: int,
    split: str = "test",
    policies: Sequence[type[Controller]] = (NetForce, MaxForce),
) -> str:
    """The experiment at the given sizes, as lines of text."""
    began = time.perf_counter()
    found = sorted_candidates(kind, certified, refused, split)
    seconds = time.perf_counter() - began
    tried = found["tried"]
    shares = [
        np.mean([c.solvable for _, c in tried]),
        np.mean([not c.solvable and c.blocked is not None for _, c in tried]),
        np.mean([not c.solvable and c.blocked is None and c.thrown_out for _, c in tried]),
    ]
    lines = [
        f"{kind}: {len(tried)} candidates of {split!r} in {seconds:.1f} s: {shares[0]:.1%} certified, "
        f"{shares[1]:.1%} blocked, {shares[2]:.1%} thrown out of the entrance, {1 - sum(shares):.1%} doubtful"
    ]
    for policy in policies:
        if certified:
            result = ride_certified(policy.from_env, kind, found["certified"])
            ratio = result.time / [c.traverse_time for _, c in found["certified"]]
            lines.append(
                f"  {policy.__name__}: {result.success.sum()} of {certified} certified finish, in "
                f"{np.nanmedian(ratio):.2f} of the certificate's time (median)"
            )
        if refused:
            result = ride_refused(policy.from_env, kind, found["refused"])
            lines.append(
                f"  {policy.__name__}: {stops_near(result, found['refused']).sum()} of {refused} refused stop within "
                f"{1e3 * NEAR:.0f} mm of the first blocked place, {result.success.sum()} finish"
            )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Steer through certified and refused scenarios with NetForce and MaxForce, or with `--policies`."""
    parser = argparse.ArgumentParser(prog="python -m agents.benchmark.certificates", description=main.__doc__)
    parser.add_argument("--kind", choices=list(RECIPES), default="SteerAny")
    parser.add_argument("--certified", type=int, default=500)
    parser.add_argument("--refused", type=int, default=200)
    parser.add_argument("--split", default="test")
    parser.add_argument("--policies", nargs="+", choices=list(CONTROLLERS), default=["NetForce", "MaxForce"])
    options = parser.parse_args(arguments)
    policies = [CONTROLLERS[name] for name in options.policies]
    print(report(options.kind, options.certified, options.refused, options.split, policies))


if __name__ == "__main__":
    main()
