"""What each kind of the benchmark's cells computes, and how it is written."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import train
from magwire_env.envs.core import SteeringCore

from ..controllers import CONTROLLERS
from ..evaluation.evaluator import EVALUATION_SEED, evaluate, make_batch
from ..evaluation.robustness import sweep
from ..learning.sb3 import load
from ..learning.training import Run, learn
from ..par.bound import Fastest
from .plan import PAR, Cell, Plan

__all__ = ["make"]


def make(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    """Compute a cell and write its record, whole or not at all; returns the record.

    A policy that refuses its arena with a `ValueError` when it is built leaves a record that says why.
    """
    started = time.perf_counter()
    result = _KINDS[cell.kind](plan, cell, out)
    record = {"settings": plan.settings(cell), "seconds": time.perf_counter() - started, **result}
    _write(cell.file(out), record)
    return record


def _write(file: Path, record: dict[str, Any]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(".part")
    partial.write_text(json.dumps(record), encoding="utf-8")
    partial.replace(file)


def _train(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    """A run folder; one that was interrupted goes on from its last checkpoint, if its settings are still the same."""
    settings, folder = plan.settings(cell), cell.run(out)
    asked = {
        "task": settings["task"], "algorithm": cell.policy, "seed": cell.seed, "scenario": settings["scenario"],
        "timesteps": settings["hyperparameters"]["n_timesteps"], "progress": False,
    }  # fmt: skip
    resumed = _resumable(folder, settings)
    if not resumed and folder.exists():
        shutil.rmtree(folder)
    run = Run.open(train.Config(run=folder, resume=resumed, **asked))
    if not learn(run):
        raise KeyboardInterrupt
    curve = (folder / "learning_curve.csv").read_text(encoding="utf-8")
    versions = json.loads((folder / "versions.json").read_text(encoding="utf-8"))
    return {"run": folder.name, "resumed": resumed, "curve": curve, "versions": versions}


def _resumable(folder: Path, settings: dict[str, Any]) -> bool:
    if not (folder / "config.json").exists() or not (folder / "last" / "model.json").exists():
        return False
    stored = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    return stored["hyperparameters"] == json.loads(json.dumps(settings["hyperparameters"]))


def _policy(plan: Plan, cell: Cell, out: Path) -> tuple[Any, dict[str, Any]]:
    """What makes the cell's policy from an env (or is it), and its env's settings."""
    env = plan.arena(cell.arena).env
    training = plan.training_of(cell)
    if training is None:
        return CONTROLLERS[cell.policy].from_env, env
    if plan.record(training, out) is None:
        raise FileNotFoundError(f"the cell {training.name!r} is not finished: no model to play with")
    model = load(training.run(out))
    own = model.meta["env"]
    if env.get("split") is not None:
        own = {k: v for k, v in own.items() if k not in ("split", "pool_size")}
    return model, own | env


def _built(policy: Any, env: gym.Env | gym.vector.VectorEnv) -> tuple[Any, str]:
    """The policy for an env or batch, or why it cannot serve it."""
    if hasattr(policy, "predict"):
        return policy, ""
    try:
        return policy(env), ""
    except ValueError as refusal:
        return None, str(refusal)


def _evaluate(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    arena = plan.arena(cell.arena)
    policy, settings = _policy(plan, cell, out)
    env = make_batch(arena.task, plan.episodes_of(arena), settings)
    policy, refusal = _built(policy, env)
    if refusal:
        return {"not_applicable": refusal}
    episodes = evaluate(policy, arena.task, env.num_envs, EVALUATION_SEED, cell.policy, env)
    return episodes.to_json()


def _par(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    """The par's episodes, and for each the lower bound of the time, s (none in a tracking task)."""
    arena = plan.arena(cell.arena)
    env = make_batch(arena.task, plan.episodes_of(arena), arena.env)
    episodes = evaluate(CONTROLLERS[PAR].from_env, arena.task, env.num_envs, EVALUATION_SEED, PAR, env)
    env.reset(seed=EVALUATION_SEED)
    core: SteeringCore = env.unwrapped.core  # type: ignore[attr-defined]
    return episodes.to_json() | {"lower_bound_s": None if arena.tracking else _least_times(core)}


def _least_times(core: SteeringCore) -> list[float]:
    """No policy reaches the goals of the episodes that have just begun in less, s."""
    sim, reach = core.sim, core.task.kind == "reach"
    direction = np.where(core.goal >= sim.tip_arclength, 1, -1)
    # A target's band is entered at its near edge; of its hold up to a control period is not looked at.
    edge = core.goal - direction * core.task.tolerance if reach else core.goal
    held = core.task.hold - sim.control_period if reach else 0.0
    fastest: dict[tuple[int, int], Fastest] = {}
    times = []
    for i, entry in enumerate(sim.lane_scenario):
        way = int(entry), int(direction[i])
        if way not in fastest:
            fastest[way] = Fastest(sim.library.scenarios[entry], way[1])
        # Of several degrees of freedom the bound takes no account.
        magnet = float(sim.magnet[i, 0]) if sim.dof == 1 else None
        times.append(fastest[way].least(float(sim.tip_arclength[i]), float(edge[i]), magnet) + held)
    return times


def _decide(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    """Times of single decisions in one env, ms; the first few, which compile and tabulate, are left out."""
    arena, count = plan.arena(cell.arena), plan.settings(cell)["decisions"]
    settings: dict[str, Any] = arena.env | ({"pool_size": 1} if arena.split is not None else {})
    env = gym.make(arena.task, **settings)
    observation, _ = env.reset(seed=EVALUATION_SEED)
    policy, refusal = _built(CONTROLLERS[cell.policy].from_env, env)
    if refusal:
        return {"not_applicable": refusal}
    state, start, times = None, np.ones(1, dtype=np.bool_), []
    for _ in range(_UNCOUNTED + count):
        before = time.perf_counter()
        action, state = policy.predict(observation, state=state, episode_start=start)
        times.append(1e3 * (time.perf_counter() - before))
        observation, _, terminated, truncated, _ = env.step(action)
        start = np.array([terminated or truncated])
        if start[0]:
            observation, _ = env.reset()
    quantiles = np.quantile(times[_UNCOUNTED:], [0.05, 0.5, 0.95, 0.99])
    return {"milliseconds": dict(zip(("q05", "median", "q95", "q99"), quantiles.tolist(), strict=True))}


_UNCOUNTED = 5


def _robustness(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    arena, settings = plan.arena(cell.arena), plan.settings(cell)
    policy, env = _policy(plan, cell, out)
    found = sweep(policy, arena.task, settings["episodes"], cell.policy, report=print, **env)
    return {"disturbed": {name: episodes.to_json() for name, episodes in found.items()}}


_KINDS = {"train": _train, "evaluate": _evaluate, "par": _par, "decide": _decide, "robustness": _robustness}
