"""Refinement of whole plans in the simulator: try random changes in time windows and keep the best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .starts import actions_of, commands_of
from .trials import Trials

__all__ = ["Refinement", "refine"]

_SIZE, _LEAST, _MOST = 0.1, 0.002, 0.5
"""First, smallest and largest size of a change: its height in servo travels of a control period, over the width of its
window in control periods."""

_CLOCKED = 0.1
"""Share of a steering plan's changes that are tried by the clock; the others follow the place of the tip."""


@dataclass(frozen=True)
class Refinement:
    """How long plans are refined, and how.

    samples : number of changes tried for each plan in a round
    rounds : at most
    patience : a plan is finished after so many rounds without an improvement by `least`
    least : s, or m of RMS error
    seed : of the changes
    """

    samples: int = 24
    rounds: int = 120
    patience: int = 25
    least: float = 1e-4
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low in (("samples", 4), ("rounds", 0), ("patience", 1)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise ValueError(f"Refinement.{name} must be a whole number of at least {low}, got {value!r}")
        if not self.least >= 0.0:
            raise ValueError(f"Refinement.least must be at least 0 (in s or m), got {self.least!r}")


def refine(trials: Trials, plans: np.ndarray, settings: Refinement) -> tuple[np.ndarray, np.ndarray]:
    """Improve plans (n, H, dof), given as actions. Returns plans and their values (n,), see `Outcome.value`.

    A round tries, for every plan: smooth bumps in random windows of one degree of freedom or of all, lasting steps,
    shifts in time, the last change that helped once more, and the sum of all changes that helped by themselves in the
    round before. The size of the changes grows after a success and shrinks after a failure.
    """
    starts, n = trials.starts, len(plans)
    library, entries, turns = starts.library, starts.entries, starts.library.is_turn
    # Commands that a servo cannot follow are hard to change: replace them by the magnets' own course if it is as good.
    first = trials.run(np.arange(n), plans)
    followed = trials.run(np.arange(n), actions_of(library, entries, first.magnet))
    same = followed.value <= first.value + settings.least
    best, value, steps, tip = (
        np.where(same.reshape(-1, *[1] * (getattr(first, k).ndim - 1)), getattr(followed, k), getattr(first, k))
        for k in ("actions", "value", "steps", "tip")
    )
    size, idle, score = np.full(n, _SIZE), np.zeros(n, dtype=np.int64), value.copy()
    last, joined = np.zeros(best.shape), np.zeros(best.shape)
    rng = np.random.default_rng(settings.seed)
    pace = library.limits.speed[entries] * starts.period
    k = settings.samples
    for _ in range(settings.rounds):
        rows = np.flatnonzero(idle < settings.patience)
        if not len(rows):
            break
        horizon = min(int(steps[rows].max()) + 2, best.shape[1])
        course = commands_of(library, entries[rows], best[rows, :horizon])
        course[:, :, turns] = np.unwrap(course[:, :, turns], axis=1)
        changes = _changes(rng, course, steps[rows], pace[rows], size[rows], k)
        changes[:, 0], changes[:, 1] = last[rows, :horizon], joined[rows, :horizon]
        changes[:, 2] = 0.5 * changes[:, 1]
        tried = actions_of(library, entries[rows], course[:, None] + changes)
        clocked = rng.random(k) < (_CLOCKED if starts.task.kind.passes else 1.0)
        follow = np.where(clocked[None, :, None], np.nan, tip[rows, None, :horizon])
        outcome = trials.run(
            np.repeat(rows, k),
            tried.reshape(-1, *tried.shape[2:]),
            None if clocked.all() else follow.reshape(-1, horizon),
        )
        values = outcome.value.reshape(len(rows), k)
        which, lane = values.argmin(axis=1), np.arange(len(rows))
        gain = np.maximum(value[rows, None] - values, 0.0)
        better = values[lane, which] < value[rows]
        own = changes.copy()
        own[:, :3] = 0.0
        own[lane, which] = 0.0
        joined[rows] = 0.0
        joined[rows, :horizon] = ((gain > 0.0)[:, :, None, None] * own).sum(axis=1)
        last[rows] = 0.0
        won, picked = rows[better], (lane * k + which)[better]
        last[won, :horizon] = changes[lane, which][better]
        for kept, new in ((best, outcome.actions), (tip, outcome.tip)):
            kept[won, :horizon], kept[won, horizon:] = new[picked], new[picked, -1:]
        value[won], steps[won] = outcome.value[picked], outcome.steps[picked]
        size[rows] = np.clip(size[rows] * np.where(better, 1.15, 0.9), _LEAST, _MOST)
        enough = value < score - settings.least
        idle = np.where(enough, 0, idle + 1)
        score = np.where(enough, value, score)
    return best, value


def _changes(
    rng: np.random.Generator, best: np.ndarray, steps: np.ndarray, pace: np.ndarray, size: np.ndarray, k: int
) -> np.ndarray:
    """Changes (m, k, H, dof) of plans (m, H, dof); all plans get the same windows, relative to their length."""
    _, horizon, dof = best.shape
    time = np.arange(horizon)
    middle = rng.uniform(-0.05, 1.05, k) * steps[:, None]
    width = np.exp(rng.uniform(np.log(1.0), np.log(25.0), k))
    off = (time - middle[:, :, None]) / width[:, None]
    bump = np.where(np.abs(off) < 1.0, 0.5 + 0.5 * np.cos(np.pi * np.clip(off, -1.0, 1.0)), 0.0)
    rise = np.clip(0.5 + 0.5 * off, 0.0, 1.0)
    kind = rng.choice(3, k, p=[0.65, 0.1, 0.25])
    shape = np.where((kind == 1)[:, None], rise, bump)
    alone = np.eye(dof)[rng.integers(dof, size=k)]
    mixed = rng.normal(size=(k, dof)) * np.where(rng.random(k)[:, None] < 0.5, alone, 1.0)
    scale = np.minimum(width, 8.0)[None, :, None] * size[:, None, None] * pace[:, None, :]
    bumps = shape[:, :, :, None] * (mixed[None] * scale)[:, :, None, :]
    # A quarter of the changes shift the plan's own course in time, within the window.
    course = np.gradient(best, axis=1) if horizon > 1 else np.zeros_like(best)
    shift = rng.normal(size=k)[None, :] * 10.0 * size[:, None]
    shifts = shape[:, :, :, None] * shift[:, :, None, None] * course[:, None]
    return np.where((kind == 2)[None, :, None, None], shifts, bumps)
