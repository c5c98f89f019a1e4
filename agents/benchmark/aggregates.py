"""The numbers of the benchmark's report, with their intervals, from its finished cells."""

from __future__ import annotations

import csv
import datetime
import os
import platform
import subprocess
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from magwire_env.envs.task import TASKS

from ..catalogue import PAR
from ..evaluation.episodes import EVALUATION_SEED
from ..evaluation.evaluator import Episodes, paired_ratio
from ..evaluation.robustness import sweep_scores
from ..evaluation.statistics import (
    interquartile_mean,
    interval,
    mean,
    median,
    performance_profile,
    stratified_bootstrap,
)
from .plan import Arena, Cell, Plan, code_digest, plain_name

__all__ = ["TAUS", "collect", "episode_records"]

TAUS = np.concatenate([np.arange(0.0, 0.8, 0.05), np.arange(0.8, 1.0501, 0.01)])
"""Scores τ at which performance profiles are computed."""

_PACKAGES = ("magwire-env", "gymnasium", "numpy", "numba", "scipy", "torch", "stable-baselines3", "sb3-contrib")


def collect(plan: Plan, out: Path) -> dict[str, Any]:
    """Everything that the report says, as plain numbers of five digits; a number that does not exist is null.

    "missing" lists the cells that are missing or were made with other settings.
    """
    cells = plan.cells()
    records = {cell: plan.record(cell, out) for cell in cells}
    arenas, scores = [], {}
    for arena in plan.arenas:
        entry, scores[arena.name] = _arena(plan, arena, records)
        arenas.append(entry)
    return _rounded(
        {
            "made": _provenance(),
            "work": _work(records),
            "arenas": arenas,
            "overall": _overall(plan, scores),
            "learning": _learning(plan, records),
            "decisions": _decisions(records),
            "robustness": _robustness(plan, records),
            "missing": [cell.name for cell, record in records.items() if record is None],
        }
    )


def episode_records(plan: Plan, out: Path) -> dict[str, Any]:
    """Every episode of every finished cell, by its name: from these every score can be computed again."""
    found = {cell.name: plan.record(cell, out) for cell in plan.cells() if cell.kind in ("evaluate", "par")}
    return {
        name: {key: record[key] for key in ("settings", "episodes", "lower_bound_s") if key in record}
        for name, record in found.items()
        if record is not None and "episodes" in record
    }


Records = dict[Cell, dict[str, Any] | None]


def _provenance() -> dict[str, Any]:
    return {
        "date": datetime.date.today().isoformat(),
        "commit": _commit(),
        "code": code_digest(),
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": {name: version(name) for name in _PACKAGES},
        "first_seed": EVALUATION_SEED,
    }


