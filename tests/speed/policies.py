"""Plain policies against Stable-Baselines3's predict: loading, one decision, a batch of 1024, in one run.

`python -m tests.speed.policies` prints one row an algorithm (networks and tasks as shipped, untrained weights). The
plain policies are timed in a process of their own, which must not import torch.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

CASES = (
    ("ppo", "MagWire/Steer-v0"), ("sac", "MagWire/Steer-v0"), ("tqc", "MagWire/SteerAny-v0"),
    ("crossq", "MagWire/Chase-v0"), ("ppo", "MagWire/Chase-v0"), ("stacked_ppo", "MagWire/SteerAny-v0"),
)  # fmt: skip
MANY = 1024


def median(call: Callable[[], Any], count: int) -> float:
    """Median time of a call, s."""
    times = []
    for _ in range(count):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return float(np.median(times[count // 10 :]))


def timed(folder: Path) -> dict[str, float]:
    """Times of the policy in `folder`, s."""
    began = time.perf_counter()
    from agents.learning import load

    imported = time.perf_counter()
    policy = load(folder)
    first = time.perf_counter()
    many = np.random.default_rng(0).standard_normal((MANY, policy.size)).astype(np.float32)
    one, start = many[0], np.zeros(1, dtype=np.bool_)
    _, state = policy.predict(one)
    found = {
        "import": imported - began,
        "first load": first - imported,
        "load": median(lambda: load(folder), 50),
        "one": median(lambda: policy.predict(one, state, start), 3000),
        "many": median(lambda: policy.predict(many), 300),
        "torch": float("torch" in sys.modules),
    }
    return found


def against_sb3(algorithm: str, task: str, folder: Path) -> list[str]:
    """A row: sizes, load, one decision, many; beside them Stable-Baselines3's."""
    import torch

    from agents.learning.export import about_model, plain, save_all
    from agents.learning.hyperparameters import hyperparameters
    from agents.learning.sb3 import make_model, make_vec_env

    torch.set_num_threads(1)
    settings = hyperparameters(algorithm, task)
    env, frames = settings.pop("env", {}), settings.pop("frame_stack", 1)
    for name in ("n_envs", "n_timesteps", "training_env"):
        settings.pop(name, None)
    env |= {"pool_size": 1} if "pool_size" in env else {}
    settings |= {"n_steps": 512, "batch_size": 1024} if "ppo" in algorithm else {}
    model = make_model(algorithm, make_vec_env(task, 2, 0, frames, **env), 0, settings)
    meta = {"task": task, "algorithm": algorithm, "seed": 0, "env": env, "scenario": None, "scenario_given": False}
    policy = plain(model, about_model(model, meta), frames)
    save_all(policy, folder)
    command = [sys.executable, "-m", "tests.speed.policies", str(folder)]
    ours = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    if ours["torch"]:
        raise RuntimeError("the plain policy imported torch")
    many = np.random.default_rng(0).standard_normal((MANY, policy.size * frames)).astype(np.float32)
    normalize = model.get_vec_normalize_env().normalize_obs
    theirs = [
        median(lambda: model.predict(normalize(many[0]), deterministic=True), 500),
        median(lambda: model.predict(normalize(many), deterministic=True), 100),
    ]
    widths = [len(policy.layers[0].weight), *(len(layer.bias) for layer in policy.layers)]
    return [
        f"{algorithm} on {task.split('/')[1]}", "–".join(map(str, widths)),
        f"{1e3 * ours['first load']:.1f}", f"{1e3 * ours['load']:.1f}",
        f"{1e6 * ours['one']:.1f}", f"{1e6 * theirs[0]:.0f}", f"{1e3 * ours['many']:.2f}", f"{1e3 * theirs[1]:.2f}",
    ]  # fmt: skip


def main() -> None:
    if len(sys.argv) > 1:
        print(json.dumps(timed(Path(sys.argv[1]))))
        return
    head = ("policy", "network", "first load ms", "load ms", "one µs", "SB3 µs", f"{MANY} ms", "SB3 ms")
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for algorithm, task in CASES:
        with tempfile.TemporaryDirectory() as folder:
            print("| " + " | ".join(against_sb3(algorithm, task, Path(folder))) + " |", flush=True)


if __name__ == "__main__":
    main()
