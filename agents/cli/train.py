"""The command ``magwire train``, which is the same as ``python train.py``."""

from __future__ import annotations

import sys
from typing import Any

import gymnasium as gym
import tyro

from agents.learning.config import BAD_INPUT, Config

__all__ = ["main", "train"]


def train(config: Config) -> dict[str, Any]:
    """Train, evaluate, write the run folder, print the table; returns the contents of results.json."""
    from agents.catalogue import CONTROLLERS, compared_with
    from agents.cli.pictures import leave_in
    from agents.evaluation.evaluator import evaluate, table
    from agents.learning import load
    from agents.learning.training import Run, learn, learning_curve

    run = Run.open(config)
    print(f"run folder: {run.folder}")

    # 1. Learn: evaluate on held-out seeds, keep the best model, write checkpoints; Ctrl-C saves and stops.
    finished = learn(run)
    learning_curve(run)
    if not finished:
        print(f"interrupted and saved; go on with: python train.py --run {run.folder} --resume")
        return {}

    # 2. Evaluate the best model, the paper's own policy and the floors, all on the same episodes.
    name = "trained " + run.algorithm.upper()
    rows = [evaluate(load(run.folder), run.task, config.episodes, name=name, **run.held_out)]
    others = compared_with(run.task, par=False, floors=True)
    for other in others:
        controller = CONTROLLERS[other].from_env
        rows.append(evaluate(controller, run.task, config.episodes, name=other, **run.same_episodes))

    # 3. Write the results and print them.
    results = {row.policy: row.to_json() for row in rows}
    run.write("results.json", results)
    print(table(rows, others[0], markdown=False))

    # 4. Draw what the best model does: plots, and a video if the extra for videos is installed.
    try:
        leave_in(run.folder, name, run.task, **run.env_settings)
    except gym.error.DependencyNotInstalled as missing:
        print(f"no video: {missing}")
    return results


def main(description: str | None, arguments: list[str] | None = None) -> None:
    """Read the command line of train.py and train; bad input ends with one line and status 1."""
    try:
        train(tyro.cli(Config, description=description, args=arguments))
    except BAD_INPUT as error:
        sys.exit(f"train.py: {error}")
