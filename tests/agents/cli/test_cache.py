"""`magwire cache` shows and clears what is kept; `--version`; a report that is better is kept."""

from __future__ import annotations

import json

import magwire_env
from agents.benchmark.costs import estimate
from agents.benchmark.plan import Cell
from agents.benchmark.plots import _OTHERS, _STYLES, _style
from agents.benchmark.report import less_than_kept
from agents.cli.main import main as magwire
from agents.par.cache import default_folder
from tests.support.benchmark import STEER, small


def test_the_version(capsys):
    magwire(["--version"])
    assert capsys.readouterr().out == f"magwire {magwire_env.__version__}\n"


def test_the_cache_is_shown_and_cleared(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path / "own"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    plan, kernel = default_folder() / "ab" / "abcd.npz", tmp_path / "kernels" / "x" / "f.nbc"
    anatomy = tmp_path / "own" / "lumens" / "abcd.lumen"
    wall = tmp_path / "own" / "walls" / "abcd.npz"
    for file in (plan, kernel, anatomy, wall):
        file.parent.mkdir(parents=True)
        file.write_bytes(bytes(2_000_000))
    magwire(["cache"])
    shown = capsys.readouterr().out
    assert "plans of the par  1      2.0 MB" in shown
    assert "anatomies read    1      2.0 MB" in shown
    assert "walls in bricks   1      2.0 MB" in shown
    assert str(tmp_path / "own" / "par") in shown
    assert plan.exists()
    magwire(["cache", "--clear"])
    assert "cleared" in capsys.readouterr().out
    assert not plan.exists()
    assert not anatomy.exists()
    assert not wall.exists()
    assert not kernel.exists()


def test_a_dry_run_says_how_long_it_will_take(tmp_path):
    plan = small(STEER, episodes=2)
    cells = plan.cells()
    assert "cells missing: about" in estimate(plan, cells, tmp_path, 2)
    assert "partly from earlier measurements" in estimate(plan, cells, tmp_path, 2)
    assert estimate(plan, [], tmp_path, 2) == "all cells are finished"
    cell = Cell("evaluate", "Steer", "MaxForce")
    cell.file(tmp_path).parent.mkdir(parents=True)
    cell.file(tmp_path).write_text(json.dumps({"settings": plan.settings(cell), "seconds": 400.0}))
    other = Cell("evaluate", "Steer", "NetForce")
    assert estimate(plan, [other], tmp_path, 1) == "1 cell missing: about 7 min with 1 worker (measured here)"


def test_a_report_with_more_cells_is_kept(tmp_path):
    assert less_than_kept({"missing": ["a", "b"]}, tmp_path) == ""
    (tmp_path / "benchmark.json").write_text(json.dumps({"missing": ["a"]}))
    assert less_than_kept({"missing": ["a"]}, tmp_path) == ""
    assert less_than_kept({"missing": []}, tmp_path) == ""
    assert less_than_kept({"missing": ["a", "b"]}, tmp_path) == "1 cell of its report missing here, such as 'b'"


def test_no_two_policies_share_a_colour():
    colours = [colour for colour, _ in _STYLES.values()]
    assert len(set(colours)) == len(colours)
    assert not set(colours) & set(_OTHERS)
    own = [_style(name)[0] for name in ("my.First", "my.Second")]
    assert len({*own, *colours}) == len(colours) + 2
