"""The subcommand `experiment`: our models against a measurement by others."""

from __future__ import annotations

import csv
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

__all__ = ["RUN", "Experiment", "experiment"]


@dataclass
class Experiment:
    """Hold a model against a measurement by others: a table, a figure and its data; status 1 if a bar is missed."""

    name: tyro.conf.Positional[str]
    """helices (E1: they buckle), continuum_robot (E2), loops (E3: real wires hang), or turning (E6: while pushing)."""
    data: Path | None = None
    """The data's file, or the folder that holds it; by default the folder in the variable MAGWIRE_DATA."""
    lumen: Path | None = None
    """Of continuum_robot: the vessel model's walls, as docs/experiments.md says."""
    out: Path = Path("experiments")
    """Folder for NAME.png and NAME.csv."""
    markdown: bool = False
    """Print the table as Markdown."""


def experiment(options: Experiment) -> None:
    """Print the table and the free parameters, write the files and print their names."""
    from magwire_env.physics.checks import one_of
    from magwire_env.validation.experiments import EXPERIMENTS

    found = EXPERIMENTS[one_of("name", options.name, tuple(EXPERIMENTS))]
    outcome = found(options.data or Path(os.environ.get("MAGWIRE_DATA", ".")), options.lumen)
    print(found.title, outcome.text(options.markdown), sep="\n\n")
    options.out.mkdir(parents=True, exist_ok=True)
    picture, numbers = (options.out / f"{found.name}{suffix}" for suffix in (".png", ".csv"))
    outcome.draw(picture)
    with numbers.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(outcome.columns)
        writer.writerows(zip(*outcome.columns.values(), strict=True))
    print(picture, numbers, sep="\n")
    if not outcome.holds:
        sys.exit(1)


RUN: dict[type, Callable[[Any], Any]] = {Experiment: experiment}
