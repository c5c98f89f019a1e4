"""How well a policy does when the world differs from its model: a sweep of disturbances, and its heat map.

The policy, its tables and its rollouts keep the nominal scenario. Only the simulator that moves the wire differs
(friction, remanence, placement), or the readings do (noise, delay).
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from magwire_env.envs.core import SteeringCore
from magwire_env.plotting import blank, styled
from magwire_env.scenario import Reading, Scenario

from .episodes import EVALUATION_SEED, built
from .evaluator import Episodes, evaluate, make_batch

__all__ = ["DISTURBANCES", "Disturbance", "heat_map", "sweep", "sweep_scores"]


@dataclass(frozen=True)
class Disturbance:
    """One way in which the world differs from the model.

    kind, level : names; a kind is a row of the heat map
    friction, remanence : factors of the wall's coefficient and of the external magnets' remanence
    placement : m, by which every external magnet's centre is shifted
    force_noise : N, standard deviation of every force reading's white noise
    delay : control steps by which the observation comes late
    """

    kind: str
    level: str
    friction: float = 1.0
    remanence: float = 1.0
    placement: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force_noise: float = 0.0
    delay: int = 0

    @property
    def name(self) -> str:
        return f"{self.kind} {self.level}"

    @property
    def of_readings(self) -> bool:
        """It changes the readings and not the motion."""
        return bool(self.force_noise or self.delay)

    def apply(self, core: SteeringCore) -> None:
        """Change every lane of a batch whose episodes have just begun."""
        n, magnets = core.sim.num_envs, core.sim.library.magnet_count
        shift = np.broadcast_to(np.array(self.placement), (n, magnets, 3))
        core.sim.vary(np.arange(n), np.full(n, self.friction), np.ones(n), np.full(n, self.remanence), shift)

    def seen_through(self, scenario: Scenario) -> Scenario:
        """The scenario with the sensing of this disturbance."""
        return scenario.replace(sensing__force=Reading(noise=self.force_noise), sensing__delay=self.delay)


def _placements(axis: int) -> list[Disturbance]:
    kind = f"magnet off in {'xyz'[axis]}"
    return [Disturbance(kind, f"{mm:+d} mm", placement=_along(axis, 1e-3 * mm)) for mm in (-10, -5, 5, 10)]


def _along(axis: int, length: float) -> tuple[float, float, float]:
    x, y, z = (length if i == axis else 0.0 for i in range(3))
    return x, y, z


NOMINAL = Disturbance("as modelled", "")

DISTURBANCES: tuple[Disturbance, ...] = (
    NOMINAL,
    *(Disturbance("friction", f"× {factor:g}", friction=factor) for factor in (0.0, 0.5, 2.0, 3.0, 4.0)),
    *(Disturbance("remanence", f"{share:+d} %", remanence=1 + share / 100) for share in (-10, -5, 5, 10)),
    *_placements(0),
    *_placements(1),
    *_placements(2),
    *(Disturbance("force noise", f"{mn:g} mN", force_noise=1e-3 * mn) for mn in (0.1, 0.3, 1.0, 3.0)),
    *(Disturbance("delay", f"{steps} step{'s'[: steps > 1]}", delay=steps) for steps in (1, 2, 3)),
)
"""The sweep: nominal first, then the kinds in the order of the heat map's rows."""


