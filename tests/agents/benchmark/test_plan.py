"""The benchmark's plan: arenas, cells, policies."""

from __future__ import annotations

import json

import pytest

from agents.benchmark import cells as kinds
from agents.benchmark.free import FREE_ARENAS, FREE_LEARNERS
from agents.benchmark.plan import ARENAS, LEARNERS, Plan
from agents.catalogue import CONTROLLERS, NOT_OF_TRACTS
from magwire_env.envs.task import TASKS


def test_the_newest_version_of_every_task_with_a_par_is_an_arena():
    old = {f"MagWire/{name}-v0" for name in ("Steer", "Reach", "Track", "SteerAny", "Orient", "Chase", "Dual")}
    free = {arena.task for arena in FREE_ARENAS}
    assert {arena.task for arena in ARENAS} == set(TASKS) - old - free
    by_name = {arena.name: arena for arena in ARENAS}
    assert len(by_name) == len(ARENAS)
    for name, task in (("Steer", "MagWire/Steer-v1"), ("Hard", "MagWire/Hard-v1"), ("Chase", "MagWire/Chase-v1")):
        assert by_name[name].task == task
    for name, episodes in (("SteerAny", 500), ("Chase", 200)):
        assert (by_name[name].split, by_name[name].episodes) == ("test", episodes)
        assert by_name[f"{name} ood"].models == name


def test_the_cells_are_what_was_asked_for():
    plan = Plan()
    cells = plan.cells()
    assert len({cell.name for cell in cells}) == len({cell.file(plan_out := kinds.Path("out")) for cell in cells})
    assert len({cell.log(plan_out) for cell in cells}) == len(set(cells)) == len(cells)
    trained = [cell for cell in cells if cell.kind == "train"]
    for learner in LEARNERS:
        for name in learner.arenas:
            assert sum((c.arena, c.policy) == (name, learner.algorithm) for c in trained) == learner.seeds
    assert not any(cell.arena.endswith("ood") for cell in trained)
    assert sum((c.kind, c.arena, c.policy) == ("evaluate", "Chase ood", "ppo") for c in cells) == 5
    for cell in cells:
        needed = plan.training_of(cell)
        assert (needed is not None) == (cell.kind != "train" and cell.seed is not None)
        assert needed is None or cells.index(needed) < cells.index(cell)
        json.dumps(plan.settings(cell))


def test_every_policy_meets_every_arena():
    cells = Plan().cells()
    for arena in ARENAS:
        if arena.controllers is None:
            met = {cell.policy for cell in cells if cell.arena == arena.name and cell.kind in ("evaluate", "par")}
            assert met >= set(CONTROLLERS) - set(NOT_OF_TRACTS), arena.name


def test_every_task_of_a_free_wire_is_an_arena_of_theirs():
    free = {"SteerFree", "Shape", "Navigate", "NavigateAny", "Recover", "Gentle", "Uniform"}
    assert {arena.task for arena in FREE_ARENAS} == {f"MagWire/{name}-v0" for name in free}
    cells = Plan(FREE_ARENAS, FREE_LEARNERS, {}).cells()
    assert {cell.kind for cell in cells} == {"train", "evaluate"}
    for arena in FREE_ARENAS:
        met = {cell.policy for cell in cells if cell.arena == arena.name and cell.kind == "evaluate"}
        learners = {learner.algorithm for learner in FREE_LEARNERS if (arena.models or arena.name) in learner.arenas}
        assert met == {*(arena.controllers or ()), *learners}
        assert "ppo" in learners
        assert arena.reference in met
        assert arena.name not in {one.name for one in ARENAS}


@pytest.mark.parametrize("name", ["episodes", "timesteps", "seeds"])
def test_a_plan_refuses_nothing_to_do(name):
    with pytest.raises(ValueError, match=f"{name} must be a whole number of at least 1, got 0"):
        Plan(**{name: 0})


def test_policies_that_see_nothing_are_floors_in_trees_too():
    plan = Plan(arenas=FREE_ARENAS, learners=FREE_LEARNERS)
    marked = {name for arena in FREE_ARENAS for name in plan.controllers(arena) if plan.is_floor(name)}
    assert marked == {"Forward", "Hold", "HoldHome", "ConstantRotation", "Random", "untrained"}
