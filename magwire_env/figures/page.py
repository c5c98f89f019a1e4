"""A figure of the paper, with its data."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["Page"]


@dataclass
class Page:
    """A matplotlib figure and its tables, by name: column heading → values of equal length."""

    figure: Any
    tables: Mapping[str, Mapping[str, Sequence[float] | np.ndarray]]

    def save(self, stem: Path) -> list[Path]:
        """Write `stem`.png, `stem`.pdf and, for each table, `stem`_name.csv (`stem`.csv for the name "")."""
        files = []
        for suffix in (".png", ".pdf"):
            files.append(stem.with_name(stem.name + suffix))
            self.figure.savefig(files[-1])
        for name, columns in self.tables.items():
            files.append(stem.with_name(f"{stem.name}_{name}.csv" if name else f"{stem.name}.csv"))
            with files[-1].open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(columns)
                writer.writerows([f"{value:.8g}" for value in row] for row in zip(*columns.values(), strict=True))
        return files
