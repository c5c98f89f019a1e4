"""The validation table at test size, and the table itself: what fails must say so."""

import functools
import math
import warnings
from pathlib import Path

import numpy as np
import pytest

from agents.cli.main import main
from magwire_env.physics import BlockMagnet
from magwire_env.scenario import Contact, Scenario
from magwire_env.simulation import drive_at
from magwire_env.validation import CHECKS, TEST, Check, Row, claims, run, table
from magwire_env.validation.motion import bench, straight_then_arc, tip_energy
from magwire_env.validation.page import without_numbers
from magwire_env.validation.report import at_least, at_most
from magwire_env.validation.rods import force_unit


@functools.cache
def printed() -> set[str]:
    """Quantities of the table in docs/physics.md, all of which must hold there; numbers in them depend on the size."""
    page = (Path(__file__).parents[2] / "docs/physics.md").read_text(encoding="utf-8")
    table = page[page.index("| quantity | expected |") :]
    lines = [line.split(" | ") for line in table.splitlines() if line.startswith("| ")][2:]
    assert all(line[-1] == "holds |" for line in lines)
    return {without_numbers(line[0].strip("| ")) for line in lines}


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
@pytest.mark.filterwarnings("default:::elastica")
def test_every_check_holds_at_test_size(check):
    rows = check.rows(TEST)
    assert rows
    assert [row.cells() for row in rows if not row.holds] == []
    for row in rows:
        if row.skipped:
            pytest.skip(row.skipped)
        assert without_numbers(row.quantity) in printed(), "docs/physics.md lacks it: print the table again"


def test_a_row_holds_within_its_tolerance_or_bound_only():
    assert Row("q", "m", 2.0, "s", 2.01, 6e-3).holds
    assert not Row("q", "m", 2.0, "s", 2.01, 4e-3).holds
    assert not Row("q", "m", -2.0, "s", 2.0, 0.1).holds
    assert not Row("q", "m", 0.0, "s", 1e-9, 0.1).holds
    assert at_most("q", "", 1.0, "s", 1.0).holds
    assert not at_most("q", "", 1.0, "s", 1.001).holds
    assert at_least("q", "", 1.0, "s", 1.0).holds
    assert not at_least("q", "", 1.0, "s", 0.999).holds
    for row in (Row("q", "", 1.0, "s", math.nan, 1.0), at_most("q", "", 1.0, "s", math.nan)):
        assert not row.holds
        assert row.verdict == "FAILS"


def test_a_check_without_its_module_is_skipped_with_the_reason():
    (row,) = Check("exact block", lambda size: [], needs="no_such_module").rows(TEST)
    assert row.verdict == "skipped"
    assert "no_such_module is not installed" in table([row])


def test_table_in_text_and_markdown():
    rows = [Row("tip angle", "°", 26.434, "elastica", 26.436, 1e-3), at_most("error", "%", 0.5, "magpylib", 0.7)]
    head, rule, first, second = table(rows).splitlines()
    assert head.split("  ")[0] == "quantity"
    assert set(rule) == {"-", " "}
    assert "26.434 °" in first
    assert "7.6e-05 (≤ 1e-03)" in first
    assert first.endswith("holds")
    assert "≤ 0.5 %" in second
    assert second.endswith("FAILS")
    lines = table(rows, markdown=True).splitlines()
    assert {line.count("|") for line in lines} == {7}


def test_a_wide_table_takes_several_lines_a_row_and_120_columns():
    long = "F19 whip, a = 1.65: most that the tip turns for 0.25° of the base, over a whole turn of it, with friction"
    rows = [Row(long, "°", 91.841, "Euler, Bernoulli and others since", 91.841, 1e-3), Row("b", "", 1.0, "", 1.0, 1e-3)]
    head, rule, *lines = table(rows).splitlines()
    assert max(map(len, (head, rule, *lines))) <= 120
    width = rule.index(" ")
    assert " ".join(line[:width].strip() for line in lines[:-1]) == long
    assert lines[-1].startswith("b ")


def test_checks_say_nothing_of_benches_whose_numbers_nobody_means():
    def odd(_):
        return [at_least("friction", "", 1.0, "", Scenario.paper().replace(contact__friction=50.0).contact.friction)]

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert run([Check("odd", odd)], TEST)[0].holds
    assert not said


