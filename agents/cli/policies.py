"""The subcommand `policies`: the trained policies of this version, and how its folder of them is filled.

``magwire policies --collect FOLDERS`` takes runs, of a benchmark (``runs/benchmark/runs``) or of ``magwire train``. For
every task among them it takes the run that did best on the held-out episodes which choose a run's best policy, tests it
on those that every evaluation uses, and writes it into the package with the others. The test's episodes choose nothing,
so that its figures may be quoted.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from magwire_env.physics.checks import whole

if TYPE_CHECKING:
    from agents.learning.plain_policy import PlainPolicy
    from agents.shipped import Trained

__all__ = ["Candidate", "Policies", "candidates", "collect", "policies", "tested"]


@dataclass
class Policies:
    """List the trained policies that come with magwire, or fill their folder from the folders of runs."""

    collect: tuple[Path, ...] = ()
    """Run folders, or folders of such: the best policy of every task is taken over."""
    out: Path | None = None
    """With collect: folder to write to; by default the one in the package."""
    episodes: int = 200
    """With collect: episodes of the test."""
    par: bool = True
    """With collect: score against Optimal on the same starts, where the wire has a par; new plans take minutes."""


def policies(options: Policies) -> None:
    """Collect if asked to, and print the table of what is there."""
    from agents.shipped import PREFIX, SHIPPED, manifest

    folder = options.out or SHIPPED
    if options.collect:
        whole("episodes", options.episodes, 1)
        collect(options.collect, folder, options.episodes, options.par)
    found = manifest(folder)
    if not found:
        print(f"no trained policies in {folder}; magwire policies --collect runs/… fills it")
        return
    print(_table(found))
    name = PREFIX + found[0].name if folder == SHIPPED else folder / found[0].name
    print("\nevery command takes them by name:")
    print("\n".join(f"  magwire {how} {name}" for how in ("evaluate", "view", "video", "play --against")))


def _table(found: list[Trained]) -> str:
    from agents.shipped import PREFIX
    from magwire_env.validation.report import format_table

    def measured(one: Trained) -> str:
        if one.median_rms_error_m is not None:
            return f"{1e3 * one.median_rms_error_m:.1f} mm"
        return "–" if one.median_time_s is None else f"{one.median_time_s:.2f} s"

    head = ("name", "task", "trained by", "steps", "success", "median", "score", "size", "SHA-256")
    rows = [
        (
            PREFIX + one.name, one.task, f"{one.algorithm}, seed {one.seed}", f"{one.timesteps / 1e6:.2g} M",
            f"{one.success_rate:.1%}", measured(one), "–" if one.score is None else f"{one.score:.3f}",
            f"{one.size / 1e3:.0f} kB", one.sha256["policy.safetensors"][:8],
        )
        for one in found
    ]  # fmt: skip
    total = sum(one.size for one in found)
    return f"{format_table(head, rows)}\n{total / 1e3:.0f} kB together"


@dataclass(frozen=True)
class Candidate:
    """The best policy of a run.

    name : under which it would be shipped: its task's, with the scenario or the algorithm where it is no usual one
    held_out : its `goodness` on the held-out episodes that chose it
    """

    folder: Path
    policy: PlainPolicy
    name: str
    held_out: tuple[float, float]


def candidates(places: Sequence[Path]) -> Iterator[Candidate]:
    """The runs in `places`; what cannot be shipped is passed over with a line that says why.

    Raises `FileNotFoundError` for a place that is not there or holds no run.
    """
    from agents.learning.policy_file import read
    from agents.learning.run_folder import best_of
    from agents.notes import note

    for place in places:
        folders = [place] if (place / "config.json").is_file() else sorted(place.glob("*/config.json"))
        folders = [path.parent if path.name == "config.json" else path for path in folders]
        if not folders:
            raise FileNotFoundError(f"{place} is no run's folder and holds none")
        for folder in folders:
            best = best_of(folder)
            if best is None:
                note(f"{folder} is passed over: it was stopped before its first evaluation")
                continue
            try:
                policy = read(best)
                yield Candidate(folder, policy, _name(policy), _held_out(folder))
            except ValueError as error:
                note(f"{folder} is passed over: {error}")


def _name(policy: PlainPolicy) -> str:
    from agents.learning.hyperparameters import hyperparameters
    from magwire_env.scenario import Scenario

    about = policy.about
    words = [about.task.rpartition("/")[2]]
    if about.scenario_given and about.scenario is not None:
        words.append(Scenario.loads(about.scenario, "the scenario kept with the run").name)
    if about.env != hyperparameters("ppo", about.task).get("env", {}):
        words.append(about.algorithm)
    return "-".join(words)


def _held_out(folder: Path) -> tuple[float, float]:
    """Of the row of the learning curve that its best policy is of."""
    from agents.learning.training import curve_of, goodness, read_curve

    path = curve_of(folder)
    if path is None:
        raise ValueError("it has no learning curve, which says how good it is")
    return max(map(goodness, read_curve(path)))


def collect(places: Sequence[Path], out: Path, episodes: int, par: bool) -> None:
    """Write the best candidate of every name into `out`, with the manifest; prints a line for each.

    Entries of other names stay, unless their task is not registered any more. The manifest is written at the end.
    """
    from agents.learning.policy_file import write
    from agents.learning.run_folder import write_whole
    from agents.shipped import MANIFEST, content, manifest
    from magwire_env.envs.task import TASKS

    best: dict[str, Candidate] = {}
    for one in candidates(places):
        if one.name not in best or one.held_out > best[one.name].held_out:
            best[one.name] = one
    entries = {entry.name: entry for entry in manifest(out)}
    for gone in [name for name, entry in entries.items() if entry.task not in TASKS]:
        print(f"{gone} goes: there is no task {entries.pop(gone).task} any more")
        shutil.rmtree(out / gone, ignore_errors=True)
    for name, one in sorted(best.items()):
        shutil.rmtree(out / name, ignore_errors=True)
        write(one.policy, out / name, halved=True)
        entries[name] = tested(out / name, name, episodes, par)
        print(f"{name} is of {one.folder}", flush=True)
    ordered = [entries[name] for name in sorted(entries)]
    write_whole(out / MANIFEST, json.dumps(content(ordered), indent=2) + "\n")


def tested(folder: Path, name: str, episodes: int, par: bool) -> Trained:
    """Play a policy's test episodes, on tracts of the test split where its task draws them; returns its entry."""
    from agents.catalogue import CONTROLLERS, PAR, has_par, resolve
    from agents.evaluation.evaluator import evaluate
    from agents.shipped import FILES, Trained, digests

    own = resolve(str(folder), split="test")
    played = evaluate(own.policy, own.task, episodes, name=name, **own.settings)
    score = None
    if par and has_par(own.task):
        best = evaluate(CONTROLLERS[PAR].from_env, own.task, episodes, name=PAR, **own.same_episodes)
        score = _known(played.mean_score(best)[0])
    summary, about = played.summary(), own.policy.about
    return Trained(
        name, own.task, about.algorithm, about.seed, about.timesteps, digests(folder),
        sum((folder / file).stat().st_size for file in FILES), episodes, summary["success_rate"],
        _known(summary["median_time_s"]), _known(summary["median_rms_error_m"]), score,
    )  # fmt: skip


def _known(value: float) -> float | None:
    """Five figures of a number, None for NaN."""
    return float(f"{value:.5g}") if value == value else None
