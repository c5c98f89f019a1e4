"""A training run: its folder, its training with evaluations and checkpoints, its learning curve."""

from __future__ import annotations

import csv
import json
import platform
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure

from magwire_env.envs.task import TASKS
from magwire_env.plotting import BLUE, RED, blank, styled
from magwire_env.quasistatic.pool import scenario_pool

from ..evaluation.episodes import EVALUATION_SEED
from ..evaluation.evaluator import evaluate
from .config import Config
from .sb3 import frozen, hyperparameters, load_parts, make_model, make_vec_env, save

__all__ = ["Run", "learn", "learning_curve", "read_curve"]

VALIDATION_SEED = EVALUATION_SEED + 500_000
"""First of the seeds that choose the best model; neither the training nor the final evaluation uses them."""

VALIDATION_EPISODES, VALIDATION_POOL = 100, 1
"""Number of episodes that choose the best model, and seed of the pool of tracts for a generated task."""

_PACKAGES = ("magwire-env", "gymnasium", "stable-baselines3", "torch", "numba", "numpy", "scipy")


@dataclass(frozen=True)
class Run:
    """A run folder and the contents of its config.json."""

    folder: Path
    config: dict[str, Any]
    settings: dict[str, Any]
    resume: bool = False

    @classmethod
    def open(cls, config: Config, changes: dict[str, Any] | None = None) -> Run:
        """Make the folder of a new run, or find the folder of a run to resume.

        changes : to the YAML's hyperparameters; a name with a dot is one inside a block

        Raises `FileExistsError` for a new run whose folder exists, `FileNotFoundError` for a run to resume whose folder
        does not. Without `resume` an existing folder is never changed.
        """
        asked = {k: (str(v) if isinstance(v, Path) else v) for k, v in asdict(config).items()}
        if config.resume:
            if config.run is None or not (Path(config.run) / "config.json").exists():
                raise FileNotFoundError(f"--resume needs --run with a run's folder, got {config.run}")
            return cls.at(Path(config.run))
        settings = _changed(hyperparameters(config.algorithm, config.task), changes or {})
        settings["n_timesteps"] = config.timesteps or settings["n_timesteps"]
        settings["n_envs"] = config.n_envs or settings["n_envs"]
        for name in ("timesteps", "n_envs", "episodes"):
            if getattr(config, name) is not None and getattr(config, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(config, name)}")
        folder = Path(config.run) if config.run is not None else _free_folder(config)
        if folder.exists():
            raise FileExistsError(f"run folder {folder} exists: choose another --run, or --resume to go on with it")
        make_vec_env(config.task, 1, **_env_settings(asked))  # a bad task or scenario fails before anything is written
        folder.mkdir(parents=True)
        run = cls(folder, asked, settings)
        run.write("config.json", {"config": asked, "hyperparameters": settings})
        run.write("versions.json", _versions())
        return run

    @classmethod
    def at(cls, folder: Path) -> Run:
        """The run in `folder`."""
        stored = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        return cls(folder, stored["config"], stored["hyperparameters"], resume=True)

    @property
    def task(self) -> str:
        return self.config["task"]

    @property
    def algorithm(self) -> str:
        return self.config["algorithm"]

    @property
    def env_settings(self) -> dict[str, Any]:
        """Keyword arguments of the env: those of the hyperparameters, and the scenario of the configuration."""
        return self.settings.get("env", {}) | _env_settings(self.config)

    @property
    def held_out(self) -> dict[str, Any]:
        """Keyword arguments of the final evaluation's env; it takes a generated task's tracts from the test split."""
        drawn = TASKS[self.task].pool is not None and self.config["scenario"] is None
        return self.env_settings | ({"split": "test"} if drawn else {})

    @property
    def same_episodes(self) -> dict[str, Any]:
        """Keyword arguments of an env for controllers: the final evaluation's episodes, the task's own observation and
        action."""
        return {k: v for k, v in self.held_out.items() if k in ("scenario", "split")}

    @property
    def validation(self) -> dict[str, Any]:
        """Keyword arguments of the env that chooses the best model.

        A generated task has a pool of tracts of its own here, neither the training's nor the test split's, because a
        policy may learn its training tracts by heart.
        """
        pool = TASKS[self.task].pool
        if pool is None or self.config["scenario"] is not None:
            return self.env_settings
        settings = {k: v for k, v in self.env_settings.items() if k not in ("split", "pool_size")}
        return settings | {"scenario": list(scenario_pool(pool, "train", VALIDATION_EPISODES, VALIDATION_POOL))}

    @property
    def meta(self) -> dict[str, Any]:
        """Contents of a saved model's model.json."""
        return {
            "task": self.task,
            "algorithm": self.algorithm,
            "seed": self.config["seed"],
            "env": self.env_settings,
            "frame_stack": self.settings.get("frame_stack", 1),
        }

    def write(self, name: str, content: Any) -> None:
        """Write a JSON file into the folder."""
        (self.folder / name).write_text(json.dumps(content, indent=2), encoding="utf-8")


