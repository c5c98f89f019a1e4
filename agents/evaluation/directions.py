"""The hard floor of a navigating task: the wire is fed at full speed under one direction of the moment.

`python -m agents.evaluation.directions --task MagWire/Navigate-v0` prints a line for each of 14 directions. A task that
the best of them passes in more than 40 % of its episodes does not ask for steering.
"""

from __future__ import annotations

import argparse
import itertools
from functools import partial
from typing import Any

import numpy as np

from magwire_env.validation.report import format_table

from ..controllers import Forward
from .evaluator import Episodes, evaluate

__all__ = ["DIRECTIONS", "best_forward", "main"]

DIRECTIONS = tuple(d for d in itertools.product((-1, 0, 1), repeat=3) if np.abs(d).sum() in (1, 3))
"""The 6 axes and the 8 diagonals."""


def best_forward(task: str, episodes: int = 50, directions: tuple = DIRECTIONS, **settings: Any) -> list[Episodes]:
    """What `Forward` does under each of `directions`, the best first."""
    rows = []
    for direction in directions:
        moment = np.array(direction, dtype=np.float64)
        policy = partial(Forward.from_env, moment=moment)
        rows.append(evaluate(policy, task, episodes, name=f"Forward {direction}", **settings))
    return sorted(rows, key=lambda row: -row.success.mean())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", default="MagWire/Navigate-v0")
    parser.add_argument("--episodes", type=int, default=50)
    options = parser.parse_args()
    rows = [(row.policy, f"{row.success.mean():.1%}") for row in best_forward(options.task, options.episodes)]
    print(format_table(("policy", "success"), rows))


if __name__ == "__main__":
    main()
