"""Navigating tasks: how an episode begins, what it counts, what a policy sees and does there."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.envs.moment import MomentActions, moments
from magwire_env.simulation.readout import ROW

TASK = "MagWire/Navigate-v0"
BRANCHES = ("aorta", "LCCA", "LSA", "RCCA", "RSA")


@pytest.fixture(scope="module")
def envs():
    return gym.make_vec(TASK, num_envs=4)


def still(envs):
    return np.zeros(envs.action_space.shape, dtype=np.float32)


def test_a_reset_names_the_target_and_all_branches_it_may_be(envs):
    _, info = envs.reset(seed=0)
    assert all(target in BRANCHES for target in info["target"])
    assert info["targets"][0] == BRANCHES
    again = envs.reset(seed=0)[1]
    assert list(again["target"]) == list(info["target"])


def test_every_branch_is_drawn(envs):
    drawn = {target for seed in range(0, 80, 4) for target in envs.reset(seed=seed)[1]["target"]}
    assert drawn == set(BRANCHES)


def test_options_set_target_and_start(envs):
    _, info = envs.reset(seed=0, options={"target": "RCCA", "start": ("LCCA", 0.05)})
    sim = envs.unwrapped.simulator
    assert list(info["target"]) == ["RCCA"] * 4
    lumen = sim.scenarios[0].tree
    assert [lumen.branches[b].name for b in sim.tip_branch] == ["LCCA"] * 4
    back = lumen.branch("LCCA").start
    on = lumen.length_of("RCCA") - back
    assert sim.astray == pytest.approx(np.full(4, 0.05), abs=2e-3)
    assert sim.remaining == pytest.approx(np.full(4, 0.05 + on - 5e-3), abs=3e-3)
    _, info = envs.reset(seed=0, options={"target": ["RCCA", "LSA", "aorta", "RSA"]})
    assert list(info["target"]) == ["RCCA", "LSA", "aorta", "RSA"]


@pytest.mark.parametrize(
    "options",
    [{"target": "LVA"}, {"target": "BCT"}, {"target": ["RSA"]}, {"target": 0.3}, {"start": ("RSA", 3.0)},
     {"start": 0.1}, {"start": ("aorta", 0.01)}, {"tip_arclength": 0.1}],
)  # fmt: skip
def test_options_that_do_not_fit_are_refused_before_anything_changes(envs, options):
    envs.reset(seed=0)
    before = envs.unwrapped.simulator.state()
    with pytest.raises(ValueError, match=r"options|arc length"):
        envs.reset(options=options)
    assert envs.unwrapped.simulator.state() == before


def test_a_tip_that_starts_astray_has_entered_no_wrong_branch_and_one_that_goes_astray_has(envs):
    envs.reset(seed=0, options={"target": "RCCA", "start": [("LCCA", 0.05), "inlet", "inlet", "inlet"]})
    info = envs.step(still(envs))[4]
    assert list(info["wrong_entries"]) == [0, 0, 0, 0]
    assert info["branch"][0] == "LCCA"
    assert info["branch"][1] == "aorta"
    navigation = envs.unwrapped.core.navigation
    readout = envs.unwrapped.simulator.readout
    for astray in ([0, 1, 0, 1], [0, 0, 0, 1], [0, 1, 0, 0], *([0, 0, 0, 0],) * 5, [0, 1, 0, 0]):
        readout[ROW.astray, :4] = 1e-2 * np.array(astray)
        navigation.moved()
    assert list(navigation.wrong_entries) == [0, 2, 0, 1]  # a flicker at the mouth counts once


def test_the_wire_reaches_the_branch_when_it_lies_just_before_its_end():
    env = gym.make(TASK)
    length = env.unwrapped.simulator.scenarios[0].tree.branch("LSA").length
    env.reset(seed=0, options={"target": "LSA", "start": ("LSA", length - 9e-3)})
    for _ in range(5):
        _, _, terminated, _, info = env.step(np.array([0, 0, 0, 1], dtype=np.float32))
        if terminated:
            break
    assert info["is_success"]
    assert info["summary"]["wrong_entries"] == 0
    assert info["summary"]["contact_peak"] == pytest.approx(1e3 * info["summary"]["peak_wall_force"])
    assert info["base_force"] > 0.0


def test_the_moment_turns_to_any_direction_and_the_magnet_stays_over_the_tip(envs):
    envs.reset(seed=1)
    sim = envs.unwrapped.simulator
    wanted = np.array([[1.0, 0, 0], [0, -1.0, 0], [0.6, 0, -0.8], [-0.4, 0.4, 0.8]])
    for _ in range(8):
        envs.step(np.column_stack([wanted, np.zeros(4)]).astype(np.float32))
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    assert moments(sim)[:, 0] == pytest.approx(wanted, abs=0.02)
    assert sim.magnet_positions[:, 0, :2] == pytest.approx(sim.tip_position[:, :2], abs=3e-3)


def test_a_moment_action_gives_back_the_command_it_stands_for(envs):
    envs.reset(seed=2)
    sim = envs.unwrapped.simulator
    actions = MomentActions(sim)
    command = sim.magnet
    command[:, -1] += 2e-3
    back = actions.command(actions.action(command))
    assert np.cos(back[:, :2]) == pytest.approx(np.cos(command[:, :2]), abs=1e-6)
    assert back[:, 4] == pytest.approx(command[:, 4], abs=1e-9)


def test_no_direction_leaves_the_magnet_and_no_feed_the_wire(envs):
    envs.reset(seed=3)
    sim = envs.unwrapped.simulator
    before = sim.magnet
    envs.step(still(envs))
    assert sim.magnet[:, [0, 1, 4]] == pytest.approx(before[:, [0, 1, 4]], abs=1e-4)


def test_moment_actions_need_a_magnet_that_turns_about_y_then_z():
    with pytest.raises(ValueError, match="about y, then z"):
        gym.make("MagWire/Steer-v0", action_mode="moment")


def test_the_route_is_seen_alike_from_tip_and_magnet():
    env = gym.make(TASK, observe=("route_from_tip", "route_from_magnet", "magnet_pose", "tip_tangent"))
    seen, _ = env.reset(seed=0, options={"target": "RCCA", "start": ("BCT", 0.03)})
    core = env.unwrapped.core
    tip, magnet, pose, tangent = (seen[core.observer.part(n)] for n in core.observer.names)
    from_tip, from_magnet = tip[:12].reshape(4, 3), magnet[:12].reshape(4, 3) + pose[3:]
    assert np.linalg.norm(from_tip, axis=1) == pytest.approx(np.linalg.norm(from_magnet, axis=1), abs=1e-5)
    assert from_tip[:, 0] == pytest.approx(from_magnet @ tangent, abs=1e-4)
    points, _, _ = core.sim.ahead(np.array([0.0, 0.01, 0.02, 0.04]))
    assert 0.1 * from_magnet == pytest.approx(points[0] - core.sim.tip_position[0], abs=1e-5)


def test_a_deep_wrong_branch_does_not_end_the_episode():
    env = gym.make(TASK)
    env.reset(seed=0, options={"target": "LSA", "start": ("RCCA", 0.07)})
    _, _, terminated, truncated, info = env.step(np.zeros(4, dtype=np.float32))
    assert not terminated
    assert not truncated
    assert info["astray"] > 0.1


def test_single_and_batch_go_the_same_way(envs):
    batch, _ = envs.reset(seed=5)
    single = gym.make(TASK)
    alone, _ = single.reset(seed=7)
    assert np.array_equal(alone, batch[2])
    action = np.array([0.5, 0.5, 0.1, 1.0], dtype=np.float32)
    for _ in range(3):
        batch = envs.step(np.tile(action, (4, 1)))[0]
        alone = single.step(action)[0]
    assert alone == pytest.approx(batch[2], abs=1e-6)


def test_a_wire_that_is_pulled_back_all_the_way_ends_no_episode():
    env = gym.make(TASK, time_limit=3.0)
    env.reset(seed=0, options={"target": "RCCA", "start": ("LCCA", 0.02)})
    terminated = truncated = False
    while not (terminated or truncated):
        *_, terminated, truncated, info = env.step(np.array([1, 0, 0, -1], dtype=np.float32))
    assert truncated
    env.reset(seed=0, options={"target": "RCCA", "start": "inlet"})
    *_, terminated, _, info = env.step(np.array([1, 0, 0, -1], dtype=np.float32))
    assert info["inserted_length"] == pytest.approx(0.05)
    assert not terminated
