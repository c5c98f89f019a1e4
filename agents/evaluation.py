"""One evaluator for every policy: the same episode seeds, batched, with intervals."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Protocol

import gymnasium as gym
import numpy as np

import magwire_env  # noqa: F401  (registers the ids)

__all__ = ["EVALUATION_SEED", "Episodes", "Policy", "evaluate", "table"]

EVALUATION_SEED = 1_000_000
"""First of the evaluation's episode seeds; training uses seeds far below."""


class Policy(Protocol):
    """Anything with SB3's ``predict``."""

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]: ...


@dataclass(frozen=True)
class Episodes:
    """What a policy did, one entry an episode seed, (n,) each.

    success : reached the goal
    time : s to the goal, interpolated within the control step; NaN where it was not reached
    peak_lateral_force, peak_wall_force, mean_wall_force : N
    magnet_travel : rad and m summed
    """

    policy: str
    success: np.ndarray
    time: np.ndarray
    peak_lateral_force: np.ndarray
    peak_wall_force: np.ndarray
    mean_wall_force: np.ndarray
    magnet_travel: np.ndarray
    reward: np.ndarray

    def median_time(self, resamples: int = 2000) -> tuple[float, float, float]:
        """Median time to goal over the successes with its bootstrap 95 % interval, s; NaN without a success."""
        times = self.time[self.success]
        if not len(times):
            return (float("nan"),) * 3
        rng = np.random.default_rng(0)
        medians = np.median(rng.choice(times, (resamples, len(times))), axis=1)
        low, high = np.quantile(medians, [0.025, 0.975])
        return float(np.median(times)), float(low), float(high)

    def summary(self) -> dict[str, float]:
        """Success rate, median time with its interval, forces and travel, as plain numbers."""
        median, low, high = self.median_time()
        return {
            "episodes": len(self.success),
            "success_rate": float(self.success.mean()),
            "median_time_s": median,
            "median_time_low_s": low,
            "median_time_high_s": high,
            "peak_lateral_force_N": float(self.peak_lateral_force.max()),
            "median_peak_lateral_force_N": float(np.median(self.peak_lateral_force)),
            "median_peak_wall_force_N": float(np.median(self.peak_wall_force)),
            "mean_wall_force_N": float(self.mean_wall_force.mean()),
            "median_magnet_travel": float(np.median(self.magnet_travel)),
            "mean_reward": float(self.reward.mean()),
        }

    def to_json(self) -> dict[str, Any]:
        """The summary and every episode; numbers that do not exist are null."""
        clean = {k: v if isinstance(v, str) else _no_nan(v.tolist()) for k, v in asdict(self).items()}
        summary = dict(zip(self.summary(), _no_nan(list(self.summary().values())), strict=True))
        return {"summary": summary, "episodes": clean}


def _no_nan(values: list[Any]) -> list[Any]:
    return [None if x != x else x for x in values]


def evaluate(
    policy: Any,
    task: str = "MagWire/Steer-v0",
    episodes: int = 200,
    seed: int = EVALUATION_SEED,
    name: str | None = None,
    env: gym.vector.VectorEnv | None = None,
    **env_settings: Any,
) -> Episodes:
    """Run one episode for each of the seeds `seed` … `seed + episodes − 1`, all side by side.

    policy : an SB3-like policy, or a callable that makes one from the batch (such as ``MaxForce.from_env``)
    env : a batch of `episodes` lanes to use; by default one is made for `task` with `env_settings`
    """
    if env is None:
        env = gym.make_vec(task, num_envs=episodes, autoreset_mode="NextStep", **env_settings)
    if not hasattr(policy, "predict"):
        policy = policy(env)
    observation, _ = env.reset(seed=seed)
    n = env.num_envs
    keys = ("time", "peak_lateral_force", "peak_wall_force", "mean_wall_force", "magnet_travel")
    results = {key: np.full(n, np.nan) for key in keys}
    success, reward_sum, running = np.zeros(n, dtype=np.bool_), np.zeros(n), np.ones(n, dtype=np.bool_)
    state, starts = None, np.ones(n, dtype=np.bool_)
    while running.any():
        action, state = policy.predict(observation, state=state, episode_start=starts, deterministic=True)
        observation, reward, terminated, truncated, infos = env.step(action)
        reward_sum += np.where(running, reward, 0.0)
        starts = terminated | truncated
        ended = running & starts
        if ended.any():
            success[ended] = infos["is_success"][ended]
            for key in keys:
                results[key][ended] = infos["summary"][key][ended]
            running &= ~ended
    results["time"][~success] = np.nan
    return Episodes(name or type(policy).__name__, success=success, reward=reward_sum, **results)


def table(rows: list[Episodes], reference: str = "MaxForce") -> str:
    """A Markdown table, one line a policy; times also as a ratio to `reference` on the episodes both finished."""
    head = ["policy", "success", "median time to goal [s] (95 %)", f"time / {reference}", "peak lateral force [mN]"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    against = next((r for r in rows if r.policy == reference), None)
    for row in rows:
        median, low, high = row.median_time()
        time = f"{median:.2f} ({low:.2f}–{high:.2f})" if median == median else "–"
        lines.append(
            f"| {row.policy} | {row.success.mean():.1%} | {time} | {_ratio(row, against)} "
            f"| {1e3 * row.peak_lateral_force.max():.1f} |"
        )
    return "\n".join(lines)


def paired_ratio(row: Episodes, against: Episodes) -> float:
    """Ratio of the median times to goal over the episodes both finished; NaN if there are none."""
    both = row.success & against.success
    return float(np.median(row.time[both]) / np.median(against.time[both])) if both.any() else float("nan")


def _ratio(row: Episodes, against: Episodes | None) -> str:
    ratio = paired_ratio(row, against) if against is not None else float("nan")
    return f"{ratio:.3f}" if ratio == ratio else "–"
