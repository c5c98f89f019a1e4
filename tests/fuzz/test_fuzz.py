"""The fuzzers at a small size, the bounds-checked build, and the page that tells of them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from magwire_env.physics import ranges
from magwire_env.simulation import Simulator
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.lanes import LANES
from magwire_env.simulation.magnetics import MAGNET

from . import calls, energy, files, free_wire, kills, scenarios, steps

DOC = Path(__file__).parents[2] / "docs" / "reliability.md"


def test_steps_in_registered_tasks_and_random_scenarios():
    seen = steps.fuzz(70_000, seed=11, lanes=64, spreads=("near", "far"), show=False)
    assert seen["lane steps"] >= 20_000
    assert seen["batches"] >= 2


@pytest.mark.parametrize("spread", scenarios.SPREADS)
def test_random_scenarios_are_accepted_often_enough(spread):
    rng = np.random.default_rng(0)
    found, refused = scenarios.batch(rng, spread, 3, scenarios.layout(rng))
    assert len({scenario.substeps for scenario in found}) == 1
    assert refused < 400


def test_calls():
    seen = calls.fuzz(300, seed=5)
    assert {name.split()[0] for name in seen} == {call.__name__ for call in calls.CALLS}


FREE = {"dragged": (False, False, False), "fed into a fork": (True, False, True), "fed and turned": (True, True, False)}
"""Whether a random free wire is fed, twists, and is in a tree."""


def free_wires(kind: str) -> tuple[list, np.random.Generator]:
    rng = np.random.default_rng(3)
    return [free_wire.scenario(rng, *FREE[kind]) for _ in range(2)], rng


@pytest.mark.parametrize("tolerance", [0.01, 1.0])
@pytest.mark.parametrize("kind", FREE)
def test_no_step_of_a_free_wire_makes_energy(kind, tolerance):
    found = energy.play(*free_wires(kind), lanes=8, steps=40, tolerance=tolerance)
    assert found.seen["judged"] > 0.7 * found.seen["steps"]
    assert found.seen["held"] > 0.4 * found.seen["steps"]
    assert found.seen["failed"] == found.seen["unexplained"] == 0
    assert found.kinetic > 0.0


def magnet_pulls_more_than_its_energy_falls(sim: Simulator) -> None:
    sim.rig._magnets[:, :, MAGNET.strength] *= 1.05


def friction_pushes(sim: Simulator) -> None:
    """In every other lane: a kernel without any friction leaves it out."""
    sim.model._par.reshape(-1, at.PAR_SIZE // LANES, LANES)[:, at.FRICTION // LANES, ::2] = -0.05
    sim.model._par.reshape(-1, at.PAR_SIZE // LANES, LANES)[:, at.FRICTION // LANES, 1::2] = 0.05


@pytest.mark.parametrize("change", [magnet_pulls_more_than_its_energy_falls, friction_pushes])
def test_a_wrong_force_is_found_by_its_energy(change):
    found = energy.play(*free_wires("dragged"), lanes=8, steps=40, change=change)
    assert found.seen["unexplained"] > 0


def test_a_batch_that_can_never_be_made_ends_in_a_sentence(monkeypatch):
    def refused(*_):
        raise ValueError("too long")

    monkeypatch.setattr(free_wire, "scenario", refused)
    with pytest.raises(RuntimeError, match="101 scenarios were refused, the last one: too long"):
        free_wire.batch(np.random.default_rng(0), 2)


@pytest.mark.parametrize(("fed", "tree"), [(False, False), (True, False), (False, True), (True, True)])
def test_random_free_wires_of_every_kind_are_accepted(fed, tree):
    rng = np.random.default_rng(1)
    assert [free_wire.scenario(rng, fed, fed, tree).model for _ in range(3)] == ["free"] * 3


@pytest.mark.parametrize("kind", ["scenario", "policy", "run", "plan"])
def test_mutated_files(kind, tmp_path):
    seen = files.fuzz(kind, 60, seed=2, folder=tmp_path)
    assert seen.total() == 60


CHECKED = """
import numpy as np
from numba import njit
from magwire_env.simulation import lanes

@njit
def loaded(a, i): return lanes.anywhere(lanes.load(a, i) > 0.0)
@njit
def stored(a, i): lanes.store(a, i, 1.0)
@njit
def gathered(t, x, k): return lanes.anywhere(lanes.gather(t, lanes.spread(x), k) > 0.0)
@njit
def rowed(a, i): return lanes.row(a, i)[0]
@njit
def parted(a, i, n): return lanes.part(a, i, n)[0]

a, b, t = np.zeros((3, lanes.LANES)), np.zeros((3, 4)), np.zeros(40)
for function, good, bad in (
    (loaded, (a, 2), [(a, 3), (a, -1)]), (stored, (a, 2), [(a, 3), (a, -1)]),
    (gathered, (t, 39.0, 0), [(t, 40.0, 0), (t, -1.0, 0), (t, 0.0, 40)]), (rowed, (b, 2), [(b, 3), (b, -1)]),
    (parted, (t, 30, 10), [(t, 31, 10), (t, -1, 2), (t, 5, -1)]),
):
    function(*good)
    for arguments in bad:
        try:
            function(*arguments)
        except IndexError as error:
            print(error)
        else:
            print("missed", function.__name__, arguments[1:])
"""


def test_the_bounds_checked_build_checks_loads_stores_and_gathers():
    done = subprocess.run(
        [sys.executable, "-c", CHECKED], env=os.environ | {"NUMBA_BOUNDSCHECK": "1"}, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    said = done.stdout.splitlines()
    assert len(said) == 12
    assert all(re.fullmatch(r"a (load|store|gather|row|part) outside of an array", line) for line in said)


def test_the_page_has_the_ranges_as_they_are():
    text = DOC.read_text(encoding="utf-8")
    assert text.partition("<!-- ranges:begin -->\n")[2].partition("\n<!-- ranges:end -->")[0] == ranges.table()


def test_every_failure_on_the_page_names_tests_that_exist():
    table = (
        DOC.read_text(encoding="utf-8").partition("<!-- failures:begin -->\n")[2].partition("<!-- failures:end -->")[0]
    )
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    assert {what.split()[0].rstrip("abcdefghi") for what, _ in rows} == {f"B{n}" for n in range(1, 13)}
    for what, tests in rows:
        named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", tests)
        assert named, what
        for file, test in named:
            assert f"def {test}(" in (DOC.parents[1] / "tests" / file).read_text(encoding="utf-8"), test


def test_the_kills_find_what_they_look_at(tmp_path):
    """Its imports stand in the function, so that a killed process starts quickly; one of them was gone."""
    assert kills.look_at_training(tmp_path / "no run yet") == -1
