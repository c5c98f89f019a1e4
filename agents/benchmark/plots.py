"""The plots of the benchmark, drawn only from the numbers of the report."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from magwire_env.plotting import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, blank, styled
from magwire_env.words import counted

from ..evaluation.robustness import heat_map
from .aggregates import TAUS

__all__ = ["DIGEST", "draw", "heat_map_name"]

DIGEST = "Source"
"""Name of the PNG text with the SHA-256 of the JSON that a plot was drawn from."""

# Classical controllers solid, learners dashed, floors dotted. No two share a colour.
_STYLES: dict[str, tuple[str, str]] = {
    "Optimal": (BLACK, "-"),
    "MaxForce": (BLUE, "-"),
    "NetForce": (GREEN, "-"),
    "MPPI": (RED, "-"),
    "PD": (PURPLE, "-"),
    "ExtremumSeeking": (ORANGE, "-"),
    "SlopeAscent": ("#556B2F", "-"),
    "ppo": ("#882255", "--"),
    "sac": ("#332288", "--"),
    "tqc": ("#999933", "--"),
    "crossq": ("#EE3377", "--"),
    "stacked_ppo": ("#00B0B0", "--"),
    "knows_ppo": ("#B15928", "--"),
    "sees_ppo": ("#7A4B00", "--"),
    "robust_ppo": ("#DDAA33", "--"),
    "HoldHome": ("#444444", ":"),
    "BestConstant": ("#2B3A8F", ":"),
    "BestConstantEach": ("#3FBF7F", ":"),
    "untrained": ("#F08080", ":"),
    "ConstantRotation": (GREY, ":"),
    "Random": (SKY, ":"),
}
_STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)
"""Ticks of the learning curves, in millions of steps."""
_MARKERS = {"-": "o", "--": "s", ":": "x"}
_RELIABLE, _SHOWN = 0.9, 0.5
"""Least success of a policy that counts for the Pareto front, and of one that is drawn beside it."""


def draw(data: dict[str, Any], folder: Path, digest: str) -> list[Path]:
    """Write every plot for which `data` has numbers; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with styled():
        for name, plot in (("profiles", _profiles), ("pareto", _pareto), ("learning", _learning)):
            figure = plot(data)
            if figure is not None:
                written.append(folder / f"benchmark_{name}.png")
                figure.savefig(written[-1], metadata={DIGEST: digest})
    for entry in data["robustness"]:
        title = f"{entry['policy']} on {entry['arena']}, {counted(entry['episodes'], 'episode')} a cell"
        written.append(heat_map(entry["rows"], title, folder / heat_map_name(entry), {DIGEST: digest}))
    return written


def heat_map_name(entry: dict[str, Any]) -> str:
    """File name of a robustness entry's heat map."""
    return f"robustness_{entry['arena']}_{entry['policy']}.png".replace(" ", "_")


_OTHERS = ("#661100", "#44AA99", "#AA4499", "#117733", "#6699CC")
"""Colours of policies that are not listed, in the order in which they are first drawn."""

_seen: dict[str, tuple[str, str]] = {}


def _style(name: str) -> tuple[str, str]:
    """Colour and line of a policy; one that is not listed has a style of its own."""
    return _STYLES.get(name) or _seen.setdefault(name, (_OTHERS[len(_seen) % len(_OTHERS)], "-."))


