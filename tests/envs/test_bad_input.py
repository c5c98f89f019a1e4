"""Bad input is refused by name, before anything is changed."""

from __future__ import annotations

from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env import Scenario
from magwire_env.envs.observation import CHANNELS
from magwire_env.scenario import Coil, Rig

ID = "MagWire/Steer-v0"


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.array([np.nan], dtype=np.float32), r"action\[0\] must be numbers in \[-1, 1\]"),
        (np.zeros(2, dtype=np.float32), r"action must have shape \(1,\), got \(2,\)"),
    ],
)
def test_a_bad_action_changes_nothing(action, words):
    env = gym.make(ID, disable_env_checker=True)
    env.reset(seed=0)
    env.step(np.array([0.1], dtype=np.float32))
    before = env.unwrapped.simulator.state()
    with pytest.raises(ValueError, match=words):
        env.step(action)
    assert env.unwrapped.simulator.state() == before
    assert env.unwrapped.core.steps[0] == 1


def test_one_bad_lane_stops_the_whole_batch_before_it_moves():
    envs = gym.make_vec(ID, num_envs=20)
    envs.reset(seed=0)
    actions = np.zeros((20, 1), dtype=np.float32)
    actions[17] = np.nan
    before = envs.unwrapped.simulator.state()
    with pytest.raises(ValueError, match=r"action\[17\]"):
        envs.step(actions)
    assert envs.unwrapped.simulator.state() == before
    with pytest.raises(ValueError, match=r"action must have shape \(20, 1\), got \(19, 1\)"):
        envs.step(actions[:19])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"action_mode": "torque"}, "action_mode must be one of 'angle', 'rate', 'direction', 'moment', got 'torque'"),
        ({"observe": ("tip_arclength", "colour")}, "got 'colour'"),
        ({"observe": ()}, "observe must name different channels"),
        ({"reward": "shaped"}, "reward must be one of 'dense', 'sparse', got 'shaped'"),
        ({"reward": 3}, "reward must be 'dense', 'sparse', RewardWeights or a dict of them, got 3"),
        ({"time_limit": -1}, "time_limit must be greater than 0 .in s., got -1"),
        ({"coupling": "lorentz"}, "coupling must be one of 'force', 'wrench', got 'lorentz'"),
        ({"scenario": 7}, "scenario must be a Scenario"),
        ({"task": "MagWire/Fly-v0"}, "task must be one of"),
    ],
)
def test_bad_arguments(settings, words):
    for make in (lambda: gym.make(ID, **settings), lambda: gym.make_vec(ID, num_envs=2, **settings)):
        with pytest.raises((ValueError, TypeError), match=words):
            make()


COILS = Scenario.paper().replace(rig=Rig((), (Coil("x"), Coil("y"))))


@pytest.mark.parametrize(
    ("task", "settings", "refused"),
    [
        ("Steer-v1", {}, {"base", "reference_preview", "wanted_points"}),
        ("Track-v1", {}, {"base", "wanted_points"}),
        ("Steer-v0", {"model": "free"}, {"drive_preview", "reference_preview", "wanted_points"}),
        ("Steer-v0", {"scenario": COILS}, {"base", "reference_preview", "magnet_preview", "wanted_points"}),
    ],
)
def test_a_channel_that_an_env_cannot_show_is_refused_when_it_is_made(task, settings, refused):
    """And those that it can show are shown."""
    for name in CHANNELS:
        for make in (gym.make, partial(gym.make_vec, num_envs=2)):
            if name in refused:
                with pytest.raises(ValueError, match=f"observe.*{name}.*(needs|shows none)"):
                    make(f"MagWire/{task}", observe=("tip_speed", name)[name == "magnet_preview" :], **settings)
                continue
            env = make(f"MagWire/{task}", observe=("tip_speed", name)[: 1 + (name != "tip_speed")], **settings)
            env.reset(seed=0)
            assert env.observation_space.contains(env.step(env.action_space.sample())[0])


