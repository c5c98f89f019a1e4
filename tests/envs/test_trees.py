"""Trees of the navigating tasks: what is shipped, how it was certified, how episodes in them begin."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from agents.controllers import FollowRoute, Hold
from agents.evaluation.certified_trees import Run, held_shares, played
from magwire_env.envs import trees
from magwire_env.envs.navigation import inside, wrong_branches
from magwire_env.envs.pools import TREES, scenario_pool
from magwire_env.lumen import Lumen

ANY, RECOVER = "MagWire/NavigateAny-v0", "MagWire/Recover-v0"


@pytest.fixture(scope="module")
def tree():
    return trees.tree_pool("test", 1)[0]


def forked() -> Lumen:
    """A trunk, a branch "left", and "right" that forks into "near" and "far"."""
    line = np.linspace(0.0, 0.06, 20)[:, None]
    ways = {name: np.array(d) / np.linalg.norm(d) for name, d in {
        "left": (1, 0.8, 0), "right": (1, -0.8, 0), "near": (1, 0, 0), "far": (0.2, -1, 0)
    }.items()}  # fmt: skip
    trunk, x = line * [1.0, 0.0, 0.0], np.array([0.06, 0.0, 0.0])
    end = x + 0.06 * ways["right"]
    return Lumen.from_lines(
        [
            ("trunk", trunk, 6e-3, None),
            ("left", x + line * ways["left"], 5e-3, "trunk"),
            ("right", x + line * ways["right"], 5e-3, "trunk"),
            ("near", end + line * ways["near"], 4e-3, "right"),
            ("far", end + line * ways["far"], 4e-3, "right"),
        ]
    )


def test_wrong_branches_are_those_that_leave_the_way():
    lumen = forked()

    def wrong(target):
        return {lumen.branches[i].name for i in wrong_branches(lumen, target)}

    assert wrong("left") == {"right"}
    assert wrong("near") == {"left", "far"}
    assert wrong("far") == {"left", "near"}


def test_the_shipped_runs_do_what_they_are_kept_for(tree):
    """Every demonstration of a tree, played back side by side, ends in its target in its last control period."""
    runs = trees.demonstrations("test", 0)
    leaves = [run.target for run in runs if run.start == "inlet"]
    assert leaves == list(tree.tree.leaves)
    asked = {(name, tree.tree.branches[i].name) for name in leaves for i in wrong_branches(tree.tree, name)}
    assert {(run.target, run.start[0]) for run in runs if run.start != "inlet"} == asked
    env = gym.make_vec(ANY, num_envs=len(runs), scenario=tree, autoreset_mode="Disabled")
    options = [run.options(tree) for run in runs]
    env.reset(options={name: [o[name] for o in options] for name in ("target", "start", "magnet_angle")})
    core, ends = env.unwrapped.core, np.zeros(len(runs), dtype=int)
    for step in range(max(len(run.actions) for run in runs)):
        action = np.zeros((len(runs), 4), dtype=np.float32)
        for i, run in enumerate(runs):
            if step < len(run.actions):
                action[i] = run.actions[step]
        success = core.step(action)[3]["is_success"]
        ends = np.where(success & (ends == 0), step + 1, ends)
    assert list(ends) == [len(run.actions) for run in runs]


@pytest.mark.parametrize("split", ["test", "ood"])
def test_a_run_plays_back_in_the_single_env(split):
    run = min(trees.demonstrations(split, 0), key=lambda run: len(run.actions))
    tree = trees.tree_pool(split, 1)[0]
    env = gym.make(ANY, scenario=tree)
    env.reset(options=run.options(tree))
    ends = [env.step(action)[2] for action in run.actions]
    assert ends == [False] * (len(ends) - 1) + [True]


def test_splits_share_no_tree():
    pools = [trees.tree_pool("train", 4), trees.tree_pool("test", 4), trees.tree_pool("train", 4, 1)]
    every = [sc.tree for pool in pools for sc in pool]
    assert len(set(every)) == len(every)
    assert {len(tree.leaves) for tree in every} <= {3, 4, 5}


def test_candidates_out_of_distribution_have_more_and_narrower_branches():
    drawn = {split: [trees.candidate(split, k) for k in range(4)] for split in ("test", "ood")}
    found = {split: [sc.tree for sc in scenarios if sc is not None] for split, scenarios in drawn.items()}
    assert max(len(tree.leaves) for tree in found["test"]) <= 5 <= min(len(tree.leaves) for tree in found["ood"])
    narrowest = {split: np.mean([tree.narrowest[0] for tree in each]) for split, each in found.items()}
    assert narrowest["ood"] < 0.9 * narrowest["test"]


def test_a_pool_begins_like_a_larger_one_and_comes_round_again():
    assert trees.tree_pool("test", 2) == trees.tree_pool("test", 3)[:2]
    count = len(trees.load()["train-1"].numbers)
    pool = scenario_pool(TREES, "train", count + 2, 1)
    assert pool[count:] == pool[:2]
    assert len(set(pool)) == count


@pytest.mark.parametrize(("split", "seed"), [("test", 1), ("ood", 3)])
def test_seeds_without_trees_are_refused(split, seed):
    with pytest.raises(ValueError, match="split and seed must be of certified trees"):
        trees.tree_pool(split, 1, seed)
    with pytest.raises(ValueError, match="split must be"):
        trees.tree_pool("valid", 1)


def test_what_is_written_is_read_again(tmp_path):
    one = trees.load()["test-0"]
    trees.save({"test-0": one}, tmp_path / "trees.npz")
    again = trees.load(tmp_path / "trees.npz")["test-0"]
    assert all(np.array_equal(value, getattr(again, name)) for name, value in vars(one).items())


def test_actions_are_kept_as_they_were_played():
    action = trees.rounded(np.array([[0.3, -1.0, 1.7, 1e-3]]))
    assert action[0, 1] == -1.0
    assert action[0, 2] == 1.0
    assert np.array_equal(trees.stored(action) / np.float32(127), action)


def test_recover_starts_inside_a_wrong_branch_of_the_way(tree):
    env = gym.make_vec(RECOVER, num_envs=16, scenario=tree)
    _, info = env.reset(seed=3)
    sim, lumen = env.unwrapped.simulator, tree.tree
    depth = sim.astray
    assert depth.min() > 0.004  # the mouth is wide: where the route's own tube ends is not where the branch begins
    assert depth.max() < 0.031
    assert np.ptp(depth) > 0.008
    for lane, target in enumerate(info["target"]):
        assert sim.tip_branch[lane] in wrong_branches(lumen, target)
    assert len({(b, t) for b, t in zip(sim.tip_branch, info["target"], strict=True)}) > 4
    nodes = sim.positions
    far = lumen.wall_distance(nodes[~np.isnan(nodes[..., 0])].reshape(-1, 3))
    assert far.min() > 0.0  # the wire lies along the branch, in the lumen
    after = env.step(np.zeros((16, 4), dtype=np.float32))[4]
    assert not after["wrong_entries"].any()


def test_an_episode_starts_inside_however_short_the_trunk():
    pool = trees.tree_pool("test", 3)
    assert min(sc.tree.trunk.length for sc in pool) < 0.07  # where a tip would start beyond the fork
    env = gym.make_vec(ANY, num_envs=24, scenario=[pool[i % 3] for i in range(24)])
    env.reset(seed=1)
    sim = env.unwrapped.simulator
    tips = sim.tip_position
    assert min(float(pool[i % 3].tree.wall_distance(tips[i : i + 1])[0]) for i in range(24)) > 2e-3
    assert sim.inserted_length.min() >= 0.05 - 1e-9
    assert np.ptp(sim.inserted_length) > 0.02


def test_an_episode_starts_less_deep_in_a_short_branch():
    lumen = forked()
    assert inside(lumen, 1) == 0.03
    assert inside(Lumen.from_lines([("a", np.linspace([0, 0, 0], [0.02, 0, 0], 9), 1e-3, None)]), 0) == pytest.approx(
        0.014
    )


def test_only_what_gets_there_demonstrates(tree):
    leaf = tree.tree.leaves[0]
    near = Run(0, leaf, (leaf, round(tree.tree.branch(leaf).length - 0.012, 3)))
    assert len(played([tree], [near], FollowRoute.from_env)[0]) < 10
    assert played([tree], [near], Hold.from_env, most=3) == [None]


def test_held_commands_of_a_shipped_tree_pass_few_of_its_ends(tree):
    passed = held_shares([tree])[0]
    leaves = len(tree.tree.leaves)
    assert passed.any()  # some do get somewhere: the floor is no accident of a wire that stands still
    assert passed.sum(axis=1).max() / leaves <= 0.4
