"""What the lock hid: the free wire under the paper's policy, as docs/physics.md tells it."""

import math
from pathlib import Path

import pytest

from magwire_env.validation.free.pictures import in_the_fork
from magwire_env.validation.page import UNLOCKED
from magwire_env.validation.unlocked import POLICIES, crossings, table

PAGE = (Path(__file__).parents[2] / "docs/physics.md").read_text(encoding="utf-8")


def test_a_fixed_magnet_moves_the_locked_wire_and_not_the_free_one():
    force, wrench, free = crossings(POLICIES[:1], (2e-3,), seconds=8.0)
    assert force.time == pytest.approx(7.5, abs=0.11)
    assert math.isnan(wrench.time)
    assert math.isnan(free.time)
    assert free.farthest < 0.11
    assert free.unconverged == 0


def test_a_magnet_that_follows_brings_the_free_wire_to_the_end():
    *_, free = crossings(POLICIES[3:], (2e-3,), seconds=8.0)
    assert 4.6 < free.time < 7.0
    assert 0.0 < free.wall < free.peak < 0.1
    line = table([free]).splitlines()[-1]
    assert line.startswith("| a magnet that follows the tip, greatest Q | free, clearance 2 mm | 5.")


def test_the_page_shows_every_policy_and_clearance():
    lines = PAGE.partition(UNLOCKED[0])[2].partition(UNLOCKED[1])[0].strip().splitlines()
    assert len(lines) == 2 + 7 * len(POLICIES)
    assert lines[2].startswith("| fixed magnet, greatest F·t | locked, driven by F·t | 7.5 s |")
    assert all(" never | 0.10 m |" in line for line in lines[4:9])


def test_the_field_chooses_the_branch_of_the_fork():
    left, right = (in_the_fork(turn)[-1] for turn in (-0.9, 0.9))
    assert left[1] > 15e-3
    assert right[1] == pytest.approx(-left[1], rel=0.02)
