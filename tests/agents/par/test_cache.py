"""Keys of plans on disk."""

from __future__ import annotations

import errno

import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.par.cache import Cache, default_folder
from agents.par.refinement import Refinement
from magwire_env import Scenario
from tests.support.episodes import QUICK, begun

PLAN = np.zeros((3, 1), dtype=np.float32)


def test_keys_tell_starts_scenarios_and_settings_apart_but_not_names(monkeypatch, tmp_path):
    cache = Cache(tmp_path)
    one = begun(n=2)
    keys = set(cache.keys(one, QUICK))
    assert len(keys) == 2
    assert keys.isdisjoint(cache.keys(one, Refinement()))
    assert keys.isdisjoint(cache.keys(begun(n=2, scenario=Scenario.paper().replace(contact__friction=0.04)), QUICK))
    assert keys == set(cache.keys(begun(n=2, scenario=Scenario.paper().replace(name="another")), QUICK))
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path))
    assert default_folder() == tmp_path / "par"


def test_an_empty_plan_is_none(tmp_path):
    cache = Cache(tmp_path)
    cache.store("00aa", PLAN[:0], 1.0)
    with pytest.warns(UserWarning, match="holds no plan"):
        assert cache.load("00aa") is None


@pytest.mark.parametrize("reason", [errno.ENOSPC, errno.EROFS])
def test_a_full_or_read_only_disk_costs_no_plan(monkeypatch, tmp_path, capsys, reason):
    """The plan was just computed, in minutes: it serves, and the reason is said."""

    def refuse(*_, **__) -> None:
        raise OSError(reason, "the disk's own words")

    cache = Cache(tmp_path / f"of-{reason}")
    monkeypatch.setattr(np, "savez_compressed", refuse)
    cache.store("00aa", PLAN, 1.0)
    said = capsys.readouterr().err
    assert "plans cannot be kept" in said
    assert "the disk's own words" in said
    assert not list(cache.folder.rglob("*.*"))
    monkeypatch.undo()
    (tmp_path / "file").write_text("no folder")
    Cache(tmp_path / "file").store("00aa", PLAN, 1.0)
    assert "MAGWIRE_CACHE" in capsys.readouterr().err
