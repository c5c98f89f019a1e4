"""E1: helices that buckle, against the free rod that twists, clamped at both ends.

A robot held a rod of 0.51 m by both ends and led it along helices of growing curvature κ, with a fixed ratio c1 of
torsion to curvature and a fixed axial moment c2 E I κ, until the rod left the helix (Tong, Borum, Jawed,
arXiv 2112.09208). κL of the departure depends on c1 and c2 alone, so there is nothing to fit.

Ours is where small motions of a free rod on the helix begin to grow, looked for around the measurement. The theory in
the file, conjugate points of the Kirchhoff rod, is independent of both.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...plotting import BLACK, BLUE, ORANGE, blank, styled
from ..free.twist import departure
from ..report import Row
from .report import Outcome, published, rows_of_file

__all__ = ["departures", "run"]

SEGMENTS = 100
AROUND = np.linspace(0.88, 1.14, 32)
"""Of the measured departure: where ours is looked for."""

ROWS = 10
"""So many are held against theory one by one, spread evenly over the file."""

BAR, SCATTER = 1.6, 9.9
"""%: the largest mean error allowed, and the largest error of a single measurement against theory."""


def departures(c1: np.ndarray, c2: np.ndarray, measured: np.ndarray, segments: int) -> np.ndarray:
    """κL (n,) at which the rods leave their helices; NaN where that is not within `AROUND` of the measured κL (n,)."""
    return np.array([
        departure(*case, segments, factors=AROUND) for case in zip(c1, c2, measured, strict=True)
    ])  # fmt: skip


def run(file: Path) -> Outcome:
    """The departure of every measured helix, with 100 segments."""
    names = ("c1", "c2", "kL_measured", "jump", "kL_theory")
    rows = rows_of_file(file, names)
    c1, c2, measured, jump, theory = (np.array([float(row[name]) for row in rows]) for name in names)
    ours = departures(c1, c2, measured, SEGMENTS)
    of_measured, of_theory = 100 * (measured / ours - 1), 100 * (ours / theory - 1)
    of_others = 100 * (measured / theory - 1)
    table = [
        Row(f"c1 {c1[i]:g}, c2 {c2[i]:g}: κL of departure", "", theory[i], "conjugate points", float(ours[i]), 5e-3)
        for i in np.linspace(0, len(rows) - 1, ROWS).round().astype(int)
    ]
    table += [
        published("≤", f"all {len(rows)}, largest difference from theory", "%", 0.5, "conjugate points",
                  float(np.abs(of_theory).max())),
        published("≤", f"{len(rows)} measurements, mean size of the error", "%", BAR,
                  f"theory: {np.abs(of_others).mean():.2f} %", float(np.abs(of_measured).mean())),
    ]  # fmt: skip
    return Outcome(
        tuple(table),
        "none",
        f"Ours less measured is {-of_measured.mean():+.2f} % in the mean (theory {-of_others.mean():+.2f} %) and "
        f"{np.abs(of_measured).max():.1f} % at most (theory {np.abs(of_others).max():.1f} %): the robot's rod leaves a "
        f"little early, as a rod that is never on the helix exactly would. {int(jump.sum())} of them jumped.",
        {"c1": c1, "c2": c2, "kL_measured": measured, "kL_theory": theory, "kL": ours, "jump": jump},
        lambda path: _draw(ours, measured, jump > 0, path),
    )


def _draw(ours: np.ndarray, measured: np.ndarray, jump: np.ndarray, path: Path) -> None:
    ends = [0.97 * float(np.minimum(ours, measured).min()), 1.02 * float(np.maximum(ours, measured).max())]
    with styled():
        figure, (left, right) = blank(1, 2, (9.0, 4.2))
        left.plot(ends, ends, color=BLACK, linewidth=0.8)
        for which, colour, label in ((~jump, BLUE, "leaves smoothly"), (jump, ORANGE, "jumps")):
            left.plot(ours[which], measured[which], "o", color=colour, markersize=3, label=label)
            right.plot(ours[which], 100 * (measured / ours - 1)[which], "o", color=colour, markersize=3)
        left.set(xlabel="κL of departure, free rod", ylabel="measured", aspect="equal", xlim=ends, ylim=ends)
        left.legend()
        right.axhline(0.0, color=BLACK, linewidth=0.8)
        right.set(xlabel="κL of departure, free rod", ylabel="measured, beyond the rod's [%]")
        figure.savefig(path)
