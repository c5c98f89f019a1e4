"""The benchmark's plots."""

from __future__ import annotations

from agents.benchmark.plots import _front, _style, draw, heat_map_name
from agents.catalogue import CONTROLLERS, NOT_OF_TRACTS
from agents.learning.config import ALGORITHMS


def test_the_front_has_what_no_other_beats_in_both():
    assert _front([(3.0, 1.0), (1.0, 3.0), (2.0, 2.0), (2.5, 2.5), (1.0, 4.0)]) == [(1.0, 3.0), (2.0, 2.0), (3.0, 1.0)]


def test_every_policy_has_a_style_of_its_own():
    styles = [_style(name) for name in (*CONTROLLERS, *ALGORITHMS) if name not in NOT_OF_TRACTS]
    assert len(set(styles)) == len(styles)
    assert _style("of a user") not in styles


def test_every_plot_with_numbers_is_drawn(data, tmp_path):
    names = {path.name for path in draw(data, tmp_path, "digest")}
    assert names == {
        "benchmark_profiles.png", "benchmark_pareto.png", "benchmark_learning.png",
        *(heat_map_name(entry) for entry in data["robustness"]),
    }  # fmt: skip
