"""Learning on the native batch beside Gymnasium's and SB3's loops over single envs: steps a second.

python -m tests.speed.learning            # a few minutes; prints the table of docs/guide/learning.md
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env as sb3_make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv

import magwire_env  # noqa: F401  (registers the ids)
from agents.learning import make_vec_env
from tests.speed.measure import both_rates, rate, ratio, table

TASK = "MagWire/Steer-v0"
LANES = 64
Case = Callable[[], tuple[int, float]]


def stepping(venv: Any, steps: int) -> Case:
    """SB3's vec env through random actions."""
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, LANES, 1)).astype(np.float32)

    def case() -> tuple[int, float]:
        venv.seed(0)
        venv.reset()
        start = time.perf_counter()
        for action in actions:
            venv.step(action)
        return LANES * steps, time.perf_counter() - start

    return case


def training(venv: Any, steps: int) -> Case:
    """Plain PPO: rollouts of 32 steps, SB3's network, 4 epochs over batches of 512."""
    model = PPO("MlpPolicy", venv, n_steps=32, batch_size=512, n_epochs=4, seed=0, device="cpu")

    def case() -> tuple[int, float]:
        start = time.perf_counter()
        model.learn(LANES * 32 * steps)
        return LANES * 32 * steps, time.perf_counter() - start

    return case


def looping(envs: gym.vector.VectorEnv, steps: int) -> Case:
    """A CleanRL-style loop's half without a network: Gymnasium's vector API through random actions."""
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, LANES, 1)).astype(np.float32)

    def case() -> tuple[int, float]:
        envs.reset(seed=0)
        start = time.perf_counter()
        for action in actions:
            envs.step(action)
        return LANES * steps, time.perf_counter() - start

    return case


def main(rounds: int, scale: int) -> None:
    """Measure the pairs in turn and print the table."""
    torch.set_num_threads(1)
    native = make_vec_env(TASK, LANES, seed=0)
    dummy = sb3_make_vec_env(TASK, LANES, seed=0, vec_env_cls=DummyVecEnv)
    pairs: dict[str, tuple[Case, Case]] = {
        "SB3's vec env, stepped": (stepping(native, 200 * scale), stepping(dummy, 10 * scale)),
        "plain SB3 PPO, trained": (training(native, scale), training(dummy, scale)),
        "Gymnasium's vector env, stepped": (
            looping(gym.make_vec(TASK, num_envs=LANES), 200 * scale),
            looping(gym.make_vec(TASK, num_envs=LANES, vectorization_mode="sync"), 10 * scale),
        ),
    }
    rows = []
    for name, (fast, slow) in pairs.items():
        _, own = both_rates({"native": fast, "loop": slow}, rounds)
        rows.append((name, rate(own["native"]), rate(own["loop"]), ratio(own, "native", "loop")))
    head = ("", "native batch", "loop over single envs", "ratio")
    print(f"{LANES} lanes, steps a second of one core, median (range) of {rounds} rounds\n\n{table(head, rows)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--scale", type=int, default=1)
    options = parser.parse_args()
    main(options.rounds, options.scale)
