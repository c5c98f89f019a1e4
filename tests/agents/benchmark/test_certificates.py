"""NetForce keeps what certificates promise: certified wires arrive, refused ones stop where they should."""

from __future__ import annotations

import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.benchmark.certificates import main, ride_certified, ride_refused, sorted_candidates, stops_near
from agents.controllers import NetForce


@pytest.fixture(scope="module")
def found():
    return sorted_candidates("SteerAny", 24, 12, seed=3)


def test_every_certified_wire_arrives_about_when_the_certificate_says(found):
    result = ride_certified(NetForce.from_env, "SteerAny", found["certified"])
    assert result.success.all()
    ratio = result.time / [c.traverse_time for _, c in found["certified"]]
    assert 0.6 < np.median(ratio) < 1.2


def test_refused_wires_stop_at_the_first_blocked_place(found):
    result = ride_refused(NetForce.from_env, "SteerAny", found["refused"])
    assert stops_near(result, found["refused"]).mean() >= 0.9


@pytest.mark.parametrize("kind", ["Orient", "Chase", "Dual"])
def test_certified_wires_arrive_under_the_other_rigs(kind):
    some = sorted_candidates(kind, 8, 0, seed=3)["certified"]
    assert ride_certified(NetForce.from_env, kind, some).success.all()


def test_the_command_prints_the_promise(capsys):
    main(["--certified", "2", "--refused", "1"])
    printed = capsys.readouterr().out
    assert "NetForce: 2 of 2 certified finish" in printed
    assert "MaxForce" in printed
