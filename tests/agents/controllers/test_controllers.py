"""Controllers answer SB3's predict, single or batched, and do what they say."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import CONTROLLERS, MaxForce
from agents.evaluation.evaluator import evaluate, paired_ratio, table
from magwire_env.simulation import best_command

ID = "MagWire/Steer-v0"


@pytest.mark.parametrize("name", list(CONTROLLERS))
@pytest.mark.parametrize("mode", ["angle", "rate", "direction"])
def test_predict_single_and_batched(name, mode):
    env = gym.make(ID, action_mode=mode)
    observation, _ = env.reset(seed=0)
    action, state = CONTROLLERS[name].from_env(env).predict(observation)
    assert env.action_space.contains(action)
    envs = gym.make_vec(ID, num_envs=3, action_mode=mode)
    observations, _ = envs.reset(seed=0)
    controller = CONTROLLERS[name].from_env(envs)
    actions, state = controller.predict(observations, episode_start=np.ones(3, dtype=bool))
    assert envs.action_space.contains(actions)
    if name != "Random":
        assert np.allclose(actions[0], action)
    actions, _ = controller.predict(observations, state=state, episode_start=np.zeros(3, dtype=bool))
    assert envs.action_space.contains(actions)


def test_max_force_turns_to_the_angle_of_figure_7():
    env = gym.make(ID)
    observation, _ = env.reset(seed=0, options={"tip_arclength": 0.3})
    action, _ = MaxForce.from_env(env).predict(observation)
    sim = env.unwrapped.simulator
    best, _ = best_command(sim.scenarios[0], np.array([0.3]))
    assert env.unwrapped.core.actuation.command(action[None])[0, 0] == pytest.approx(best[0, 0], abs=5e-3)


def test_constant_rotation_starts_afresh_with_each_episode():
    envs = gym.make_vec(ID, num_envs=2)
    observations, _ = envs.reset(seed=0)
    controller = CONTROLLERS["ConstantRotation"].from_env(envs)
    first, state = controller.predict(observations)
    _, state = controller.predict(observations, state)
    again, _ = controller.predict(observations, state, episode_start=np.array([True, False]))
    assert again[0] == pytest.approx(first[0])
    assert again[1, 0] > first[1, 0]


def test_a_controller_refuses_a_foreign_env():
    with pytest.raises(ValueError, match="env must be a MagWire env or batch"):
        MaxForce.from_env(gym.make("Pendulum-v1"))


def test_a_controller_says_which_channel_it_misses():
    env = gym.make(ID, observe=("tip_speed",))
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match="observe must include 'tip_arclength'"):
        MaxForce.from_env(env).predict(observation)


@pytest.fixture(scope="module")
def rows():
    return {name: evaluate(c.from_env, ID, 24, name=name) for name, c in CONTROLLERS.items()}


def test_the_papers_policy_reaches_the_end_every_time_and_a_blind_one_does_not(rows):
    assert rows["MaxForce"].success.all()
    assert rows["ConstantRotation"].success.mean() < 0.2
    assert rows["Random"].success.mean() < 0.5


def test_evaluation_is_the_same_twice_and_paired(rows):
    again = evaluate(MaxForce.from_env, ID, 24)
    assert np.array_equal(again.time, rows["MaxForce"].time)
    assert paired_ratio(again, rows["MaxForce"]) == 1.0
    # The first lanes of a longer evaluation are the episodes of a shorter one.
    assert np.array_equal(evaluate(MaxForce.from_env, ID, 5).time, again.time[:5])


def test_the_interval_brackets_the_median_and_the_table_shows_all(rows):
    median, low, high = rows["MaxForce"].median_time()
    assert 6.0 < low < median < high < 9.0
    text = table(list(rows.values()))
    assert len(text.splitlines()) == 2 + len(rows)
    assert "| MaxForce | 100.0% |" in text
    assert rows["ConstantRotation"].to_json()["episodes"]["time"].count(None) > 10
