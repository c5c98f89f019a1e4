"""Every task's page says what its env really has: numbers, bounds, the order of the action."""

import pickle
import re

import gymnasium as gym
import numpy as np
import pytest

import magwire_env
from magwire_env.envs import pages
from magwire_env.envs.action import MODES
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


def sections(task: str) -> dict[str, str]:
    """A page's sections by title, each as one line; "" is what comes before the first."""
    parts = re.split(r"^ *## (.*)$", pages.page(task), flags=re.MULTILINE)
    return {title: " ".join(text.split()) for title, text in zip(["", *parts[1::2]], parts[::2], strict=True)}


@pytest.mark.parametrize("task", magwire_env.TASK_IDS)
def test_a_page_has_no_parameters_of_its_kind_and_no_broken_lines(task):
    lines = pages.page(task).splitlines()[1:-1]
    assert all(line == "" or re.match(r" {4}\S| {6}[^\s*]", line) for line in lines)
    assert " : " not in sections(task)["Description"]


def test_a_page_has_every_paragraph_that_says_what_is_asked():
    assert "Neither reward nor success knows of that limit." in sections("MagWire/Gentle-v0")["Description"]
    assert "back out" in sections("MagWire/Steer-v1")[""]
    assert "back out" not in sections("MagWire/Steer-v0")[""]


@pytest.mark.parametrize("task", magwire_env.TASK_IDS)
def test_a_page_says_by_which_end_the_tip_may_not_leave(task):
    """What it says is held by the tests of fed wires, shapes, and tasks that end at the far end."""
    text, kind = sections(task)["Episode End"], TASKS[task].kind
    leaves = "leaves the tract by either end" if kind.ends_far else "leaves the tract backwards"
    assert ("leaves the tract" in text) == (not kind.navigates and not kind.shapes)
    assert (leaves in text) == (not kind.navigates and not kind.shapes)
    assert ("pulled back, that ends no episode" in text) == kind.navigates
    assert ("comes behind the clamp" in text) == kind.shapes


@pytest.mark.parametrize("task", magwire_env.TASK_IDS)
def test_a_page_names_every_action_mode_and_its_own(task):
    text = sections(task)["Action Space"]
    assert all(f'`"{mode}"`' in text for mode in MODES)
    assert f'here `"{TASKS[task].action_mode}"` by default' in text


@pytest.mark.parametrize("task", magwire_env.TASK_IDS)
def test_a_page_speaks_of_the_rig_that_the_task_has(task):
    rig = made(task).simulator.scenarios[0].rig
    said = sections(task)
    for text in (said["Description"], said["Starting State"].split("`reset")[0]):
        assert bool(re.search(r"\bcoils\b", text)) == bool(rig.coils)
        assert bool(re.search(r"\bmagnets?\b", text)) == bool(rig.magnets)


@pytest.mark.parametrize("task", magwire_env.TASK_IDS)
def test_a_page_names_every_channel_and_every_option(task):
    said = sections(task)
    assert all(f"`{name}`: " in said["Observation Space"] for name in TASKS[task].observe)
    assert all(f"* `{name}`: " in said["Starting State"] for name in TASKS[task].kind.takes)
    assert "see the task" not in said["Starting State"]
