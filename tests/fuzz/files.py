"""Mutated files: each is read, or refused by an error that a command prints as one line; nothing hangs or fills memory.

`python -m tests.fuzz.files --count 20000 [--kind scenario|policy|run|plan|centreline] [--seed N]` prints counts, and
ends with status 1 at the first file that raises anything else or takes longer than `MOST_SECONDS`; that file is kept.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from agents.learning.config import BAD_INPUT
from magwire_env import Scenario

MOST_SECONDS = 20.0
MOST_MEMORY = 8 * 2**30

TOKENS = [
    b"NaN", b"nan", b"Infinity", b"-1", b"0", b"1e999", b"9" * 400, b"null", b"true", b"[]", b"{}", b'""', b"[" * 2000,
    b"\xff\xfe\x00", b"18446744073709551616", b"-0.0", b'"../../etc/passwd"', b"\n", b",", b'{"a":', b"1e-320",
    b"\x00" * 64, b"<", b"payload_mod:MagWire/Steer-v0",
]  # fmt: skip


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """A few random changes: bytes flipped, pieces cut out, doubled or moved, tokens put in, numbers replaced."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(data) + 1))
        size = int(min(len(data) - at, rng.geometric(0.05)))
        token = TOKENS[rng.integers(len(TOKENS))]
        kind = int(rng.integers(7))
        if kind == 0 and data:
            data[at % len(data)] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del data[at : at + size]
        elif kind == 2:
            data[at:at] = data[at : at + size]
        elif kind == 3:
            data[at:at] = token
        elif kind == 4:
            del data[at:]
        elif kind == 5:
            numbers = [i for i in range(at, min(len(data), at + 300)) if 48 <= data[i] < 58]
            if numbers:
                data[numbers[0] : numbers[0] + 1] = token
        else:
            data[at : at + size] = rng.bytes(size)
    return bytes(data)


class Kind:
    """Files of one kind in a folder, and what reads them all.

    files : names of those that are mutated
    """

    def __init__(self, folder: Path, files: list[str], read: Callable[[Path], Any]) -> None:
        self.folder, self.files, self.read = folder, files, read


def scenarios(folder: Path) -> Kind:
    """A scenario's TOML, short enough that mutations meet every key."""
    short = Scenario.paper().replace(tract=straight())
    short.save(folder / "mine.toml")
    return Kind(folder, ["mine.toml"], lambda where: Scenario.load(where / "mine.toml"))


def straight() -> Any:
    """A short tract of few points."""
    from magwire_env.lumen import Tract

    return Tract.from_points([(x, 0.02 * x * x, -0.05) for x in (-0.3, -0.1, 0.1, 0.3)])


def policies(folder: Path) -> Kind:
    """A policy as plain arrays."""
    from agents.learning import load
    from agents.learning.plain_policy import Layer, Normalization, PlainPolicy, PolicyAbout
    from agents.learning.policy_file import write

    rng = np.random.default_rng(0)
    sizes = [(7, 8), (8, 1)]
    layers = [Layer(rng.normal(size=s).astype(np.float32), np.zeros(s[1], dtype=np.float32), "tanh") for s in sizes]
    text = Scenario.paper().replace(tract=straight()).dumps()
    about = PolicyAbout("MagWire/Steer-v0", "ppo", 0, 1, {}, text, True, ("tip_arclength",), {"numpy": "2"})
    ends = (-np.ones(1, dtype=np.float32), np.ones(1, dtype=np.float32))
    write(PlainPolicy(layers, Normalization(np.zeros(7), np.ones(7), 10.0), *ends, False, 1, about), folder)

    def read(where: Path) -> None:
        policy = load(where)
        policy.predict(np.zeros(policy.size, dtype=np.float32))
        _ = policy.env_settings

    return Kind(folder, ["policy.json", "policy.safetensors"], read)


