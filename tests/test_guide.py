"""The guide's pages and its notebook are carried out as they stand, outside the repository."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import pytest

from agents.cli.main import main as magwire
from tests.support.certified import check_certified
from tests.support.pages import blocks, follow, words

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / "docs" / "guide"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder to stand in; modules that are written there are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    path, modules = list(sys.path), set(sys.modules)
    sys.path.append(str(tmp_path))
    yield tmp_path
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        if getattr(sys.modules[name], "__file__", None) and str(tmp_path) in str(sys.modules[name].__file__):
            del sys.modules[name]


def typed(command: str) -> None:
    """A line of a page: `magwire` with its arguments."""
    program, *arguments = words(command)
    assert program == "magwire", command
    magwire(arguments)
    check_certified(arguments)


@pytest.mark.parametrize(("page", "least"), [("policies", 4), ("scenarios", 4), ("learning", 5)])
@pytest.mark.filterwarnings("ignore:.*is not a writable:UserWarning", "ignore:Loky-backed:UserWarning")
def test_a_page_works_as_written(page, least, folder, capsys, monkeypatch):
    monkeypatch.setattr(
        "agents.cli.pictures.leave_in", lambda *_, **__: []
    )  # the pictures of a run have their own tests
    assert follow(GUIDE / f"{page}.md", typed, folder) >= least
    printed = capsys.readouterr().out
    assert "\nMaxForce " in printed


@pytest.mark.filterwarnings("ignore:.*is not a writable:UserWarning")
def test_the_page_on_images_works_as_written(folder, capsys, monkeypatch):
    monkeypatch.setattr("agents.cli.pictures.leave_in", lambda *_, **__: [])
    assert follow(GUIDE / "images.md", typed, folder) == 4
    printed = capsys.readouterr().out
    assert "\nsees " in printed
    assert "\nMaxForce " in printed


def test_the_page_on_anatomies_works_as_written(folder, capsys):
    assert follow(GUIDE / "anatomies.md", typed, folder) == 3
    printed = capsys.readouterr().out
    assert "fork: 3 branches, 2 ends" in printed
    assert "; no bend\n" in printed
    assert (folder / "fork.png").exists()


def test_the_page_on_tasks_works_as_written(folder, capsys, monkeypatch):
    """Its Python is run; of a command, whose numbers stand in the page, the parser takes every argument."""
    asked: list[object] = []
    cli = importlib.import_module("agents.cli.main")  # the package's own `main` is its function
    monkeypatch.setattr(cli, "_RUN", dict.fromkeys(cli._RUN, asked.append))
    assert follow(GUIDE / "tasks.md", typed, folder) >= 6
    assert len(asked) >= 11
    start, target, arrives = capsys.readouterr().out.split()[-3:]
    assert start != target
    assert arrives == "True"


def test_the_notebook_runs_cell_by_cell(folder, capsys):
    notebook = json.loads((GUIDE / "quickstart.ipynb").read_text(encoding="utf-8"))
    matplotlib.use("Agg")
    names: dict = {"__name__": "notebook"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 5
    subprocess.run([sys.executable, "-c", "".join(cells[0]["source"])], check=True)  # nothing is imported before it
    for number, cell in enumerate(cells):
        assert not cell["outputs"], "outputs are not kept"
        exec(compile("".join(cell["source"]), f"cell {number}", "exec"), names)
    assert names["info"]["is_success"]
    assert names["found"].solvable
    assert capsys.readouterr().out.count("| MaxForce ") == 2


def test_every_page_stands_in_the_site_and_its_links_lead_somewhere():
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in sorted((ROOT / "docs").rglob("*.md")):
        name = page.relative_to(ROOT / "docs").as_posix()
        assert f": {name}" in site, f"{name} is not in mkdocs.yml"
        text = page.read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#]+)\)", text):
            assert link.startswith("http") or (page.parent / link).exists(), f"{name} links to {link}"
        assert list(blocks(page)) is not None
