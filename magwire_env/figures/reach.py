"""On how many other tracts the claim "one magnet, one axis, any direction" holds, and what more magnets change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..plotting import BLUE, GREEN, GREY, ORANGE, blank
from ..quasistatic.reach import Drive, Reach, distance, drives, recorded
from ..quasistatic.rigs import RIGS
from .page import Page

__all__ = ["claims_reach"]

_SHORT = ("one magnet,\none axis", "one magnet,\ntwo axes", "two magnets,\none axis each", "one magnet\nthat follows")
"""The names of `RIGS`, in two lines."""

_COLOURS = {
    ("force", "centre"): BLUE,
    ("wrench", "centre"): ORANGE,
    ("force", "face"): GREEN,
    ("wrench", "face"): GREY,
}
"""By coupling and by what the 7 cm end at."""


def claims_reach() -> Page:
    """Tracts that are passed, by rig; drive and torque along the paper's tract."""
    reaches, found = recorded(), drives()
    kinds = list(dict.fromkeys(row.tracts for row in reaches))
    figure, axes = blank(2, 2, (9.4, 6.4), height_ratios=(1.15, 1))
    for panel, kind in zip(axes[0], kinds, strict=True):
        rows = [row for row in reaches if row.tracts == kind]
        _counts(panel, rows)
        panel.set(title=f"Generated tracts, {kind}", ylim=(0, rows[0].number))
    axes[0, 0].set_ylabel(f"of {reaches[0].number} tracts, passed both ways")
    axes[0, 0].legend(loc="upper left")
    _drives(axes[1, 0], found)
    _torques(axes[1, 1], found)
    for panel in axes.flat:
        panel.set_xticks(range(len(_SHORT)), _SHORT, fontsize=7.5)
        panel.grid(False, axis="x")
    return Page(figure, {"tracts": _tract_columns(reaches, kinds), "paper": _paper_columns(found)})


def _bars(panel: Any, values: Sequence[float], place: float, width: float, form: str, **look: Any) -> None:
    """A bar for each rig, `place` beside the rig's middle, with its number above it."""
    bars = panel.bar(np.arange(len(values)) + place, values, width, **look)
    panel.bar_label(bars, fmt=form, fontsize=6.5)


def _counts(panel: Any, rows: Sequence[Reach]) -> None:
    for i, ((coupling, reading), colour) in enumerate(_COLOURS.items()):
        both = [row.both for row in rows if (row.coupling, row.reading) == (coupling, reading)]
        label = f"{coupling}, 7 cm to the {reading}"
        _bars(panel, both, 0.21 * (i - 1.5), 0.2, "%d", color=colour, label=label)


def _drives(panel: Any, found: Sequence[Drive]) -> None:
    for i, coupling in enumerate(("force", "wrench")):
        least = [1e3 * row.least for row in found if row.coupling == coupling]
        colour = _COLOURS[coupling, "centre"]
        _bars(panel, least, 0.4 * (i - 0.5), 0.38, "%.1f", color=colour, label=f"{coupling}, 7 cm to the centre")
    panel.set(title="The paper's tract: least drive along it", ylabel="drive (mN)", ylim=(0, 11))
    panel.legend(loc="upper left")


def _torques(panel: Any, found: Sequence[Drive]) -> None:
    for i, coupling in enumerate(("force", "wrench")):
        rows, colour = [row for row in found if row.coupling == coupling], _COLOURS[coupling, "centre"]
        greatest, spared = ([1e3 * getattr(row, name) for row in rows] for name in ("torque", "spared"))
        look = {"color": colour, "label": f"{coupling}, at the greatest drive"}
        _bars(panel, greatest, 0.42 * (i - 0.5) - 0.1, 0.19, "%.2f", **look)
        look = {
            "color": "white",
            "edgecolor": colour,
            "hatch": "////",
            "label": f"{coupling}, at the first rig's drive",
        }
        _bars(panel, spared, 0.42 * (i - 0.5) + 0.1, 0.19, "%.2f", **look)
    panel.set(title="The paper's tract: torque on the tip", ylabel="median torque (mN·m)", ylim=(0, 0.85))
    panel.legend(loc="upper left", ncols=2, fontsize=7.5)


def _tract_columns(reaches: Sequence[Reach], kinds: Sequence[str]) -> dict[str, list[float]]:
    """The record in numbers: `kind` and `rig` count from 0 in the order of the record."""
    names = list(RIGS)
    columns: dict[str, list[float]] = {
        "kind": [kinds.index(row.tracts) for row in reaches],
        "distance_m": [distance(row.reading) for row in reaches],
        "rig": [names.index(row.rig) for row in reaches],
        "wrench": [float(row.coupling == "wrench") for row in reaches],
    }
    units = {"number": "number", "forward": "forward", "back": "back", "both": "both", "weakest": "weakest_N"}
    return columns | {heading: [getattr(row, name) for row in reaches] for name, heading in units.items()}


def _paper_columns(found: Sequence[Drive]) -> dict[str, list[float]]:
    names = list(RIGS)
    columns: dict[str, list[float]] = {
        "rig": [names.index(row.rig) for row in found],
        "wrench": [float(row.coupling == "wrench") for row in found],
    }
    units = {
        "least": "least_drive_N",
        "median": "median_drive_N",
        "torque": "median_torque_Nm",
        "spared": "spared_torque_Nm",
    }
    return columns | {heading: [getattr(row, name) for row in found] for name, heading in units.items()}
