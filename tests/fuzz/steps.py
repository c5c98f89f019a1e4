"""Env steps under adversarial actions, in the registered tasks and in random accepted scenarios.

`python -m tests.fuzz.steps --steps 10000000 [--seed N] [--lanes 256] [--spread near|far|anywhere]` prints counts a
batch, and ends with status 1 at the first thing that is wrong: a number that is not finite, an observation outside of
its space, a wire whose nodes have passed each other without a word, or totals that differ from what the steps said.
With ``NUMBA_BOUNDSCHECK=1`` the kernels check every index of theirs. A wire whose motion diverges must be said
(`RuntimeError`); it is counted.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import Counter
from typing import Any

import gymnasium as gym
import numpy as np

import magwire_env
from agents.catalogue import has_par
from magwire_env.envs.observation import CHANNELS
from magwire_env.envs.route_channels import ROUTE_CHANNELS

from .scenarios import SPREADS, batch, layout

EDGES = np.array([1, -1, 0, 3e38, -3e38, np.inf, -np.inf, 1e-45, -1e-45, 0.999999, np.pi], dtype=np.float32)
TASKS = ("MagWire/Steer-v0", "MagWire/Reach-v0", "MagWire/Track-v0")


def actions(rng: np.random.Generator, step: int, shape: tuple[int, int], style: np.ndarray) -> np.ndarray:
    """What each lane's style does: extreme words, uniform noise, full swings, or one action kept."""
    found = rng.uniform(-1, 1, shape).astype(np.float32)
    edges = EDGES[rng.integers(len(EDGES), size=shape)]
    swings = np.full(shape, 1.0 if step % 2 else -1.0, dtype=np.float32)
    kept = np.broadcast_to(np.linspace(-1, 1, shape[0], dtype=np.float32)[:, None], shape)
    return np.choose(style[:, None], [found, edges, swings, kept])


def check(condition: Any, words: str) -> None:
    """Stop with `words` unless the condition holds."""
    if not condition:
        raise AssertionError(words)


def crossed(sim: Any, used: np.ndarray) -> np.ndarray:
    """(n,) lanes in which a node has passed the next one; used : (n, nodes − 1), which are no idle ones."""
    return ((np.diff(sim.state().arclengths, axis=1) <= 0) & used).any(axis=1)


def play(envs: gym.vector.VectorEnv, steps: int, rng: np.random.Generator) -> Counter:
    """Steps of a batch, every one looked at; counts of lane steps, episodes, and what was said of them."""
    core: Any = envs.unwrapped.core  # type: ignore[attr-defined]
    n, seen, style = envs.num_envs, Counter(), rng.integers(4, size=envs.num_envs)
    observation, _ = envs.reset(seed=int(rng.integers(2**31)))
    total, fresh = np.zeros(n), np.ones(n, dtype=np.bool_)
    used = np.isfinite(core.sim.positions[:, :-1, 0])
    for step in range(steps):
        check(envs.observation_space.contains(observation), "an observation lies outside of its space")
        try:
            observation, reward, terminated, truncated, info = envs.step(
                actions(rng, step, envs.action_space.shape, style)
            )
        except RuntimeError as error:
            check("has diverged" in str(error), str(error))
            seen["batches that said they diverged"] += 1
            break
        spoken = info["_is_success"]
        seen["lane steps"] += int(spoken.sum())
        check(np.isfinite(reward).all(), "a reward is not finite")
        for key, value in info.items():
            if not key.startswith("_") and key != "summary":
                check(np.isfinite(np.asarray(value, dtype=np.float64)).all(), f"info[{key!r}] is not finite")
        total[fresh] = 0.0
        total += np.where(spoken, info["unconverged"], 0.0)
        seen["lane steps that said unconverged"] += int((info["unconverged"][spoken] > 0).sum())
        over = terminated | truncated
        passed = crossed(core.sim, used)
        check((info["unconverged"][passed & spoken] > 0).all(), "nodes have passed each other, and nobody said so")
        seen["lane steps with crossed nodes, said"] += int((passed & spoken).sum())
        if over.any():
            seen["episodes"] += int(over.sum())
            summary = info["summary"]
            check(np.array_equal(summary["unconverged"][over], total[over].astype(np.int64)), "a summary lost a count")
        fresh = ~spoken
    return seen


