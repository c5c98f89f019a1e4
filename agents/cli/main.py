"""The `magwire` command."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

import magwire_env
from agents.cli import anatomy as anatomy_cli
from agents.cli import experiment as experiment_cli
from agents.cli import identify as identify_cli
from agents.cli import record as record_cli
from agents.cli import view as view_cli
from agents.cli.cache import Cache, cache
from agents.cli.export import Export, export
from agents.cli.policies import Policies, policies
from agents.cli.train import train
from agents.learning.config import BAD_INPUT, Algorithm, Config
from magwire_env.physics.checks import whole
from magwire_env.words import counted

if TYPE_CHECKING:
    from agents.catalogue import Entrant

__all__ = ["main"]


@dataclass
class Train(Config):
    """Train a policy, as `python train.py` does, or one for each of several seeds."""

    seeds: str | None = None
    """Seeds such as 0-9 or 0,3,5: one run for each, side by side, in place of `seed`."""
    workers: int = 2
    """With seeds: processes at a time."""
    ray: str | None = None
    """With seeds: train on Ray, "local" or the address of a cluster whose nodes share this folder."""


@dataclass
class Evaluate:
    """Evaluate a trained model or a controller over a fixed list of episode seeds."""

    policy: tyro.conf.Positional[str]
    """A run's or policy's folder, trained/…, an SB3 .zip, a controller such as MaxForce, or a module:thing."""
    task: str | None = None
    """Environment id; by default the policy's own task, or MagWire/Steer-v1."""
    episodes: int = 200
    """Number of episode seeds."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    split: Literal["train", "test", "ood"] = "test"
    """Split of a generated task's tracts; the first ones are used, each once."""
    env_kwargs: tuple[str, ...] = ()
    """key=value for the env: observe, action_mode, reward, safety, coupling, time_limit, split, pool_size, scenario."""
    par: bool = True
    """Score against Optimal on the same starts; the first time, this takes minutes."""
    out: Path | None = None
    """Write the summary and every episode here as JSON."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


@dataclass
class Robustness:
    """Sweep friction, remanence, the magnet's place, force noise and delay; write a heat map and its numbers."""

    policy: tyro.conf.Positional[str]
    """A run's or policy's folder, trained/…, an SB3 .zip, a controller's name, or module:thing of your own."""
    task: str | None = None
    """Environment id; by default the policy's own task, or MagWire/Steer-v1."""
    episodes: int = 50
    """Number of episode seeds for each disturbance."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    split: Literal["train", "test", "ood"] = "test"
    """Split of a generated task's tracts."""
    env_kwargs: tuple[str, ...] = ()
    """key=value for the env: observe, action_mode, reward, safety, coupling, time_limit, split, pool_size, scenario."""
    par: bool = True
    """Score against Optimal without disturbance; otherwise against the policy itself without disturbance."""
    out: Path = Path("robustness")
    """Folder to write to."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


@dataclass
class Benchmark:
    """Train and evaluate every policy in every arena, and write the report; goes on where it stopped."""

    set: Literal["locked", "free"] = "locked"
    """Arenas of the locked wire, which have a par, or of free wires: trees, SteerFree and Shape."""
    out: Path = Path("runs/benchmark")
    """Folder of the finished cells."""
    workers: int = 2
    """Processes at a time, one core each."""
    ray: str | None = None
    """Make the cells as tasks of Ray: "local", or the address of a cluster, which then has the workers."""
    store: str | None = None
    """URL through which a cluster's nodes share files (s3://…, file:///…), where they do not share the folder out."""
    only: tuple[str, ...] = ()
    """Only cells whose name contains one of these patterns, such as "evaluate Steer MPPI" or "train*ppo"."""
    controllers: tuple[str, ...] = ()
    """Policies that take part too: a run's or policy's folder, trained/…, an SB3 .zip, or module:thing of your own."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""
    again: bool = False
    """Make finished cells again; with --only, those."""
    dry_run: bool = False
    """Only list the cells with their state, and how long those that are missing will take."""
    report_only: bool = False
    """Only write the report, from the finished cells."""
    docs: Path | None = None
    """Folder for benchmark.md, benchmark.json and figures/; by default that of the cells. The repository's is docs."""
    readme: Path | None = None
    """A README whose main table is replaced."""
    episodes: int | None = None
    """At most so many episodes in an evaluation, to try things out."""
    timesteps: int | None = None
    """At most so many steps in a training, to try things out."""
    seeds: int | None = None
    """At most so many training seeds, to try things out."""


