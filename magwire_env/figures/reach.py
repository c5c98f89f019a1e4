"""On how many other tracts the claim "one magnet, one axis, any direction" holds, and what more magnets change."""

from __future__ import annotations

import numpy as np

from ..plotting import BLUE, GREEN, GREY, ORANGE, blank
from ..quasistatic.reach import READINGS, Reach, drives, recorded
from .page import Page

__all__ = ["claims_reach"]

_SHORT = {
    "one magnet, one axis": "one magnet,\none axis",
    "one magnet, two axes": "one magnet,\ntwo axes",
    "two magnets, one axis each": "two magnets",
    "one magnet that follows, one axis": "following\nmagnet",
}


def claims_reach() -> Page:
    """Shares of tracts by rig; drive and torque along the paper's tract."""
    reaches, found = recorded(), drives()
    kinds = list(dict.fromkeys(row.tracts for row in reaches))
    figure, axes = blank(1, 3, (9.9, 4.2), width_ratios=(1, 1, 1.1))
    for panel, kind in zip(axes, kinds, strict=False):
        _shares(panel, [row for row in reaches if row.tracts == kind], kind)
    axes[0].legend(loc="upper left", fontsize=7)
    axes[0].set_ylabel(f"of {reaches[0].number} tracts, passed both ways (%)")
    panel, twin = axes[2], axes[2].twinx()
    for coupling, colour, mark in (("force", BLUE, "o"), ("wrench", ORANGE, "s")):
        rows = [row for row in found if row.coupling == coupling]
        x = np.arange(len(rows))
        panel.plot(x, [1e3 * row.least for row in rows], mark, ls="-", color=colour, label=f"least drive, {coupling}")
        twin.plot(
            x, [1e3 * row.torque for row in rows], mark, ls=":", color=colour, mfc="none", label=f"torque, {coupling}"
        )
    panel.set(title="Along the paper's tract", ylabel="least drive (mN)", ylim=(0, None))
    twin.set(ylabel="median torque on the tip (mN·m)", ylim=(0, 1.0))
    twin.grid(False)
    panel.set_xticks(range(len(_SHORT)), list(_SHORT.values()), fontsize=7)
    lines, other = panel.get_legend_handles_labels(), twin.get_legend_handles_labels()
    panel.legend(lines[0] + other[0], lines[1] + other[1], fontsize=7, loc="upper left")
    counts: dict[str, list] = {
        name: [getattr(row, name) for row in reaches] for name in ("number", "forward", "back", "both", "weakest")
    }
    numbers: dict[str, list] = {
        "kind": [kinds.index(row.tracts) for row in reaches],
        "distance_m": [READINGS[row.reading] for row in reaches],
        "rig": [list(_SHORT).index(row.rig) for row in reaches],
        "wrench": [float(row.coupling == "wrench") for row in reaches],
    }
    along: dict[str, list] = {
        "rig": [list(_SHORT).index(row.rig) for row in found],
        "wrench": [float(row.coupling == "wrench") for row in found],
        "least_drive_N": [row.least for row in found],
        "median_drive_N": [row.median for row in found],
        "median_torque_Nm": [row.torque for row in found],
    }
    return Page(figure, {"tracts": numbers | counts, "paper": along})


def _shares(panel, rows: list[Reach], kind: str) -> None:
    """Bars by rig: both couplings, both readings of 7 cm."""
    styles = {
        ("force", "centre"): (BLUE, "7 cm to the centre, force"),
        ("wrench", "centre"): (ORANGE, "7 cm to the centre, wrench"),
        ("force", "face"): (GREEN, "7 cm to the face, force"),
        ("wrench", "face"): (GREY, "7 cm to the face, wrench"),
    }
    x = np.arange(len(_SHORT))
    for i, ((coupling, reading), (colour, label)) in enumerate(styles.items()):
        own = [row for row in rows if (row.coupling, row.reading) == (coupling, reading)]
        shares = [100 * row.both / row.number for row in own]
        bars = panel.bar(x + 0.2 * (i - 1.5), shares, 0.19, color=colour, label=label)
        panel.bar_label(bars, fmt="%.0f", fontsize=6)
    panel.set(title=f"Generated tracts, {kind}", ylim=(0, 105))
    panel.set_xticks(x, list(_SHORT.values()), fontsize=7)
