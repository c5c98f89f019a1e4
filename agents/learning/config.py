"""What a training run is made of: its configuration, and the learning algorithms there are."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import gymnasium as gym

__all__ = ["ALGORITHMS", "BAD_INPUT", "Algorithm", "Config"]

ALGORITHMS: dict[str, tuple[str, str]] = {
    "ppo": ("stable_baselines3", "PPO"),
    "sac": ("stable_baselines3", "SAC"),
    "tqc": ("sb3_contrib", "TQC"),
    "crossq": ("sb3_contrib", "CrossQ"),
    "stacked_ppo": ("stable_baselines3", "PPO"),
    "knows_ppo": ("stable_baselines3", "PPO"),
    "sees_ppo": ("stable_baselines3", "PPO"),
    "robust_ppo": ("stable_baselines3", "PPO"),
}
"""Algorithm → the package and the class that implement it.

``stacked_ppo`` is PPO with a memory: it sees its last few observations, and only the forces and the magnet in them.
``knows_ppo`` is PPO that knows the magnets: it sees a force model, the channel ``drive_preview``.
``sees_ppo`` is PPO that sees an X-ray image alone.
``robust_ppo`` is PPO for scenarios with a wide variation: it begins with what `MaxForce` does.
"""

if TYPE_CHECKING:
    Algorithm = str
else:
    Algorithm = Literal[tuple(ALGORITHMS)]  # so that the command line lists the choices

BAD_INPUT = (ValueError, OSError, gym.error.Error)
"""Errors that end a command with one line in place of a traceback."""


@dataclass
class Config:
    """What a run is made of."""

    task: str = "MagWire/Steer-v1"
    """Environment id."""
    algorithm: Algorithm = "ppo"
    """Learning algorithm; its hyperparameters are in agents/hyperparameters."""
    seed: int = 0
    """Seeds the network, the exploration and the training episodes (lane i has seed + i)."""
    run: Path | None = None
    """Run folder; by default runs/<task>-<algorithm>-seed<seed>, with a number if that exists."""
    timesteps: int | None = None
    """Environment steps; by default those of the YAML."""
    n_envs: int | None = None
    """Lanes of the batch; by default those of the YAML."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    env_kwargs: tuple[str, ...] = ()
    """key=value for the env: observe, action_mode, reward, safety, coupling, time_limit, split, pool_size, scenario."""
    threads: int = 1
    """Torch threads; these networks are too small to gain from a second one."""
    evaluations: int = 10
    """Number of evaluations on held-out seeds during the training; the best model is kept."""
    episodes: int = 200
    """Episodes of the final evaluation."""
    resume: bool = False
    """Go on from the last checkpoint in the run folder."""
    trust: bool = False
    """Also open files of earlier versions (model.zip, pickles), which run any program that stands in them."""
    progress: bool = field(default_factory=lambda: sys.stderr.isatty())
    """Show a progress bar."""
