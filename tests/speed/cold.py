"""Item 8: the time to import, and to the first step with a cold and with a warm cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.speed.measure import table

ROOT = Path(__file__).parents[2]

IMPORT = """
import time; start = time.perf_counter()
import magwire_env
print(time.perf_counter() - start)
"""

FIRST = """
import time; start = time.perf_counter()
import gymnasium as gym, magwire_env
env = gym.make("MagWire/Steer-v0"); env.reset(seed=0); env.step(env.action_space.sample())
print(time.perf_counter() - start)
"""


def seconds(script: str, cache: str | None = None) -> float:
    """What a fresh process printed."""
    environment = dict(os.environ, PYTHONPATH=str(ROOT)) | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def compiled(cache: str) -> int:
    """Compiled functions in a cache folder."""
    return len(list(Path(cache).rglob("*.nbc")))


def cold_start() -> str:
    """The table, and whether a second process compiled anything."""
    imports = [seconds(IMPORT) for _ in range(5)]
    with tempfile.TemporaryDirectory() as cache:
        cold = seconds(FIRST, cache)
        before = compiled(cache)
        warm = [seconds(FIRST, cache) for _ in range(5)]
        again = compiled(cache) - before
    rows = [
        ("`import magwire_env`", f"{np.median(imports):.2f} s", "0.6 s"),
        ("make, reset, first step, import included, warm cache", f"{np.median(warm):.2f} s", "1.5 s"),
        ("the same, empty cache", f"{cold:.1f} s", "15 s"),
    ]
    return table(("cold start", "median of 5 (cold: 1)", "wanted"), rows) + (
        f"\n\nFunctions compiled anew by a second process: {again}."
    )
