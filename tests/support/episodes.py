"""Episodes that have just begun, for tests of the par."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.evaluation.episodes import EVALUATION_SEED
from agents.par.refinement import Refinement
from agents.par.starts import Starts
from magwire_env.envs.vector_env import MagWireVectorEnv

QUICK = Refinement(samples=8, rounds=4)


def begun(task: str = "MagWire/Steer-v0", n: int = 8, seed: int = EVALUATION_SEED, **settings: Any) -> Starts:
    """The evaluation's first `n` starts."""
    env = MagWireVectorEnv(n, task, **settings)
    env.reset(seed=seed)
    return Starts.of(env.core, np.arange(n))
