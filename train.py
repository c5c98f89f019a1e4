"""Train a steering policy and say how good it is.

    python train.py                                  # PPO on MagWire/Steer-v0, about a minute on two cores
    python train.py --algorithm sac --seed 3
    python train.py --run runs/mine --resume         # go on where a run stopped

Everything lands in one run folder: config.json, versions.json, checkpoints, the best model with its normalisation,
learning_curve.png, results.json, path.png, arclength.png, episode.mp4, TensorBoard logs. Read on from `main`; the
parts it calls are in `agents/`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import tyro

BAD_INPUT = (ValueError, FileNotFoundError, FileExistsError, gym.error.Error)
"""What ends the program with one line in place of a traceback."""


@dataclass
class Config:
    """What a run is made of."""

    task: str = "MagWire/Steer-v0"
    """Environment id."""
    algorithm: Literal["ppo", "sac", "tqc", "crossq", "stacked_ppo"] = "ppo"
    """Learning algorithm; its hyperparameters stand in agents/hyperparameters."""
    seed: int = 0
    """Seeds the network, the exploration and the training episodes (lane i has seed + i)."""
    run: Path | None = None
    """Run folder; by default runs/<task>-<algorithm>-seed<seed>, with a number if that exists."""
    timesteps: int | None = None
    """Environment steps; by default the YAML's."""
    n_envs: int | None = None
    """Lanes of the batch; by default the YAML's."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    threads: int = 1
    """Torch threads; these networks are too small for a second one to pay."""
    evaluations: int = 10
    """Evaluations on held-out seeds along the way; the best model of them is kept."""
    episodes: int = 200
    """Episodes of the final evaluation."""
    resume: bool = False
    """Go on from the last checkpoint in the run folder."""
    progress: bool = field(default_factory=lambda: sys.stderr.isatty())
    """Show a progress bar."""


def main(config: Config) -> dict[str, Any]:
    """Train, evaluate, write the run folder, print the table; returns what results.json holds."""
    from agents.cli.pictures import leave_in
    from agents.controllers import CONTROLLERS
    from agents.evaluation.evaluator import evaluate, table
    from agents.learning.sb3 import load
    from agents.learning.training import Run, learn, learning_curve

    run = Run.open(config)
    print(f"run folder: {run.folder}")

    # 1. Learn: periodic evaluation on seeds the training never sees, the best model kept, checkpoints, Ctrl-C saves.
    finished = learn(run)
    learning_curve(run)
    if not finished:
        print(f"interrupted and saved; go on with: python train.py --run {run.folder} --resume")
        return {}

    # 2. Evaluate the best model beside the paper's own policy and two floors, all on the same episodes.
    name = "trained " + run.algorithm.upper()
    rows = [evaluate(load(run.folder), run.task, config.episodes, name=name, **run.held_out)]
    for other in ("MaxForce", "ConstantRotation", "Random"):
        controller = CONTROLLERS[other].from_env
        rows.append(evaluate(controller, run.task, config.episodes, name=other, **run.same_episodes))

    # 3. Leave the results and say them.
    results = {row.policy: row.to_json() for row in rows}
    run.write("results.json", results)
    print(table(rows))

    # 4. Pictures of what it does: plots, and a video where the extra that draws it is installed.
    try:
        leave_in(run.folder, name, run.task, **run.env_settings)
    except gym.error.DependencyNotInstalled as missing:
        print(f"no video: {missing}")
    return results


if __name__ == "__main__":
    try:
        main(tyro.cli(Config, description=__doc__))
    except BAD_INPUT as error:
        sys.exit(f"train.py: {error}")
