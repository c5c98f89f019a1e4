"""Hyperparameters by search: Optuna's tree-structured Parzen estimator over short trainings with fixed seeds.

``magwire tune --task MagWire/Steer-v0 --algorithm ppo`` writes the study to ``runs/studies/``. Its result is then
copied by hand into the algorithm's YAML. The first trial has the YAML's own values, so a study also says whether the
search beat them.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import optuna
import yaml
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial

from magwire_env.physics.checks import one_of, whole
from magwire_env.words import counted

from ..engines import Outcome, Task, engine, run
from .config import Config
from .hyperparameters import hyperparameters
from .training import Run, curve_of, learn, read_curve

__all__ = ["SPACES", "STUDIES", "tune"]

STUDIES = Path("runs/studies")
"""Where studies go by default: below the folder that one stands in. Those of the package's own settings are in
``agents/hyperparameters/studies``."""

Space = dict[str, Callable[[optuna.Trial, str], Any]]


def _log(low: float, high: float) -> Callable[[optuna.Trial, str], float]:
    return lambda trial, name: float(f"{trial.suggest_float(name, low, high, log=True):.3g}")


def _linear(low: float, high: float) -> Callable[[optuna.Trial, str], float]:
    return lambda trial, name: trial.suggest_float(name, low, high, step=0.1)


def _one_of(*values: Any) -> Callable[[optuna.Trial, str], Any]:
    return lambda trial, name: trial.suggest_categorical(name, values)


_ON_POLICY: Space = {
    "learning_rate": lambda trial, name: f"lin_{_log(2e-4, 4e-3)(trial, name):.3g}",
    "n_steps": _one_of(16, 32, 64),
    "batch_size": _one_of(512, 1024, 2048),
    "n_epochs": _one_of(4, 6, 8, 10),
    "gamma": _one_of(0.95, 0.97, 0.98, 0.99, 0.995),
    "gae_lambda": _one_of(0.85, 0.9, 0.95, 0.98),
    "clip_range": _one_of(0.1, 0.2, 0.3),
    "policy_kwargs.log_std_init": _linear(-2.5, 0.0),
}
_OFF_POLICY: Space = {
    "learning_rate": _log(2e-4, 4e-3),
    "batch_size": _one_of(256, 512, 1024),
    "gradient_steps": _one_of(8, 16, 32),
    "gamma": _one_of(0.95, 0.97, 0.98, 0.99, 0.995),
}
SPACES: dict[str, Space] = {
    "ppo": _ON_POLICY,
    "stacked_ppo": _ON_POLICY,
    "knows_ppo": _ON_POLICY,
    "sees_ppo": _ON_POLICY,
    "robust_ppo": _ON_POLICY,
    "sac": _OFF_POLICY | {"tau": _one_of(0.005, 0.01, 0.02)},
    "tqc": _OFF_POLICY | {"tau": _one_of(0.005, 0.01, 0.02), "top_quantiles_to_drop_per_net": _one_of(0, 2, 5)},
    "crossq": _OFF_POLICY | {"policy_delay": _one_of(1, 2, 3)},
}
"""Hyperparameters that are searched for each algorithm; a name with a dot is one inside ``policy_kwargs``."""


def tune(
    task: str,
    algorithm: str,
    trials: int = 16,
    timesteps: int | None = None,
    seed: int = 1000,
    scenario: str | None = None,
    out: Path = STUDIES,
    storage: str | None = None,
    workers: int = 1,
    ray: str | None = None,
) -> Path:
    """Run a study and write its settings, the best trial, and all trials in their order. Returns the file.

    trials : number of trainings; the first has the YAML's values
    timesteps : env steps of each training; by default a third of the YAML's
    seed : of the search and of every training; the benchmark trains with other seeds
    scenario : a TOML file or a shipped name, in place of the task's
    out : folder to write to
    storage : a journal file or a database's URL, in which a study goes on where it stopped; by default a journal file
        that lasts as long as this call
    workers, ray : see `agents.engines.engine`; with one worker a study depends on its seed alone
    """
    one_of("algorithm", algorithm, tuple(SPACES))
    whole("trials", trials, 1)
    given = hyperparameters(algorithm, task)
    timesteps = timesteps or given["n_timesteps"] // 3
    config = Config(
        task=task, algorithm=algorithm, seed=seed, timesteps=timesteps, scenario=scenario, evaluations=1,
        progress=False,
    )  # fmt: skip
    name = f"{algorithm}-{task.split('/')[-1]}" + ("" if scenario is None else f"-{Path(scenario).stem}")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with tempfile.TemporaryDirectory() as scratch:
        place = storage or str(Path(scratch) / "study.journal")
        study = _study(place, name)
        if not study.trials:
            study.enqueue_trial(_as_given(given, SPACES[algorithm]))
        left = max(0, trials - len(_finished(study)))
        tasks = [Task(f"{name} {i}", _one_trial, (place, name, config)) for i in range(left)]

        def told(outcome: Outcome) -> None:
            print(outcome.result if outcome.failure is None else f"FAILED    {outcome.failure}", flush=True)

        outcomes = run(engine(workers, ray), tasks, told)
        rows = [dict(trial.user_attrs["row"]) for trial in _finished(study)]
    if failed := [outcome.failure for outcome in outcomes if outcome.failure is not None]:
        raise ValueError(f"{len(failed)} of {counted(left, 'trial')} failed, the first with: {failed[0]}")
    path = out / f"{name}.yml"
    out.mkdir(parents=True, exist_ok=True)
    content = _described(config, rows)
    path.write_text(yaml.safe_dump(content, sort_keys=False, width=120), encoding="utf-8")
    return path


def _described(config: Config, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What a study's file holds: its settings, the best trial, and all trials in their order."""
    return {
        "task": config.task,
        "scenario": config.scenario,
        "algorithm": config.algorithm,
        "seed": config.seed,
        "timesteps": config.timesteps,
        "optuna": version("optuna"),
        "value": "mean episode reward on the held-out episodes after the last step",
        "given": rows[0]["value"],
        "best": dict(max(rows, key=lambda row: row["value"])),
        "trials": rows,
    }


