"""The aggregates of made-up cells."""

from __future__ import annotations

import pytest


def _entry(data: dict, arena: str, policy: str) -> dict:
    found = next(a for a in data["arenas"] if a["name"] == arena)
    return next(p for p in found["policies"] if p["policy"] == policy)


def test_the_aggregates_are_those_of_the_cells(data):
    entry = _entry(data, "Steer", "MaxForce")
    assert entry["success"] == 1.0
    assert entry["score"] == [0.8, 0.8, 0.8]
    assert entry["time_s"][0] == pytest.approx(1.25 * 7.5, rel=1e-4)
    assert entry["time_s"][1] < entry["time_s"][0] < entry["time_s"][2]
    entry = _entry(data, "Steer", "ppo")
    assert (entry["seeds"], entry["seeds_planned"]) == (3, 3)
    assert entry["success"] == pytest.approx(1 - 4 / 120, rel=1e-4)
    assert entry["success_of_seeds"] == [1.0, 1.0, 0.9]
    assert entry["score"][0] == pytest.approx(1 - 4 / 120, rel=1e-4)
    bracket = next(a for a in data["arenas"] if a["name"] == "Steer")["bracket"]
    assert bracket["gap"] == pytest.approx(1 / 0.98 - 1, rel=1e-4)
    assert _entry(data, "Track", "MaxForce")["rms_error_mm"] == [1.25, 1.25, 1.25]
    curve = data["learning"][0]
    assert curve["success"] == {"mean": [0.0, 0.9], "low": [0.0, 0.8], "high": [0.0, 1.0]}
    assert curve["time_s"]["mean"] == [None, 8.5]
