"""The `magwire` command."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

import train
from agents.cli import view as view_cli
from train import BAD_INPUT

__all__ = ["main"]


@dataclass
class Train(train.Config):
    """Train a policy; the same as `python train.py`."""


@dataclass
class Evaluate:
    """Evaluate a trained model or a controller over a fixed list of episode seeds."""

    policy: tyro.conf.Positional[str]
    """A run or model folder, or a controller's name, such as MaxForce."""
    task: str | None = None
    """Environment id; by default the model's own task, or MagWire/Steer-v0."""
    episodes: int = 200
    """Number of episode seeds."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    split: Literal["train", "test", "ood"] = "test"
    """Tracts of a generated task's episodes: the first ones of the split, each ridden once."""
    par: bool = True
    """Score against Optimal on the same starts, which takes minutes the first time."""
    out: Path | None = None
    """Write the summary and every episode here as JSON."""


@dataclass
class Robustness:
    """Sweep friction, remanence, the magnet's place, force noise and delay; write a heat map and its numbers."""

    policy: tyro.conf.Positional[str]
    """A run or model folder, or a controller's name."""
    task: str | None = None
    """Environment id; by default the model's own task, or MagWire/Steer-v0."""
    episodes: int = 50
    """Number of episode seeds for each disturbance."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    split: Literal["train", "test", "ood"] = "test"
    """Tracts of a generated task's episodes."""
    par: bool = True
    """Score against Optimal, undisturbed; else against the policy itself, undisturbed."""
    out: Path = Path("robustness")
    """Folder to write to."""


@dataclass
class Benchmark:
    """Train and evaluate everything everywhere, and write the report; goes on where it stopped."""

    out: Path = Path("runs/benchmark")
    """Folder of the finished cells."""
    workers: int = 2
    """Processes at a time, one core each."""
    only: tuple[str, ...] = ()
    """Only cells whose name has one of these patterns in it, such as "evaluate Steer MPPI" or "train*ppo"."""
    again: bool = False
    """Make cells anew that are finished; for those of --only."""
    dry_run: bool = False
    """List the cells with their state, and make none."""
    report_only: bool = False
    """Write the report from the finished cells, and make none."""
    docs: Path | None = None
    """Folder for benchmark.md, benchmark.json and figures/; by default the one of the cells. The repository's: docs."""
    readme: Path | None = None
    """A README to write the main table into."""
    episodes: int | None = None
    """At most so many episodes an evaluation, to try things out."""
    timesteps: int | None = None
    """At most so many steps a training, to try things out."""
    seeds: int | None = None
    """At most so many training seeds, to try things out."""


def evaluate(options: Evaluate) -> None:
    """Print a table with the policy beside MaxForce (and the par), and write JSON where asked."""
    from agents.controllers import CONTROLLERS
    from agents.evaluation.evaluator import evaluate, table

    asked, name, task, settings, plain = _chosen(options)
    rows = [evaluate(asked, task, options.episodes, name=name, **settings)]
    for other in ("MaxForce", *_par(options)):
        if name != other:
            rows.append(evaluate(CONTROLLERS[other].from_env, task, options.episodes, name=other, **plain))
    par = next((row for row in rows if row.policy in _par(options)), None)
    if options.out is not None:
        options.out.write_text(json.dumps({r.policy: r.to_json(par) for r in rows}, indent=2), encoding="utf-8")
    print(table(rows, par=par))


def _par(options: Evaluate | Robustness) -> tuple[str, ...]:
    """The par's name, if it is asked for and there is one."""
    from agents.controllers import CONTROLLERS

    return ("Optimal",) if options.par and "Optimal" in CONTROLLERS else ()


def _chosen(options: Evaluate | Robustness) -> tuple[Any, str, str, dict[str, Any], dict[str, Any]]:
    """Policy (or what makes one), its name, task, its env's settings, and those of the other policies' env."""
    from agents.controllers import CONTROLLERS
    from agents.learning.sb3 import load
    from magwire_env.envs.task import TASKS

    if options.episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {options.episodes}")
    task, policy, own = options.task, Path(options.policy), dict[str, Any]()
    asked: Any
    if options.policy in CONTROLLERS:
        asked, name = CONTROLLERS[options.policy].from_env, options.policy
    elif policy.is_dir():
        asked, name = load(policy), policy.name
        task, own = task or asked.meta["task"], dict(asked.meta.get("env", {}))
    else:
        raise ValueError(f"policy must be a model folder or one of {', '.join(CONTROLLERS)}; got {options.policy!r}")
    task = task or "MagWire/Steer-v0"
    if options.scenario is not None:
        own["scenario"] = options.scenario
    elif task in TASKS and TASKS[task].pool is not None and "scenario" not in own:
        own["split"] = options.split
    plain: dict[str, Any] = {key: value for key, value in own.items() if key in ("scenario", "split")}
    return asked, name, task, own, plain


