"""How long one decision of a controller takes in a single env, on every task: median and quantiles over an episode.

`python -m tests.speed.decisions [--controller MPPI] [--decisions N]` prints one row a task; control is at 10 Hz.
"""

from __future__ import annotations

import argparse
import time

import gymnasium as gym
import numpy as np

import magwire_env
from agents.catalogue import CONTROLLERS
from magwire_env.envs.task import TASKS


def decisions(controller: str, task: str, count: int, pool_size: int = 4) -> np.ndarray:
    """Times (count,) s of the first decisions, resets between episodes left out."""
    pooled = TASKS[task].pool is not None
    env = gym.make(task, **({"pool_size": pool_size} if pooled else {}))
    policy = CONTROLLERS[controller].from_env(env)
    observation, _ = env.reset(seed=0)
    state, start, times = None, True, np.empty(count)
    policy.predict(observation)  # compiles
    for k in range(count):
        began = time.perf_counter()
        action, state = policy.predict(observation, state, np.array([start]))
        times[k] = time.perf_counter() - began
        observation, _, terminated, truncated, _ = env.step(action)
        if start := terminated or truncated:
            observation, _ = env.reset()
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--controller", choices=list(CONTROLLERS), default="MPPI")
    parser.add_argument("--decisions", type=int, default=200)
    arguments = parser.parse_args()
    print(f"| {arguments.controller} | median ms | 90 % | 99 % | longest |\n|---|---|---|---|---|")
    for task in magwire_env.TASK_IDS:
        times = 1e3 * decisions(arguments.controller, task, arguments.decisions)
        numbers = " | ".join(f"{x:.1f}" for x in np.quantile(times, [0.5, 0.9, 0.99, 1.0]))
        print(f"| {task} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
