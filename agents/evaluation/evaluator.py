"""One evaluator for every policy: the same episode seeds side by side, scores against a par, intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from textwrap import fill
from typing import Any

import gymnasium as gym
import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env.envs.core import SteeringCore
from magwire_env.envs.pools import scenario_pool
from magwire_env.envs.task import TASKS, known_task
from magwire_env.progress import Progress
from magwire_env.validation.report import format_table
from magwire_env.words import counted

from .episodes import EVALUATION_SEED, built
from .episodes import episodes as played
from .statistics import interval, mean, median

__all__ = ["Episodes", "evaluate", "make_batch", "paired_ratio", "table"]

_MISSING = "–"


@dataclass(frozen=True)
class Episodes:
    """What a policy did: arrays (n,) with one entry for each episode seed.

    start, goal : m, tip arc lengths at the beginning (in a tracking task, both are the first of the reference)
    success : reached the goal
    time : s to the goal, interpolated within the control step; NaN where it was not reached
    path_ratio : share of the way that was covered when the episode ended; NaN in a tracking task
    rms_error : m, of a tracking task; NaN elsewhere
    peak_lateral_force, peak_wall_force, mean_wall_force : N
    cost : wall force above its limit, summed over the control steps, N·steps
    magnet_travel : rad and m summed
    steps : control steps
    unconverged : integration steps whose motion is not to be trusted, see `magwire_env.simulation.readout`
    wrong_entries : branches off the route that the tip has entered, of a navigating task; NaN elsewhere
    within_limit : 1 where the cost stayed below the task's limit, else 0; NaN of a task without such a limit
    """

    policy: str
    start: np.ndarray
    goal: np.ndarray
    success: np.ndarray
    time: np.ndarray
    path_ratio: np.ndarray
    rms_error: np.ndarray
    peak_lateral_force: np.ndarray
    peak_wall_force: np.ndarray
    mean_wall_force: np.ndarray
    cost: np.ndarray
    magnet_travel: np.ndarray
    steps: np.ndarray
    unconverged: np.ndarray
    reward: np.ndarray
    wrong_entries: np.ndarray
    within_limit: np.ndarray

    @property
    def tracking(self) -> bool:
        """The episodes are of a tracking task, which is judged by its error and not by its time."""
        return bool(np.isfinite(self.rms_error).all())

    def score(self, par: Episodes) -> np.ndarray:
        """How near every episode came to the par, (n,): the par's time over its own, 0 where the goal was not reached.

        In a tracking task, the par's RMS error over its own. NaN where the par itself did not reach the goal.

        par : `Optimal` on the same episodes; if it has more, the first ones count

        Raises `ValueError` for a par of other episodes.
        """
        n = len(self.success)
        same = len(par.success) >= n and np.allclose([par.start[:n], par.goal[:n]], [self.start, self.goal], atol=1e-9)
        if not same:
            raise ValueError(f"par must be of the same episodes as {self.policy}'s {n}, got other starts or goals")
        if self.tracking:
            return par.rms_error[:n] / self.rms_error
        with np.errstate(invalid="ignore"):
            return np.where(par.success[:n], np.where(self.success, par.time[:n] / self.time, 0.0), np.nan)

    def median_time(self, resamples: int = 2000) -> tuple[float, float, float]:
        """Median time to goal of the successful episodes with its bootstrap 95 % interval, s; NaN without any."""
        return interval([self.time[self.success]], median, resamples)

    def mean_score(self, par: Episodes) -> tuple[float, float, float]:
        """Mean of the score, failures as 0, with its bootstrap 95 % interval; NaN if the par never reached the goal."""
        score = self.score(par)
        return interval([score[np.isfinite(score)]], mean)

    def summary(self) -> dict[str, float]:
        """Success rate, median time with its interval, forces, cost and travel, as plain numbers."""
        time, low, high = self.median_time()
        return {
            "episodes": len(self.success),
            "success_rate": float(self.success.mean()),
            "median_time_s": time,
            "median_time_low_s": low,
            "median_time_high_s": high,
            "mean_path_ratio": float(self.path_ratio.mean()),
            "median_rms_error_m": float(np.median(self.rms_error)),
            "peak_lateral_force_N": float(self.peak_lateral_force.max()),
            "median_peak_lateral_force_N": float(np.median(self.peak_lateral_force)),
            "median_peak_wall_force_N": float(np.median(self.peak_wall_force)),
            "mean_wall_force_N": float(self.mean_wall_force.mean()),
            "mean_cost_N_steps": float(self.cost.mean()),
            "median_magnet_travel": float(np.median(self.magnet_travel)),
            "mean_reward": float(self.reward.mean()),
            "mean_wrong_entries": float(self.wrong_entries.mean()),
            "within_limit_rate": float(self.within_limit.mean()),
            "untrusted_episodes": int((self.unconverged > 0).sum()),
        }

    def to_json(self, par: Episodes | None = None) -> dict[str, Any]:
        """The summary (with the score against `par`) and all episodes; a number that does not exist is null."""
        clean = {k: v if isinstance(v, str) else _no_nan(v.tolist()) for k, v in asdict(self).items()}
        summary = self.summary()
        if par is not None:
            summary |= dict(zip(("score", "score_low", "score_high"), self.mean_score(par), strict=True))
            clean["score"] = _no_nan(self.score(par).tolist())
        return {"summary": dict(zip(summary, _no_nan(list(summary.values())), strict=True)), "episodes": clean}

    @classmethod
    def from_json(cls, stored: dict[str, Any]) -> Episodes:
        """The episodes of what `to_json` returned."""
        episodes = stored["episodes"]
        kinds: dict[str, Any] = {"success": np.bool_, "steps": np.int64, "unconverged": np.int64}
        if "unconverged" not in episodes:  # of an earlier version
            episodes = {**episodes, "unconverged": [0] * len(episodes["success"])}
        episodes = {**dict.fromkeys(("wrong_entries", "within_limit"), [None] * len(episodes["success"])), **episodes}
        arrays: dict[str, Any] = {
            f.name: np.array(
                [np.nan if x is None else x for x in episodes[f.name]], dtype=kinds.get(f.name, np.float64)
            )
            for f in fields(cls)
            if f.name != "policy"
        }
        return cls(episodes["policy"], **arrays)


def _no_nan(values: list[Any]) -> list[Any]:
    return [None if x != x else x for x in values]


_SUMMARISED = (
    "time",
    "rms_error",
    "peak_lateral_force",
    "peak_wall_force",
    "mean_wall_force",
    "magnet_travel",
    "wrong_entries",
    "within_limit",
)


def evaluate(
    policy: Any,
    task: str = "MagWire/Steer-v0",
    episodes: int = 200,
    seed: int = EVALUATION_SEED,
    name: str | None = None,
    env: gym.vector.VectorEnv | None = None,
    disturb: Callable[[SteeringCore], None] | None = None,
    **env_settings: Any,
) -> Episodes:
    """Run one episode for each of the seeds `seed` … `seed + episodes − 1`, all side by side.

    In a generated task without a `scenario`, every episode has a tract of its own: the first `episodes` of the pool of
    `split` (by default "train"). So a smaller evaluation is the beginning of a larger one, and `pool_size` is ignored.
    Certified trees are a limited number (`magwire_env.envs.trees`) and come round again.

    policy : an SB3-like policy, or a callable that makes one from the batch (such as ``MaxForce.from_env``), whose
        class may ask for settings of the env (``env_kwargs``)
    env : a batch of `episodes` lanes; by default one is made for `task` with `env_settings`
    disturb : changes the simulator when the episodes have begun; the policy is not told
    """
    if env is None:
        maker = getattr(policy, "__self__", None)  # the class of a ``from_env``
        env = make_batch(task, episodes, dict(getattr(maker, "env_kwargs", {})) | env_settings)
    core: SteeringCore = env.unwrapped.core  # type: ignore[attr-defined]
    policy = built(policy, env)
    observation, _ = env.reset(seed=seed)
    if disturb is not None:
        disturb(core)
        core.sim.load_state(core.sim.state())  # computes the loads again, now that something has changed
        if core.shapes:
            core.shapes.measure()
        observation = core.observe()
    n = env.num_envs
    results = {f.name: np.full(n, np.nan) for f in fields(Episodes) if f.name != "policy"}
    results |= {"start": core.sim.tip_arclength, "goal": core.goal.copy()}
    results |= {name: np.zeros(n, dtype=np.int64) for name in ("steps", "unconverged")}
    results["success"] = np.zeros(n, dtype=np.bool_)
    cost, reward = np.zeros(n), np.zeros(n)
    title = name or type(policy).__name__
    with Progress(f"{title} on {core.task.id}: episodes ended", n) as progress:
        for step in played(env, policy, observation):
            ended, info = step.ended, step.info
            progress.done += int(ended.sum())
            reward += np.where(step.running, step.reward, 0.0)
            cost += np.where(step.running, core.cost_unit * info["cost"], 0.0)
            if ended.any():
                results["success"][ended] = info["is_success"][ended]
                results["path_ratio"][ended] = np.nan if core.task.kind.follows else info["path_ratio"][ended]
                for key in (*_SUMMARISED, "steps", "unconverged"):
                    if key in info["summary"]:
                        results[key][ended] = info["summary"][key][ended]
    results["time"][~results["success"]] = np.nan
    return Episodes(title, **results | {"cost": cost, "reward": reward})


def make_batch(task: str, episodes: int, env_settings: dict[str, Any]) -> gym.vector.VectorEnv:
    """The batch of an evaluation; `evaluate` says which tracts a generated task has."""
    settings, task = dict(env_settings), known_task(task)
    kind = TASKS[task].pool
    if kind is not None and settings.get("scenario") is None:
        settings.pop("pool_size", None)
        settings["scenario"] = list(scenario_pool(kind, settings.pop("split", "train"), episodes))
    return gym.make_vec(task, num_envs=episodes, autoreset_mode="NextStep", **settings)


def table(rows: list[Episodes], reference: str = "MaxForce", par: Episodes | None = None, markdown: bool = True) -> str:
    """A table, one line a policy; a tracking task has errors in place of times.

    reference : policy that times are compared with, on the episodes that both finished
    par : adds a column with the score against it
    markdown : as Markdown; otherwise for a terminal of 120 columns, with short headings and what they mean below
    """
    tracking = any(row.tracking for row in rows)
    against = next((r for r in rows if r.policy == reference), None)
    columns = _columns(rows, tracking, reference, against, par)
    lines = [tuple(column.cell(row) for column in columns) for row in rows]
    if markdown:
        head = [column.head for column in columns]
        parts = [head, ["---"] * len(head), *lines]
        text = "\n".join("| " + " | ".join(cells) + " |" for cells in parts)
        return "\n".join([text, *_untrusted(rows)])
    text = format_table(tuple(column.short for column in columns), lines)
    meaning = "; ".join(f"{c.short}: {c.head}" for c in columns if c.short != c.head)
    return "\n".join([text, "", fill(meaning, 118), *_untrusted(rows)])


def _untrusted(rows: list[Episodes]) -> list[str]:
    """Lines that say which policies' episodes have steps not to be trusted."""
    lines = []
    for row in rows:
        untrusted = int((row.unconverged > 0).sum())
        if untrusted:
            share = f"{untrusted} of {counted(len(row.success), 'episode')} {'has' if untrusted == 1 else 'have'}"
            said = f"{row.policy}: {share} steps not to be trusted, in which "
            lines += ["", said + "friction did not converge, nodes passed each other, or the step was too long."]
    return lines


