"""E2: the measured tip of a magnetic continuum robot in the open, against a rod with two ring magnets.

Dreyfus, Boehler, Nelson, RA-L 2022 (doi 10.1109/LRA.2022.3187249) filmed a tube with a soft end and two rings, pushed
through a sheath and turned by a uniform field, and ran SOFA on the same commands. Lengths and fields are not in the
data, so each pose (x, y, angle) leaves one number to judge after the inserted length and the field's angle have been
fitted.

In a uniform field the rings feel couples and no forces, so the rod's curvature is constant between them: an equilibrium
of the free rod in the plane is a row of circular arcs, and only the angles of the two rings are unknown. Newton's
method follows them while the field grows from zero; what is no minimum of the energy does not count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from ...plotting import BLUE, GREY, ORANGE, blank, styled
from ...words import counted
from ..report import Row
from .among_walls import followed, in_the_model, load_lumen
from .report import Outcome, published, rows_of_file

__all__ = ["Setting", "fitted_poses", "fitted_setting", "rod", "run"]

SHAFT, SOFT, SOFT_LENGTH = 170e6, 21e6, 34e-3
"""Pa, Pa, m: moduli of the tube and its end, and the end's length; a ring at both ends of it."""
SECOND_MOMENT = math.pi / 4 * (0.665e-3**4 - 0.4e-3**4)
MOMENT = 3.73e-3
"""A·m² of each ring."""

RUN, VESSEL = "9978_free", "9976_vessel"
SOFA, SOFA_VESSEL = (7.16e-3, math.radians(7.2)), (4.73e-3, math.radians(3.7))
"""Mean errors of SOFA on the commands themselves: m, rad."""

_POSITION, _ANGLE = 4e-3, math.radians(4.0)
"""What counts as much as each other in the fit of a pose."""


@dataclass(frozen=True)
class Setting:
    """What all poses share. field : T; x, y : m, the sheath's end; heading : rad, from +y to +x."""

    field: float
    x: float
    y: float
    heading: float


FOUND = Setting(field=97e-3, x=2.4e-3, y=-74e-3, heading=0.0)
"""Where the search over the settings starts; near its end."""

IN_THE_VESSEL = Setting(field=97e-3, x=-24e-3, y=-90e-3, heading=0.0)
"""The same for the run among vessels: the sheath lies below its first pose."""