def test_a_scenario_that_does_not_exist_names_the_shipped_ones():
    with pytest.raises(FileNotFoundError, match=r"shipped: .*paper"):
        gym.make(ID, scenario="no-such")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tip": 0.1}, r"options must be of tip_arclength, target, magnet_angle; got 'tip'"),
        ({"tip_arclength": 0.9}, r"options\['tip_arclength'\] must lie in \[0, target\)"),
        ({"tip_arclength": np.nan}, r"options\['tip_arclength'\] must be finite"),
        ({"target": 5.0}, r"options\['target'\] must lie in \(0, 0.8\]"),
        ({"magnet_angle": [1.0, 2.0, 3.0]}, r"options\['magnet_angle'\] must be one number or"),
        ({"magnet_angle": 1e300}, r"options\['magnet_angle'\] must lie within ±1e\+06"),
    ],
)
def test_bad_reset_options_leave_the_episode_as_it_was(options, words):
    env = gym.make(ID, disable_env_checker=True)
    env.reset(seed=0)
    before = env.unwrapped.simulator.state()
    with pytest.raises(ValueError, match=words):
        env.reset(options=options)
    assert env.unwrapped.simulator.state() == before


def test_step_before_reset():
    for env, action in ((gym.make(ID).unwrapped, np.zeros(1)), (gym.make_vec(ID, num_envs=2), np.zeros((2, 1)))):
        with pytest.raises(gym.error.ResetNeeded):
            env.step(action)


def test_disabled_autoreset_refuses_to_step_an_ended_lane():
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", time_limit=0.1)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 1), dtype=np.float32))
    with pytest.raises(gym.error.ResetNeeded, match="lane 0 has ended"):
        envs.step(np.zeros((2, 1), dtype=np.float32))


@pytest.mark.parametrize("mask", [np.zeros(2, dtype=bool), np.ones(3, dtype=bool), [True, False], np.ones(2)])
def test_bad_reset_mask(mask):
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled")
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"reset_mask": mask})


def test_a_list_of_seeds_must_fit():
    with pytest.raises(ValueError, match=r"seed must be one number or 3 \(num_envs\) of them, got 2"):
        gym.make_vec(ID, num_envs=3).reset(seed=[1, 2])


def test_a_wire_too_long_for_the_task_is_refused():
    with pytest.raises(ValueError, match="must leave a way between the start and the goal"):
        gym.make(ID, scenario=Scenario.paper().replace(wire__length=0.785))


def test_seeds_may_be_numbers_of_numpy():
    envs, same = gym.make_vec(ID, num_envs=2), gym.make_vec(ID, num_envs=2)
    wanted = envs.reset(seed=5)[0]
    for seed in (np.int64(5), [np.int64(5), np.int32(6)]):
        assert np.array_equal(same.reset(seed=seed)[0], wanted)


def test_a_rig_of_coils_alone_may_vary():
    scenario = Scenario.paper().replace(rig=Rig((), (Coil("x"), Coil("y"))), variation__friction=0.5)
    env = gym.make(ID, scenario=scenario, disable_env_checker=True)
    _, info = env.reset(seed=0)
    assert 0.5 <= info["variation/friction"] <= 1.5
    env.step(np.zeros(2, dtype=np.float32))


def test_tracking_goes_on_past_the_end_of_its_reference():
    env = gym.make("MagWire/Track-v0", time_limit=0.5, disable_env_checker=True).unwrapped
    env.reset(seed=0)
    ends = [env.step(np.zeros(1, dtype=np.float32))[3] for _ in range(100)]
    assert ends[4]
    assert env.observation_space.contains(env.core.observe()[0])


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (lambda sim: sim.reset(magnet=[[1e300]]), r"magnet must lie within ±1e\+06"),
        (lambda sim: sim.set_rig([[-1e7]]), r"magnet must lie within ±1e\+06"),
        (lambda sim: sim.load_state(sim.state().replaced(magnet=np.array([[1e9]]))), r"magnet must lie within"),
        (lambda sim: sim.vary([0], [1e9], [1.0], [1.0], [[[0, 0, 0]]]), r"friction must lie in \[0, 1000\]"),
        (lambda sim: sim.vary([0], [1.0], [-1.0], [1.0], [[[0, 0, 0]]]), r"stiffness must lie in \[0, 1000\]"),
    ],
)
def test_a_simulator_refuses_settings_that_would_overflow(entry, words):
    sim = gym.make(ID).unwrapped.simulator
    before = sim.state()
    with pytest.raises(ValueError, match=words):
        entry(sim)
    assert sim.state() == before
