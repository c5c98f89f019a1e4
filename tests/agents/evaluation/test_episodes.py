"""The loop that plays episodes: each lane's first to its end, whatever the others do."""

from __future__ import annotations

import gymnasium as gym
import numpy as np

from agents.controllers import MaxForce, Random
from agents.evaluation.episodes import built, episodes

ID = "MagWire/Steer-v0"


class Recorder:
    """Holds the magnet and writes down which lanes it was told to start afresh."""

    def __init__(self):
        self.starts = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.starts.append(episode_start.copy())
        return np.zeros((len(observation), 1), dtype=np.float32), state


def test_every_lane_ends_once_and_runs_until_then():
    env = gym.make_vec(ID, num_envs=5)
    observation, _ = env.reset(seed=0)
    steps = list(episodes(env, MaxForce.from_env(env), observation))
    ended = np.array([step.ended for step in steps])
    running = np.array([step.running for step in steps])
    assert (ended.sum(axis=0) == 1).all()
    assert np.array_equal(running.sum(axis=0), ended.argmax(axis=0) + 1)
    assert len(steps) == running.sum(axis=0).max()
    lengths = [step.info["summary"]["steps"][lane] for lane, step in enumerate(steps[k] for k in ended.argmax(axis=0))]
    assert np.array_equal(lengths, running.sum(axis=0))


def test_a_policy_is_told_of_the_episodes_that_a_batch_begins_by_itself():
    env = gym.make_vec(ID, num_envs=3)
    observation, _ = env.reset(seed=0, options={"tip_arclength": np.array([0.78, 0.1, 0.1]), "magnet_angle": 3.0})
    told = {}
    for restarts in (True, False):
        observation, _ = env.reset(seed=0, options={"tip_arclength": np.array([0.78, 0.1, 0.1]), "magnet_angle": 3.0})
        recorder = Recorder()
        ended = [step.ended for step in episodes(env, recorder, observation, restarts)]
        told[restarts] = np.array(recorder.starts)
    assert told[True][0].all()
    assert told[False][0].all()
    assert not told[False][1:].any()
    first = int(np.argmax([e[0] for e in ended]))
    assert told[True][first + 1, 0]


def test_a_single_env_is_a_batch_of_one():
    env, envs = gym.make(ID), gym.make_vec(ID, num_envs=1)
    one = list(episodes(env, MaxForce.from_env(env), env.reset(seed=4)[0]))
    many = list(episodes(envs, MaxForce.from_env(envs), envs.reset(seed=4)[0]))
    assert len(one) == len(many)
    assert one[-1].ended.tolist() == [True]
    assert one[-1].info["summary"]["time"] == many[-1].info["summary"]["time"][0]


def test_a_policy_is_taken_as_it_is_or_made_for_the_env():
    env = gym.make(ID)
    policy = Random.from_env(env)
    assert built(policy, env) is policy
    assert isinstance(built(Random.from_env, env), Random)
