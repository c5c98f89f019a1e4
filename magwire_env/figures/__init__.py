"""The paper's figures, drawn from the model: PNG and PDF, with the data beside them as CSV.

`draw(folder)`, or `magwire figures --out folder`. Matplotlib is imported only when a figure is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from ..physics.checks import one_of
from ..plotting import styled
from . import drawings, forces, reach, rods, shapes
from .page import Page

__all__ = ["FIGURES", "Page", "draw"]

FIGURES: dict[str, Callable[[], Page]] = {
    "figure1_approaching_dipole": rods.approaching,
    "figure2_turning_dipole": rods.turning,
    "figure3_wire_model": drawings.wire_model,
    "figure4_setup": drawings.setup,
    "figure5_flux_and_force": forces.flux,
    "figure6_force_against_angle": forces.against_angle,
    "figure7_best_angle": forces.best_angle,
    "figure8_coupling": forces.coupling,
    "figure9_wanted_shapes": shapes.wanted_shapes,
    "figure10_reach": reach.claims_reach,
}
"""1 to 7 are the paper's; 8 shows what its projection of the force leaves out, 9 the way back from a shape to magnets
that make it, 10 on how many other tracts the claim holds."""


def draw(folder: str | Path, only: Iterable[str] = ()) -> list[Path]:
    """Write the figures (`only` those named, by default all) to `folder`, and return the files written.

    Raises `ValueError` for an unknown name, `ImportError` without matplotlib.
    """
    names = tuple(only) or tuple(FIGURES)
    for name in names:
        one_of("only", name, tuple(FIGURES))
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    with styled():
        return [path for name in names for path in FIGURES[name]().save(out / name)]
