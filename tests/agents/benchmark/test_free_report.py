"""The report of free wires: of made-up cells, and the committed one, whose texts must be of its own numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from agents.benchmark.aggregates import collect
from agents.benchmark.free import FREE_ARENAS
from agents.benchmark.plan import Cell, Learner, Plan
from agents.benchmark.report import LOCKED, insert, text_of, write
from agents.benchmark.sets import SETS
from tests.agents.benchmark.conftest import CURVE, _episodes

DOCS = Path(__file__).parents[3] / "docs"
README = DOCS.parent / "README.md"
FREE = SETS["free"].form
ARENAS = tuple(arena for arena in FREE_ARENAS if arena.name in ("Gentle", "SteerFree"))
PLAN = Plan(ARENAS, (Learner("ppo", ("Gentle", "SteerFree"), 2),), {}, episodes=40)


def _put(out: Path, cell: Cell, content: dict) -> None:
    cell.file(out).parent.mkdir(parents=True, exist_ok=True)
    cell.file(out).write_text(json.dumps({"settings": PLAN.settings(cell), "seconds": 2.0, **content}))


def _played(policy: str, slower: float, failures: int, gentle: bool) -> dict:
    episodes = _episodes(policy, slower, False, failures)
    n = len(episodes.success)
    episodes.wrong_entries[:] = 0.25 if gentle else np.nan
    episodes.within_limit[:] = np.arange(n) >= 4 if gentle else np.nan
    episodes.unconverged[:3] = 7 if policy == "Random" else 0
    return episodes.to_json()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    out = tmp_path_factory.mktemp("cells")
    for arena, names in (("Gentle", ("FollowRoute", "Random")), ("SteerFree", ("MaxForce", "Random"))):
        for name, slower in zip(names, (1.0, 2.0), strict=True):
            _put(out, Cell("evaluate", arena, name), _played(name, slower, 0, arena == "Gentle"))
    for seed in range(2):
        _put(out, Cell("train", "Gentle", "ppo", seed), {"curve": CURVE.format(1), "resumed": False})
        _put(out, Cell("evaluate", "Gentle", "ppo", seed), _played("ppo", 0.8 + 0.1 * seed, 2, True))
    return json.loads(text_of(collect(PLAN, out)))


def test_times_are_given_over_the_reference_and_nothing_is_scored(data):
    gentle = data["arenas"][0]
    assert gentle["reference"] == "FollowRoute"
    by_name = {entry["policy"]: entry for entry in gentle["policies"]}
    assert by_name["Random"]["time_over_reference"] == [2.0]
    assert by_name["ppo"]["time_over_reference"] == pytest.approx([0.8, 0.9])
    assert by_name["ppo"]["within_limit"] == 0.9
    assert not any(entry["kind"] == "par" for entry in gentle["policies"])
    assert data["overall"] == []
    assert "train SteerFree ppo seed 1" in data["missing"]


def test_the_page_says_it_plainly(data):
    page = FREE.page(data)
    gentle, free = page.partition("## SteerFree")[::2]
    assert "time / FollowRoute" in gentle
    assert "time / MaxForce" in free
    assert "| ppo *(trained, 2 seeds)* | 95 % |" in gentle
    assert "| 0.80–0.90 | 0.25 | 90 % |" in gentle
    assert "wrong branches" not in free
    assert "| Random *(floor)* | 100 % |" in gentle
    rows = [line.split("|")[1:-1] for line in gentle.splitlines() if line.startswith("| Random")]
    assert rows[0][-1].strip() == "3"  # untrusted episodes
    assert "**Missing** from this report" in page
    assert "score" not in gentle.partition("## Gentle")[2]


def test_the_files_are_the_jsons_own(data, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text("\n".join((*LOCKED.marks, *FREE.marks)))
    files = write(data, tmp_path, readme, form=FREE)
    assert {file.name for file in files} == {"benchmark_trees.json", "benchmark_trees.md", "README.md"}
    _check(tmp_path, readme)
    assert readme.read_text().startswith("\n".join(LOCKED.marks))  # the other table is left alone
    (tmp_path / "benchmark_trees.md").write_text((tmp_path / "benchmark_trees.md").read_text().replace("0.80", "0.81"))
    with pytest.raises(AssertionError):
        _check(tmp_path, readme)


def _check(docs: Path, readme: Path) -> None:
    """Page and README table are those of benchmark_trees.json."""
    text = (docs / "benchmark_trees.json").read_text(encoding="utf-8")
    numbers = json.loads(text)
    whole = readme.read_text(encoding="utf-8")
    assert text == text_of(numbers)
    assert (docs / "benchmark_trees.md").read_text(encoding="utf-8") == FREE.page(numbers)
    assert whole == insert(whole, FREE.readme(numbers), FREE.marks)


@pytest.mark.skipif(not (DOCS / "benchmark_trees.json").exists(), reason="docs/benchmark_trees.json is not made yet")
def test_the_committed_report_is_of_its_own_numbers():
    _check(DOCS, README)
