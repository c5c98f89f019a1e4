"""Plans are kept, and made again when they must be."""

from __future__ import annotations

import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.par.cache import Cache
from agents.par.planner import best_plans
from tests.support.episodes import QUICK, begun


def test_a_kept_plan_is_the_same_and_a_damaged_file_is_survived(tmp_path):
    starts, cache = begun(n=3), Cache(tmp_path)
    made = best_plans(starts, QUICK, cache)
    files = sorted(tmp_path.rglob("*.npz"))
    assert len(files) == 3
    assert not list(tmp_path.rglob("*.part"))
    before = [f.stat().st_mtime_ns for f in files]
    kept = best_plans(starts, QUICK, cache)
    assert [f.stat().st_mtime_ns for f in files] == before
    assert np.array_equal(kept.actions[:, :60], made.actions[:, :60])
    assert np.array_equal(kept.time, made.time)
    files[0].write_bytes(files[0].read_bytes()[:100])
    with pytest.warns(UserWarning, match=files[0].name):
        again = best_plans(starts, QUICK, cache)
    assert again.time == pytest.approx(made.time, abs=1e-4)  # planned alone now, and not beside the others
    assert np.array_equal(best_plans(starts, QUICK, cache).time, again.time)


def test_a_plan_of_another_simulator_is_made_again(tmp_path):
    starts, cache = begun(n=1), Cache(tmp_path)
    made = best_plans(starts, QUICK, cache)
    (key,) = cache.keys(starts, QUICK)
    cache.store(key, made.actions[0], float(made.time[0]) - 0.5)
    with pytest.warns(UserWarning, match="another simulator"):
        assert best_plans(starts, QUICK, cache).time == pytest.approx(made.time)
