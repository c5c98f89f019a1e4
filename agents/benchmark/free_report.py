"""The page and the README's table of the benchmark of free wires, made only from its JSON."""

from __future__ import annotations

from typing import Any

from magwire_env.words import counted

from .writing import NONE, between, labelled, percent, provenance, table, trained_label

__all__ = ["markdown", "readme_table"]

_COLUMNS = (
    "policy", "success", "median time [s] (95 %)", "time / {}", "wrong branches", "cost within limit",
    "peak wall force [mN]", "mean wall force [mN]", "untrusted episodes",
)  # fmt: skip
_OF_TREES, _OF_LIMITS = "wrong branches", "cost within limit"


def markdown(data: dict[str, Any]) -> str:
    """The whole page."""
    parts = [_head(data), *(_arena(arena) for arena in data["arenas"]), _learning(data), provenance(data)]
    return "\n\n".join(part for part in parts if part) + "\n"


def readme_table(data: dict[str, Any]) -> str:
    """Success and median time of every policy in every arena."""
    names = list(dict.fromkeys(entry["policy"] for arena in data["arenas"] for entry in arena["policies"]))
    rows = []
    for name in names:
        own = [next((p for p in arena["policies"] if p["policy"] == name), None) for arena in data["arenas"]]
        kind = next(entry["kind"] for entry in own if entry is not None)
        rows.append([labelled(name, kind), *(_success_and_time(entry) for entry in own)])
    return table(["policy", *(arena["name"] for arena in data["arenas"])], rows)


def _success_and_time(entry: dict[str, Any] | None) -> str:
    if entry is None or entry["state"] == "not applicable":
        return NONE
    if entry["state"] == "missing":
        return "missing"
    time = entry["time_s"][0]
    return percent(entry["success"]) + ("" if time is None else f" · {time:.1f} s")


def _head(data: dict[str, Any]) -> str:
    text = f"""# Benchmark of free wires

Printed by `magwire benchmark --set free`. Every policy plays the same episodes (seeds from {data["made"]["first_seed"]}
on; in generated trees each episode has a certified tree of its own, and trees come round again where there are fewer),
all numbers stand in [benchmark_trees.json](benchmark_trees.json). Free wires have no par and so no scores.

- *floor* marks the policies that see nothing, and *untrained*, which is ppo before its training.
- *time* is the median over the episodes that reached the goal, with its bootstrap 95 % interval. Trained policies are
  all their training seeds together.
- *time / FollowRoute*, or another name, is the ratio of the median times over the episodes that both finished; of
  trained policies its lowest and highest over the training seeds. The named controller is a reference that a policy may
  well beat, no par.
- *wrong branches* are those entered in an episode, in the mean. *cost within limit* is the share of episodes in which
  the wall's force above the scenario's limit, over time, stayed below the task's limit.
- *wall force* at its peak: median over the episodes.
- *untrusted episodes* have integration steps that are not to be trusted, mostly of a wire that buckles against a dead
  end. They count like all others; what they say of force is not to be believed."""
    if data.get("episodes_in"):
        text += f"\n\nEvery episode of every policy stands in [{data['episodes_in']}]({data['episodes_in']})."
    if missing := data["missing"]:
        text += f"\n\n**Missing** from this report: {counted(len(missing), 'cell')}, {', '.join(missing)}."
    return text


def _arena(arena: dict[str, Any]) -> str:
    where = [f"`{arena['task']}`", counted(arena["episodes"], "episode")]
    where += [f"split `{arena['split']}`"] if arena["split"] else []
    played = [entry for entry in arena["policies"] if entry["state"] == "played"]
    without = {
        column
        for column, name in ((_OF_TREES, "wrong_entries"), (_OF_LIMITS, "within_limit"))
        if all(entry[name] is None for entry in played)
    }
    kept = [i for i, column in enumerate(_COLUMNS) if column not in without]
    rows = [[row[i] for i in kept] for row in map(_row, arena["policies"])]
    head = [_COLUMNS[i].format(arena["reference"]) for i in kept]
    lines = [f"## {arena['name']}", "", ", ".join(where) + ".", "", table(head, rows)]
    refused = {e["policy"]: e["reason"] for e in arena["policies"] if e["state"] == "not applicable"}
    if refused:
        lines += ["", "Not applicable: " + "; ".join(f"{name} ({reason})" for name, reason in refused.items()) + "."]
    return "\n".join(lines)


def _row(entry: dict[str, Any]) -> list[str]:
    label = trained_label(entry) if entry["kind"] == "trained" else labelled(entry["policy"], entry["kind"])
    if entry["state"] != "played":
        return [label, "missing" if entry["state"] == "missing" else NONE, *[NONE] * (len(_COLUMNS) - 2)]
    wrong, within = entry["wrong_entries"], entry["within_limit"]
    return [
        label, percent(entry["success"]), between(entry["time_s"], 2), _ratio(entry.get("time_over_reference", [])),
        NONE if wrong is None else f"{wrong:.2f}", NONE if within is None else percent(within),
        f"{entry['peak_wall_force_mN']:.1f}", f"{entry['mean_wall_force_mN']:.1f}", str(entry["untrusted_episodes"]),
    ]  # fmt: skip


def _ratio(values: list[float | None]) -> str:
    """Of one or several training seeds."""
    some = [value for value in values if value is not None]
    if not some:
        return NONE
    low, high = f"{min(some):.2f}", f"{max(some):.2f}"
    return low if low == high else f"{low}–{high}"


def _learning(data: dict[str, Any]) -> str:
    rows = [
        [entry["arena"], entry["algorithm"], str(entry["seeds"]), f"{entry['steps'][-1] / 1e6:.2f}",
         f"{sum(seconds) / len(seconds):.0f}" if (seconds := entry["training_seconds"]) else NONE]
        for entry in data["learning"]
    ]  # fmt: skip
    if not rows:
        return ""
    return "## Learning\n\nTraining seconds are by the clock, evaluations included, mean over the seeds.\n\n" + table(
        ["arena", "algorithm", "seeds", "steps [millions]", "training [s]"], rows
    )