def evaluate(options: Evaluate) -> None:
    """Print a table with the policy beside MaxForce and the par, and write JSON if a file is given."""
    from agents.catalogue import CONTROLLERS, PAR, compared_with
    from agents.evaluation.evaluator import evaluate, table

    own = _entrant(options)
    rows = [evaluate(own.policy, own.task, options.episodes, name=own.name, **own.settings)]
    names = compared_with(own.task, options.par)
    for name in names:
        if own.name != name:
            policy = CONTROLLERS[name].from_env
            rows.append(evaluate(policy, own.task, options.episodes, name=name, **own.same_episodes))
    par = next((row for row in rows if row.policy == PAR), None)
    if options.out is not None:
        options.out.write_text(json.dumps({r.policy: r.to_json(par) for r in rows}, indent=2), encoding="utf-8")
    print(table(rows, names[0], par=par, markdown=False))


def _rivals(options: Evaluate | Robustness) -> tuple[str, ...]:
    """The par's name, if the par is wanted."""
    from agents.catalogue import PAR

    return (PAR,) if options.par else ()


def _entrant(options: Evaluate | Robustness) -> Entrant:
    from agents.catalogue import resolve

    whole("episodes", options.episodes, 1)
    return resolve(options.policy, options.task, options.scenario, options.split, options.trust, options.env_kwargs)


def robustness(options: Robustness) -> None:
    """Write the heat map and its JSON, and print the names of the files."""
    from agents.catalogue import CONTROLLERS
    from agents.evaluation.evaluator import evaluate
    from agents.evaluation.robustness import heat_map, sweep, sweep_scores

    own = _entrant(options)
    found = sweep(own.policy, own.task, options.episodes, own.name, **own.settings)
    par = None
    for name in _rivals(options):
        policy = CONTROLLERS[name].from_env
        par = evaluate(policy, own.task, options.episodes, name=name, **own.same_episodes)
    rows = sweep_scores(found, par)
    against = "itself undisturbed" if par is None else par.policy
    title = f"{own.name} on {own.task}, {counted(options.episodes, 'episode')} a cell, score against {against}"
    picture = heat_map(rows, title, options.out / f"{own.name}.png", label="score")
    data = {"policy": own.name, "task": own.task, "episodes": options.episodes, "against": against, "rows": rows}
    numbers = picture.with_suffix(".json")
    numbers.write_text(json.dumps(data, indent=2), encoding="utf-8")
    print(picture, numbers, sep="\n")


def benchmark(options: Benchmark) -> None:
    """Make the missing cells and write the report; status 1 if a cell failed."""
    from agents.benchmark.aggregates import collect, episode_records
    from agents.benchmark.costs import estimate
    from agents.benchmark.jobs import run_cells, selected
    from agents.benchmark.plan import Plan
    from agents.benchmark.report import less_than_kept, write
    from agents.benchmark.sets import SETS

    asked = SETS[options.set]
    plan = Plan(
        asked.arenas, asked.learners, asked.robustness,
        extra=options.controllers, trust=options.trust, episodes=options.episodes, timesteps=options.timesteps,
        seeds=options.seeds,
    )  # fmt: skip
    cells = selected(plan.cells(), options.only)
    states = {cell: plan.state(cell, options.out) for cell in cells}
    if options.dry_run:
        print("\n".join(f"{state:<9} {cell.name}" for cell, state in states.items()))
        print(
            estimate(
                plan, [cell for cell, state in states.items() if state != "finished"], options.out, options.workers
            )
        )
        return
    failed = []
    if not options.report_only:
        wanted = [cell for cell, state in states.items() if options.again or state != "finished"]
        print(f"{counted(len(wanted), 'cell')} to make, {len(cells) - len(wanted)} finished", flush=True)
        try:
            failed = run_cells(plan, wanted, options.out, options.workers, options.ray, options.store)
        except KeyboardInterrupt:
            sys.exit("interrupted; finished cells are kept, and the same command goes on")
    data = collect(plan, options.out)
    docs, readme = options.docs or options.out, options.readme
    if less := less_than_kept(data, docs, asked.form.stem):
        print(f"{docs} is kept, with {less}; the report goes to {options.out}")
        docs, readme = options.out, None
    for path in write(data, docs, readme, episode_records(plan, options.out), asked.form):
        print(path)
    if data["missing"]:
        print(f"{counted(len(data['missing']), 'cell')} missing from the report, which names them")
    if failed:
        print("\n".join(f"failed: {cell.name}, see {cell.log(options.out)}" for cell in failed))
        sys.exit(1)


