"""Pools come back from the disk bit for bit, and are made again where the file is damaged or cannot be written."""

from __future__ import annotations

import pytest

from magwire_env.envs.task import TASKS
from magwire_env.quasistatic import pool
from magwire_env.quasistatic.kept_pools import kept_pools
from magwire_env.quasistatic.pool import RECIPES, scenario_pool


def refused(*_, **__):
    raise AssertionError("it is made again")


@pytest.fixture
def store(tmp_path, monkeypatch):
    """An empty cache, and no pool in this process."""
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path / "cache"))
    scenario_pool.cache_clear()
    yield kept_pools()
    scenario_pool.cache_clear()


def test_a_pool_is_made_once(store, monkeypatch):
    first = scenario_pool("Orient", "ood", 3, 5)
    assert len(list(store.glob("*.npz"))) == 1
    scenario_pool.cache_clear()
    monkeypatch.setattr(pool, "build_pool", refused)
    assert scenario_pool("Orient", "ood", 3, 5) == first
    for other in (("Orient", "test", 3, 5), ("Orient", "ood", 2, 5), ("Orient", "ood", 3, 6), ("Dual", "ood", 3, 5)):
        with pytest.raises(AssertionError, match="made again"):
            scenario_pool(*other)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 cut", None])
def test_a_damaged_file_costs_the_making(store, damage):
    first = scenario_pool("Orient", "test", 2)
    (file,) = store.glob("*.npz")
    file.write_bytes(file.read_bytes()[:-200] if damage is None else damage)
    scenario_pool.cache_clear()
    assert scenario_pool("Orient", "test", 2) == first


def test_a_store_that_cannot_be_written_is_no_error(store):
    store.parent.mkdir(parents=True)
    store.write_text("a file where the folder should be")
    assert len(scenario_pool("Orient", "test", 2)) == 2


def test_certificates_are_for_the_time_that_the_tasks_allow():
    for task in TASKS.values():
        if task.pool in RECIPES:
            assert RECIPES[task.pool].time_limit == task.time_limit, task.id