def test_the_command_prints_the_table_and_fails_with_the_checks(monkeypatch, capsys):
    good = Check("good", lambda size: [Row("length", "m", 1.0, "ruler", 1.0, 1e-3)])
    bad = Check("bad", lambda size: [at_least("margin", "mN", 0.0, "claim", -0.1)])
    monkeypatch.setattr("magwire_env.validation.CHECKS", (good,))
    main(["validate", "--quick"])
    assert capsys.readouterr().out.endswith("1 hold, 0 skipped, 0 fail\n")
    monkeypatch.setattr("magwire_env.validation.CHECKS", (good, bad))
    with pytest.raises(SystemExit) as ended:
        main(["validate", "--quick", "--markdown"])
    assert ended.value.code == 1
    out = capsys.readouterr().out
    assert "| margin | ≥ 0 mN | claim | -0.1 mN |  | FAILS |" in out
    assert "1 hold, 0 skipped, 1 fail" in out


def stronger_block(patch) -> None:
    patch.setattr("magwire_env.validation.magnets.BLOCK", BlockMagnet((50.8e-3,) * 3, 1.01 * 1.3))


def stiffer_wire(patch) -> None:
    patch.setattr("magwire_env.validation.rods.force_unit", lambda rod: 0.99 * force_unit(rod))


def weaker_coupling(patch) -> None:
    patch.setattr("magwire_env.validation.motion.tip_energy", lambda *args: 0.99 * tip_energy(*args))


def rougher_wall(patch) -> None:
    resistance = claims.resistance
    patch.setattr("magwire_env.validation.claims.resistance", lambda *args: resistance(*args) + 2e-3)


@pytest.mark.parametrize(
    ("doctor", "names"),
    [
        (stronger_block, ["block and tip, coaxial"]),
        (stiffer_wire, ["cantilever"]),
        (weaker_coupling, ["generalised force", "energy"]),
        (rougher_wall, ["the paper's claim"]),
    ],
)
def test_checks_notice_a_wrong_law(monkeypatch, doctor, names):
    doctor(monkeypatch)
    for check in CHECKS:
        if check.name in names:
            assert not all(row.holds for row in check.rows(TEST)), check.name


def test_resistance_of_a_frictionless_wire_is_what_the_bends_store():
    paper = Scenario.paper().replace(contact__friction=0.0)
    head, tail = paper.tract.curvature(np.array([0.42, 0.32]))
    stored = 0.5 * paper.wire.bending_rigidity * (head**2 - tail**2)
    assert claims.resistance(paper, 0.42, 1.0) == pytest.approx(stored, rel=1e-9)
    assert claims.resistance(paper, 0.42, -1.0) == pytest.approx(-stored, rel=1e-9)


@pytest.mark.parametrize("depth", [0.02, 0.04, 0.08])
def test_friction_along_a_wire_with_its_head_in_an_arc(depth):
    """In closed form, b = ½ E I κ²: forward b (2 − e^{−μφ}), back b (e^{μφ} − 2)."""
    bend, mu = 0.05, 0.3
    scenario = bench(straight_then_arc(bend, math.pi, 0.5, 2.5e-3), contact=Contact(friction=mu))
    b, grown = 0.5 * scenario.wire.bending_rigidity / bend**2, math.exp(mu * depth / bend)
    assert claims.resistance(scenario, 0.5 + depth, 1.0) == pytest.approx(b * (2 - 1 / grown), rel=2e-2)
    assert claims.resistance(scenario, 0.5 + depth, -1.0) == pytest.approx(b * (grown - 2), rel=2e-2)


def test_margins_name_the_weakest_place():
    scenario = Scenario.paper()
    s = np.linspace(0.1, 0.8, 71)
    found = claims.margins(scenario, s, 1.0)
    least, at = found.weakest
    assert least == found.margin.min() > 0
    assert found.margin[np.searchsorted(s, at)] == least
    heavier = claims.margins(scenario.replace(contact__friction=0.5), s, 1.0)
    assert (heavier.margin < found.margin).all()


def test_share_of_places_where_the_paper_s_angle_pushes_backwards():
    scenario, s = Scenario.paper(), np.linspace(0.1, 0.8, 141)
    share = claims.backward_share(scenario, s)
    angles = claims.best_command(scenario, s)[0]
    q = drive_at(scenario.replace(coupling="wrench"), angles, s)
    assert share == (q < 0).mean()
    assert 0.1 < share < 0.3
