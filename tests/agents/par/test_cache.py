"""Keys of plans on disk."""

from __future__ import annotations

import magwire_env  # noqa: F401  (registers the ids)
from agents.par.cache import Cache, default_folder
from agents.par.refinement import Refinement
from magwire_env import Scenario
from tests.support.episodes import QUICK, begun


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
