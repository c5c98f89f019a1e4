"""Pictures of an identification: measured beside predicted, and the residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..plotting import BLACK, BLUE, GREY, ORANGE, blank, styled
from .identified import Identified
from .logs import MEASURED

__all__ = ["residual_plot"]


def residual_plot(found: Identified, path: Path) -> Path:
    """Write a picture with a row for each measured column: data and fit over time, residuals over time."""
    predictor = found.predictor
    columns = predictor.columns
    with styled():
        figure, axes = blank(len(columns), 2, (9.0, 1.7 * len(columns) + 0.6), squeeze=False, sharex=True)
        for number, name in enumerate(columns):
            mine = predictor.column_of == number
            order = np.arange(mine.sum())
            time = predictor.times[mine] if len(predictor.log.episodes) == 1 else order
            left, right = axes[number]
            left.plot(time, predictor.measured[mine], ".", color=GREY, markersize=2.5, label="measured")
            left.plot(time, found.predicted[mine], color=BLUE, label="fit")
            noise = found.noise[MEASURED[name].kind]
            right.axhspan(-noise, noise, color=ORANGE, alpha=0.25, linewidth=0, label="noise, one deviation")
            right.axhline(0.0, color=BLACK, linewidth=0.6)
            right.plot(time, found.residuals[mine], ".", color=BLUE, markersize=2.5)
            left.set_ylabel(f"{name} [{MEASURED[name].unit or '1'}]")
            right.set_ylabel("measured − fit")
        axes[0, 0].legend()
        axes[0, 1].legend()
        for axis in axes[-1]:
            axis.set_xlabel("time [s]" if len(predictor.log.episodes) == 1 else "measurement, episode after episode")
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    return path
