"""The report from made-up cells; and the committed report, whose texts and plots must be of its own numbers."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agents.benchmark.aggregates import collect
from agents.benchmark.plan import PAR, Arena, Cell, Learner, Plan
from agents.benchmark.plots import DIGEST
from agents.benchmark.report import MARKS, insert, markdown, readme_table, text_of, write
from agents.evaluation.evaluator import Episodes
from agents.evaluation.robustness import DISTURBANCES

DOCS = Path(__file__).parents[3] / "docs"
README = DOCS.parent / "README.md"
N = 40
PLAN = Plan(
    (Arena("Steer", "MagWire/Steer-v0", episodes=N), Arena("Track", "MagWire/Track-v0", episodes=N)),
    (Learner("ppo", ("Steer",), 3), Learner("sac", ("Steer",), 2)),
    robustness={"Steer": ("MaxForce",)},
)
CURVE = "timesteps,seconds,success_rate,median_time_s,mean_reward\n1000,1,0.0,nan,-5\n2000,2,{},8.5,3\n"


def _episodes(policy: str, slower: float, tracking: bool, failures: int = 0) -> Episodes:
    rng = np.random.default_rng(0)
    fields = {f.name: rng.uniform(0.01, 0.1, N) for f in dataclasses.fields(Episodes) if f.name != "policy"}
    fields["time"] = slower * np.linspace(7.0, 8.0, N)
    fields["time"][:failures] = np.nan
    fields["success"] = np.isfinite(fields["time"])
    fields["rms_error"] = 1e-3 * slower * np.ones(N) if tracking else np.full(N, np.nan)
    fields["path_ratio"] = np.full(N, np.nan) if tracking else np.ones(N)
    fields["steps"] = np.full(N, 75)
    return Episodes(policy, **fields)


def _put(out: Path, cell: Cell, content: dict) -> None:
    cell.file(out).parent.mkdir(parents=True, exist_ok=True)
    cell.file(out).write_text(json.dumps({"settings": PLAN.settings(cell), "seconds": 2.0, **content}))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    out = tmp_path_factory.mktemp("cells")
    for arena in ("Steer", "Track"):
        tracking = arena == "Track"
        par = _episodes(PAR, 1.0, tracking)
        bound = {"lower_bound_s": None if tracking else (0.98 * par.time).tolist()}
        _put(out, Cell("par", arena, PAR), par.to_json() | bound)
        for name, slower in (("MaxForce", 1.25), ("Random", 4.0)):
            _put(out, Cell("evaluate", arena, name), _episodes(name, slower, tracking).to_json())
        _put(out, Cell("evaluate", arena, "NetForce"), {"not_applicable": "it does not like it"})
    for seed, failures in enumerate((0, 0, 4)):
        _put(out, Cell("train", "Steer", "ppo", seed), {"curve": CURVE.format(1 - seed / 10), "resumed": False})
        _put(out, Cell("evaluate", "Steer", "ppo", seed), _episodes("ppo", 1.0, False, failures).to_json())
    disturbed = {one.name: _episodes("MaxForce", 1.25, False, i).to_json() for i, one in enumerate(DISTURBANCES)}
    _put(out, Cell("robustness", "Steer", "MaxForce"), {"disturbed": disturbed})
    return json.loads(text_of(collect(PLAN, out)))


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
    assert entry["score_mean"] == pytest.approx(1 - 4 / 120, rel=1e-4)
    bracket = next(a for a in data["arenas"] if a["name"] == "Steer")["bracket"]
    assert bracket["gap"] == pytest.approx(1 / 0.98 - 1, rel=1e-4)
    assert _entry(data, "Track", "MaxForce")["rms_error_mm"] == [1.25, 1.25, 1.25]
    curve = data["learning"][0]
    assert curve["success"] == {"mean": [0.0, 0.9], "low": [0.0, 0.8], "high": [0.0, 1.0]}
    assert curve["time_s"]["mean"] == [None, 8.5]


def test_what_is_missing_is_named(data):
    assert "train Steer sac seed 1" in data["missing"]
    assert "evaluate Steer sac seed 0" in data["missing"]
    assert not any("NetForce" in name for name in data["missing"])
    page = markdown(data)
    assert f"**Missing**: {len(data['missing'])} cells" in page
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


def test_the_files_are_the_jsons_own(data, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{MARKS[0]}\nold\n{MARKS[1]}\nafter\n")
    files = write(data, tmp_path, readme)
    assert {p.name for p in files} >= {"benchmark.json", "benchmark.md", "README.md", "robustness_Steer_MaxForce.png"}
    assert "old" not in readme.read_text()
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
