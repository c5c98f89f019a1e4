"""What each kind of cell computes, and how a cell is written."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from magwire_env.envs.core import SteeringCore

from ..catalogue import CONTROLLERS, PAR, resolve
from ..evaluation.episodes import EVALUATION_SEED, built
from ..evaluation.evaluator import evaluate, make_batch
from ..evaluation.robustness import sweep
from ..learning.config import Config
from ..learning.run_folder import Checkpoints, locked, write_whole
from ..learning.scenario_copy import digest, text_for
from ..learning.stored import read_json
from ..learning.training import Run, curve_of, learn
from ..par.bracket import least_times
from ..par.starts import Starts
from ..processes import PATIENCE
from .plan import Cell, Plan

__all__ = ["make"]


def make(plan: Plan, cell: Cell, out: Path, token: str = "") -> dict[str, Any]:
    """Compute a cell and write its record; returns the record. The file is there only when it is complete.

    token : of the run of the benchmark that makes it

    If a policy refuses its arena with a `ValueError` when it is built, the record says why.
    """
    started = time.perf_counter()
    result = _MAKERS[cell.kind](plan, cell, out)
    seconds = time.perf_counter() - started
    record = {"settings": plan.settings(cell), "seconds": seconds, "made_by": token, **result}
    write_whole(cell.file(out), json.dumps(record))
    return record


def _train(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    """Train into a run folder; go on from its last checkpoint if there is one with the same settings."""
    settings, folder = plan.settings(cell), cell.run(out)
    asked = {
        "task": settings["task"], "algorithm": cell.policy, "seed": cell.seed, "scenario": settings["scenario"],
        "timesteps": settings["hyperparameters"]["n_timesteps"], "progress": False,
    }  # fmt: skip
    resumed = _resumable(folder, settings)
    if not resumed and folder.exists():
        with locked(folder, PATIENCE):  # a worker whose parent was killed may be saving there
            shutil.rmtree(folder)
    run = Run.open(Config(run=folder, resume=resumed, **asked))
    if not learn(run, PATIENCE):
        raise KeyboardInterrupt
    curve_file = curve_of(folder)
    assert curve_file is not None  # it has been evaluated at its end
    curve = curve_file.read_text(encoding="utf-8")
    versions = json.loads((folder / "versions.json").read_text(encoding="utf-8"))
    return {"run": folder.name, "resumed": resumed, "curve": curve, "versions": versions}


def _resumable(folder: Path, settings: dict[str, Any]) -> bool:
    """A checkpoint stands in `folder`, of a training with the same settings."""
    if not (folder / "config.json").exists() or Checkpoints(folder).newest() is None:
        return False
    stored = read_json(folder / "config.json").tree
    text = text_for(settings["task"], settings["scenario"])
    return stored.get("hyperparameters") == json.loads(json.dumps(settings["hyperparameters"])) and stored.get(
        "scenario_sha256"
    ) == (None if text is None else digest(text))


def _policy(plan: Plan, cell: Cell, out: Path) -> tuple[Any, dict[str, Any]]:
    """The cell's policy (or what makes it from an env), and its env's settings."""
    arena, training = plan.arena(cell.arena), plan.training_of(cell)
    if training is not None and plan.record(training, out) is None:
        raise FileNotFoundError(f"the cell {training.name!r} is not finished: no model to play with")
    name = cell.policy if training is None else str(training.run(out))
    entrant = resolve(name, arena.task, arena.scenario, arena.split, plan.trust)
    return entrant.policy, entrant.settings


def _built_or_refused(policy: Any, env: gym.Env | gym.vector.VectorEnv) -> tuple[Any, str]:
    """The policy for an env or batch, or why it cannot serve this env."""
    try:
        return built(policy, env), ""
    except ValueError as refusal:
        return None, str(refusal)


def _evaluate(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    arena = plan.arena(cell.arena)
    policy, settings = _policy(plan, cell, out)
    env = make_batch(arena.task, plan.episodes_of(arena), settings)
    policy, refusal = _built_or_refused(policy, env)
    if refusal:
        return {"not_applicable": refusal}
    episodes = evaluate(policy, arena.task, env.num_envs, EVALUATION_SEED, cell.policy, env)
    return episodes.to_json()


def _par(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    """The par's episodes, and a lower bound of the time for each, s (none in a tracking task)."""
    arena = plan.arena(cell.arena)
    env = make_batch(arena.task, plan.episodes_of(arena), arena.env | CONTROLLERS[PAR].env_kwargs)
    # Without the user's cache of plans, so that the seconds of the cell are those of an empty one.
    optimal = CONTROLLERS[PAR].from_env(env, cache=False)
    episodes = evaluate(optimal, arena.task, env.num_envs, EVALUATION_SEED, PAR, env)
    env.reset(seed=EVALUATION_SEED)
    core: SteeringCore = env.unwrapped.core  # type: ignore[attr-defined]
    bound = None if arena.tracking else least_times(Starts.of(core, np.arange(env.num_envs))).tolist()
    return episodes.to_json() | {"lower_bound_s": bound}


def _decide(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    """Times of single decisions in one env, ms. The first few are left out, because they compile and tabulate."""
    arena, count = plan.arena(cell.arena), plan.settings(cell)["decisions"]
    own = resolve(cell.policy, trust=plan.trust)
    settings: dict[str, Any] = own.settings | arena.env | ({"pool_size": 1} if arena.split is not None else {})
    env = gym.make(arena.task, **settings)
    observation, _ = env.reset(seed=EVALUATION_SEED)
    policy, refusal = _built_or_refused(own.policy, env)
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
"""Number of first decisions that are not timed."""


def _robustness(plan: Plan, cell: Cell, out: Path) -> dict[str, Any]:
    arena, settings = plan.arena(cell.arena), plan.settings(cell)
    policy, env = _policy(plan, cell, out)
    found = sweep(policy, arena.task, settings["episodes"], cell.policy, report=print, **env)
    return {"disturbed": {name: episodes.to_json() for name, episodes in found.items()}}


_MAKERS = {"train": _train, "evaluate": _evaluate, "par": _par, "decide": _decide, "robustness": _robustness}