def runs(folder: Path) -> Kind:
    """A run's folder after a tiny training."""
    from agents.learning import training
    from agents.learning.config import Config
    from agents.learning.run_folder import Checkpoints
    from agents.learning.stored import read_json
    from agents.learning.tree_file import load_tree

    tiny = {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "policy_kwargs": {"net_arch": [4]}}
    config = Config(run=folder / "run", timesteps=256, n_envs=8, evaluations=1, episodes=1, progress=False)
    before, training.VALIDATION_EPISODES = training.VALIDATION_EPISODES, 2
    training.learn(training.Run.open(config, tiny))
    training.VALIDATION_EPISODES = before
    newest = Checkpoints(folder / "run").newest()
    assert newest is not None
    inside = newest.relative_to(folder)

    def read(where: Path) -> None:
        run = training.Run.at(where / "run")
        run.say_what_changed()
        _ = run.env_settings, run.held_out
        read_json(where / inside / "checkpoint.json").whole("timesteps")
        load_tree(where / inside / "last", "training")
        training.read_curve(where / inside / "learning_curve.csv")

    files = ["run/config.json", "run/versions.json", "run/scenario.toml", f"{inside}/checkpoint.json"]
    files += [f"{inside}/last/training.json", f"{inside}/last/training.safetensors", f"{inside}/learning_curve.csv"]
    return Kind(folder, files, read)


def plans(folder: Path) -> Kind:
    """A kept plan of the par: a damaged one is warned about, and none."""
    from agents.par.cache import Cache

    Cache(folder).store("00aa", np.ones((40, 1), dtype=np.float32), 7.5)
    return Kind(folder, ["00/00aa.npz"], lambda where: Cache(where).load("00aa"))


def centrelines(folder: Path) -> Kind:
    """Centreline files of three formats, one of them chosen by each read."""
    from magwire_env.lumen import Tract
    from tests.support.centreline_writers import Vtp, csv_text, markups, vessel, write

    xyz, radius = vessel(60)
    contents = {
        "a.csv": csv_text(xyz, radius, "x [mm],y [mm],z [mm],radius [mm]"), "b.vtp": Vtp().file([xyz], [radius]),
        "c.vtp": Vtp("ascii", compressed=False).file([xyz], [radius]), "d.mrk.json": markups(xyz),
    }  # fmt: skip
    for name, content in contents.items():
        write(folder, name, content)

    def read(where: Path) -> None:
        for name in contents:
            try:
                Tract.load(where / name, None if name.startswith(("a", "d")) else "mm")
            except ValueError:
                continue

    return Kind(folder, list(contents), read)


KINDS = {"scenario": scenarios, "policy": policies, "run": runs, "plan": plans, "centreline": centrelines}


def fuzz(kind: str, count: int, seed: int, folder: Path) -> Counter:
    """Read `count` mutated files of a kind; counts of those read and of those refused."""
    whole = folder / "whole"
    whole.mkdir(parents=True)
    made = KINDS[kind](whole)
    made.read(whole)
    rng, seen, there = np.random.default_rng(seed), Counter(), folder / "mutated"
    shutil.copytree(whole, there)
    for number in range(count):
        name = made.files[rng.integers(len(made.files))]
        content = mutated((whole / name).read_bytes(), rng)
        (there / name).write_bytes(content)
        began = time.monotonic()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made.read(there)
            seen["read"] += 1
        except BAD_INPUT as error:
            if not str(error):
                raise AssertionError(f"{kind} {seed}/{number}: {name} was refused without a word") from error
            seen["refused"] += 1
        except BaseException as error:
            (folder / "bad").write_bytes(content)
            raise AssertionError(
                f"{kind} {seed}/{number}: {name} raised {type(error).__name__}: {error}; it is kept as {folder / 'bad'}"
            ) from error
        if time.monotonic() - began > MOST_SECONDS:
            raise AssertionError(f"{kind} {seed}/{number}: {name} took {time.monotonic() - began:.0f} s")
        (there / name).write_bytes((whole / name).read_bytes())
    return seen


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=list(KINDS), action="append")
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    for kind in options.kind or KINDS:
        folder = Path(tempfile.mkdtemp(prefix="magwire-files-"))
        seen = fuzz(kind, options.count, options.seed, folder)
        print(f"{kind:<12} {dict(seen)}", flush=True)
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
