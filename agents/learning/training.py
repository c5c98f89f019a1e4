"""Learning: a run from its start or its newest checkpoint to its end, with evaluations on the way."""

from __future__ import annotations

import csv
import io
import json
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.type_aliases import RolloutReturn
from stable_baselines3.common.vec_env import VecEnv

from magwire_env.envs.task import TASKS

from ..evaluation.episodes import EVALUATION_SEED
from ..evaluation.evaluator import evaluate
from ..notes import note
from .export import about_model, plain, save_all
from .imitation import imitate
from .plain_policy import PlainPolicy
from .policy_file import read
from .resuming import put_back, taken
from .run import VALIDATION_EPISODES, Run
from .run_folder import BEST, LAST, Checkpoints, locked, write_whole
from .sb3 import make_model, make_vec_env
from .stored import read_json
from .tree_file import load_tree, save_tree

__all__ = ["CURVE", "Run", "curve_of", "goodness", "learn", "learning_curve", "read_curve"]

VALIDATION_SEED = EVALUATION_SEED + 500_000
"""Held-out seeds for choosing the best model: neither training's nor the final evaluation's."""

CURVE = "learning_curve.csv"
_COLUMNS = (
    "timesteps", "seconds", "success_rate", "median_time_s", "mean_reward", "median_rms_error_m", "within_limit_rate",
)  # fmt: skip
_LATER_COLUMNS = {"within_limit_rate"}
"""Columns that the curves of earlier versions do not have; they read as NaN."""


def learn(run: Run, patience: float = 0.0) -> bool:
    """Train to the end; false if Ctrl-C or SIGTERM stopped it, after saving a checkpoint.

    patience : s to wait for another process that is about to end its work on the run

    Raises `ValueError` if another process is writing the run, or its checkpoint is damaged; `OSError` if the end cannot
    be written.
    """
    with locked(run.folder, patience):
        torch.set_num_threads(run.config["threads"])
        model, progress = _begun(run)
        left = progress.total - model.num_timesteps
        if left > 0:
            with _stopped_by_signals(progress.ask_to_stop):
                model.learn(left, reset_num_timesteps=False, progress_bar=run.config["progress"])
        return progress.finished()


def _begun(run: Run) -> tuple[BaseAlgorithm, Progress]:
    """The model at the run's start, or where its newest checkpoint left it."""
    settings = dict(run.settings)
    n_envs, total = settings.pop("n_envs"), settings.pop("n_timesteps")
    settings.pop("env", None)
    lesson = settings.pop("imitate", None)
    frames, env = settings.pop("frame_stack", 1), run.env_settings | settings.pop("training_env", {})
    try:
        venv = make_vec_env(run.task, n_envs, seed=run.config["seed"], frame_stack=frames, **env)
        model = make_model(run.algorithm, venv, run.config["seed"], settings, run.folder / "tensorboard")
    except (
        TypeError,
        AttributeError,
        AssertionError,
    ) as error:  # of settings that do not exist, or are of a wrong kind
        raise ValueError(f"{run.folder / 'config.json'} has hyperparameters that make no model: {error}") from error
    checkpoints = Checkpoints(run.folder)
    newest = checkpoints.newest()
    progress = Progress(run, model, total, checkpoints)
    if newest is not None:
        run.say_what_changed()
        progress.go_on_from(newest)
    elif (run.folder / LAST / "model.zip").exists():
        model = progress.model = _of_an_earlier_version(run, venv)
    elif run.resume:
        note(f"{run.folder} was stopped before its first checkpoint, and begins again")
    if lesson is not None and newest is None and not model.num_timesteps:
        off = imitate(model, **lesson)
        progress.evaluate_first()
        note(f"imitated {lesson['teacher']} for {lesson['steps']} steps: root mean square error {off:.2f}")
    model.set_logger(configure(str(run.folder / "tensorboard"), ["tensorboard"]))
    progress.watch()
    return model, progress


def _of_an_earlier_version(run: Run, venv: VecEnv) -> BaseAlgorithm:
    folder = run.folder / LAST
    if not run.trust:
        raise ValueError(
            f"{folder} was saved by an earlier version as model.zip and normalization.pkl, which can carry a program "
            "and were not opened; --trust opens them, if the run is your own"
        )
    from .trusted import parts

    note("the earlier version kept no replay buffer, episodes or random states: these begin anew")
    return parts(folder, venv)[0]


