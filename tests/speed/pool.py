"""Time to generate and certify pools: `python -m tests.speed.pool [size]`, for every kind of task."""

import sys
import time

from magwire_env.quasistatic.pool import RECIPES, build_pool


def main(size: int = 1000) -> None:
    print(f"| kind | {size} certified scenarios [s] | processor [s] | candidates accepted |\n|---|---|---|---|")
    for kind in RECIPES:
        build_pool(kind, "train", 1, seed=1)  # compiles
        wall, cpu = time.perf_counter(), time.process_time()
        pool = build_pool(kind, "train", size)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        print(f"| {kind} | {wall:.1f} | {cpu:.1f} | {pool.acceptance:.0%} of {pool.tried} |", flush=True)


if __name__ == "__main__":
    main(*(int(n) for n in sys.argv[1:]))
