"""What a scenario's numbers must lie in, and files that try to get past it."""

import dataclasses
import typing

import pytest

from magwire_env import Scenario
from magwire_env.physics import BlockMagnet, CylinderMagnet, Guidewire, PointDipole, Tract
from magwire_env.physics.ranges import RANGES
from magwire_env.scenario import (
    ActuatedMagnet,
    Coil,
    Contact,
    Current,
    Feed,
    Reading,
    Sensing,
    Slide,
    Timing,
    Turn,
    Twist,
    Variation,
)

PAPER = Scenario.paper()
PARTS = {
    "Guidewire": PAPER.wire, "Tract": PAPER.tract, "BlockMagnet": BlockMagnet((0.05, 0.05, 0.05), 1.3),
    "CylinderMagnet": PAPER.tip, "PointDipole": PointDipole(1.0), "Contact": PAPER.contact, "Timing": Timing(),
    "ActuatedMagnet": PAPER.rig.magnets[0], "Turn": Turn(), "Slide": Slide("x", -1.0, 1.0), "Current": Current(),
    "Coil": Coil("x"), "Feed": Feed(), "Twist": Twist(),
    "Reading": Reading(), "Sensing": Sensing(), "Variation": Variation(), "Scenario": PAPER,
}  # fmt: skip
KINDS = (
    Guidewire, Tract, BlockMagnet, CylinderMagnet, PointDipole, Contact, Timing, ActuatedMagnet, Turn, Slide, Current,
    Coil, Feed, Twist, Reading, Sensing, Variation, Scenario,
)  # fmt: skip


@pytest.mark.parametrize("name", RANGES)
def test_a_number_beyond_its_range_is_refused_by_name(name):
    part, _, field = name.partition(".")
    low, high, _ = RANGES[name]
    whole = isinstance(low, int)
    for value in (low - 1 if whole else low - max(1e-3 * abs(low), 1e-300), high + 1 if whole else 1.001 * high):
        given = value
        if field in ("position", "gravity", "size"):
            given = (0.01, 0.01, value)
        elif field == "points":
            given = ((0.0, 0.0, 0.0), (0.0, 0.0, value))
        with pytest.raises(ValueError, match=f"{part}.{field}"):
            dataclasses.replace(PARTS[part], **{field: given})


def test_every_number_of_a_scenario_has_a_range():
    """A field of floats that nobody bounds would let a scenario in that overflows."""
    for kind in KINDS:
        for field, hint in typing.get_type_hints(kind).items():
            numbers = hint in (int, float, float | None, int | None) or "float" in str(hint)
            if numbers and field != "dipoles":
                assert f"{kind.__name__}.{field}" in RANGES


HEAD = PAPER.dumps()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (HEAD.replace("friction = 0.05", f"friction = {'9' * 400}").encode(), "Contact.friction must be finite"),
        (HEAD.replace("friction = 0.05", f"friction = {'9' * 5000}").encode(), "not valid TOML|thousands of digits"),
        (HEAD.replace("friction = 0.05", "friction = 'text'").encode(), "Contact.friction must be a number"),
        (("name = " + "[" * 100_000).encode(), "mine.toml is not valid TOML"),
        (b"name = '\xff\xfe'", "mine.toml must be text in UTF-8"),
        (HEAD.replace("[timing]", "[timing]\nsubsteps = 1000000000").encode(), "Timing.substeps must lie in"),
        (HEAD.replace("delay = 0", "delay = 1000000000").encode(), "Sensing.delay must lie in"),
        (HEAD.replace('"fitted",\n    21,', '"grid",\n    [10000, 10000, 10000],').encode(), "at most 200000 dipoles"),
    ],
)  # fmt: skip
def test_a_file_that_asks_for_too_much_ends_in_a_sentence(tmp_path, content, words):
    file = tmp_path / "mine.toml"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=words) as error:
        Scenario.load(file)
    assert str(file) in str(error.value)
    assert len(str(error.value)) < 1000


def test_a_huge_file_is_refused_unread(tmp_path):
    file = tmp_path / "huge.toml"
    with file.open("wb") as out:
        out.truncate(100 * 2**20)
    with pytest.raises(ValueError, match="104857600 bytes long, more than"):
        Scenario.load(file)
