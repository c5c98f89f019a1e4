"""The look of all plots and pictures: one palette, one matplotlib style, figures without a window.

Matplotlib is imported only when a figure is made.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

import numpy as np

__all__ = [
    "BLACK", "BLUE", "BROWN", "GREEN", "GREY", "ORANGE", "PURPLE", "RED", "SEQUENCE", "SKY", "YELLOW", "blank",
    "broken", "rgb", "styled",
]  # fmt: skip

# Okabe and Ito's palette, which is safe for the colour-blind; brown is added as a ninth.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, RED, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
BROWN, GREY = "#8C510A", "#8C8C8C"
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


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255 each, of a colour such as "#0072B2"."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue


def styled() -> AbstractContextManager[None]:
    """The shared style, for as long as the context lasts."""
    import matplotlib as mpl

    return mpl.rc_context(_STYLE)


def blank(rows: int = 1, columns: int = 1, size: tuple[float, float] = (7.5, 3.6), **options: Any) -> tuple[Any, Any]:
    """An empty figure of `size` inches and its axes, on an Agg canvas: it opens no window and stays in no registry."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **options)


def broken(values: np.ndarray, jump: float) -> np.ndarray:
    """`values` (n,) with NaN after every step larger than `jump`, so that a line through them has a gap there."""
    out = np.array(values, dtype=float)
    out[1:][np.abs(np.diff(values)) > jump] = np.nan
    return out
