"""The generator: every tract within its bounds, a value of its seed, and the splits apart."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from magwire_env.lumen import generator
from magwire_env.lumen.generator import (
    SPLITS,
    Bounds,
    extent,
    generate,
    main,
    self_clearance,
    sharpest_bend,
    within_bounds,
)
from magwire_env.lumen.named import circle, paper_spiral, straight
from magwire_env.physics import Tract
from magwire_env.scenario import above

ROOMY = Bounds(length=(0.05, 2.0), bend_radius=0.02, lumen=(1e-3, 19e-3), margin=1e-3, box=(1.0, 1.0, 1.0))


def digest(seeds, split):
    """A hash of the control points in whole micrometres."""
    points = [np.rint(1e6 * np.array(generate(seed, split).points)).astype("<i4").tobytes() for seed in seeds]
    return hashlib.sha256(b"".join(points)).hexdigest()[:16]


@pytest.mark.parametrize("split", SPLITS)
def test_a_sample_keeps_to_its_bounds_measured_another_way(split):
    bounds = Bounds()
    for seed in range(0, 600, 6):
        tract = generate(seed, split)
        within_bounds(tract, bounds)
        s = np.linspace(0.0, tract.length, 1201)
        p, t = tract.position(s), tract.tangent(s)
        r = tract.radius_at(s[::3])
        q = p[::3]
        gap = np.linalg.norm(q[:, None] - q, axis=2) - r[:, None] - r
        gap[np.abs(s[::3, None] - s[::3]) < 4 * tract.widest] = np.inf
        assert bounds.length[0] <= tract.length <= bounds.length[1]
        assert np.linalg.norm(np.diff(t, axis=0), axis=1).max() / s[1] <= 1.001 / bounds.bend_radius
        assert (np.abs(p) <= np.array(bounds.box) / 2 + 1e-6).all()
        assert bounds.lumen[0] <= r.min()
        assert r.max() <= bounds.lumen[1]
        assert gap.min() >= bounds.margin - 2e-4
        assert above(tract, 0.07)[2] <= bounds.box[2] / 2 + 0.07  # where the magnet 7 cm away goes


def test_lumens_vary_and_the_default_tract_is_a_good_use_of_its_box():
    tracts = [generate(seed) for seed in range(40)]
    assert all(isinstance(t.radius, tuple) and len(t.radius) == len(t.points) for t in tracts)
    assert np.mean([t.widest - min(t.radius) for t in tracts]) > 0.3e-3
    assert np.std([t.length for t in tracts]) > 0.03
    assert np.median([extent(t).max() for t in tracts]) > 0.17


def test_a_tract_depends_on_seed_split_and_bounds_alone():
    assert generate(7) == generate(7, "train", Bounds())
    assert generate(7) != generate(8)
    assert generate(7) != generate(7, bounds=Bounds(bend_radius=0.032))
    # Whatever ran before, in another process, and (rounded to 1 µm) on another machine: these never change.
    here = Path(__file__).parent
    program = (
        "import tests.lumen.test_generator as t; "
        "print(t.digest(range(5), 'train'), t.digest(range(5), 'test'), t.digest(range(9), 'ood'))"
    )
    command = [sys.executable, "-c", program]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, cwd=here.parents[1]).stdout
    assert printed.split() == PINNED
    assert [digest(range(5), "train"), digest(range(5), "test"), digest(range(9), "ood")] == PINNED


PINNED = ["114bf37e98dbc6de", "b545b7f8261a48d8", "184358727464aaa6"]


def test_splits_are_disjoint():
    shapes = {split: {generate(seed, split).points for seed in range(60)} for split in SPLITS}
    assert all(len(found) == 60 for found in shapes.values())
    assert not shapes["train"] & shapes["test"]
    assert not shapes["train"] & shapes["ood"]
    # Not near-copies either: the closest pair of a train and a test tract is centimetres apart somewhere.
    ends = {k: np.array([[p[0], p[len(p) // 2], p[-1]] for p in v]) for k, v in shapes.items()}
    between = np.abs(ends["train"][:, None] - ends["test"]).max(axis=(2, 3))
    assert between.min() > 5e-3


def test_the_other_families_are_ones_training_never_shows():
    trained, others = [generate(s) for s in range(100)], [generate(s, "ood") for s in range(100)]
    # A wander's height comes back to where it began; a helix climbs by a lumen and more a turn.
    assert max(climb(t) for t in trained) < 1e-3
    assert sum(climb(t) > 0.028 and winds(t) > 1.4 for t in others) >= 20
    # Loops side by side, and arches: three straight runs or more, which a wander has once in a hundred.
    assert sum(straight_runs(t) >= 3 for t in trained) <= 4
    assert sum(straight_runs(t) >= 3 for t in others) >= 35


def climb(tract):
    return abs(tract.points[-1][2] - tract.points[0][2])


def winds(tract):
    """Turns of the tangent about z."""
    t = tract.tangent(np.linspace(0.0, tract.length, 400))
    return np.ptp(np.unwrap(np.arctan2(t[:, 1], t[:, 0]))) / (2 * np.pi)


def straight_runs(tract):
    """How many runs of 50 mm and more bend less than a radius of 0.2 m."""
    s = np.linspace(0.0, tract.length, 800)
    flat = tract.curvature(s) < 5.0
    runs = np.split(flat, np.flatnonzero(np.diff(flat)) + 1)
    return sum(run[0] and len(run) * s[1] >= 0.05 for run in runs)


@pytest.mark.parametrize("split", SPLITS)
def test_other_bounds_are_kept_too(split):
    bounds = Bounds(length=(0.3, 0.4), bend_radius=0.02, lumen=(4e-3, 4e-3), margin=1e-3, box=(0.15, 0.2, 0.06))
    for seed in range(10):
        tract = generate(seed, split, bounds)
        within_bounds(tract, bounds)
        assert tract.widest == min(tract.radius) == 4e-3


def test_impossible_bounds_say_so():
    with pytest.raises(ValueError, match=r"bounds must leave room.*box=\(0.06, 0.06, 0.05\)"):
        generate(0, bounds=Bounds(box=(0.06, 0.06, 0.05)))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"seed": -1}, "seed must be a whole number of at least 0, got -1"),
        ({"seed": 1.5}, "seed must be a whole number"),
        ({"seed": True}, "seed must be a whole number"),
        ({"seed": 1, "split": "validation"}, "split must be one of 'train', 'test', 'ood', got 'validation'"),
    ],
)
def test_bad_arguments_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        generate(**arguments)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"length": (0.8, 0.8)}, r"Bounds.length must span at least 2 %"),
        ({"length": (0.8,)}, r"Bounds.length must be 2 finite numbers \(in m\)"),
        ({"bend_radius": 0.0}, "Bounds.bend_radius must be greater than 0"),
        ({"bend_radius": 8e-3}, "Bounds.bend_radius must exceed the widest lumen radius"),
        ({"lumen": (8e-3, 7e-3)}, r"Bounds.lumen must be \(least, most\)"),
        ({"margin": -1e-3}, "Bounds.margin must be at least 0"),
        ({"box": (0.2, 0.2, 0.0)}, r"Bounds.box\[2\] must be greater than 0"),
    ],
)
def test_bounds_refuse_what_cannot_be(changes, words):
    with pytest.raises(ValueError, match=words):
        Bounds(**changes)


def bent(turn, radius=0.03, lead=0.1):
    """Two straight leads joined by an arc of `turn` rad in the x–y plane."""
    angle = np.linspace(0.0, turn, 40)[1:-1]
    arc = radius * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
    first = np.stack([np.linspace(-lead, 0.0, 40), np.zeros(40), np.zeros(40)], axis=1)
    end = radius * np.array([np.sin(turn), 1 - np.cos(turn), 0.0])
    out = end + np.linspace(0.0, lead, 40)[:, None] * np.array([np.cos(turn), np.sin(turn), 0.0])
    return np.vstack([first, arc, out])


@pytest.mark.parametrize(
    ("tract", "changes", "words"),
    [
        (straight(0.8), {"length": (0.9, 1.2)}, r"length must lie in \[0.9, 1.2\] m, got 0.8000 m"),
        (straight(0.8), {"box": (0.5, 0.5, 0.1)}, r"x must stay within ±0.25 m, got -?0.4000 m at s = 0"),
        (straight(0.8, 5e-3), {"lumen": (6e-3, 8e-3)}, "lumen radius must lie in .*, got 0.005"),
        (circle(0.4), {"bend_radius": 0.07}, "bend radius must be at least 0.07 m, got 0.063"),
        (Tract.from_points(bent(np.pi), 12e-3), {"margin": 40e-3}, "walls of parts .* at least 0.04 m apart, got 0.0"),
    ],
)
def test_within_bounds_names_what_is_broken(tract, changes, words):
    within_bounds(tract, ROOMY)
    bounds = Bounds(**{name: getattr(ROOMY, name) for name in ROOMY.__dataclass_fields__} | changes)
    with pytest.raises(ValueError, match=words):
        within_bounds(tract, bounds)


def test_measures_against_closed_forms():
    points = bent(1.15 * np.pi)  # leads that come together, closest at their ends
    tract = Tract.from_points(points, 5e-3)
    gap, (one, other) = self_clearance(tract)
    assert gap == pytest.approx(np.linalg.norm(points[0] - points[-1]) - 10e-3, abs=1e-4)
    assert (one, other) == pytest.approx((0.0, tract.length))
    ring = circle(0.4, radius=10e-3)  # parts 40 mm apart along it, either way round
    assert self_clearance(ring)[0] == pytest.approx(2 * 0.2 / np.pi * np.sin(np.pi * 0.04 / 0.4) - 20e-3, rel=0.02)
    assert sharpest_bend(ring)[0] == pytest.approx(0.2 / np.pi, rel=2e-3)
    assert sharpest_bend(straight())[0] > 1e6
    assert self_clearance(straight(0.02))[0] == np.inf
    assert extent(straight(0.8)) == pytest.approx([0.8, 0.0, 0.0])
    bend, at = sharpest_bend(paper_spiral())
    assert 1 / paper_spiral().curvature(at) == pytest.approx(bend, rel=1e-9)


def test_the_command_prints_a_summary(capsys):
    main(["--check", "12", "--split", "test"])
    printed = capsys.readouterr().out
    assert printed.startswith("12 tracts of 'test', seeds 0 to 11, all within Bounds(")
    for word in ("accepted", "bend radius", "wall to wall", "length", "ms a tract"):
        assert word in printed
    with pytest.raises(SystemExit):
        main(["--check", "0"])


def test_the_command_names_the_seed_that_breaks_a_bound(monkeypatch):
    search = generator._search
    monkeypatch.setattr(
        generator, "_search", lambda seed, *rest: (straight(0.8), 1) if seed == 3 else search(seed, *rest)
    )
    with pytest.raises(ValueError, match=r"seed 3 of 'train': .* must stay within"):
        generator.check(5)
