"""The learning algorithms: each has a class, hyperparameters and a search space."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest
from stable_baselines3.common.base_class import BaseAlgorithm

import agents
from agents.learning import config
from agents.learning.hyperparameters import hyperparameters
from agents.learning.sb3 import algorithm_class
from agents.learning.tuning import SPACES


def test_every_algorithm_is_complete():
    assert set(SPACES) == set(config.ALGORITHMS) == set(get_args(config.Algorithm))
    files = {path.stem for path in (Path(agents.__path__[0]) / "hyperparameters").glob("*.yml")}
    assert files == set(config.ALGORITHMS) | {"tasks"}


@pytest.mark.parametrize("algorithm", list(config.ALGORITHMS))
def test_its_class_and_its_hyperparameters_are_found(algorithm):
    assert issubclass(algorithm_class(algorithm), BaseAlgorithm)
    assert hyperparameters(algorithm, "MagWire/Steer-v0")["n_timesteps"] > 0
