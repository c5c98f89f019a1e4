"""Long work speaks: a line within two seconds, how far it is, and nothing when it is short."""

from __future__ import annotations

import io
import time

import pytest

from magwire_env import progress
from magwire_env.progress import Progress


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    monkeypatch.setattr(progress, "FIRST", 0.02)
    monkeypatch.setattr(progress, "AGAIN", 0.02)
    monkeypatch.delenv("MAGWIRE_PROGRESS", raising=False)


def wait_for(stream: io.StringIO, words: str) -> None:
    until = time.monotonic() + 20
    while words not in stream.getvalue():
        assert time.monotonic() < until, stream.getvalue()
        time.sleep(0.01)


def test_a_long_step_is_not_silent_and_says_how_far_it_is():
    stream = io.StringIO()
    with Progress("planning", 4, stream) as work:
        wait_for(stream, "planning, 0 of 4")
        work.done, work.stage = 2, "refining"
        wait_for(stream, "planning, 2 of 4, refining")
        assert "to go" in work.line()
    said = stream.getvalue()
    time.sleep(0.1)
    assert stream.getvalue() == said


def test_of_nested_work_the_innermost_speaks():
    outer, inner = io.StringIO(), io.StringIO()
    with Progress("all", 1, outer):
        wait_for(outer, "all")
        with Progress("a part", 1, inner):
            before = outer.getvalue()
            wait_for(inner, "a part")
            assert outer.getvalue().count("\n") <= before.count("\n") + 1
        wait_for(outer, "all")


def test_short_work_and_quiet_work_say_nothing(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(progress, "FIRST", 60.0)
    with Progress("short", 1, stream):
        pass
    monkeypatch.setattr(progress, "FIRST", 0.01)
    monkeypatch.setenv("MAGWIRE_PROGRESS", "0")
    with Progress("quiet", 1, stream):
        time.sleep(0.05)
    assert stream.getvalue() == ""