class Progress:
    """Evaluates on held-out seeds between rollouts, keeps the best policy, and saves all that it takes to go on.

    total : env steps of the whole training
    """

    def __init__(self, run: Run, model: BaseAlgorithm, total: int, checkpoints: Checkpoints) -> None:
        self.run, self.model, self.total, self.checkpoints = run, model, total, checkpoints
        self.rows: list[dict[str, float]] = []
        self.best: PlainPolicy | None = None
        self._stopping = self._stopped = False
        self._every = max(1, total // max(1, run.config["evaluations"]))
        self._next, self._evaluated = self._every, -1
        self._held_out = run.validation
        self._before, self._started = 0.0, time.perf_counter()

    @property
    def _seconds(self) -> float:
        """s that the training has taken, in all the processes it ran in."""
        return self._before + time.perf_counter() - self._started

    def go_on_from(self, checkpoint: Path) -> None:
        """Bring the model and everything kept beside it to where a checkpoint left them."""
        stored = read_json(checkpoint / "checkpoint.json")
        try:
            put_back(self.model, load_tree(checkpoint / LAST, "training"))
        except ValueError as error:
            raise ValueError(f"{checkpoint / LAST} is damaged or of another training: {error}") from error
        self.rows = read_curve(checkpoint / CURVE)
        self.best = read(checkpoint / BEST) if (checkpoint / BEST).exists() else None
        self._next, self._evaluated = stored.whole("next_evaluation"), stored.get("evaluated", int)
        self._before = float(stored.get("seconds", int, float))

    def watch(self) -> None:
        """Come between the model's rollouts, before anything is drawn for the next one."""
        model: Any = self.model
        collect, on_policy = model.collect_rollouts, isinstance(model, OnPolicyAlgorithm)

        def collect_rollouts(*args: Any, **options: Any) -> Any:
            if model.num_timesteps >= self._next:
                self._next += self._every
                self._evaluate()
                self._save()
            if self._stopping:
                self._stopped = True
                self._save(at_the_end=True)
                return False if on_policy else RolloutReturn(0, 0, continue_training=False)
            return collect(*args, **options)

        model.collect_rollouts = collect_rollouts

    def evaluate_first(self) -> None:
        """Evaluate and save before the first rollout too: the policy has learnt something already."""
        self._next = self.model.num_timesteps

    def ask_to_stop(self) -> None:
        """Stop before the next rollout."""
        self._stopping = True

    def finished(self) -> bool:
        """Evaluate and save the end; false, without either, if the training was stopped before."""
        if self._stopped:
            return False
        if self._evaluated != self.model.num_timesteps:
            self._evaluate()
            self._save(at_the_end=True)
        return True

    def _evaluate(self) -> None:
        model = self.model
        policy = plain(model, about_model(model, self.run.meta), self.run.frames)
        episodes = evaluate(policy, self.run.task, VALIDATION_EPISODES, VALIDATION_SEED, **self._held_out)
        result = episodes.summary()
        model.logger.record("eval/success_rate", result["success_rate"])
        model.logger.record("eval/median_time_s", result["median_time_s"])
        model.logger.dump(model.num_timesteps)
        score = goodness(result)
        if score > max((goodness(row) for row in self.rows), default=(-1.0, 0.0)):
            self.best = policy
        values = (model.num_timesteps, round(self._seconds, 1), *(result[name] for name in _COLUMNS[2:]))
        self.rows.append(dict(zip(_COLUMNS, values, strict=True)))
        self._evaluated = model.num_timesteps
        print(
            f"{model.num_timesteps:>9} steps  {self._seconds:6.1f} s  "
            f"success {result['success_rate']:6.1%}  {_measured(result)}",
            flush=True,
        )

    def _save(self, at_the_end: bool = False) -> None:
        """Write a checkpoint; where that fails on the way, say so and go on: else the model would be lost."""
        try:
            self.checkpoints.write(self._fill)
        except OSError as error:
            if at_the_end:
                raise
            note(f"no checkpoint at {self.model.num_timesteps} steps ({error}); the training goes on and tries again")

    def _fill(self, folder: Path) -> None:
        model = self.model
        save_all(plain(model, about_model(model, self.run.meta), self.run.frames), folder / LAST)
        save_tree(taken(model), folder / LAST, "training")
        if self.best is not None:
            save_all(self.best, folder / BEST)
        text = io.StringIO()
        writer = csv.DictWriter(text, _COLUMNS)
        writer.writeheader()
        writer.writerows(row | {"timesteps": int(row["timesteps"])} for row in self.rows)
        (folder / CURVE).write_text(text.getvalue(), encoding="utf-8", newline="")
        state = {
            "format": 1, "timesteps": model.num_timesteps, "seconds": self._seconds, "evaluated": self._evaluated,
            "next_evaluation": self._next,
        }  # fmt: skip
        (folder / "checkpoint.json").write_text(json.dumps(state, indent=2), encoding="utf-8")


def curve_of(folder: Path) -> Path | None:
    """The file with a run's learning curve, or None if it has none yet."""
    newest = Checkpoints(folder).newest()
    return next((p for p in (newest and newest / CURVE, folder / CURVE) if p is not None and p.exists()), None)


def learning_curve(run: Run, folder: Path | None = None) -> None:
    """Draw learning_curve.png: success rate and median time to goal on held-out episodes, over environment steps.

    folder : to write to; by default the run's, where the numbers are put beside it as they are in the newest checkpoint
    """
    path = curve_of(run.folder)
    rows = [] if path is None else read_curve(path)
    if not rows or path is None:
        return
    if folder is None:
        write_whole(run.folder / CURVE, path.read_text(encoding="utf-8"))
    from magwire_env.plotting import BLUE, RED, blank, styled

    steps = np.array([r["timesteps"] for r in rows]) / 1e6
    with styled():
        figure, (top, bottom) = blank(2, 1, size=(7, 5), sharex=True)
        top.plot(steps, [100 * r["success_rate"] for r in rows], "o-", color=BLUE)
        title = f"{run.task}, {run.algorithm.upper()}, seed {run.config['seed']}"
        top.set(ylabel="success [%]", ylim=(-5, 105), title=title)
        tracking = TASKS[run.task].kind.follows if run.task in TASKS else False
        key, name = ("mean_reward", "mean reward") if tracking else ("median_time_s", "median time to goal [s]")
        bottom.plot(steps, [r[key] for r in rows], "o-", color=RED)
        bottom.set(ylabel=name, xlabel="environment steps [millions]")
        figure.savefig((folder or run.folder) / "learning_curve.png")


def read_curve(path: Path) -> list[dict[str, float]]:
    """The rows of a learning_curve.csv. Raises `ValueError`, naming it, for one that is damaged."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    except (TypeError, ValueError, csv.Error) as error:
        raise ValueError(f"{path} is truncated or damaged: {error}") from error
    rows = [dict.fromkeys(_LATER_COLUMNS, float("nan")) | row for row in rows]
    if any(set(row) != set(_COLUMNS) for row in rows):
        raise ValueError(f"{path} must have the columns {', '.join(_COLUMNS)}, got {', '.join(map(str, rows[0]))}")
    return rows


def _measured(result: dict[str, float]) -> str:
    """What an evaluation measured beside success: a tracking task's error, or the time to the goal, if there is one,
    and how many episodes kept a limit on their cost."""
    if result["median_rms_error_m"] == result["median_rms_error_m"]:
        return f"median RMS error {1e3 * result['median_rms_error_m']:.1f} mm"
    time, within = result["median_time_s"], result["within_limit_rate"]
    limit = f"  cost within its limit {within:6.1%}" if within == within else ""
    return f"median time {f'{time:.3f} s' if time == time else '–'}{limit}"


def goodness(result: Mapping[str, float]) -> tuple[float, float]:
    """How good a model is: success first, then speed, or in a tracking task the RMS error.

    In a task with a limit on an episode's cost, such as Gentle, the share of episodes within it counts like success:
    the lower of the two comes first.
    """
    rms, within = result["median_rms_error_m"], result["within_limit_rate"]
    measure = rms if rms == rms else result["median_time_s"]
    reached = result["success_rate"] if within != within else min(result["success_rate"], within)
    return reached, -measure if measure == measure else -float("inf")


@contextmanager
def _stopped_by_signals(ask: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C or SIGTERM asks for a stop between rollouts; a second one stops at once."""
    kinds = [kind for kind in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(kind) is not signal.SIG_IGN]

    def asked(*_: Any) -> None:
        ask()
        for kind in kinds:
            signal.signal(kind, signal.default_int_handler)

    try:
        before = [signal.signal(kind, asked) for kind in kinds]
    except ValueError:  # not in the main thread: the caller's own business
        yield
        return
    try:
        yield
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)
