"""The `magwire` command."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

import train
from agents import view_cli
from train import BAD_INPUT

__all__ = ["main"]


@dataclass
class Train(train.Config):
    """Train a policy; the same as `python train.py`."""


@dataclass
class Evaluate:
    """Evaluate a trained model or a controller over a fixed list of episode seeds."""

    policy: tyro.conf.Positional[str]
    """A run or model folder, or a controller's name: MaxForce, ConstantRotation, Random."""
    task: str | None = None
    """Environment id; by default the model's own task, or MagWire/Steer-v0."""
    episodes: int = 200
    """Number of episode seeds."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    split: Literal["train", "test", "ood"] = "test"
    """Tracts of a generated task's episodes."""
    out: Path | None = None
    """Write the summary and every episode here as JSON."""


def evaluate(options: Evaluate) -> None:
    """Print a table with the policy beside MaxForce, and write JSON where asked."""
    from agents.controllers import CONTROLLERS
    from agents.evaluation import evaluate, table
    from agents.learning import load
    from magwire_env.envs.task import TASKS

    if options.episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {options.episodes}")
    settings: dict[str, Any] = {} if options.scenario is None else {"scenario": options.scenario}
    task, policy = options.task, Path(options.policy)
    asked: Any
    if options.policy in CONTROLLERS:
        asked, name = CONTROLLERS[options.policy].from_env, options.policy
    elif policy.is_dir():
        asked, name = load(policy), policy.name
        task = task or asked.meta["task"]
        settings = asked.meta.get("env", {}) | settings
    else:
        raise ValueError(f"policy must be a model folder or one of {', '.join(CONTROLLERS)}; got {options.policy!r}")
    task = task or "MagWire/Steer-v0"
    if task in TASKS and TASKS[task].pool is not None and options.scenario is None:
        settings["split"] = options.split
    rows = [evaluate(asked, task, options.episodes, name=name, **settings)]
    if name != "MaxForce":
        rows.append(evaluate(CONTROLLERS["MaxForce"].from_env, task, options.episodes, name="MaxForce", **settings))
    if options.out is not None:
        options.out.write_text(json.dumps({r.policy: r.to_json() for r in rows}, indent=2), encoding="utf-8")
    print(table(rows))


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
        | Annotated[Validate, tyro.conf.subcommand("validate")]
        | Annotated[Figures, tyro.conf.subcommand("figures")]
    )
    for command in view_cli.COMMANDS:
        commands = commands | command
    options = tyro.cli(commands, prog="magwire", description=__doc__, args=arguments)  # type: ignore[call-overload]
    try:
        if isinstance(options, Evaluate):
            evaluate(options)
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
