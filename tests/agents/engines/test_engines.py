"""Tasks on an engine: their order, their failures, and workers that are lost."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time

import pytest

from agents.engines import LocalEngine, Lost, Task, engine, run
from agents.engines.engine import ENVIRONMENT
from agents.engines.shared import Shared, is_url
from tests.support.tasks import always_dies, dies_once, environment, fails, slow, square


def test_results_failures_and_lost_workers(tmp_path):
    tasks = [Task(f"square {i}", square, (i,)) for i in range(3)]
    tasks += [Task("bad", fails), Task("once", dies_once, (str(tmp_path / "mark"),)), Task("never", always_dies)]
    tasks += [Task("words", environment, (tuple(ENVIRONMENT),))]
    told = []
    outcomes = {o.task.name: o for o in run(LocalEngine(2), tasks, told.append, progress=False)}
    assert len(told) == len(tasks)
    assert [outcomes[f"square {i}"].result for i in range(3)] == [0, 1, 4]
    assert isinstance(outcomes["bad"].failure, ValueError)
    assert outcomes["once"].result == 1  # the second attempt
    assert isinstance(outcomes["never"].failure, Lost)
    assert outcomes["words"].result == ENVIRONMENT


def test_a_task_waits_for_those_it_needs_even_if_they_fail():
    tasks = [
        Task("last", square, (3,), frozenset({"bad", "first"})), Task("bad", fails), Task("first", square, (2,)),
    ]  # fmt: skip
    assert [o.task.name for o in run(LocalEngine(2), tasks, progress=False)][-1] == "last"
    with pytest.raises(ValueError, match="in a circle"):
        run(LocalEngine(1), [Task("a", square, (1,), frozenset({"a"}))], progress=False)


@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="Ctrl-C goes astray under -n: run it without")
def test_an_interrupt_ends_the_workers():
    before = set(multiprocessing.active_children())

    def ended(outcome) -> None:
        raise AssertionError(f"it should not have ended: {outcome}")

    began = time.monotonic()
    timer = threading.Timer(1.5, lambda: signal.pthread_kill(threading.main_thread().ident, signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        run(LocalEngine(2), [Task(f"slow {i}", slow, (60.0,)) for i in range(4)], ended, progress=False)
    assert time.monotonic() - began < 25.0
    assert set(multiprocessing.active_children()) <= before


def test_no_worker_is_refused():
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        engine(0)


def test_files_go_by_a_url(tmp_path):
    url, here, there = f"file://{tmp_path}/shared", tmp_path / "here", tmp_path / "there"
    assert is_url(url)
    assert not is_url(tmp_path)
    (here / "runs" / "a" / "deep").mkdir(parents=True)
    (here / "runs" / "a" / "deep" / "x.txt").write_text("one")
    (here / "record.json").write_text("{}")
    shared = Shared(url)
    shared.push(["runs/a", "record.json", "not there"], here)
    (here / "runs" / "a" / "deep" / "x.txt").write_text("two")
    shared.push(["runs/a"], here)
    shared.pull(["runs/a", "record.json", "nothing"], there)
    assert (there / "runs" / "a" / "deep" / "x.txt").read_text() == "two"
    assert (there / "record.json").read_text() == "{}"
    assert sorted(p.name for p in there.rglob("*")) == ["a", "deep", "record.json", "runs", "x.txt"]