def rod(
    length: np.ndarray, angle: np.ndarray, setting: Setting, soft: float = SOFT
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tips (n, 2) m, their headings (n,) rad, and whether each equilibrium is a minimum, (n,).

    length : (n,) m out of the sheath, more than the soft end's; angle : (n,) rad, of the field from +y to +x
    soft : Pa, modulus of the end
    """
    shaft_bending, soft_bending = SHAFT * SECOND_MOMENT, soft * SECOND_MOMENT
    to_first = shaft_bending / (length - SOFT_LENGTH)  # N·m/rad, from the sheath to the first ring
    to_second = soft_bending / SOFT_LENGTH
    first, second = np.full(length.shape, setting.heading), np.full(length.shape, setting.heading)
    for strength in MOMENT * setting.field * np.linspace(0.1, 1.0, 10):
        for _ in range(5):
            on_first = to_first * (first - setting.heading) - to_second * (second - first)
            on_first -= strength * np.sin(angle - first)
            on_second = to_second * (second - first) - strength * np.sin(angle - second)
            a = to_first + to_second + strength * np.cos(angle - first)
            b = to_second + strength * np.cos(angle - second)
            det = a * b - to_second**2
            safe = np.where(np.abs(det) < 1e-12, 1e-12, det)
            first = first - np.clip((b * on_first + to_second * on_second) / safe, -0.5, 0.5)
            second = second - np.clip((a * on_second + to_second * on_first) / safe, -0.5, 0.5)
    stable = (a > 0) & (det > 0) & (np.hypot(on_first, on_second) < 1e-6 * to_second)
    tip = np.array([setting.x, setting.y])[:, None] + _arc(length - SOFT_LENGTH, setting.heading, first)
    tip = tip + _arc(np.full(length.shape, SOFT_LENGTH), first, second)
    return tip.T, second, stable


def _arc(length: np.ndarray, start: np.ndarray | float, end: np.ndarray) -> np.ndarray:
    """(2, n) m, from the beginning of arcs to their ends: the chord, exactly."""
    half = 0.5 * (end - start)
    chord = length * np.sinc(half / np.pi)
    return chord * np.stack([np.sin(start + half), np.cos(start + half)])


def fitted_poses(poses: np.ndarray, setting: Setting, rounds: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """The length and field angle of each pose, and what is left.

    poses : (n, 3) m, m, rad

    Returns length and angle (n, 2), and the gaps (n, 3) in x, y and heading. A grid over all lengths and angles, then
    finer ones about the best; only minima of the energy count.
    """
    lengths, angles = np.linspace(SOFT_LENGTH + 3e-3, 0.25, 44), np.linspace(-math.pi, math.pi, 61)[1:]
    grid = np.stack(np.meshgrid(lengths, angles, indexing="ij"), axis=-1).reshape(-1, 2)
    tip, heading, stable = rod(grid[:, 0], grid[:, 1], setting)
    cost = _cost(np.column_stack([tip, heading])[None] - poses[:, None], stable)
    best = grid[cost.argmin(axis=1)]
    reach = np.array([lengths[1] - lengths[0], angles[1] - angles[0]])
    near = np.stack(np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7), indexing="ij"), axis=-1).reshape(-1, 2)
    every = np.arange(len(poses))
    for _ in range(rounds):
        trial = best[:, None] + reach * near
        trial[..., 0] = np.maximum(trial[..., 0], SOFT_LENGTH + 1e-3)
        tip, heading, stable = rod(trial[..., 0].ravel(), trial[..., 1].ravel(), setting)
        gaps = np.column_stack([tip, heading]).reshape(len(poses), -1, 3) - poses[:, None]
        which = _cost(gaps, stable.reshape(len(poses), -1)).argmin(axis=1)
        best, left, reach = trial[every, which], gaps[every, which], 0.4 * reach
    return best, left


def _cost(gaps: np.ndarray, stable: np.ndarray) -> np.ndarray:
    size = (gaps[..., 0] ** 2 + gaps[..., 1] ** 2) / _POSITION**2 + (gaps[..., 2] / _ANGLE) ** 2
    return np.where(stable, size, 1e6)


def fitted_setting(poses: np.ndarray, start: Setting = FOUND, evaluations: int = 100) -> Setting:
    """The setting of least mean gap, by the simplex method; (n, 3) poses."""
    scale = np.array([10e-3, 2e-3, 10e-3, 0.05])

    def mean_gap(z: np.ndarray) -> float:
        field, x, y, heading = z * scale
        if field < 1e-3:
            return 1e3
        _, gaps = fitted_poses(poses, Setting(field, x, y, heading), rounds=1)
        return float(np.minimum(np.sqrt(_cost(gaps, np.ones(len(gaps), dtype=np.bool_))), 8.0).mean())

    z = np.array([start.field, start.x, start.y, start.heading]) / scale
    simplex = np.vstack([z, z + np.diag([1.0, 1.0, 0.7, 1.0])])
    options = {"maxfev": evaluations, "initial_simplex": simplex, "xatol": 1e-2, "fatol": 1e-4}
    found = minimize(mean_gap, z, method="Nelder-Mead", options=options)
    field, x, y, heading = (float(v) for v in found.x * scale)
    return Setting(field, x, y, heading)


def measured_poses(file: Path, name: str = RUN) -> np.ndarray:
    """(n, 3) m, m, rad of a run, by default that in the open."""
    rows = [row for row in rows_of_file(file, ("run", "x_m", "y_m", "angle_rad")) if row["run"] == name]
    if not rows:
        raise ValueError(f"{file} must have rows of the run {name!r}")
    return np.array([[float(row[name]) for name in ("x_m", "y_m", "angle_rad")] for row in rows])


def run(file: Path, lumen: Path | None = None) -> Outcome:
    """Fit the setting to every other pose, then length and field angle of each pose; the errors of all.

    lumen : file of the vessel model's walls, see `among_walls`; without it the vessel run is fitted without walls
    """
    poses = measured_poses(file)
    setting = fitted_setting(poses[::2])
    best, gaps = fitted_poses(poses, setting)
    place, turn = np.hypot(gaps[:, 0], gaps[:, 1]), np.abs(gaps[:, 2])
    source = "SOFA on the commands, by its authors"
    angle, sofa_angle = math.degrees(float(turn.mean())), math.degrees(SOFA[1])
    rows: tuple[Row, ...] = (
        published("≤", "open run: mean distance of the tip", "mm", 1e3 * SOFA[0], source, 1e3 * float(place.mean())),
        published("≤", "open run: mean error of the tip's angle", "°", sofa_angle, source, angle),
    )
    held = float(place[1::2].mean())
    vessel = measured_poses(file, VESSEL)
    if lumen is None:
        among, missed = "vessel run, without its walls", _without_walls(vessel)
        walls = (
            "The vessels' walls are not in the data: the rod that is fitted to that run bends in the open, and misses "
            "SOFA's errors, which has the walls; --lumen takes them from a file."
        )
    else:
        among = "vessel run, in its lumen"
        missed, failed = _within_walls(vessel, lumen, setting.field)
        walls = (
            f"In the lumen the robot follows the vessel run under the open run's field; {counted(failed, 'step')} that "
            "were tried out on the way did not converge and do not count."
        )
    rows += (
        published("≤", f"{among}: mean distance of the tip", "mm", 1e3 * SOFA_VESSEL[0], source, 1e3 * missed[0]),
        published("≤", f"{among}: mean error of the tip's angle", "°", math.degrees(SOFA_VESSEL[1]), source,
                  math.degrees(missed[1])),
    )  # fmt: skip
    end = f"({1e3 * setting.x:.3g}, {1e3 * setting.y:.3g}) mm"
    return Outcome(
        rows,
        f"of all poses: field {1e3 * setting.field:.3g} mT, sheath's end {end}, its heading "
        f"{math.degrees(setting.heading):.2g}°; of each pose: inserted length and the field's angle",
        "SOFA had no free parameter a pose, so the two are not alike: two of three numbers a pose are fitted here. The "
        f"{len(place[1::2])} poses that did not fit the setting are off by {1e3 * held:.2f} mm in the mean, the worst "
        f"of all by {1e3 * place.max():.1f} mm and {math.degrees(turn.max()):.1f}°. {walls}",
        {
            "x_m": poses[:, 0], "y_m": poses[:, 1], "angle_rad": poses[:, 2], "x_gap_m": gaps[:, 0],
            "y_gap_m": gaps[:, 1], "angle_gap_rad": gaps[:, 2], "length_m": best[:, 0], "field_angle_rad": best[:, 1],
        },
        lambda path: _draw(poses, gaps, path),
    )  # fmt: skip


def _without_walls(poses: np.ndarray) -> tuple[float, float]:
    """Mean errors, m and rad, of a rod in the open fitted to poses (n, 3), one field for all of them."""
    _, gaps = fitted_poses(poses, fitted_setting(poses[::8], IN_THE_VESSEL, evaluations=60))
    return float(np.hypot(gaps[:, 0], gaps[:, 1]).mean()), float(np.abs(gaps[:, 2]).mean())


def _within_walls(poses: np.ndarray, lumen: Path, field: float) -> tuple[tuple[float, float], int]:
    """Mean errors, m and rad, of the robot that follows poses (n, 3) in a file's lumen, and the steps that failed."""
    gaps, failed = followed(in_the_model(poses), load_lumen(lumen), field, (_POSITION, _ANGLE))
    return (float(np.hypot(gaps[:, 0], gaps[:, 1]).mean()), float(np.abs(gaps[:, 2]).mean())), failed


def _draw(poses: np.ndarray, gaps: np.ndarray, path: Path) -> None:
    ours = poses + gaps
    with styled():
        figure, (left, right) = blank(1, 2, (9.0, 4.0))
        left.plot(1e3 * poses[:, 0], 1e3 * poses[:, 1], "o", color=GREY, markersize=3, label="measured")
        left.plot(1e3 * ours[:, 0], 1e3 * ours[:, 1], ".", color=BLUE, markersize=4, label="rod")
        left.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        left.legend()
        right.plot(1e3 * np.hypot(gaps[:, 0], gaps[:, 1]), color=BLUE, label="tip [mm]")
        right.plot(np.degrees(np.abs(gaps[:, 2])), color=ORANGE, label="angle [°]")
        right.set(xlabel="pose", ylabel="error")
        right.legend()
        figure.savefig(path)