def sweep(
    policy: Any,
    task: str,
    episodes: int = 50,
    name: str | None = None,
    disturbances: Sequence[Disturbance] = DISTURBANCES,
    report: Callable[[str], None] = lambda _: None,
    **env_settings: Any,
) -> dict[str, Episodes]:
    """Name of each disturbance → what the policy did under it, on the first `episodes` starts of the evaluation.

    policy : an SB3-like policy, or a callable that makes one from the batch
    report : called with the name of each disturbance when it is done
    """
    env = make_batch(task, episodes, env_settings)
    core: SteeringCore = env.unwrapped.core  # type: ignore[attr-defined]
    nominal = built(policy, env)
    found = {}
    for one in disturbances:
        if one.of_readings:
            # Readings belong to the scenario, so this needs a batch of its own.
            seen = [one.seen_through(sc) for sc in core.sim.scenarios]
            settings = {k: v for k, v in env_settings.items() if k not in ("scenario", "split", "pool_size")}
            batch = make_batch(task, episodes, settings | {"scenario": seen})
            found[one.name] = evaluate(policy, task, episodes, EVALUATION_SEED, name, env=batch)
            batch.close()
        else:
            core.sim.assign(np.arange(episodes), core.sim.lane_scenario.copy())  # undoes the disturbance before
            found[one.name] = evaluate(nominal, task, episodes, EVALUATION_SEED, name, env=env, disturb=one.apply)
        report(one.name)
    env.close()
    return found


def sweep_scores(found: dict[str, Episodes], par: Episodes | None) -> list[dict[str, Any]]:
    """For each disturbance its kind, level, success rate, median time [s] of the successes, which is None without any,
    and the mean of the score, failures as 0.

    par : `Optimal` on the undisturbed episodes; a score then says how much of the nominal par is left. Without it, the
        policy itself, undisturbed, is the par
    """
    against = par if par is not None else found[NOMINAL.name]
    rows = []
    for one in DISTURBANCES:
        if one.name in found:
            episodes = found[one.name]
            score, low, high = episodes.mean_score(against)
            time = episodes.median_time()[0]
            rows.append(
                {"kind": one.kind, "level": one.level, "success": float(episodes.success.mean()),
                 "median_time_s": None if np.isnan(time) else time, "score": score, "score_low": low,
                 "score_high": high}
            )  # fmt: skip
    return rows


def heat_map(
    rows: Sequence[dict[str, Any]],
    title: str,
    path: Path,
    metadata: dict[str, str] | None = None,
    label: str = "score (undisturbed par = 1)",
) -> Path:
    """Draw `sweep_scores` to `path`: a row for each kind, a column for each level, success beside score.

    metadata : texts that are stored in the PNG
    label : of the score
    """
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    with styled():
        figure, panels = blank(1, 2, size=(9.6, 0.46 * len(kinds) + 1.5), sharey=True)
        for axes, quantity, heading in zip(panels, ("success", "score"), ("success", label), strict=True):
            image = _panel(axes, rows, kinds, quantity)
            figure.colorbar(image, ax=axes, shrink=0.85, pad=0.01)
            axes.set(title=heading, xticks=[], yticks=range(len(kinds)), yticklabels=kinds)
            axes.grid(visible=False)
            axes.tick_params(length=0)
            for spine in axes.spines.values():
                spine.set_visible(False)
        figure.suptitle("\n".join(textwrap.wrap(title, 110)), fontsize=10)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata=metadata)
    return path


def _panel(axes: Any, rows: Sequence[dict[str, Any]], kinds: Sequence[str], quantity: str) -> Any:
    """Draw one quantity: in each cell its level and its number, or a dash where there is no number."""
    width = max(sum(row["kind"] == kind for row in rows) for kind in kinds)
    known = [row[quantity] for row in rows if row[quantity] is not None and row[quantity] == row[quantity]]
    low, high = min([*known, 0.95]), max([*known, 1.0])  # the colours are spread over the numbers there are
    values = np.full((len(kinds), width), np.nan)
    for y, kind in enumerate(kinds):
        for x, row in enumerate(row for row in rows if row["kind"] == kind):
            value = np.nan if row[quantity] is None else row[quantity]
            values[y, x] = value
            number = "–" if np.isnan(value) else f"{value:.0%}" if quantity == "success" else f"{value:.2f}"
            text = f"{row['level']}\n{number}" if row["level"] else number
            colour = "white" if (value - low) / (high - low) < 0.6 else "black"
            axes.text(x, y, text, ha="center", va="center", fontsize=7.5, color=colour)
    return axes.imshow(values, vmin=low, vmax=high, cmap="viridis", aspect="auto")
