"""A figure and its data, and the look all figures share."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["BLACK", "BLUE", "GREEN", "GREY", "ORANGE", "PURPLE", "RED", "SEQUENCE", "Page", "blank", "broken", "styled"]

# Okabe and Ito's palette: told apart with any colour vision.
BLACK, ORANGE, BLUE, GREEN, RED, PURPLE = "#000000", "#E69F00", "#0072B2", "#009E73", "#D55E00", "#CC79A7"
GREY = "#8C8C8C"
SEQUENCE = "viridis"

_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.4,
    "pdf.fonttype": 42,
    "savefig.dpi": 150,
}


def styled() -> AbstractContextManager[None]:
    """The shared look, for as long as the context lasts."""
    import matplotlib as mpl

    return mpl.rc_context(_STYLE)


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


def blank(rows: int = 1, columns: int = 1, size: tuple[float, float] = (7.5, 3.6), **options: Any) -> tuple[Any, Any]:
    """An empty figure of `size` inches and its axes, on Agg: no window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **options)


def broken(values: np.ndarray, jump: float) -> np.ndarray:
    """`values` (n,) with NaN after every step larger than `jump`, so that a line through them does not bridge it."""
    out = np.array(values, dtype=float)
    out[1:][np.abs(np.diff(values)) > jump] = np.nan
    return out
