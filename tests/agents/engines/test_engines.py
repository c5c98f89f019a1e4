"""Tasks on an engine: their order, their failures, and workers that are lost."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from agents.engines import LocalEngine, Lost, Task, engine, run
from agents.engines.engine import ENVIRONMENT
from agents.engines.shared import Shared, is_url
from tests.fuzz.kills import session_of
from tests.support.tasks import always_dies, dies_once, environment, fails, slow, square

ROOT = Path(__file__).parents[3]


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


AT_WORK = """
import sys
from agents.engines import LocalEngine, Task, run
from tests.support.tasks import stays

if __name__ == "__main__":
    run(LocalEngine(2), [Task(f"stays {i}", stays, (sys.argv[1],)) for i in range(2)], progress=False)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_the_process_that_started_them(kind, tmp_path):
    """However it ended: a benchmark that is begun again must not find the old one's workers at its cells."""
    program, at_work = tmp_path / "at_work.py", tmp_path / "at_work"
    program.write_text(AT_WORK)
    at_work.mkdir()
    paths = os.pathsep.join([str(ROOT), *sys.path])
    parent = subprocess.Popen(
        [sys.executable, program, at_work], env=os.environ | {"PYTHONPATH": paths}, start_new_session=True
    )
    try:
        until = time.monotonic() + 60
        while len(list(at_work.iterdir())) < 2:
            assert time.monotonic() < until
            time.sleep(0.1)
        parent.send_signal(kind)
        parent.wait(30)
        until = time.monotonic() + 20
        while session_of(parent) and time.monotonic() < until:
            time.sleep(0.1)
        assert not session_of(parent)
    finally:
        for number in (parent.pid, *session_of(parent)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        parent.wait(30)


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
