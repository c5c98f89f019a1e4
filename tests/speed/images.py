"""Fluoroscopic images a second, on one thread and on two: the wires of a batch in the middle of their episodes.

`python -m tests.speed.images` prints one row a case; `--write` puts them into ``docs/speed.md``. Cases run in turn,
round after round. An image counts from the simulator's state to the finished grey values.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import gymnasium as gym

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.envs.fluoroscopy import Fluoroscopy
from tests.speed.bench import DOCS, machine
from tests.speed.measure import both_rates, rate, table

LANES, LOOKS, ROUNDS, STEPS = 1024, 5, 9, 10
BEGIN, END = "<!-- images: printed by tests.speed.images -->", "<!-- images: end -->"

SCENES = {"the aortic arch, a fed wire": "MagWire/Navigate-v0", "the paper's tract": "MagWire/Steer-v1"}
KINDS = {"84 × 84": Fluoroscopy(), "84 × 84, noise": Fluoroscopy(noise=0.03), "128 × 128": Fluoroscopy(size=128)}


def looking(task: str, options: Fluoroscopy, threads: int) -> Callable[[], tuple[int, float]]:
    """A case that takes the images of all lanes again and again."""
    envs = gym.make_vec(task, num_envs=LANES, observe=options, threads=threads)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    for _ in range(STEPS):
        envs.step(envs.action_space.sample())
    read = envs.unwrapped.core.shown.fluoroscope.read  # type: ignore[attr-defined]

    def case() -> tuple[int, float]:
        began = time.perf_counter()
        for _ in range(LOOKS):
            read()
        return LANES * LOOKS, time.perf_counter() - began

    return case


def printed() -> str:
    """The machine, and a table with one row a case."""
    named = {
        (scene, kind, threads): looking(task, options, threads)
        for scene, task in SCENES.items()
        for kind, options in KINDS.items()
        for threads in (1, 2)
    }
    where = machine()
    wall, spent = both_rates({str(key): case for key, case in named.items()}, ROUNDS)
    rows = [(*key, rate(wall[str(key)]), rate(spent[str(key)])) for key in named]
    head = ("anatomy", "image", "threads", "images/s, median (range)", "a second of processor time")
    return f"{where}\n\n{table(head, rows)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/speed.md")
    write = parser.parse_args().write
    text = printed()
    print(text)
    if write:
        page = DOCS / "speed.md"
        before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
        page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
