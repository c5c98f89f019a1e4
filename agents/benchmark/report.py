"""The benchmark's report: a JSON of aggregates, and the page, the README's table and the plots, made only from it."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from magwire_env.words import counted

from .plan import plain_name
from .plots import draw, heat_map_name
from .writing import NONE, between, labelled, percent, provenance, table, trained_label

__all__ = ["LOCKED", "MARKS", "Form", "insert", "less_than_kept", "markdown", "readme_table", "text_of", "write"]

MARKS = ("<!-- benchmark:begin -->", "<!-- benchmark:end -->")
"""The README's table is between these two lines."""

README_POLICIES = (
    "Optimal", "MPPI", "NetForce", "MaxForce", "ppo", "knows_ppo",
    "untrained", "HoldHome", "BestConstant", "BestConstantEach", "ConstantRotation", "Random",
)  # fmt: skip
"""The README shows these rows, on the registered tasks' own episodes; docs/benchmark.md has every policy and arena."""


def _locked_figures(data: dict[str, Any], docs: Path, digest: str) -> list[Path]:
    return draw(data, docs / "figures", digest)


@dataclass(frozen=True)
class Form:
    """How the report of one set of arenas is written.

    stem : of its files, such as benchmark.json and benchmark.md
    marks : the README's table is between these two lines
    page, readme : of the JSON's numbers, the page and the table
    figures : draws into the docs' folder what the page shows, with the SHA-256 of the JSON; returns the files
    """

    stem: str
    marks: tuple[str, str]
    page: Callable[[dict[str, Any]], str]
    readme: Callable[[dict[str, Any]], str]
    figures: Callable[[dict[str, Any], Path, str], list[Path]]


def write(
    data: dict[str, Any],
    docs: Path,
    readme: Path | None = None,
    episodes: dict[str, Any] | None = None,
    form: Form | None = None,
) -> list[Path]:
    """Write benchmark.json, benchmark.md and figures/*.png under `docs`, and the README's table; returns the files.

    episodes : of `aggregates.episode_records`, written compressed to benchmark_episodes.json.gz
    form : of the set of arenas, by default `LOCKED`

    Each plot carries the SHA-256 of the JSON, so that a plot of other numbers is noticed.
    """
    form = form or LOCKED
    packed = f"{form.stem}_episodes.json.gz"
    text = text_of(data if episodes is None else data | {"episodes_in": packed})
    data = json.loads(text)
    docs.mkdir(parents=True, exist_ok=True)
    files = [docs / f"{form.stem}.json", docs / f"{form.stem}.md"]
    files[0].write_text(text, encoding="utf-8")
    files[1].write_text(form.page(data), encoding="utf-8")
    files += form.figures(data, docs, hashlib.sha256(text.encode()).hexdigest())
    if episodes is not None:
        files.append(docs / packed)
        files[-1].write_bytes(gzip.compress(json.dumps(episodes, separators=(",", ":")).encode(), mtime=0))
    if readme is not None:
        whole = insert(readme.read_text(encoding="utf-8"), form.readme(data), form.marks)
        readme.write_text(whole, encoding="utf-8")
        files.append(readme)
    return files


def less_than_kept(data: dict[str, Any], docs: Path, stem: str = "benchmark") -> str:
    """What the report that stands in `docs` has and `data` lacks, as a clause; "" if it may be written over."""
    file = docs / f"{stem}.json"
    if not data["missing"] or not file.exists():
        return ""
    kept = json.loads(file.read_text(encoding="utf-8"))
    lost = sorted(set(data["missing"]) - set(kept["missing"]))
    return f"{counted(len(lost), 'cell')} of its report missing here, such as {lost[0]!r}" if lost else ""