def registered(rng: np.random.Generator, lanes: int) -> tuple[str, gym.vector.VectorEnv]:
    """A registered task of locked wires, a random action mode, all channels, a random coupling; others: `free_wire`."""
    task = str(rng.choice([name for name in magwire_env.TASK_IDS if has_par(name)]))
    settings: dict[str, Any] = {"action_mode": str(rng.choice(["angle", "rate", "direction"]))}
    if rng.random() < 0.5:
        settings["observe"] = channels(task)
    if rng.random() < 0.3:
        settings["coupling"] = str(rng.choice(["force", "wrench"]))
    if "Any" in task or task.split("/")[1][:4] in ("Orie", "Chas", "Dual"):
        settings["pool_size"] = 8
    return f"{task} {settings.get('action_mode')}", gym.make_vec(
        task, num_envs=lanes, time_limit=float(rng.uniform(1, 30)), **settings
    )


def channels(task: str) -> tuple[str, ...]:
    """All channels that a task of a locked wire can show."""
    none = set(ROUTE_CHANNELS) if "Track" in task else {"reference_preview", *ROUTE_CHANNELS}
    return tuple(name for name in CHANNELS if name not in none)


def random_scenarios(rng: np.random.Generator, lanes: int, spread: str) -> tuple[str, gym.vector.VectorEnv, int]:
    """A task over accepted random scenarios of one layout, and how many draws were refused."""
    shared, task = layout(rng), str(rng.choice(TASKS))
    scenarios, refused = batch(rng, spread, max(1, min(lanes, 16)), shared)
    settings: dict[str, Any] = {"observe": channels(task)} if rng.random() < 0.5 else {}
    if not shared.dofs:
        settings.pop("observe", None)
    envs = gym.make_vec(
        task, num_envs=lanes, scenario=(scenarios * (lanes // len(scenarios) + 1))[:lanes],
        time_limit=float(rng.uniform(20, 100)) * shared.period,
        action_mode=str(rng.choice(["angle", "rate", "direction"])), **settings,
    )  # fmt: skip
    return f"{task} {spread} {shared}", envs, refused


def fuzz(steps: int, seed: int, lanes: int, spreads: tuple[str, ...], show: bool = True) -> Counter:
    """At least `steps` lane steps, half in registered tasks and half in random scenarios."""
    rng, totals, number = np.random.default_rng(seed), Counter(), 0
    while totals["lane steps"] < steps:
        number += 1
        began, refused = time.perf_counter(), 0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                if number % 2:
                    what, envs = registered(rng, lanes)
                else:
                    what, envs, refused = random_scenarios(rng, lanes, str(rng.choice(spreads)))
            except ValueError as refusal:  # a wire too long for the task, a channel that needs magnets: said by name
                totals["batches refused"] += 1
                if show:
                    print(f"{'':>11}  refused: {str(refusal)[:150]}", flush=True)
                check(" must " in str(refusal), f"refused without saying what is allowed: {refusal}")
                continue
        seen = play(envs, max(20, min(1000, 500_000 // lanes)), rng)
        envs.close()
        totals += seen
        totals["scenarios refused"] += refused
        totals["batches"] += 1
        if show:
            rate = seen["lane steps"] / (time.perf_counter() - began)
            told = {k: v for k, v in seen.items() if k != "lane steps"}
            print(f"{totals['lane steps']:>11,}  {rate:9,.0f}/s  {what}  {told}", flush=True)
    return totals


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lanes", type=int, default=1024)
    parser.add_argument("--spread", choices=list(SPREADS), action="append")
    options = parser.parse_args()
    spreads = tuple(options.spread or SPREADS)
    print(dict(fuzz(options.steps, options.seed, options.lanes, spreads)))


if __name__ == "__main__":
    main()
