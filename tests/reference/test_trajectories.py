"""Recorded trajectories of every task, to 1e-9: an edit that moves results cannot pass unseen.

``python -m tests.reference.test_trajectories`` records them anew; say in CHANGELOG.md what moved, and by how much.
"""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from tests.reference.trajectories import IDS, settings

RECORD = Path(__file__).parent / "trajectories.json"
SEEDS, STEPS = (0, 1, 2), 60


def played(env_id: str) -> list[float]:
    """Of three episodes under held random actions: the last observation, and the rewards and wall forces summed."""
    envs = gym.make_vec(env_id, num_envs=len(SEEDS), **settings(env_id))
    observation, _ = envs.reset(seed=list(SEEDS))
    rng = np.random.default_rng(3)
    reward, wall = np.zeros(len(SEEDS)), np.zeros(len(SEEDS))
    for step in range(STEPS):
        if step % 6 == 0:
            action = rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)  # type: ignore[arg-type]
        observation, rewards, _, _, info = envs.step(action)
        reward, wall = reward + rewards, wall + info["wall_force"]
    sim = envs.unwrapped.simulator  # type: ignore[attr-defined]
    return [*sim.travelled, *sim.tip_velocity, *sim.drive_force, *reward, *wall, *map(float, observation.ravel())]


@pytest.mark.parametrize("env_id", IDS)
def test_a_recorded_trajectory_is_played_again(env_id: str) -> None:
    recorded = json.loads(RECORD.read_text(encoding="utf-8"))[env_id]
    found = played(env_id)
    exact = 5 * len(SEEDS)  # what comes before the observations
    assert found[:exact] == pytest.approx(recorded[:exact], rel=1e-9, abs=1e-12)
    assert found[exact:] == pytest.approx(recorded[exact:], rel=1e-6, abs=1e-6)  # single precision


if __name__ == "__main__":
    RECORD.write_text(json.dumps({env_id: played(env_id) for env_id in IDS}, indent=1), encoding="utf-8")