def text_of(data: dict[str, Any]) -> str:
    """The text of the JSON file, with one line for each entry of a top-level list, so that versions can be compared."""
    parts = []
    for key, value in data.items():
        if isinstance(value, list) and value:
            lines = ",\n  ".join(_compact(item) for item in value)
            parts.append(f" {json.dumps(key)}: [\n  {lines}\n ]")
        else:
            parts.append(f" {json.dumps(key)}: {_compact(value)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def insert(text: str, table: str, marks: tuple[str, str] = MARKS) -> str:
    """`text` with `table` between its marks. Raises `ValueError` if it does not have each mark once, in order."""
    if any(text.count(mark) != 1 for mark in marks) or text.index(marks[0]) > text.index(marks[1]):
        raise ValueError(f"README must hold the lines {marks[0]!r} and {marks[1]!r} once each, in this order")
    before, _, rest = text.partition(marks[0])
    return f"{before}{marks[0]}\n{table}\n{marks[1]}{rest.partition(marks[1])[2]}"


def readme_table(data: dict[str, Any]) -> str:
    """Success and score of the `README_POLICIES` in the arenas that are a registered task as it is, older versions too.

    A policy that no arena has is left out.
    """
    arenas = [arena for arena in data["arenas"] if arena["name"] == plain_name(arena["task"])]
    entries = [entry for arena in arenas for entry in arena["policies"]]
    names = [name for name in README_POLICIES if any(entry["policy"] == name for entry in entries)]
    rows = []
    for name in names:
        own = [next((p for p in arena["policies"] if p["policy"] == name), None) for arena in arenas]
        kind = next(entry["kind"] for entry in own if entry is not None)
        rows.append([labelled(name, kind), *(_success_and_score(entry) for entry in own)])
    return table(["policy", *(arena["name"] for arena in arenas)], rows)


def _success_and_score(entry: dict[str, Any] | None) -> str:
    if entry is None or entry["state"] == "not applicable":
        return NONE
    if entry["state"] == "missing":
        return "missing"
    score = entry["score"][0]
    return f"{percent(entry['success'])} · " + (NONE if score is None else f"{score:.2f}")


def markdown(data: dict[str, Any]) -> str:
    """The whole page."""
    parts = [_head(data), _overall(data), *(_arena(arena) for arena in data["arenas"])]
    parts += [_learning(data), _decisions(data), _robustness(data), provenance(data)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _head(data: dict[str, Any]) -> str:
    missing = data["missing"]
    text = f"""# Benchmark

Printed by `magwire benchmark`. Every policy rides the same episodes (seeds from {data["made"]["first_seed"]} on; on
generated tasks each episode has a certified tract of its own), all numbers stand in [benchmark.json](benchmark.json).

- *par* is `Optimal`, the best trajectory found with the model and the true state in hand, one for every episode;
  *floor* marks the policies that see nothing. [par.md](par.md) says how many pars an independent search beats.
- *score* is par's time / own time on the same start, 0 where the goal was not reached; on Track par's RMS error / own.
  Given is the mean over all episodes, failures with their 0, and its bootstrap 95 % interval, which resamples training
  seeds and, within each, episodes. *IQM* is the interquartile mean (Agarwal et al., 2021), the middle half of the
  episodes: it drops the worst quarter, and failures with it.
- *BestConstant* holds the one of 32 commands (64 or 72 for several degrees of freedom) that succeeds most often in
  these very episodes, *BestConstantEach* the best one of each episode; *untrained* is ppo before its training.
- `ppo`, `sac`, `tqc` and `crossq` see and do what the task registers. `knows_ppo` knows the magnets: it sees a force
  model (the channel `drive_preview`) and turns the magnets by rates.
- *time* is the median over the episodes that reached the goal. Trained policies are all their training seeds together.
- *wall force* at its peak: median over the episodes; *cost* is the wall force above the scenario's limit, summed over
  the control steps of an episode, mean over the episodes; *travel* is the magnets' median, rad and m summed.
- The defaults of `MPPI`, `PD` and `ExtremumSeeking` were chosen on some of these episodes (up to 100 of Steer, Track
  and the test tracts); trained policies and their hyperparameters have seen none of them.

![Performance profiles](figures/benchmark_profiles.png)

![Time against force](figures/benchmark_pareto.png)

Circles are controllers, squares trained policies, crosses floors; hollow ones reach the goal in less than 90 % of the
episodes and do not count for the front, those below 50 % are left out."""
    if data.get("note"):
        text += f"\n\n**Note**: {data['note']}"
    if data.get("episodes_in"):
        text += f"\n\nEvery episode of every policy stands in [{data['episodes_in']}]({data['episodes_in']})."
    if missing:
        text += f"\n\n**Missing** from this report: {counted(len(missing), 'cell')}, {', '.join(missing)}."
    return text


def _overall(data: dict[str, Any]) -> str:
    if not data["overall"]:
        return ""
    rows = [[row["policy"], between(row["score"], 3)] for row in data["overall"]]
    return "\n".join(
        [
            "## All tasks together",
            "",
            f"Mean of the score over the latest versions of the {data['overall'][0]['tasks']} registered tasks, for "
            "the policies that play in all of them; as many episodes of each, strata are the tasks and training seeds.",
            "",
            table(["policy", "score (95 %)"], rows),
        ]
    )


def _arena(arena: dict[str, Any]) -> str:
    where = [f"`{arena['task']}`", counted(arena["episodes"], "episode")]
    where += [f"split `{arena['split']}`"] if arena["split"] else []
    where += [f"scenario `{arena['scenario']}`"] if arena["scenario"] else []
    lines = [f"## {arena['name']}", "", ", ".join(where) + ".", ""]
    measure = "median RMS error [mm] (95 %)" if arena["tracking"] else "median time [s] (95 %)"
    head = ["policy", "success", measure, "score (95 %)", "path covered", "peak wall force [mN]"]
    head += ["mean wall force [mN]", "travel", "cost [mN·steps]", "IQM of the score (95 %)"]
    rows = [_row(entry, arena["tracking"]) for entry in arena["policies"]]
    lines += [table(head, rows), ""]
    lines += [_bracket(arena)]
    untrusted = {e["policy"]: e["untrusted_episodes"] for e in arena["policies"] if e.get("untrusted_episodes")}
    if untrusted:
        listed = ", ".join(f"{name} in {count}" for name, count in untrusted.items())
        lines += ["", f"Episodes with integration steps that are not to be trusted: {listed}."]
    refused = {e["policy"]: e["reason"] for e in arena["policies"] if e["state"] == "not applicable"}
    if refused:
        lines += ["", "Not applicable: " + "; ".join(f"{name} ({reason})" for name, reason in refused.items()) + "."]
    return "\n".join(lines)


def _row(entry: dict[str, Any], tracking: bool) -> list[str]:
    label = trained_label(entry) if entry["kind"] == "trained" else labelled(entry["policy"], entry["kind"])
    if entry["state"] != "played":
        return [label, "missing" if entry["state"] == "missing" else NONE, *[NONE] * 8]
    own = between(entry["rms_error_mm"], 2) if tracking else between(entry["time_s"], 2)
    path = entry["path_ratio"]
    return [
        label, percent(entry["success"]), own, between(entry["score"], 3),
        NONE if path is None else percent(path), f"{entry['peak_wall_force_mN']:.1f}",
        f"{entry['mean_wall_force_mN']:.1f}", f"{entry['magnet_travel']:.2f}", f"{entry['cost_mN_steps']:.1f}",
        between(entry["score_interquartile"], 3),
    ]  # fmt: skip


def _bracket(arena: dict[str, Any]) -> str:
    bracket, best = arena["bracket"], arena["best_mean_score"]
    said = "" if best is None else f"Highest mean score: {best:.4f} ({arena['best_policy']})"
    if bracket is None:
        return said + "." if said else "No par, so no scores." if not arena["tracking"] else ""
    gap = bracket["gap"]
    text = (
        f"Bracket of the least time: at least {bracket['lower_s']:.3f} s (bound), at most {bracket['upper_s']:.3f} s "
        f"(par), means over the episodes; gap {100 * gap:.1f} %, from {100 * bracket['gap_least']:.1f} % to "
        f"{100 * bracket['gap_largest']:.1f} %."
    )
    if best is not None:
        verdict = "within" if best <= 1.0 + gap else "**beyond**"
        text += f" {said}, {verdict} 1 + gap."
    return text


def _learning(data: dict[str, Any]) -> str:
    if not data["learning"]:
        return ""
    rows = []
    for entry in data["learning"]:
        seconds = entry["training_seconds"]
        rows.append(
            [entry["arena"], entry["algorithm"], str(entry["seeds"]), f"{entry['steps'][-1] / 1e6:.2f}",
             f"{sum(seconds) / len(seconds):.0f}" if seconds else NONE,
             _mean_and_range(entry["success"], lambda x: f"{100 * x:.0f}"),
             _mean_and_range(entry["time_s"], lambda x: f"{x:.2f}")]
        )  # fmt: skip
    head = ["arena", "algorithm", "seeds", "steps [millions]", "training [s]", "success at the end [%]"]
    columns = [*head, "median time at the end [s]"]
    return (
        "## Learning\n\n![Learning curves](figures/benchmark_learning.png)\n\n"
        "Training seconds are of one core, evaluations included, mean over the seeds; the last columns are of the last "
        f"evaluation while training, on episodes kept for that: mean (lowest–highest seed).\n\n{table(columns, rows)}"
    )


def _mean_and_range(of: dict[str, list[float | None]], form: Any) -> str:
    mean, low, high = of["mean"][-1], of["low"][-1], of["high"][-1]
    return NONE if mean is None else f"{form(mean)} ({form(low)}–{form(high)})"


def _decisions(data: dict[str, Any]) -> str:
    if not data["decisions"]:
        return ""
    rows = [
        [row["policy"], row["arena"], *(f"{row[q]:.2f}" for q in ("median", "q05", "q95", "q99"))]
        for row in data["decisions"]
    ]
    return (
        "## Time for a decision\n\nOf one env, one thread, other cells keep the next core busy; control leaves it "
        "100 ms.\n\n" + table(["policy", "task", "median [ms]", "5 % [ms]", "95 % [ms]", "99 % [ms]"], rows)
    )


def _robustness(data: dict[str, Any]) -> str:
    if not data["robustness"]:
        return ""
    parts = [
        "## Robustness",
        "Only the simulator (or the reading) departs from the model; policies keep the nominal one, and scores are "
        "against the nominal par, so that an easier world can give more than 1. `ppo` is training seed 0; the policy "
        "that ships is another seed. Success · score.",
    ]
    for arena in dict.fromkeys(entry["arena"] for entry in data["robustness"]):
        entries = [entry for entry in data["robustness"] if entry["arena"] == arena]
        levels = [(row["kind"], row["level"]) for row in entries[0]["rows"]]
        rows = []
        for kind, level in levels:
            found = [next(r for r in e["rows"] if (r["kind"], r["level"]) == (kind, level)) for e in entries]
            rows.append([f"{kind} {level}".strip(), *(_of_sweep(row) for row in found)])
        parts.append(f"### {arena}, {entries[0]['episodes']} episodes a cell")
        parts.append(table(["disturbance", *(entry["policy"] for entry in entries)], rows))
        parts += [f"![{e['policy']} on {arena}](figures/{heat_map_name(e)})" for e in entries]
    return "\n\n".join(parts)


def _of_sweep(row: dict[str, Any]) -> str:
    return f"{percent(row['success'])} · " + (NONE if row["score"] is None else f"{row['score']:.2f}")


LOCKED = Form("benchmark", MARKS, markdown, readme_table, _locked_figures)
"""The form of the report of the locked wire's arenas."""