def _commit() -> str:
    """The commit of the tree, "+" after it if files differ from it; "unknown" outside a repository."""
    here = Path(__file__).parent
    try:
        head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, check=True)
        changed = subprocess.run(
            ["git", "status", "--porcelain", "-uno"], cwd=here, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head.stdout.strip() + ("+" if changed.stdout.strip() else "")


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown processor"


def _work(records: Records) -> dict[str, Any]:
    """Kind of cell → number of finished cells, and their seconds of one core together."""
    work: dict[str, dict[str, float]] = {}
    for cell, record in records.items():
        if record is not None:
            entry = work.setdefault(cell.kind, {"cells": 0, "seconds": 0.0})
            entry["cells"] += 1
            entry["seconds"] += record["seconds"]
    return work


# --- arenas -----------------------------------------------------------------------------------------------------------


def _arena(plan: Plan, arena: Arena, records: Records) -> tuple[dict[str, Any], dict[str, list[np.ndarray]]]:
    """An arena's entry, and every policy's scores, one array for each training seed."""
    of_par = plan.par(arena)
    found = None if of_par is None else records[of_par]
    par = None if found is None else Episodes.from_json(found)
    policies, scores = [], {}
    names: list[tuple[str, str, list[Cell]]] = [] if of_par is None else [(PAR, "par", [of_par])]
    for name in plan.controllers(arena):
        kind = "floor" if plan.is_floor(name) else "controller"
        names.append((name, kind, [Cell("evaluate", arena.name, name)]))
    for algorithm, seeds in plan.trained(arena).items():
        names.append((algorithm, "trained", [Cell("evaluate", arena.name, algorithm, c.seed) for c in seeds]))
    for name, kind, cells in names:
        rows = [records[cell] for cell in cells]
        entry, scores[name] = _policy(rows, par)
        if arena.reference is not None and entry["state"] == "played":
            entry |= _beside(rows, records[Cell("evaluate", arena.name, arena.reference)])
        policies.append({"policy": name, "kind": kind, **entry})
    best = max(
        ((e["score"][0], e["policy"]) for e in policies if e["kind"] != "par" and _exists(e.get("score", [None])[0])),
        default=(None, None),
    )
    entry = {
        "name": arena.name, "task": arena.task, "tracking": arena.tracking, "split": arena.split,
        "scenario": arena.scenario, "episodes": plan.episodes_of(arena), "bracket": _bracket(found),
        "best_mean_score": best[0], "best_policy": best[1], "policies": policies,
        **({} if arena.reference is None else {"reference": arena.reference}),
        "profiles": {name: _profile(groups) for name, groups in scores.items() if groups and name != PAR},
    }  # fmt: skip
    return entry, scores


def _exists(value: Any) -> bool:
    return value is not None and value == value


def _policy(found: Sequence[dict[str, Any] | None], par: Episodes | None) -> tuple[dict[str, Any], list[np.ndarray]]:
    """A policy's aggregates over its training seeds (strata), and its scores."""
    records = [record for record in found if record is not None]
    entry: dict[str, Any] = {"seeds": len(records), "seeds_planned": len(found)}
    if not records:
        return entry | {"state": "missing"}, []
    if "not_applicable" in records[0]:
        return entry | {"state": "not applicable", "reason": records[0]["not_applicable"]}, []
    rows = [Episodes.from_json(record) for record in records]
    scores = [] if par is None else [_finite(row.score(par)) for row in rows]

    def over(of: Callable[[Episodes], np.ndarray]) -> np.ndarray:
        return np.concatenate([of(row) for row in rows])

    success = over(lambda r: r.success)
    entry |= {
        "state": "played",
        "success": float(success.mean()),
        "success_of_seeds": [float(row.success.mean()) for row in rows],
        "time_s": interval([row.time[row.success] for row in rows], median, whole_groups=True),
        "rms_error_mm": interval([1e3 * _finite(row.rms_error) for row in rows], median, whole_groups=True),
        "score": interval(scores, mean, whole_groups=True),
        "score_interquartile": interval(scores, interquartile_mean, whole_groups=True),
        "path_ratio": float(over(lambda r: r.path_ratio).mean()),
        "peak_wall_force_mN": 1e3 * float(np.median(over(lambda r: r.peak_wall_force))),
        "mean_wall_force_mN": 1e3 * float(over(lambda r: r.mean_wall_force).mean()),
        "magnet_travel": float(np.median(over(lambda r: r.magnet_travel))),
        "cost_mN_steps": 1e3 * float(over(lambda r: r.cost).mean()),
        "untrusted_episodes": int((over(lambda r: r.unconverged) > 0).sum()),
    }
    return entry, [group for group in scores if len(group)]


def _beside(found: Sequence[dict[str, Any] | None], reference: dict[str, Any] | None) -> dict[str, Any]:
    """What an arena with a reference tells more: wrong branches, kept limits, and the time over the reference's."""
    rows = [Episodes.from_json(record) for record in found if record is not None]
    told: dict[str, Any] = {
        name: float(np.concatenate([getattr(row, name) for row in rows]).mean())
        for name in ("wrong_entries", "within_limit")
    }
    if reference is not None:
        against = Episodes.from_json(reference)
        told["time_over_reference"] = [paired_ratio(row, against) for row in rows]
    return told


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _bracket(par: dict[str, Any] | None) -> dict[str, Any] | None:
    """Mean bounds, s, and the gap, upper / lower − 1, of the episodes that the par finished."""
    if par is None or par["lower_bound_s"] is None:
        return None
    upper = np.array([np.nan if t is None else t for t in par["episodes"]["time"]])
    reached = np.isfinite(upper)
    if not reached.any():
        return None
    lower, upper = np.array(par["lower_bound_s"], dtype=float)[reached], upper[reached]
    gap = upper / lower - 1.0
    return {"lower_s": lower.mean(), "upper_s": upper.mean(), "gap": upper.mean() / lower.mean() - 1.0,
            "gap_least": gap.min(), "gap_largest": gap.max()}  # fmt: skip


def _profile(groups: list[np.ndarray]) -> dict[str, list[float]]:
    value, low, high = stratified_bootstrap(groups, lambda scores: performance_profile(scores, TAUS), resamples=400)
    return {name: np.round(row, 3).tolist() for name, row in (("share", value), ("low", low), ("high", high))}


def _overall(plan: Plan, scores: dict[str, dict[str, list[np.ndarray]]]) -> list[dict[str, Any]]:
    """Mean of the score over the latest versions of all registered tasks, for the policies that play in all of them.

    Strata are the tasks and their training seeds.
    """
    plain = {plain_name(task) for task in TASKS}
    tasks = [
        arena.name
        for arena in plan.arenas
        if arena.reference is None and arena.name in plain and not arena.task.endswith(arena.name)
    ]
    names = list(dict.fromkeys(name for task in tasks for name in scores[task]))
    rows = []
    for name in names:
        groups = [scores[task].get(name, []) for task in tasks]
        if all(groups):
            # The same number of episodes from every task, so that more training seeds or tracts have no more weight.
            share = min(len(group) for seeds in groups for group in seeds)
            score = interval([group[:share] for seeds in groups for group in seeds], mean)
            rows.append({"policy": name, "tasks": len(tasks), "score": score})
    return sorted(rows, key=lambda row: -row["score"][0])


# --- learning, decisions, robustness ----------------------------------------------------------------------------------


def _learning(plan: Plan, records: Records) -> list[dict[str, Any]]:
    """For each arena and algorithm, the learning curves' mean and range over the training seeds."""
    found = []
    for arena in plan.arenas:
        for algorithm, cells in plan.trained(arena).items():
            done = [record for cell in cells if (record := records[cell]) is not None]
            if arena.models is not None or not done:
                continue
            curves = [list(csv.DictReader(record["curve"].splitlines())) for record in done]
            steps = np.array([float(row["timesteps"]) for row in curves[0]])
            entry: dict[str, Any] = {
                "arena": arena.name, "algorithm": algorithm, "tracking": arena.tracking, "seeds": len(done),
                "steps": steps.tolist(),
                "training_seconds": [record["seconds"] for record in done if not record["resumed"]],
            }  # fmt: skip
            columns = ("success", "success_rate"), ("time_s", "median_time_s"), ("reward", "mean_reward")
            for name, column in columns:
                lines = np.array([_interpolated(steps, curve, column) for curve in curves])
                entry[name] = _mean_and_range(lines)
            found.append(entry)
    return found


def _interpolated(steps: np.ndarray, curve: Sequence[dict[str, str]], column: str) -> np.ndarray:
    """A curve's column at `steps`; NaN where it has no number yet."""
    own = np.array([float(row["timesteps"]) for row in curve])
    return np.interp(steps, own, [float(row[column] or "nan") for row in curve])


def _mean_and_range(lines: np.ndarray) -> dict[str, list[float]]:
    """Mean, lowest and highest over the rows that have a number; NaN where no row has one."""
    some = np.isfinite(lines).any(axis=0)
    kept = np.where(np.isfinite(lines).any(axis=0), lines, 0.0)
    return {
        name: np.where(some, of(kept, axis=0), np.nan).tolist()
        for name, of in (("mean", np.nanmean), ("low", np.nanmin), ("high", np.nanmax))
    }


def _decisions(records: Records) -> list[dict[str, Any]]:
    return [
        {"arena": cell.arena, "policy": cell.policy, **record["milliseconds"]}
        for cell, record in records.items()
        if cell.kind == "decide" and record is not None and "milliseconds" in record
    ]


def _robustness(plan: Plan, records: Records) -> list[dict[str, Any]]:
    found = []
    for cell, record in records.items():
        if cell.kind != "robustness" or record is None:
            continue
        of_par = plan.par(plan.arena(cell.arena))
        par = None if of_par is None else records[of_par]
        episodes = {name: Episodes.from_json(stored) for name, stored in record["disturbed"].items()}
        rows = sweep_scores(episodes, None if par is None else Episodes.from_json(par))
        found.append(
            {"arena": cell.arena, "policy": cell.policy, "episodes": record["settings"]["episodes"],
             "against": cell.policy if par is None else PAR, "rows": rows}
        )  # fmt: skip
    return found


def _rounded(value: Any) -> Any:
    """Plain Python values with five digits; None for a number that is not finite."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_rounded(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.5g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