@dataclass(frozen=True)
class _Column:
    """A column of the table: its heading, the same for a terminal, and what stands in a policy's line."""

    head: str
    short: str
    cell: Callable[[Episodes], str]


def _columns(
    rows: list[Episodes], tracking: bool, reference: str, against: Episodes | None, par: Episodes | None
) -> list[_Column]:
    def mn(of: Callable[[Episodes], float]) -> Callable[[Episodes], str]:
        return lambda row: f"{1e3 * of(row):.1f}"

    columns = [
        _Column("policy", "policy", lambda row: row.policy),
        _Column("success", "success", lambda row: f"{row.success.mean():.1%}"),
    ]
    if tracking:
        error = "median RMS error [mm]"
        columns.append(_Column(error, "error [mm]", lambda row: f"{1e3 * np.median(row.rms_error):.2f}"))
    else:
        time = "median time to goal [s] (95 %)"
        columns.append(_Column(time, "time [s]", lambda row: _between(*row.median_time(), digits=2)))
        columns.append(_Column(f"time / {reference}", "ratio", lambda row: _ratio(row, against)))
    if par is not None:
        columns.append(_Column("score (95 %)", "score", lambda row: _between(*row.mean_score(par), digits=3)))
    if not tracking:
        columns.append(_Column("path covered", "path", lambda row: f"{row.path_ratio.mean():.1%}"))
    if np.isfinite(rows[0].wrong_entries).all():
        columns.append(_Column("wrong branches entered", "wrong", lambda row: f"{row.wrong_entries.mean():.2f}"))
    if np.isfinite(rows[0].within_limit).all():
        columns.append(_Column("cost within its limit", "within", lambda row: f"{row.within_limit.mean():.1%}"))
    return [
        *columns,
        _Column("peak lateral force [mN]", "side", mn(lambda row: row.peak_lateral_force.max())),
        _Column("peak wall force [mN]", "wall", mn(lambda row: float(np.median(row.peak_wall_force)))),
        _Column("mean wall force [mN]", "mean", mn(lambda row: row.mean_wall_force.mean())),
        _Column("cost [mN·steps]", "cost", mn(lambda row: row.cost.mean())),
        _Column("magnet travel", "travel", lambda row: f"{np.median(row.magnet_travel):.2f}"),
    ]


def paired_ratio(row: Episodes, against: Episodes) -> float:
    """Ratio of the median times to goal over the episodes that both finished; NaN if there are none."""
    both = row.success & against.success
    return float(np.median(row.time[both]) / np.median(against.time[both])) if both.any() else float("nan")


def _ratio(row: Episodes, against: Episodes | None) -> str:
    ratio = paired_ratio(row, against) if against is not None else float("nan")
    return f"{ratio:.3f}" if ratio == ratio else _MISSING


def _between(value: float, low: float, high: float, digits: int) -> str:
    """A number with its interval, or a dash where it does not exist."""
    return f"{value:.{digits}f} ({low:.{digits}f}–{high:.{digits}f})" if value == value else _MISSING
