"""The kernels as built for other processors than this one: whether they agree, and how fast they are.

`python -m tests.speed.processors` moves the same wires in three builds, each in a process of its own: for this
processor, for one with AVX2 and no AVX-512, and for any x86-64. It ends with status 1 if tips differ by more than
`AGREE`. A build for AVX2 is not yet a processor that has no more: how fast that is, only `make bench` there can say.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

import numpy as np

from magwire_env import Scenario, Simulator

_AVX2 = "+sse3,+ssse3,+sse4.1,+sse4.2,+popcnt,+cx16,+avx,+avx2,+fma,+f16c,+bmi,+bmi2,+lzcnt,+movbe"
BUILDS = {
    "this processor": {},
    "AVX2": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": _AVX2},
    "any x86-64": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
}
"""Name → what tells Numba which processor to compile for."""

AGREE = 3e-12
"""m, by which a build's tips may differ from those of this processor's build after `STEPS`."""

WIRES, LANES, STEPS, ROUNDS = 64, 1024, 120, 5


def moved() -> list[float]:
    """Tips of `WIRES` wires after `STEPS` random commands, m."""
    rng = np.random.default_rng(0)
    sim = Simulator(Scenario.paper(), num_envs=WIRES, threads=1)
    sim.reset(tip_arclength=rng.uniform(0.1, 0.6, WIRES))
    for _ in range(STEPS):
        sim.step(rng.uniform(0.0, 2 * np.pi, (WIRES, 1)))
    return sim.tip_arclength.tolist()


def rate() -> float:
    """Control steps a second of one thread, the best of `ROUNDS`."""
    sim = Simulator(Scenario.paper(), num_envs=LANES, threads=1)
    sim.reset()
    command, seconds = np.full((LANES, 1), 3.5), []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        for _ in range(50):
            sim.step(command)
        seconds.append(time.perf_counter() - began)
    return 50 * LANES / min(seconds)


def build(name: str) -> tuple[np.ndarray, float]:
    """Tips and rate of a build, made in a process of its own."""
    command = [sys.executable, "-m", "tests.speed.processors", "_one"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=os.environ | BUILDS[name])
    found = json.loads(done.stdout)
    return np.array(found["tips"]), found["rate"]


def main() -> None:
    if sys.argv[1:] == ["_one"]:
        print(json.dumps({"tips": moved(), "rate": rate()}))
        return
    from tests.speed.bench import machine

    print(machine(), flush=True)
    found = {name: build(name) for name in BUILDS}
    own = found["this processor"][0]
    print("| build | control steps/s, one thread | tips differ by at most [m] |\n| --- | --- | --- |")
    gaps = {name: float(np.abs(tips - own).max()) for name, (tips, _) in found.items()}
    for name, (_, speed) in found.items():
        print(f"| {name} | {speed / 1e6:.2f} M | {gaps[name]:.1e} |")
    wrong = [name for name, gap in gaps.items() if not gap <= AGREE]
    if wrong:
        sys.exit(f"{' and '.join(wrong)} differ by more than {AGREE} m")


if __name__ == "__main__":
    main()
