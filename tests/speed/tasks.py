"""Steps a second of every task's native batch beside Steer's, in turn in one run, resets as they come.

`python -m tests.speed.tasks [--lanes N]` prints one row a task; the pools are built before the clock starts.
"""

from __future__ import annotations

import argparse
import time

import gymnasium as gym
import numpy as np

import magwire_env

ROUNDS, STEPS = 7, 60


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lanes", type=int, default=1024)
    lanes = parser.parse_args().lanes
    envs = {task: gym.make_vec(task, num_envs=lanes) for task in magwire_env.TASK_IDS}
    for env in envs.values():
        env.reset(seed=0)
        env.action_space.seed(0)
    rates: dict[str, list[float]] = {task: [] for task in envs}
    for _ in range(ROUNDS):
        for task, env in envs.items():
            actions = env.action_space.sample()  # held: random targets, some of which lead out and reset
            started = time.perf_counter()
            for _ in range(STEPS):
                env.step(actions)
            rates[task].append(lanes * STEPS / (time.perf_counter() - started))
    base = np.array(rates["MagWire/Steer-v0"])
    print(f"| {lanes} lanes | env steps/s, median (range) | over Steer, median (range) |")
    print("|---|---|---|")
    for task, rate in rates.items():
        ratio = np.array(rate) / base
        print(
            f"| {task} | {np.median(rate) / 1e3:.0f} k ({min(rate) / 1e3:.0f}–{max(rate) / 1e3:.0f}) "
            f"| {np.median(ratio):.2f} ({ratio.min():.2f}–{ratio.max():.2f}) |"
        )


if __name__ == "__main__":
    main()
