"""The report of made-up cells; and the committed report, whose texts and plots must be of its own numbers."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest
from PIL import Image

from agents.benchmark.plots import DIGEST
from agents.benchmark.report import MARKS, README_POLICIES, insert, markdown, readme_table, text_of, write

DOCS = Path(__file__).parents[3] / "docs"
README = DOCS.parent / "README.md"


def test_what_is_missing_is_named(data):
    assert "train Steer sac seed 1" in data["missing"]
    assert "evaluate Steer sac seed 0" in data["missing"]
    assert not any("NetForce" in name for name in data["missing"])
    page = markdown(data)
    assert f"**Missing** from this report: {len(data['missing'])} cells, " in page
    assert "| sac *(trained, 0 of 2 seeds)* | missing |" in page
    assert "Not applicable: NetForce (it does not like it)." in page


def test_the_page_says_it_plainly(data):
    page = markdown(data)
    assert "| MaxForce | 100 % | 9.38 (" in page
    assert "| Optimal *(par)* | 100 % |" in page
    assert "| Random *(floor)* | 100 % |" in page
    assert "| ppo *(trained, 3 seeds)* | 97 % |" in page
    assert "gap 2.0 %" in page
    assert "within 1 + gap" in page
    assert "| MaxForce | 100 % | 1.25 (1.25–1.25) | 0.800 (0.800–0.800) | – |" in page
    assert "| friction × 4 |" in page
    assert "| Steer | ppo | 3 |" in page
    for table in re.findall(r"(?:^\|.*\|\n)+", page, re.MULTILINE):
        assert len({line.count("|") for line in table.splitlines()}) == 1


def test_a_par_that_is_beaten_is_not_passed_over(data):
    changed = json.loads(json.dumps(data))
    changed["arenas"][0]["best_mean_score"] = 1.05
    assert "Highest mean score: 1.0500 (ppo), **beyond** 1 + gap" in markdown(changed)


def test_nearly_all_is_not_all(data):
    changed = json.loads(json.dumps(data))
    next(p for p in changed["arenas"][0]["policies"] if p["policy"] == "MaxForce")["success"] = 0.998
    assert "| MaxForce | 99.8 % |" in markdown(changed)
    assert "99.8 % · 0.80" in readme_table(changed)


def test_the_readme_shows_a_few_policies_on_the_registered_tasks(data):
    head, _, *rows = readme_table(data).splitlines()
    assert "ood" not in head
    assert [row.split("|")[1].split()[0] for row in rows] == [p for p in README_POLICIES if p != "knows_ppo"]


def test_the_files_are_the_jsons_own(data, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{MARKS[0]}\nstale\n{MARKS[1]}\nafter\n")
    files = write(data, tmp_path, readme)
    assert {p.name for p in files} >= {"benchmark.json", "benchmark.md", "README.md", "robustness_Steer_MaxForce.png"}
    assert "stale" not in readme.read_text()
    assert readme.read_text().startswith("before\n") and readme.read_text().endswith("\nafter\n")  # noqa: PT018
    _check(tmp_path, readme)
    (tmp_path / "benchmark.md").write_text((tmp_path / "benchmark.md").read_text().replace("0.800", "0.801"))
    with pytest.raises(AssertionError):
        _check(tmp_path, readme)


def test_a_plot_of_other_numbers_is_found_out(data, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text("\n".join(MARKS))
    write(data, tmp_path, readme)
    changed = json.loads(json.dumps(data))
    changed["made"]["cores"] = 99
    text = text_of(changed)
    (tmp_path / "benchmark.json").write_text(text)
    (tmp_path / "benchmark.md").write_text(markdown(json.loads(text)))
    with pytest.raises(AssertionError, match="is not of these numbers"):
        _check(tmp_path, readme)


@pytest.mark.parametrize("text", ["", MARKS[0], f"{MARKS[1]} {MARKS[0]}", " ".join(MARKS + MARKS)])
def test_a_readme_without_its_marks_is_refused(text):
    with pytest.raises(ValueError, match="README must hold the lines"):
        insert(text, "table")


def _check(docs: Path, readme: Path) -> None:
    """Page, README table and plots are those of benchmark.json."""
    text = (docs / "benchmark.json").read_text(encoding="utf-8")
    data = json.loads(text)
    page, whole = (docs / "benchmark.md").read_text(encoding="utf-8"), readme.read_text(encoding="utf-8")
    assert text == text_of(data)
    assert page == markdown(data)
    assert whole == insert(whole, readme_table(data))
    digest = hashlib.sha256(text.encode()).hexdigest()
    cited = re.findall(r"\]\((figures/[^)]+\.png)\)", page)
    assert cited
    for name in cited:
        with Image.open(docs / name) as picture:
            assert picture.text[DIGEST] == digest, f"{name} is not of these numbers"


@pytest.mark.skipif(not (DOCS / "benchmark.json").exists(), reason="docs/benchmark.json has not been made yet")
def test_the_committed_report_is_of_its_own_numbers():
    _check(DOCS, README)
    assert (DOCS / "benchmark.json").stat().st_size < 1_000_000
