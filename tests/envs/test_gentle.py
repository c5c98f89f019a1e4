"""The task with a limit on the force: its cost, and that demonstrations in narrow trees stay below the limit."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from magwire_env.envs import trees
from magwire_env.envs.task import TASKS

GENTLE = "MagWire/Gentle-v0"
LIMIT = TASKS[GENTLE].kind.cost_limit


@pytest.fixture(scope="module")
def tree():
    return trees.tree_pool("test", 1, 0, "NarrowTrees")[0]


def forward(n):
    return np.tile(np.array([0, 0, 0, 1], dtype=np.float32), (n, 1))


def test_the_cost_is_the_force_above_the_limit_over_time(tree):
    envs = gym.make_vec(GENTLE, num_envs=8, scenario=tree, autoreset_mode="Disabled", time_limit=4.0)
    envs.reset(seed=0)
    core, period = envs.unwrapped.core, envs.unwrapped.simulator.control_period
    total = np.zeros(8)
    for _ in range(core.step_limit):
        info = core.step(forward(8))[3]
        assert info["cost"] == pytest.approx(period * np.maximum(info["contact_peak"] - 40.0, 0.0))
        total += info["cost"]
    summary = core.summary(np.arange(8))
    assert summary["cost"] == pytest.approx(total)
    assert list(summary["within_limit"]) == list(total <= LIMIT)
    assert total.max() > 10 * LIMIT  # some are pushed against a dead end
    envs.reset(seed=0)
    assert not core.navigation.cost.any()


def test_a_copied_state_carries_the_cost(tree):
    envs = gym.make_vec(GENTLE, num_envs=4, scenario=tree)
    envs.reset(seed=1)
    for _ in range(25):
        envs.step(forward(4))
    navigation = envs.unwrapped.core.navigation
    kept, before = navigation.state(), navigation.cost.copy()
    for _ in range(5):
        envs.step(forward(4))
    assert (navigation.cost > before).any()
    navigation.load_state(kept)
    assert np.array_equal(navigation.cost, before)


def test_other_navigating_tasks_have_no_limit():
    env = gym.make("MagWire/Navigate-v0")
    env.reset(seed=0)
    info = env.step(env.action_space.sample())[4]
    assert info["cost"] == pytest.approx(max(1e-3 * info["contact_peak"] - 0.1, 0.0))
    assert env.unwrapped.core.navigation.within_limit.all()
    assert "within_limit" not in env.unwrapped.core.navigation.summary(env.unwrapped.core.summary(np.arange(1)))


@pytest.mark.parametrize("forest", ["NarrowTrees", "TreesInField"])
def test_every_demonstration_of_a_forest_does_what_it_is_kept_for(forest):
    """In its last control period it ends in its target; from the inlet of a narrow tree below the limit."""
    task = next(task.id for task in TASKS.values() if task.pool == forest)
    scenario, runs = trees.tree_pool("test", 1, 0, forest)[0], trees.demonstrations("test", 0, 0, forest)
    assert [run.target for run in runs if run.start == "inlet"] == list(scenario.tree.leaves)
    env = gym.make_vec(task, num_envs=len(runs), scenario=scenario, autoreset_mode="Disabled")
    options = [run.options(scenario) for run in runs]
    env.reset(options={name: [o[name] for o in options] for name in ("target", "start", "magnet_angle")})
    core, ends = env.unwrapped.core, np.zeros(len(runs), dtype=int)
    within = np.zeros(len(runs), dtype=bool)
    for step in range(max(len(run.actions) for run in runs)):
        action = np.array([run.actions[min(step, len(run.actions) - 1)] for run in runs])
        new = core.step(action)[3]["is_success"] & (ends == 0)
        ends, within = np.where(new, step + 1, ends), np.where(new, core.navigation.within_limit, within)
    assert list(ends) == [len(run.actions) for run in runs]
    assert within[[run.start == "inlet" for run in runs]].all()


@pytest.mark.parametrize("forest", trees.FORESTS)
def test_a_forest_refuses_splits_that_it_does_not_have(forest):
    with pytest.raises(ValueError, match="split and seed must be of certified trees"):
        trees.tree_pool("test", 1, 7, forest)
    with pytest.raises(ValueError, match="split must be"):
        trees.candidate("elsewhere", 0, 0, forest)
    with pytest.raises(ValueError, match="forest must be"):
        trees.candidate("test", 0, 0, "Wood")


def test_narrow_trees_are_narrower_and_the_field_has_no_magnet():
    wide, narrow, field = (trees.tree_pool("test", 6, 0, forest) for forest in trees.FORESTS)
    radius = [np.mean([sc.tree.trunk.radius(0.0) for sc in pool]) for pool in (wide, narrow)]
    assert radius[1] < 0.8 * radius[0]
    assert {len(sc.rig.magnets) for sc in field} == {0}
    assert [sc.contact.wall_force_limit for sc in narrow] == [0.04] * 6
