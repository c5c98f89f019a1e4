"""Threads, forks, and what a process loads and compiles."""

import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from magwire_env import Scenario, Simulator
from magwire_env.simulation.threads import share_out

FIRST_STEP = """
import gymnasium as gym, magwire_env
env = gym.make("MagWire/Steer-v0"); env.reset(seed=0); env.step(env.action_space.sample())
envs = gym.make_vec("MagWire/Steer-v0", num_envs=100, time_limit=0.2); envs.reset(seed=0)
for _ in range(4): envs.step(envs.action_space.sample())
"""


def python(code: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True, check=True
    )
    return done.stdout


@pytest.mark.parametrize("threads", [2, 3])
def test_serial_and_parallel_agree_bit_for_bit(threads):
    """More threads than blocks divide evenly among, and than there may be cores."""
    commands = np.random.default_rng(0).uniform(0.0, 6.0, (10, 200, 1))

    def run(count):
        sim = Simulator(Scenario.paper(), num_envs=200, threads=count)
        for command in commands:
            sim.step(command)
        state = sim.state()
        return state.arclengths, state.velocities, sim.wall_force, sim.tip_field

    for serial, parallel in zip(run(1), run(threads), strict=True):
        assert np.array_equal(serial, parallel)


def test_every_block_is_run_once_and_a_failure_is_raised_after_all_have_ended():
    seen = []
    share_out(lambda blocks, work: seen.extend(blocks), np.arange(17), [np.zeros(1)] * 2, 2)
    assert sorted(seen) == list(range(17))

    def fails(blocks, work):
        if 16 in blocks:
            raise RuntimeError("in a thread")
        seen.append("other")

    with pytest.raises(RuntimeError, match="in a thread"):
        share_out(fails, np.arange(17), [np.zeros(1)] * 2, 2)
    assert seen[-1] == "other"


def test_forked_workers_step_large_batches():
    """A child has no worker threads, even if the parent had woken its own."""
    gym.make_vec("MagWire/Steer-v0", num_envs=256, threads=2).reset(seed=0)
    envs = gym.vector.AsyncVectorEnv([lambda: gym.make("MagWire/Steer-v0")] * 2)
    try:
        first, _ = envs.reset(seed=5)
        after = envs.step(np.zeros((2, 1), dtype=np.float32))[0]
    finally:
        envs.close()
    single = gym.make("MagWire/Steer-v0")
    assert np.array_equal(first[1], single.reset(seed=6)[0])
    assert np.array_equal(after[1], single.step(np.zeros(1, dtype=np.float32))[0])


def test_a_second_process_compiles_nothing(tmp_path: Path):
    def compiled():
        return {p.name: p.stat().st_mtime_ns for p in tmp_path.rglob("*.nb?")}

    python(FIRST_STEP, NUMBA_CACHE_DIR=str(tmp_path))
    first = compiled()
    assert len(first) >= 10
    python(FIRST_STEP, NUMBA_CACHE_DIR=str(tmp_path))
    assert compiled() == first


def test_importing_loads_nothing_heavy():
    heavy = ("numba", "scipy", "torch", "matplotlib", "pygame", "stable_baselines3", "magwire_env.simulation")
    code = f"import sys, magwire_env; print([m for m in {heavy!r} if m in sys.modules])"
    assert python(code).strip() == "[]"