def robustness(options: Robustness) -> None:
    """Write the heat map and its JSON, and print their names."""
    from agents.controllers import CONTROLLERS
    from agents.evaluation.evaluator import evaluate
    from agents.evaluation.robustness import heat_map, sweep, sweep_scores

    asked, name, task, settings, plain = _chosen(options)
    found = sweep(asked, task, options.episodes, name, **settings)
    par = None
    for other in _par(options):
        par = evaluate(CONTROLLERS[other].from_env, task, options.episodes, name=other, **plain)
    rows = sweep_scores(found, par)
    against = "itself undisturbed" if par is None else par.policy
    title = f"{name} on {task}, {options.episodes} episodes a cell, score against {against}"
    picture = heat_map(rows, title, options.out / f"{name}.png", label="score")
    data = {"policy": name, "task": task, "episodes": options.episodes, "against": against, "rows": rows}
    numbers = picture.with_suffix(".json")
    numbers.write_text(json.dumps(data, indent=2), encoding="utf-8")
    print(picture, numbers, sep="\n")


def benchmark(options: Benchmark) -> None:
    """Make what is missing, write the report; status 1 if a cell failed."""
    from agents.benchmark.aggregates import collect
    from agents.benchmark.jobs import run_cells, selected
    from agents.benchmark.plan import Plan
    from agents.benchmark.report import write

    plan = Plan(episodes=options.episodes, timesteps=options.timesteps, seeds=options.seeds)
    cells = selected(plan.cells(), options.only)
    states = {cell: plan.state(cell, options.out) for cell in cells}
    if options.dry_run:
        print("\n".join(f"{state:<9} {cell.name}" for cell, state in states.items()))
        return
    failed = []
    if not options.report_only:
        wanted = [cell for cell, state in states.items() if options.again or state != "finished"]
        print(f"{len(wanted)} cells to make, {len(cells) - len(wanted)} finished", flush=True)
        try:
            failed = run_cells(plan, wanted, options.out, options.workers)
        except KeyboardInterrupt:
            sys.exit("interrupted: what is finished is kept, the same command goes on")
    data = collect(plan, options.out)
    for path in write(data, options.docs or options.out, options.readme):
        print(path)
    if data["missing"]:
        print(f"{len(data['missing'])} cells are missing from the report, which names them")
    if failed:
        print("\n".join(f"failed: {cell.name}, see {cell.log(options.out)}" for cell in failed))
        sys.exit(1)


@dataclass
class Tune:
    """Search an algorithm's hyperparameters on a task with Optuna, and write the study as YAML."""

    task: str = "MagWire/Steer-v0"
    """Environment id."""
    algorithm: Literal["ppo", "sac", "tqc", "crossq", "stacked_ppo"] = "ppo"
    """Learning algorithm."""
    trials: int = 16
    """Trainings; the first has the YAML's values."""
    timesteps: int | None = None
    """Environment steps of each; by default a third of the YAML's."""
    seed: int = 1000
    """Of the search and of every training; the benchmark's training seeds are others."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    out: Path | None = None
    """Folder to write to; by default agents/hyperparameters/studies."""


def tune(options: Tune) -> None:
    """Run the study, a line a trial, and print the file's name."""
    from agents.learning.tuning import STUDIES, tune

    print(tune(**asdict(options) | {"out": options.out or STUDIES}))


@dataclass
class Validate:
    """Check the physics against closed forms, magpylib, PyElastica and conservation laws; status 1 if a check fails."""

    quick: bool = False
    """The size the test suite runs: seconds in place of minutes."""
    markdown: bool = False
    """Print the table as Markdown."""


def validate(options: Validate) -> None:
    """Print the table of checks, and how many hold."""
    from magwire_env.validation import CHECKS, FULL, TEST, run, table

    rows = run(CHECKS, TEST if options.quick else FULL)
    print(table(rows, options.markdown))
    verdicts = [row.verdict for row in rows]
    counts = {name: verdicts.count(name) for name in ("holds", "skipped", "FAILS")}
    print(f"\n{counts['holds']} hold, {counts['skipped']} skipped, {counts['FAILS']} fail")
    if counts["FAILS"]:
        sys.exit(1)


@dataclass
class Figures:
    """Draw the paper's figures as PNG and PDF, with their data beside them as CSV."""

    out: Path = Path("figures")
    """Folder to write to."""
    only: tuple[str, ...] = ()
    """Names of the figures wanted; by default all."""


def figures(options: Figures) -> None:
    """Write the figures, and print the files' names."""
    from magwire_env.figures import draw

    for path in draw(options.out, options.only):
        print(path)


def main(arguments: list[str] | None = None) -> None:
    """Run one subcommand; bad input ends with one line and status 1."""
    commands: Any = (
        Annotated[Train, tyro.conf.subcommand("train")]
        | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
        | Annotated[Robustness, tyro.conf.subcommand("robustness")]
        | Annotated[Benchmark, tyro.conf.subcommand("benchmark")]
        | Annotated[Tune, tyro.conf.subcommand("tune")]
        | Annotated[Validate, tyro.conf.subcommand("validate")]
        | Annotated[Figures, tyro.conf.subcommand("figures")]
    )
    for command in view_cli.COMMANDS:
        commands = commands | command
    options = tyro.cli(commands, prog="magwire", description=__doc__, args=arguments)  # type: ignore[call-overload]
    try:
        if isinstance(options, Evaluate):
            evaluate(options)
        elif isinstance(options, Robustness):
            robustness(options)
        elif isinstance(options, Benchmark):
            benchmark(options)
        elif isinstance(options, Tune):
            tune(options)
        elif isinstance(options, Validate):
            validate(options)
        elif isinstance(options, Figures):
            figures(options)
        elif type(options) in view_cli.LOOKS:
            view_cli.look(options)
        else:
            train.main(options)
    except BAD_INPUT as error:
        sys.exit(f"magwire: {error}")
