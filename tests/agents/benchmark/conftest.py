"""A report of made-up cells, which several tests read."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.benchmark.aggregates import collect
from agents.benchmark.plan import Arena, Cell, Learner, Plan
from agents.benchmark.report import text_of
from agents.catalogue import PAR
from agents.evaluation.evaluator import Episodes
from agents.evaluation.robustness import DISTURBANCES

N = 40
PLAN = Plan(
    (Arena("Steer", "MagWire/Steer-v1", episodes=N), Arena("Track", "MagWire/Track-v0", episodes=N)),
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
    fields["steps"], fields["unconverged"] = np.full(N, 75), np.zeros(N, dtype=np.int64)
    return Episodes(policy, **fields)


def _put(out: Path, cell: Cell, content: dict) -> None:
    cell.file(out).parent.mkdir(parents=True, exist_ok=True)
    cell.file(out).write_text(json.dumps({"settings": PLAN.settings(cell), "seconds": 2.0, **content}))


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What `collect` makes of the cells; tests must not change it."""
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