def _study(storage: str, name: str) -> optuna.Study:
    """The study of this name, which is made if there is none."""
    where: Any = storage
    if "://" not in storage:
        Path(storage).parent.mkdir(parents=True, exist_ok=True)
        where = JournalStorage(JournalFileBackend(storage))
    return optuna.create_study(storage=where, study_name=name, direction="maximize", load_if_exists=True)


def _finished(study: optuna.Study) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.COMPLETE,))


def _one_trial(storage: str, name: str, config: Config, attempt: int = 0) -> str:
    """A task: one more trial of a study; returns a line about it."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study, said = _study(storage, name), []
    study.sampler = optuna.samplers.TPESampler(seed=config.seed + len(study.trials))

    def objective(trial: optuna.Trial) -> float:
        changes = {name: ask(trial, name) for name, ask in SPACES[config.algorithm].items()}
        began = time.perf_counter()
        value = _trained(config, changes)
        row = {"value": round(value, 4), "seconds": round(time.perf_counter() - began, 1), **changes}
        trial.set_user_attr("row", row)
        said.append(f"trial {trial.number:>3}: {value:8.3f}  {changes}")
        return value

    study.optimize(objective, n_trials=1)
    return said[0]


def _as_given(given: dict[str, Any], space: Space) -> dict[str, Any]:
    """The YAML's values as a trial. A value that the YAML does not have is left to the search."""
    values = {}
    for name in space:
        value: Any = given
        for key in name.split("."):
            value = value.get(key) if isinstance(value, dict) else None
        if value is not None:
            values[name] = float(str(value).removeprefix("lin_")) if name == "learning_rate" else value
    return values


def _trained(config: Config, changes: dict[str, Any]) -> float:
    """Mean episode reward on the held-out episodes after a training with `changes`."""
    with tempfile.TemporaryDirectory() as folder:
        run = Run.open(replace(config, run=Path(folder) / "run"), changes)
        if not learn(run):
            raise KeyboardInterrupt
        path = curve_of(run.folder)
        assert path is not None  # it has been evaluated at its end
        return read_curve(path)[-1]["mean_reward"]