def _grid(count: int, height: float) -> tuple[Any, list[Any]]:
    """A figure of `count` panels in three columns."""
    columns = min(3, count)
    rows = -(-count // columns)
    figure, axes = blank(rows, columns, size=(3.4 * columns, height * rows + 0.7), squeeze=False)
    flat = list(axes.flat)
    for spare in flat[count:]:
        spare.set_visible(False)
    return figure, flat[:count]


def _legend(figure: Any, panels: Iterable[Any]) -> None:
    """One legend for all panels, in the order of the styles."""
    handles: dict[str, Any] = {}
    for axes in panels:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    order = sorted(handles, key=lambda name: list(_STYLES).index(name) if name in _STYLES else len(_STYLES))
    figure.legend([handles[name] for name in order], order, loc="outside lower center", ncols=6)


def _profiles(data: dict[str, Any]) -> Any:
    """Share of the runs whose score is greater than τ, one panel for each arena."""
    arenas = [arena for arena in data["arenas"] if arena["profiles"]]
    if not arenas:
        return None
    figure, panels = _grid(len(arenas), 2.4)
    for axes, arena in zip(panels, arenas, strict=True):
        for name, profile in arena["profiles"].items():
            colour, line = _style(name)
            axes.plot(TAUS, profile["share"], line, color=colour, label=name)
            axes.fill_between(TAUS, profile["low"], profile["high"], color=colour, alpha=0.15, linewidth=0)
        axes.set(title=arena["name"], xlim=(0, TAUS[-1]), ylim=(-0.02, 1.02), xlabel="score τ")
        axes.axvline(1.0, color="0.7", lw=0.8, zorder=0)
    for axes in panels[::3]:
        axes.set_ylabel("share above τ")
    _legend(figure, panels)
    return figure


def _pareto(data: dict[str, Any]) -> Any:
    """Median time against median peak wall force; a policy that is too unreliable for the front is hollow."""
    arenas = [a for a in data["arenas"] if not a["tracking"] and any(_time(p) is not None for p in a["policies"])]
    if not arenas:
        return None
    figure, panels = _grid(len(arenas), 2.4)
    for axes, arena in zip(panels, arenas, strict=True):
        front = []
        for entry in arena["policies"]:
            time, force = _time(entry), entry.get("peak_wall_force_mN")
            if time is None or force is None or entry["success"] < _SHOWN:
                continue
            colour, line = _style(entry["policy"])
            reliable, marker = entry["success"] >= _RELIABLE, _MARKERS.get(line, "D")
            look = {"color": colour} if reliable or marker == "x" else {"edgecolors": colour, "facecolors": "none"}
            axes.scatter(time, force, s=26, marker=marker, label=entry["policy"], zorder=3, **look)
            if reliable:
                front.append((time, force))
        best = _front(front)
        if len(best) > 1:
            axes.plot(*zip(*best, strict=True), color="0.6", lw=0.9, zorder=1)
        axes.set(title=arena["name"], xlabel="median time to goal [s]")
        axes.ticklabel_format(useOffset=False)
    for axes in panels[::3]:
        axes.set_ylabel("median peak wall force [mN]")
    _legend(figure, panels)
    return figure


def _time(entry: dict[str, Any]) -> float | None:
    return entry["time_s"][0] if entry["state"] == "played" else None


def _front(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points that no other point beats in both, from the fastest to the gentlest."""
    kept: list[tuple[float, float]] = []
    for time, force in sorted(points):
        if not kept or force < kept[-1][1]:
            kept.append((time, force))
    return kept


def _learning(data: dict[str, Any]) -> Any:
    """Success and median time (reward in a tracking task) over the steps: mean and range of the training seeds."""
    entries = data["learning"]
    if not entries:
        return None
    arenas = list(dict.fromkeys(entry["arena"] for entry in entries))
    columns = min(4, len(arenas))
    rows = -(-len(arenas) // columns)
    figure, axes = blank(2 * rows, columns, size=(3.0 * columns, 3.6 * rows + 0.7), squeeze=False)
    used = []
    for i in range(rows * columns):
        pair = axes[2 * (i // columns) : 2 * (i // columns) + 2, i % columns]
        if i < len(arenas):
            _curves(pair, [entry for entry in entries if entry["arena"] == arenas[i]], first=i % columns == 0)
            used += list(pair)
        else:
            for spare in pair:
                spare.set_visible(False)
    _legend(figure, used)
    return figure


def _curves(pair: Any, entries: list[dict[str, Any]], first: bool) -> None:
    """Draw one arena's curves; the `first` of a row has labels."""
    tracking = entries[0]["tracking"]
    for entry in entries:
        colour, line = _style(entry["algorithm"])
        steps = np.array(entry["steps"]) / 1e6
        for panel, key, factor in zip(pair, ("success", "reward" if tracking else "time_s"), (100.0, 1.0), strict=True):
            mean, low, high = (factor * np.array(entry[key][k], dtype=float) for k in ("mean", "low", "high"))
            panel.plot(steps, mean, line, marker=".", ms=4, color=colour, label=entry["algorithm"])
            panel.fill_between(steps, low, high, color=colour, alpha=0.15, linewidth=0)
    for panel in pair:
        panel.set_xscale("log")  # learners differ by a hundred in the steps they take
        ticks = [x for x in _STEPS if 0.8 * min(panel.get_xlim()) <= x <= 1.2 * max(panel.get_xlim())]
        panel.set_xticks(ticks, [f"{x:g}" for x in ticks])
        panel.set_xticks([], minor=True)
    pair[0].set(title=entries[0]["arena"], ylim=(-3, 103), ylabel="success [%]" if first else "")
    name = "reward" if tracking else "median time [s]" if first else ""
    pair[1].set(xlabel="steps [millions]", ylabel=name)
