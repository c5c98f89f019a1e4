"""A small training run that several tests read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from agents.cli.train import train
from agents.learning.config import Config
from tests.support.training import SMALL


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder of a small PPO run, and what `train` returned."""
    folder = tmp_path_factory.mktemp("runs") / "small"
    return folder, train(Config(run=folder, **SMALL))
