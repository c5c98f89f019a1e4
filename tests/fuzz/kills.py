"""Kills, at random and at chosen moments, and what is left on the disk after each.

`python -m tests.fuzz.kills training --count 100 [--seed N]` kills trainings by SIGKILL and SIGTERM; the training that
goes on after each kill must end bit for bit where one that nobody disturbed ends.
`python -m tests.fuzz.kills benchmark --count 30` kills the benchmark's parent, `... par --count 20` a process that
fills a pool of tracts and plans pars. It prints a line a kill, and ends with status 1 at the first thing that is wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ID = "MagWire/Steer-v0"
TINY = {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "policy_kwargs": {"net_arch": [8, 8]}}
STEPS, LANES, EVALUATIONS = 4096, 8, 16


def check(condition: bool, words: str) -> None:
    """Stop with `words` unless the condition holds."""
    if not condition:
        raise AssertionError(words)


# --- a training -------------------------------------------------------------------------------------------------------


def train_on(folder: Path) -> None:
    """Begin a small training in `folder`, or go on with it."""
    from agents.learning import training
    from agents.learning.config import Config

    training.VALIDATION_EPISODES = 4
    config = Config(
        run=folder, timesteps=STEPS, n_envs=LANES, evaluations=EVALUATIONS, episodes=1, progress=False,
        resume=(folder / "config.json").exists(),
    )  # fmt: skip
    training.learn(training.Run.open(config, TINY))


def look_at_training(folder: Path) -> int:
    """Read everything that a run's folder holds; returns the steps of its newest checkpoint, −1 without one."""
    from agents.learning import load
    from agents.learning.policy_file import read
    from agents.learning.run_folder import Checkpoints, locked
    from agents.learning.stored import read_json
    from agents.learning.training import curve_of, goodness, read_curve
    from agents.learning.tree_file import load_tree

    if not folder.exists():
        return -1
    read_json(folder / "config.json"), read_json(folder / "versions.json")
    with locked(folder):
        pass  # the dead hold nothing
    newest = Checkpoints(folder).newest()
    if newest is None:
        return -1
    state = read_json(newest / "checkpoint.json")
    load_tree(newest / "last", "training")
    steps = state.whole("timesteps")
    check(read(newest / "last").about.timesteps == steps, "the last policy is of another moment")
    curve = curve_of(folder)
    check(curve is not None and curve.parent == newest, "the curve is of another checkpoint")
    rows = read_curve(newest / "learning_curve.csv")
    if rows:
        best = max(rows, key=goodness)
        check(load(folder).about.timesteps == best["timesteps"], "best and the curve disagree")
    return steps