@dataclass
class Tune:
    """Search an algorithm's hyperparameters on a task with Optuna, and write the study as YAML."""

    task: str = "MagWire/Steer-v1"
    """Environment id."""
    algorithm: Algorithm = "ppo"
    """Learning algorithm."""
    trials: int = 16
    """Number of trainings; the first has the YAML's values."""
    timesteps: int | None = None
    """Environment steps of each; by default a third of the YAML's."""
    seed: int = 1000
    """Seed of the search and of every training; the benchmark trains with other seeds."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    out: Path = Path("runs/studies")
    """Folder to write to."""
    storage: str | None = None
    """Optuna's storage, in which the study goes on where it stopped and which all workers share: a journal file, or a
    database's URL. By default a journal file that lasts as long as the command."""
    workers: int = 1
    """Trainings at a time. With one, a study depends on its seed alone."""
    ray: str | None = None
    """Train on Ray: "local", or the address of a cluster whose nodes reach the storage."""


def tune(options: Tune) -> None:
    """Run the study, print a line for each trial, and print the name of the file."""
    from agents.learning.tuning import tune

    print(tune(**asdict(options)))


def train_seeds(options: Train) -> None:
    """Train one policy, or one for each seed; status 1 if one of those failed."""
    asked = {f.name: getattr(options, f.name) for f in fields(Config)}
    if options.seeds is None:
        train(Config(**asked))
        return
    from agents.cli.seeds import numbers, train_all

    if failed := train_all(Config(**asked), numbers(options.seeds), options.workers, options.ray):
        sys.exit("\n".join(f"failed: {line}" for line in failed))


@dataclass
class Validate:
    """Check the physics against closed forms, magpylib, PyElastica and conservation laws; status 1 if a check fails."""

    quick: bool = False
    """Run the size of the test suite: about a minute in place of half an hour."""
    markdown: bool = False
    """Print the table as Markdown."""
    only: tuple[str, ...] = ()
    """Beginnings of the checks' names, such as F13 or "capstan"; by default all."""


def validate(options: Validate) -> None:
    """Print the table of checks, and the number of those that hold."""
    from magwire_env.validation import CHECKS, FULL, TEST, run, table

    checks = [check for check in CHECKS if not options.only or check.name.startswith(options.only)]
    if not checks:
        raise ValueError(f"only: no check's name begins with any of {options.only}")
    rows = run(checks, TEST if options.quick else FULL)
    print(table(rows, options.markdown))
    verdicts = [row.verdict for row in rows]
    counts = {name: verdicts.count(name) for name in ("holds", "skipped", "FAILS")}
    print(f"\n{counts['holds']} hold, {counts['skipped']} skipped, {counts['FAILS']} fail")
    if counts["FAILS"]:
        sys.exit(1)


@dataclass
class Figures:
    """Draw the paper's figures as PNG and PDF, and write their data as CSV."""

    out: Path = Path("figures")
    """Folder to write to."""
    only: tuple[str, ...] = ()
    """Names of the figures; by default all."""


def figures(options: Figures) -> None:
    """Write the figures, and print the names of the files."""
    from magwire_env.figures import draw

    for path in draw(options.out, options.only):
        print(path)


def main(arguments: list[str] | None = None) -> None:
    """Run one subcommand; bad input ends with one line and status 1."""
    if (sys.argv[1:] if arguments is None else arguments) == ["--version"]:
        print(f"magwire {magwire_env.__version__}")
        return
    if str(Path.cwd()) not in sys.path and "" not in sys.path:
        sys.path.append(str(Path.cwd()))  # where a user's own modules are; last, so that it hides no other
    run = _RUN | record_cli.RUN | identify_cli.RUN | experiment_cli.RUN | anatomy_cli.RUN | view_cli.RUN
    commands: list[Any] = [Annotated[kind, tyro.conf.subcommand(kind.__name__.lower())] for kind in run]
    options: Any = tyro.cli(reduce(or_, commands), prog="magwire", description=__doc__, args=arguments)
    try:
        run[type(options)](options)
    except BAD_INPUT as error:
        sys.exit(f"magwire: {error}")


_RUN: dict[type, Callable[[Any], Any]] = {
    Train: train_seeds, Export: export, Evaluate: evaluate, Robustness: robustness, Benchmark: benchmark, Tune: tune,
    Validate: validate, Figures: figures, Policies: policies, Cache: cache,
}  # fmt: skip
