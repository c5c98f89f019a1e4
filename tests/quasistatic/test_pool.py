"""Pools: certified, a value of their arguments, splits apart."""

import numpy as np
import pytest

from magwire_env.quasistatic.certificate import GOAL_MARGIN
from magwire_env.quasistatic.held import held_commands
from magwire_env.quasistatic.pool import RECIPES, build_pool, candidates, scenario_pool
from magwire_env.simulation import Simulator, certify


@pytest.mark.parametrize("kind", list(RECIPES))
def test_every_scenario_is_certified_and_keeps_the_kinds_promises(kind):
    steered = kind.endswith("v1")
    pool = build_pool(kind, "test", 2 if steered else 6)
    assert len(pool.scenarios) == len(pool.certificates) == len(set(pool.scenarios)) == (2 if steered else 6)
    assert (0.0 if steered else 0.25) < pool.acceptance <= pool.certified / pool.tried <= 1.0
    assert all(c.weakest[1] < RECIPES[kind].weakest for c in pool.certificates)
    assert all(c.solvable for c in certify(pool.scenarios))
    for sc in pool.scenarios:
        assert sc.coupling == ("force" if kind.startswith("SteerAny") or kind == "Hard-v1" else "wrench")
        assert min(m.distance_to(sc.tract.position([0.0, sc.tract.length])) for m in sc.rig.magnets) >= 0.0699
    dofs = [(type(d).__name__, d.axis) for d in pool.scenarios[0].rig.dofs]
    turn = ("Turn", "y")
    wanted = {
        "SteerAny": [turn],
        "Orient": [turn, ("Turn", "z")],
        "Chase": [("Slide", "x"), ("Slide", "y"), turn],
        "Dual": [turn, ("Turn", "x")],
    }
    assert dofs == wanted["SteerAny" if kind == "Hard-v1" else kind.removesuffix("-v1")]


def test_a_pool_depends_on_its_arguments_alone_and_a_smaller_one_begins_it():
    build_pool.cache_clear()
    scenario_pool.cache_clear()
    ten = scenario_pool("SteerAny", "train", 10)
    build_pool.cache_clear()
    scenario_pool.cache_clear()
    assert scenario_pool("SteerAny", "train", 4) == ten[:4]
    assert scenario_pool("SteerAny", "train", 10) == ten
    assert scenario_pool("SteerAny", "train", 10) is scenario_pool("SteerAny", "train", 10)


def test_splits_and_seeds_share_no_tract():
    pools = [candidates("SteerAny", *which) for which in (("train", 8), ("test", 8), ("train", 8, 1), ("ood", 4))]
    tracts = [sc.tract for pool in pools for sc in pool]
    assert len(set(tracts)) == len(tracts)


def test_unknown_kinds_and_bad_sizes_are_refused():
    with pytest.raises(ValueError, match="kind"):
        scenario_pool("Swim")
    with pytest.raises(ValueError, match="split"):
        scenario_pool("SteerAny", "validation")
    with pytest.raises(ValueError, match="size"):
        scenario_pool("SteerAny", size=0)


def test_no_held_command_crosses_an_admitted_tract_in_the_simulator():
    pool = build_pool("SteerAny-v1", "test", 2)
    for sc in pool.scenarios:
        sim = Simulator(sc, len(commands := held_commands(np.array([True]))))
        angles = sc.rig.dofs[0].home + 2 * np.pi * (commands - 0.5)
        sim.reset(sc.wire.length, angles)
        for _ in range(150):
            sim.step(angles)
        assert sim.tip_arclength.max() < sc.tract.length - GOAL_MARGIN