def killed_at_call(number: int, before: bool) -> None:
    """Have this process kill itself at its `number`-th change of a name, flush or removal on the disk."""
    calls = [0]

    def dangerous(real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            calls[0] += 1
            if calls[0] == number and before:
                os.kill(os.getpid(), signal.SIGKILL)
            result = real(*args, **options)
            if calls[0] == number:
                os.kill(os.getpid(), signal.SIGKILL)
            return result

        return call

    for module, name in ((os, "rename"), (os, "replace"), (os, "fsync"), (os, "mkdir"), (os, "unlink"), (os, "rmdir")):
        setattr(module, name, dangerous(getattr(module, name)))


def forked(work: Callable[[], None], log: Path) -> int:
    """A child process that does `work`, ends, and leaves what it says in a log; returns its id."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
        out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(out, 1), os.dup2(out, 2)
        work()
        status = 0
    except KeyboardInterrupt:
        status = 130
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(status)


def end_of(folder: Path) -> tuple[dict[str, np.ndarray], str]:
    """All that a training ended with, but for the time it took."""
    from safetensors.numpy import load_file

    from agents.learning.run_folder import Checkpoints

    newest = Checkpoints(folder).newest()
    assert newest is not None
    return load_file(newest / "last" / "training.safetensors"), (newest / "last" / "training.json").read_text()


def kill_trainings(count: int, seed: int, folder: Path) -> None:
    """Kill trainings `count` times, beginning anew when one has come to its end."""
    log = folder / "child.log"
    train_on(folder / "warm")  # what the children then need not import, nor load
    started = time.monotonic()
    _, status = os.waitpid(forked(lambda: train_on(folder / "whole"), log), 0)
    check(status == 0, log.read_text())
    seconds, wanted = time.monotonic() - started, end_of(folder / "whole")
    rng, kills, ended, run = np.random.default_rng(seed), 0, 0, folder / "run"
    reached = -1
    while kills < count:
        kind = ("SIGKILL", "SIGTERM", "chosen")[kills % 3]
        call, before = int(rng.integers(1, 200)), bool(rng.integers(2))

        def work(kind: str = kind, call: int = call, before: bool = before) -> None:
            if kind == "chosen":
                killed_at_call(call, before)
            train_on(run)

        child = forked(work, log)
        moment = rng.uniform(0.0, 0.8 * seconds)
        if kind != "chosen":
            time.sleep(moment)
            os.kill(child, signal.SIGKILL if kind == "SIGKILL" else signal.SIGTERM)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            check(os.WEXITSTATUS(status) in (0, 130), log.read_text())
        now = look_at_training(run)
        check(now >= reached, f"{reached} steps were saved, {now} are left")
        reached = now
        where = f"call {call}" if kind == "chosen" else f"{moment:.2f} s"
        kills += 1
        print(f"{kills:>4} {kind:<8} {where:<9} {now:>6} steps saved", flush=True)
        if now >= STEPS:
            _, status = os.waitpid(forked(lambda: train_on(run), log), 0)
            check(status == 0, log.read_text())
            found = end_of(run)
            same = found[1] == wanted[1] and all(np.array_equal(a, found[0][name]) for name, a in wanted[0].items())
            check(same, "the training that was killed ended elsewhere")
            ended, reached = ended + 1, -1
            shutil.rmtree(run)
    left = sorted({p.name for p in run.glob("checkpoints/*")} if run.exists() else set())
    print(f"{kills} kills, {ended} trainings ended, each bit for bit as the one that nobody disturbed; left: {left}")


# --- processes of their own -------------------------------------------------------------------------------------------


def session_of(process: subprocess.Popen) -> set[int]:
    """Ids of the living processes of a process's session, itself left out."""
    living = set()
    for path in Path("/proc").iterdir():
        if path.name.isdecimal() and int(path.name) != process.pid:
            try:
                fields = (path / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has just ended
            if int(fields[3]) == process.pid and fields[0] != "Z":
                living.add(int(path.name))
    return living


def killed(command: list[str], moment: float, kind: int, log: Path, patience: float, env: dict[str, str]) -> bool:
    """Start a command, kill it after `moment` s, wait for all it started; false if it had ended by itself before."""
    with log.open("w") as out:
        process = subprocess.Popen(command, stdout=out, stderr=out, start_new_session=True, env=os.environ | env)
    try:
        process.wait(moment)
        check(process.returncode == 0, log.read_text())
        return False
    except subprocess.TimeoutExpired:
        process.send_signal(kind)
    process.wait(patience)
    until = time.monotonic() + patience
    while session_of(process) and time.monotonic() < until:
        time.sleep(0.1)
    orphans = session_of(process)
    check(not orphans, f"{len(orphans)} processes live on after their parent was killed")
    return True


def bench(out: Path) -> None:
    """A small benchmark: two trainings, and who plays with them."""
    from agents.benchmark.jobs import run_cells
    from agents.benchmark.plan import Arena, Learner, Plan

    arena = Arena("Steer", ID, episodes=8)
    plan = Plan((arena,), (Learner("ppo", ("Steer",), 2),), robustness={}, timesteps=60_000)
    cells = [cell for cell in plan.cells() if cell.policy in ("ppo", "MaxForce", "Random")]
    cells = [cell for cell in cells if plan.state(cell, out) != "finished"]
    print(len(cells), "cells to make", flush=True)
    check(not run_cells(plan, cells, out, 2), "a cell failed")


def records(out: Path) -> dict[str, Any]:
    """What the finished cells hold, but for times and for whether they were resumed."""
    found = {}
    for path in sorted(out.glob("*/*.json")):
        record = json.loads(path.read_text())
        for name in ("seconds", "resumed", "made_by"):
            record.pop(name, None)
        if "curve" in record:
            record["curve"] = [[v for i, v in enumerate(r.split(",")) if i != 1] for r in record["curve"].split()]
        found[str(path.relative_to(out))] = record
    return found


def kill_benchmarks(count: int, seed: int, folder: Path) -> None:
    """Kill the parent of a benchmark `count` times."""
    rng, kills, out, log = np.random.default_rng(seed), 0, folder / "out", folder / "log"
    command = [sys.executable, "-m", "tests.fuzz.kills", "_bench"]
    started = time.monotonic()
    subprocess.run([*command, folder / "whole"], check=True, stdout=subprocess.DEVNULL)
    seconds, wanted = time.monotonic() - started, records(folder / "whole")
    ended, finished = 0, dict[str, int]()
    while kills < count:
        kind = (signal.SIGKILL, signal.SIGTERM)[kills % 2]
        moment = float(rng.uniform(0.0, seconds))
        alive = killed([*command, str(out)], moment, kind, log, 60.0, {})
        now = {str(path): path.stat().st_mtime_ns for path in out.glob("*/*.json")}
        check(all(now.get(path) == when for path, when in finished.items()), "a finished cell was made again or lost")
        records(out)
        steps = [look_at_training(run) for run in sorted((out / "runs").glob("*"))] if (out / "runs").exists() else []
        finished = now
        if alive:
            kills += 1
            print(f"{kills:>4} {kind.name} {moment:5.1f} s, {len(now)} cells, {steps} steps saved", flush=True)
        else:
            check(records(out) == wanted, "the benchmark that was killed found other numbers")
            ended, finished = ended + 1, {}
            shutil.rmtree(out)
    print(f"{kills} kills, {ended} benchmarks ended with the same numbers as the one that nobody disturbed; no orphan")


def pars(out: Path) -> None:
    """Fill a pool of tracts and plan the pars of its episodes, into the cache that the environment names."""
    from agents.evaluation.evaluator import evaluate
    from agents.par.optimal import Optimal
    from agents.par.refinement import Refinement

    episodes = evaluate(lambda env: Optimal(env, Refinement(rounds=2)), "MagWire/SteerAny-v0", 3)
    (out / "times.json").write_text(json.dumps(episodes.time.tolist()))


def kill_pars(count: int, seed: int, folder: Path) -> None:
    """Kill a process that fills a pool and plans its pars `count` times."""
    from agents.par.cache import Cache

    rng, kills, ended, log = np.random.default_rng(seed), 0, 0, folder / "log"
    command = [sys.executable, "-m", "tests.fuzz.kills", "_pars", str(folder)]
    started = time.monotonic()
    subprocess.run(command, check=True, env=os.environ | {"MAGWIRE_CACHE": str(folder / "whole")})
    seconds, wanted = time.monotonic() - started, json.loads((folder / "times.json").read_text())
    cache, kept = folder / "cache", set[str]()
    while kills < count:
        kind = (signal.SIGKILL, signal.SIGTERM)[kills % 2]
        moment = float(rng.uniform(0.0, 1.1 * seconds))
        alive = killed(command, moment, kind, log, 60.0, {"MAGWIRE_CACHE": str(cache)})
        now = {path.stem for path in cache.glob("par/*/*.npz")}
        check(kept <= now, "a plan was lost")
        plans = Cache(cache / "par")
        check(all(plans.load(key) is not None for key in now), "a plan cannot be read")
        kept = now
        if alive:
            kills += 1
            print(f"{kills:>4} {kind.name} {moment:5.1f} s, {len(now)} plans kept", flush=True)
        else:
            check(json.loads((folder / "times.json").read_text()) == wanted, "the plans that were kept are others")
            ended, kept = ended + 1, set()
            shutil.rmtree(cache)
    print(f"{kills} kills, {ended} times all pars as of the one that nobody disturbed; no orphan, no file unreadable")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["training", "benchmark", "par", "_bench", "_pars"])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.what == "_bench":
        bench(options.folder)
    elif options.what == "_pars":
        pars(options.folder)
    else:
        work = {"training": kill_trainings, "benchmark": kill_benchmarks, "par": kill_pars}[options.what]
        with tempfile.TemporaryDirectory() as folder:
            work(options.count, options.seed, Path(folder))


if __name__ == "__main__":
    main()
