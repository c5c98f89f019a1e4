"""A Ray cluster of two nodes on this machine, one of which is killed in mid-benchmark."""

from __future__ import annotations

import importlib.util
import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from agents.benchmark.jobs import run_cells
from agents.benchmark.plan import Arena, Plan
from tests.fuzz.kills import session_of

pytestmark = [
    pytest.mark.cluster,
    pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed"),
    pytest.mark.skipif(
        "MAGWIRE_TEST_CLUSTER" not in os.environ,
        reason="two Ray nodes need free cores to start in time: set MAGWIRE_TEST_CLUSTER=1, and run it without -n",
    ),
]

ROOT = Path(__file__).parents[3]
ARENAS = tuple(Arena(f"Steer {word}", "MagWire/Steer-v0", episodes=200) for word in "abcdefgh")
PLAN = Plan(ARENAS, (), robustness={}, episodes=200)
CELLS = [cell for cell in PLAN.cells() if cell.policy in ("MaxForce", "ExtremumSeeking", "Random")]


def node(port: int, folder: str, head: bool) -> subprocess.Popen:
    """A node with one processor, and everything it starts in a session of its own."""
    environment = os.environ | {
        "PYTHONPATH": str(ROOT), "RAY_USAGE_STATS_ENABLED": "0", "RAY_health_check_period_ms": "1000",
        "RAY_health_check_failure_threshold": "3",
    }  # fmt: skip
    ray = str(Path(sys.executable).with_name("ray"))
    place = ["--head", f"--port={port}", f"--temp-dir={folder}", "--include-dashboard=false"]
    place = place if head else [f"--address=127.0.0.1:{port}"]
    command = [ray, "start", "--block", "--num-cpus=1", "--disable-usage-stats", "--node-ip-address=127.0.0.1", *place]
    with (Path(folder) / f"log-{'head' if head else 'node'}").open("w") as log:
        return subprocess.Popen(command, env=environment, start_new_session=True, stdout=log, stderr=log, cwd=ROOT)


def end(process: subprocess.Popen) -> None:
    """Kill a node and all that it started, as a machine that loses its power does."""
    for number in (process.pid, *session_of(process)):
        try:
            os.kill(number, signal.SIGKILL)
        except ProcessLookupError:
            continue
    process.wait(30)


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, Callable[[], None]]]:
    """The address of two nodes, and what kills the second one."""
    from agents.engines.on_ray import RayEngine

    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    monkeypatch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    folder = tempfile.mkdtemp(prefix="ray", dir="/tmp")  # a socket's path is short
    head = node(port, folder, True)
    address, nodes = f"127.0.0.1:{port}", [head]
    try:
        until = time.monotonic() + 180
        said = Path(folder) / "log-head"
        while "block forever" not in said.read_text():
            assert time.monotonic() < until, said.read_text()
            time.sleep(0.5)
        nodes.append(node(port, folder, False))
        engine = RayEngine(address, 1)
        try:
            while engine.processors() < 2:
                assert time.monotonic() < until, (Path(folder) / "log-node").read_text()
                time.sleep(0.5)
        finally:
            engine.close()
        yield address, lambda: end(nodes[1])
    finally:
        for one in nodes:
            end(one)
        shutil.rmtree(folder, ignore_errors=True)


def results(out: Path) -> dict[str, Any]:
    """What the cells computed, without how long it took and who made it."""
    found = {}
    for path in sorted(out.glob("evaluate/*.json")):
        record = json.loads(path.read_text())
        found[path.name] = {k: v for k, v in record.items() if k not in ("seconds", "made_by")}
    return found


def test_a_node_that_dies_in_mid_benchmark_costs_nothing_but_its_own_cells(cluster, tmp_path, monkeypatch):
    address, kill_node = cluster
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    out, alone, at_the_kill = tmp_path / "cluster", tmp_path / "alone", {}

    def kill_in_the_middle() -> None:
        while len(list(out.glob("evaluate/*.json"))) < 3:
            time.sleep(0.05)
        kill_node()
        at_the_kill.update({p.name: p.stat().st_mtime_ns for p in out.glob("evaluate/*.json")})

    killer = threading.Thread(target=kill_in_the_middle, daemon=True)
    killer.start()
    failed = run_cells(PLAN, CELLS, out, workers=1, ray=address)
    killer.join(30)
    assert not failed
    assert 3 <= len(at_the_kill) < len(CELLS)
    after = {p.name: p.stat().st_mtime_ns for p in out.glob("evaluate/*.json")}
    assert len(after) == len(CELLS)
    assert all(after[name] == when for name, when in at_the_kill.items())  # nothing finished was made again
    assert not run_cells(PLAN, CELLS, alone, workers=1)
    assert results(out) == results(alone)
