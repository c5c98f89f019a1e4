"""Running cells: chosen, in order, some of them failing."""

from __future__ import annotations

import pytest

from agents.benchmark import jobs
from agents.benchmark.jobs import jobs_of, run_cells, selected
from agents.benchmark.plan import Arena, Cell, Plan
from magwire_env.progress import Progress
from tests.support.benchmark import ID, STEER, small


def test_patterns_choose_cells():
    cells = Plan().cells()
    assert [c.name for c in selected(cells, ["evaluate Steer NetForce"])] == ["evaluate Steer NetForce"]
    assert {c.kind for c in selected(cells, ["train*ppo", "par Steer"])} == {"train", "par"}
    assert selected(cells, []) == cells
    with pytest.raises(ValueError, match="only must match some cell's name"):
        selected(cells, ["nothing of the kind"])


def test_jobs_hold_every_cell_once_and_wait_for_training():
    plan = Plan()
    cells = plan.cells()
    jobs = jobs_of(plan, cells)
    assert sorted(c.name for job in jobs for c in job.cells) == sorted(c.name for c in cells)
    chase = next(job for job in jobs if Cell("evaluate", "Chase ood", "ppo", 2) in job.cells)
    assert Cell("train", "Chase", "ppo", 2) in chase.needs
    # What is not asked for is not waited for.
    assert not jobs_of(plan, [Cell("evaluate", "Chase ood", "ppo", 2)])[0].needs


def test_failures_are_reported_and_the_rest_goes_on(tmp_path, capfd, monkeypatch):
    bad = Arena("Nowhere", ID, scenario="no-such-scenario", episodes=2)
    plan = small(STEER, bad)
    chosen = [Cell("evaluate", arena, name) for arena in ("Nowhere", "Steer") for name in ("MaxForce", "Random")]
    bars = []
    monkeypatch.setattr(jobs, "Progress", lambda *about: bars.append(Progress(*about)) or bars[-1])
    failed = run_cells(plan, chosen, tmp_path, workers=2)
    assert [(bar.done, bar.total) for bar in bars] == [(4, 4)]
    assert sorted(cell.name for cell in failed) == ["evaluate Nowhere MaxForce", "evaluate Nowhere Random"]
    assert "no shipped scenario of that name" in failed[0].log(tmp_path).read_text()
    assert "Traceback" in failed[0].log(tmp_path).read_text()
    assert [plan.state(cell, tmp_path) for cell in chosen[2:]] == ["finished"] * 2
    said = capfd.readouterr().out
    assert "FAILED    evaluate Nowhere MaxForce" in said
    assert "done      evaluate Steer Random" in said
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        run_cells(plan, chosen, tmp_path, workers=0)
