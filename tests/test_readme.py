"""The README: its Python runs as written and in order; its commands are ones that the programs take.

`python tests/readme.py` goes further: it carries out every block, shell blocks too, in a fresh clone.
"""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest

from tests.support.certified import check_certified
from tests.support.pages import blocks, follow, words

cli = importlib.import_module("agents.cli.main")  # the package's own `main` is its function
ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


@pytest.fixture
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    path = list(sys.path)
    yield
    sys.path[:] = path


@pytest.mark.usefixtures("_elsewhere")
def test_the_blocks_work_in_order(tmp_path, monkeypatch):
    """Python is run; of a command, the parser takes every argument, and what it names has been made by then."""
    asked: list[object] = []
    monkeypatch.setattr(cli, "_RUN", dict.fromkeys(cli._RUN, asked.append))
    monkeypatch.setattr(cli.view_cli, "RUN", dict.fromkeys(cli.view_cli.RUN, asked.append))
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))

    def typed(command: str) -> None:
        program, *arguments = words(command)
        if program == "make":
            assert arguments[0] in targets, command
        elif program == "magwire":
            cli.main(arguments)
            check_certified(arguments)
            for argument in arguments:
                if re.fullmatch(r"[\w/]+\.(toml|zip|py)(:\w+)?", argument):
                    assert (tmp_path / argument.split(":")[0]).exists(), command
        else:
            assert program in (".", "pip"), command

    assert follow(README, typed, tmp_path) > 15
    assert len(asked) > 12


def test_every_run_it_names_is_the_one_that_make_train_makes():
    named = set(re.findall(r"runs/Steer[\w.-]*", README.read_text(encoding="utf-8")))
    assert named == {"runs/Steer-v1-ppo-seed0"}


def test_it_speaks_of_files_that_exist():
    text = README.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if not link.startswith("http")]
    paths = re.findall(r"`((?:magwire_env|agents|tests|docs)/[\w/.]*)`", text)
    assert links
    for path in (*links, *paths):
        assert (ROOT / path).exists(), path


def test_the_blocks_are_what_the_runner_of_the_fresh_clone_knows():
    languages = {block.language for block in blocks(README)}
    assert languages == {"sh", "python", "toml"}
