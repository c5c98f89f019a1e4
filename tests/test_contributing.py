"""CONTRIBUTING.md: its walks are carried out, block by block in order, as a reader would."""

import re
from pathlib import Path

import gymnasium as gym
import pytest

from agents.catalogue import CONTROLLERS
from magwire_env.envs.observation import CHANNELS
from magwire_env.envs.task import TASKS
from magwire_env.simulation.model import _MODELS

PAGE = Path(__file__).parents[1] / "CONTRIBUTING.md"
WALKS = ("task", "observation channel", "reward term", "controller", "wire model")


@pytest.fixture
def _tidy():
    """What the walks register is taken back."""
    tables = (TASKS, CHANNELS, CONTROLLERS, _MODELS, gym.registry)
    before = [set(table) for table in tables]
    yield
    for table, names in zip(tables, before, strict=True):
        for name in set(table) - names:
            del table[name]


@pytest.mark.usefixtures("_tidy")
def test_the_five_walks_work_as_written():
    text = PAGE.read_text(encoding="utf-8")
    walks = re.findall(r"^## How to add an? (.*?)$(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert tuple(name for name, _ in walks) == WALKS
    names: dict = {"__name__": "walks"}
    for name, walk in walks:
        blocks = re.findall(r"^```python\n(.*?)^```$", walk, re.MULTILINE | re.DOTALL)
        assert blocks, f"no code in the walk {name!r}"
        for block in blocks:
            exec(compile(block, f"{PAGE.name}: {name}", "exec"), names)
    assert "Mine/HalfWay-v0" in TASKS
    assert {"field"} < set(CHANNELS)


def test_every_path_it_names_exists():
    for path in re.findall(r"`((?:magwire_env|agents|tests)/[\w/.]*)`", PAGE.read_text(encoding="utf-8")):
        assert (PAGE.parent / path).exists(), path
