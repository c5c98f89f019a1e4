"""Every task's page says what its env really has: numbers, bounds, the order of the action."""

import pickle
import re

import gymnasium as gym
import numpy as np
import pytest

import magwire_env
from magwire_env.envs import pages
from magwire_env.envs.task import TASKS

SETTINGS = {"pool_size": 1}


def made(task: str) -> gym.Env:
    return gym.make(task, **(SETTINGS if TASKS[task].pool else {})).unwrapped


def test_the_ids_are_those_of_the_table():
    assert tuple(TASKS)[: len(magwire_env.TASK_IDS)] == magwire_env.TASK_IDS


@pytest.mark.parametrize("task", magwire_env.TASK_IDS)
def test_a_page_has_a_row_for_every_number(task):
    env = made(task)
    text = env.__doc__
    observations, actions = text.split("## Observation Space")[1].split("## Action Space")
    found = re.findall(r"^ *\| (\d+)(?:–(\d+))? \| .* \| -(\S+) \| (\S+) \| 1 \|$", observations, re.MULTILINE)
    numbers = [n for first, last, *_ in found for n in range(int(first), int(last or first) + 1)]
    assert numbers == list(range(env.observation_space.shape[0]))
    bounds = [float(high) for first, last, _, high in found for _ in range(int(first), int(last or first) + 1)]
    assert np.allclose(bounds, env.observation_space.high)
    rows = re.findall(r"^ *\| (\d+) \| .* \| -1 \| 1 \| .* \|$", actions.split("## Dynamics")[0], re.MULTILINE)
    assert [int(n) for n in rows] == list(range(env.action_space.shape[0]))
    assert max(len(line) for line in text.splitlines() if "|" not in line) <= 120


def test_the_action_order_of_chase_is_x_y_angle():
    env = made("MagWire/Chase-v0")
    rows = re.findall(r"^ *\| (\d) \| (.*) \| -1 \| 1 \|", env.__doc__.split("## Action Space")[1], re.MULTILINE)
    assert [text for _, text in rows] == ["place of the magnet along x", "place of the magnet along y", "angle of the magnet about y"]  # fmt: skip # noqa: E501
    env.reset(seed=0)
    before = env.simulator.magnet_positions[0, 0]
    env.step(np.float32([1.0, 0.0, 0.0]))
    moved = env.simulator.magnet_positions[0, 0] - before
    assert abs(moved[0]) > 1e-3


def test_the_env_of_a_task_can_be_pickled_and_is_a_class_of_its_own():
    env = made("MagWire/Reach-v0")
    assert type(env).__name__ == "Reach_v0"
    assert type(pickle.loads(pickle.dumps(env))) is type(env)
    with pytest.raises(AttributeError, match="has no attribute 'Nothing_v0'"):
        _ = pages.Nothing_v0