def learn(run: Run) -> bool:
    """Train to the end; false if Ctrl-C stopped it, after a checkpoint was saved."""
    settings = dict(run.settings)
    n_envs, total, _ = settings.pop("n_envs"), settings.pop("n_timesteps"), settings.pop("env", None)
    torch.set_num_threads(run.config["threads"])
    frames, env = settings.pop("frame_stack", 1), run.env_settings | settings.pop("training_env", {})
    venv = make_vec_env(run.task, n_envs, seed=run.config["seed"], frame_stack=frames, **env)
    if run.resume:
        model, _, _ = load_parts(run.folder / "last", venv)
        model.tensorboard_log = str(run.folder / "tensorboard")
    else:
        model = make_model(run.algorithm, venv, run.config["seed"], settings, run.folder / "tensorboard")
    model.set_logger(configure(str(run.folder / "tensorboard"), ["tensorboard"]))
    left = total - model.num_timesteps
    if left <= 0:
        return True
    progress = Progress(run, total)
    with _interruptible(progress):
        model.learn(left, callback=progress, reset_num_timesteps=False, progress_bar=run.config["progress"])
    save(model, run.folder / "last", run.meta)
    return not progress.interrupted


class Progress(BaseCallback):
    """Evaluates on held-out seeds, keeps the best model and a checkpoint, and stops between steps on request."""

    def __init__(self, run: Run, total: int) -> None:
        super().__init__()
        self.run, self.total = run, total
        self.interrupted = False
        self.curve = run.folder / "learning_curve.csv"
        self._best = self._best_so_far()
        self._next = 0
        self._every = max(1, total // max(1, run.config["evaluations"]))
        self._held_out = run.validation
        self._started = time.perf_counter()

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self._every

    def _on_step(self) -> bool:
        return not self.interrupted

    def _on_rollout_start(self) -> None:
        # Here an on-policy model has just been updated.
        if self.num_timesteps >= self._next:
            self._next += self._every
            self._evaluate()

    def _on_training_end(self) -> None:
        if not self.interrupted:
            self._evaluate()

    def _evaluate(self) -> None:
        policy = frozen(self.model, self.run.meta)
        episodes = evaluate(policy, self.run.task, VALIDATION_EPISODES, VALIDATION_SEED, **self._held_out)
        result = episodes.summary()
        self.logger.record("eval/success_rate", result["success_rate"])
        self.logger.record("eval/median_time_s", result["median_time_s"])
        self.logger.dump(self.num_timesteps)
        new = not self.curve.exists()
        with self.curve.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            if new:
                writer.writerow(["timesteps", "seconds", "success_rate", "median_time_s", "mean_reward"])
            seconds = time.perf_counter() - self._started
            row = [result["success_rate"], result["median_time_s"], result["mean_reward"]]
            writer.writerow([self.num_timesteps, f"{seconds:.1f}", *row])
        print(
            f"{self.num_timesteps:>9} steps  {time.perf_counter() - self._started:6.1f} s  "
            f"success {result['success_rate']:6.1%}  median time {result['median_time_s']:.3f} s",
            flush=True,
        )
        save(self.model, self.run.folder / "last", self.run.meta)
        score = _score(result["success_rate"], result["median_time_s"])
        if score > self._best:
            self._best = score
            save(self.model, self.run.folder / "best", self.run.meta)

    def _best_so_far(self) -> tuple[float, float]:
        scores = [_score(r["success_rate"], r["median_time_s"]) for r in read_curve(self.curve)]
        return max(scores, default=(-1.0, 0.0))


def learning_curve(run: Run, folder: Path | None = None) -> None:
    """Draw learning_curve.png: success rate and median time to goal on held-out episodes, over environment steps."""
    rows = read_curve(run.folder / "learning_curve.csv")
    if not rows:
        return
    steps = np.array([r["timesteps"] for r in rows]) / 1e6
    with styled():
        figure, (top, bottom) = blank(2, 1, size=(7, 5), sharex=True)
        top.plot(steps, [100 * r["success_rate"] for r in rows], "o-", color=BLUE)
        title = f"{run.task}, {run.algorithm.upper()}, seed {run.config['seed']}"
        top.set(ylabel="success [%]", ylim=(-5, 105), title=title)
        bottom.plot(steps, [r["median_time_s"] for r in rows], "o-", color=RED)
        bottom.set(ylabel="median time to goal [s]", xlabel="environment steps [millions]")
        figure.savefig((folder or run.folder) / "learning_curve.png")


def read_curve(path: Path) -> list[dict[str, float]]:
    """The rows of a learning_curve.csv; none if there is no file yet."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]


def _score(success_rate: float, median_time: float) -> tuple[float, float]:
    """How good a model is: success first, then speed."""
    return success_rate, -median_time if median_time == median_time else -float("inf")


@contextmanager
def _interruptible(progress: Progress) -> Iterator[None]:
    """Ctrl-C requests a stop between two steps; a second Ctrl-C stops at once."""

    def ask(*_: Any) -> None:
        progress.interrupted = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    try:
        before = signal.signal(signal.SIGINT, ask)
    except ValueError:  # not in the main thread, where signals cannot be caught
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _env_settings(config: dict[str, Any]) -> dict[str, Any]:
    return {} if config["scenario"] is None else {"scenario": config["scenario"]}


def _changed(settings: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`settings` with `changes`; a name "block.inner" changes an entry of a block."""
    settings = dict(settings)
    for name, value in changes.items():
        block, _, inner = name.partition(".")
        settings[block] = {**settings.get(block, {}), inner: value} if inner else value
    return settings


def _free_folder(config: Config) -> Path:
    """A folder under runs/ that does not exist yet."""
    base = Path("runs") / f"{config.task.split('/')[-1]}-{config.algorithm}-seed{config.seed}"
    folder, number = base, 2
    while folder.exists():
        folder, number = base.with_name(f"{base.name}-{number}"), number + 1
    return folder


def _versions() -> dict[str, str]:
    return {"python": platform.python_version(), "machine": platform.machine()} | {p: version(p) for p in _PACKAGES}
