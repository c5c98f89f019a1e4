"""Trajectories of every task, to hold one tree of the project against another on the same machine.

    git worktree add ../before COMMIT
    python -m tests.reference.trajectories --against ../before

plays 2 000 random steps of every id in the single env and in the batch, in all three autoreset modes, with this tree
and with the other, and compares observations, rewards, ends and infos bit for bit. Both trees are compiled as they are
written: the kernels' leave to reorder sums and to fuse products is taken back, since with it the last bits follow the
names of variables and the places of brackets. Without that (`--fast`) two trees agree to rounding only. Processors
differ in the last bits too, so digests of one machine say nothing on another; `test_trajectories.py` keeps recorded
numbers to 1e-9 instead.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import llvmlite.ir
import numba.core.fastmathpass
import numpy as np
from gymnasium.vector import AutoresetMode

import magwire_env  # noqa: F401  (registers the ids)

IDS = tuple(f"MagWire/{name}-v0" for name in ("Steer", "Reach", "Track", "SteerAny", "Orient", "Chase", "Dual"))
GOAL_ID = "MagWire/ReachGoal-v0"
LANES = 20
POOL = 8
"""Scenarios of a generated task's pool: enough to draw from, quick to certify."""


def settings(env_id: str) -> dict[str, Any]:
    """Arguments of `gym.make` for a quick pool."""
    return {"pool_size": POOL} if env_id.split("/")[1].startswith(("SteerAny", "Orient", "Chase", "Dual")) else {}


def compile_as_written() -> None:
    """Take back the compiler's leave to reorder and to fuse arithmetic, for everything compiled from now on."""
    whole = llvmlite.ir.Instruction.__init__

    def without_flags(self: Any, *args: Any, name: str = "", flags: Any = ()) -> None:
        # parent, type, opname, operands, and then perhaps name and flags
        name, flags = (*args[4:], *(name, flags)[len(args) - 4 :])
        whole(self, *args[:4], name=name, flags=tuple(f for f in flags if f not in _LEAVE))

    llvmlite.ir.Instruction.__init__ = without_flags
    numba.core.fastmathpass.rewrite_module = lambda module, options: None


_LEAVE = ("contract", "reassoc", "arcp", "nsz", "fast")

NEW = {"unconverged", "_unconverged"}
"""Keys of `info` that the other tree may not have yet."""


def flat(value: Any) -> bytes:
    """Any step's result as bytes; dictionaries by sorted key."""
    if isinstance(value, dict):
        return b"".join(key.encode() + flat(value[key]) for key in sorted(value) if key not in NEW)
    if isinstance(value, (tuple, list)):
        return b"".join(flat(v) for v in value)
    array = np.asarray(value)
    if array.dtype == object:
        return b"".join(flat(v) for v in array.ravel() if v is not None)
    if array.dtype.kind == "f":
        array = array.astype(np.float64)
    return array.tobytes()


def single(env_id: str, steps: int, **extra: Any) -> list[str]:
    """A digest of every 50 steps of one env, reset whenever an episode ends."""
    env = gym.make(env_id, **settings(env_id), **extra)
    rng = np.random.default_rng(7)
    digests, digest = [], hashlib.sha256(flat(env.reset(seed=11)))
    for step in range(1, steps + 1):
        result = env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32))  # type: ignore[arg-type]
        digest.update(flat(result))
        if result[2] or result[3]:
            digest.update(flat(env.reset()))
        if step % 50 == 0:
            digests.append(digest.hexdigest()[:16])
    return digests


def batch(env_id: str, steps: int, mode: AutoresetMode, **extra: Any) -> list[str]:
    """A digest of every 50 steps of a batch."""
    vector = {"autoreset_mode": mode, "time_limit": 6.0, **settings(env_id), **extra}
    envs = gym.make_vec(env_id, num_envs=LANES, **vector)
    rng = np.random.default_rng(5)
    digests, digest = [], hashlib.sha256(flat(envs.reset(seed=23)))
    for step in range(1, steps + 1):
        result = envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32))  # type: ignore[arg-type]
        digest.update(flat(result))
        ended = result[2] | result[3]
        if mode == AutoresetMode.DISABLED and ended.any():
            digest.update(flat(envs.reset(options={"reset_mask": ended})))
        if step % 50 == 0:
            digests.append(digest.hexdigest()[:16])
    return digests


def imperfect() -> Any:
    """The paper's scenario with noise, delay and variation."""
    from magwire_env import Scenario
    from magwire_env.scenario import Reading

    return Scenario.paper().replace(
        sensing__force=Reading(noise=1e-3), sensing__length=Reading(bias=1e-3), sensing__delay=1,
        variation__friction=0.3, variation__stiffness=0.2, variation__remanence=0.1, variation__placement=1e-3,
    )  # fmt: skip


EVERY_CHANNEL = (
    "tip_arclength", "tip_speed", "drive_force", "lateral_force", "magnet", "magnet_speed", "distance_left",
    "tip_force", "tip_torque", "wall_force", "tip_position", "tip_tangent", "tract_preview", "drive_preview",
)  # fmt: skip


def all_digests(steps: int) -> dict[str, list[str]]:
    """By what was played: its digests."""
    warnings.simplefilter("ignore")
    found = {}
    for env_id in (*IDS, GOAL_ID):
        found[f"{env_id} single"] = single(env_id, steps)
    for env_id in IDS:
        for mode in AutoresetMode:
            found[f"{env_id} batch {mode.name}"] = batch(env_id, steps, mode)
        channels = EVERY_CHANNEL + (("reference_preview",) if "Track" in env_id else ())
        found[f"{env_id} all channels, rate"] = batch(
            env_id, steps // 4, AutoresetMode.NEXT_STEP, observe=channels, action_mode="rate"
        )
    found["Steer imperfect"] = batch(IDS[0], steps // 4, AutoresetMode.NEXT_STEP, scenario=imperfect(), safety=True)
    found["Steer direction, sparse"] = batch(
        IDS[0], steps // 4, AutoresetMode.NEXT_STEP, action_mode="direction", reward="sparse", coupling="wrench"
    )
    return found


def digests_of(tree: Path, steps: int, fast: bool, cache: str) -> dict[str, list[str]]:
    """What `all_digests` gives with the project at `tree`; `cache` is a folder for compiled code."""
    command = [sys.executable, str(Path(__file__).resolve()), "--steps", str(steps), *(["--fast"] if fast else [])]
    done = subprocess.run(
        command, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree.resolve()), "NUMBA_CACHE_DIR": cache}, check=True,
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])  # type: ignore[union-attr]
    parser.add_argument("--against", type=Path, help="folder of the other tree; without it the digests are printed")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--fast", action="store_true", help="compile as usual: equal to rounding only")
    options = parser.parse_args()
    if options.against is None:
        if not options.fast:
            compile_as_written()
        print(json.dumps(all_digests(options.steps)))
        return
    with tempfile.TemporaryDirectory() as cache:
        here, there = (digests_of(tree, options.steps, options.fast, cache) for tree in (Path.cwd(), options.against))
    differ = 0
    for name, theirs in there.items():
        first = next((i for i, (a, b) in enumerate(zip(here[name], theirs, strict=True)) if a != b), None)
        differ += first is not None
        print(f"{name}: {'equal' if first is None else f'differs before step {50 * (first + 1)}'}")
    print(f"{len(there) - differ} of {len(there)} equal")
    sys.exit(differ > 0)


if __name__ == "__main__":
    main()
