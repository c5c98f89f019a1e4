"""A smoke test of an installation: `python tests/floors.py` needs the core alone, `--train` the extra `train` too.

`make floors` runs it on the lowest versions that pyproject.toml allows, first without any extra.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path


def core() -> None:
    """Envs, batch, simulator and certificate with the core's dependencies; importing loads nothing heavy."""
    import gymnasium as gym
    import numpy as np

    import magwire_env

    heavy = {"numba", "scipy", "torch", "matplotlib", "pygame"} & set(sys.modules)
    assert not heavy, f"import magwire_env loads {heavy}"
    env = gym.make("MagWire/Steer-v0")
    env.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(np.array([0.3], dtype=np.float32))
    assert env.observation_space.contains(observation)
    envs = gym.make_vec("MagWire/Track-v0", num_envs=40)
    envs.reset(seed=0)
    assert np.isfinite(envs.step(envs.action_space.sample())[1]).all()
    from magwire_env.quasistatic import certificate

    scenario = magwire_env.Scenario.paper()
    assert certificate(scenario).solvable
    with tempfile.TemporaryDirectory() as folder:
        scenario.save(Path(folder) / "mine.toml")
        assert magwire_env.Scenario.load(Path(folder) / "mine.toml") == scenario


def train() -> None:
    """A training of a few seconds, and its evaluation."""
    from agents.cli import main

    with tempfile.TemporaryDirectory() as folder:
        main(["train", "--timesteps", "4096", "--run", str(Path(folder) / "run"), "--episodes", "4"])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--train", action="store_true")
    train() if parser.parse_args().train else core()
    print("ok")
