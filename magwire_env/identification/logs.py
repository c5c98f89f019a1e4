"""Logs: what was commanded and what was measured, control period by control period.

A log is a CSV file in SI units (s, m, rad, A, N, N·m), comma separated, with one header line; lines that begin with "#"
are remarks. A row is one moment: what was measured then, and the command that is held from then on to the next row. The
rows follow each other at the scenario's control period. Columns:

episode      optional: a number; the wire lies at rest, without stretch, in the first row of each episode
time         s
command_0 …  rad, m or A: what each degree of freedom of the rig was told, in the order of the scenario's rig
rig_0 …      optional: where it stood; the first row of an episode counts; by default its home
others       what was measured, of `MEASURED`, as many as there are; an empty cell is a moment without a measurement
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..scenario import Scenario
from ..simulation import Simulator

__all__ = ["MEASURED", "Episode", "Log", "Quantity", "start_of"]

_MOST_BYTES = 256 * 2**20
_MAGNITUDES = {"m": 100.0, "N": 1e4, "N·m": 1e4, "m/s": 1e3, "": 1.0001}
"""Values beyond these are refused: most likely they are not in SI units."""


class Quantity(NamedTuple):
    """Something that may be measured.

    kind : measurements of one kind are taken to have the same noise
    attribute, component : where the simulator has it
    noise : a first guess of the noise's standard deviation, refined by the fit
    """

    unit: str
    kind: str
    attribute: str
    component: int | None
    noise: float
    text: str

    def of(self, sim: Simulator) -> np.ndarray:
        """(n,) its present values in the lanes."""
        values = np.asarray(getattr(sim, self.attribute))
        return values if self.component is None else values[:, self.component]


def _vector(name: str, unit: str, kind: str, attribute: str, noise: float, text: str) -> dict[str, Quantity]:
    return {
        f"{name}_{axis}": Quantity(unit, kind, attribute, i, noise, f"{text}, {axis}") for i, axis in enumerate("xyz")
    }


MEASURED: dict[str, Quantity] = {
    **_vector("tip", "m", "position", "tip_position", 1e-3, "position of the tip"),
    **_vector("tangent", "", "direction", "tip_tangent", 2e-2, "direction of the tip"),
    "tip_arclength": Quantity("m", "arc length", "travelled", None, 1e-3, "way from the inlet to the tip"),
    "tip_speed": Quantity("m/s", "speed", "tip_velocity", None, 1e-2, "speed of the tip along its way"),
    "drive_force": Quantity("N", "force", "drive_force", None, 1e-3, "magnets' force along the tip's way"),
    "lateral_force": Quantity("N", "force", "lateral_force", None, 1e-3, "magnetic force across that way"),
    "wall_force": Quantity("N", "wall force", "wall_force", None, 1e-2, "force on the wall"),
    "tip_torque": Quantity("N·m", "torque", "tip_torque", None, 1e-5, "magnetic torque on the tip"),
    **_vector("base_force", "N", "base force", "base_force", 1e-3, "force that holds the wire's base"),
    **_vector("base_torque", "N·m", "base torque", "base_torque", 1e-5, "torque that holds the wire's base"),
    "inserted_length": Quantity("m", "arc length", "inserted_length", None, 1e-3, "wire beyond the inlet"),
}
"""Column → what it holds. `base_force`, `base_torque` and `inserted_length` are of wire models that have them."""


@dataclass(frozen=True, eq=False)
class Episode:
    """One run from rest.

    time : (T,) s
    commands : (T, dof) rad, m or A
    rig : (dof,) where the rig stood at first, or None for its home
    measured : column → (T,), NaN where nothing was measured
    """

    time: np.ndarray
    commands: np.ndarray
    rig: np.ndarray | None
    measured: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, eq=False)
class Log:
    """Episodes with the same columns; `load` reads a CSV file and `save` writes one."""

    episodes: tuple[Episode, ...]

    def __post_init__(self) -> None:
        if not self.episodes:
            raise ValueError("Log.episodes must hold at least one episode, got none")

    @property
    def columns(self) -> tuple[str, ...]:
        """Which quantities were measured."""
        return tuple(self.episodes[0].measured)

    @property
    def dof(self) -> int:
        """Degrees of freedom of the rig."""
        return self.episodes[0].commands.shape[1]

    def fits(self, scenario: Scenario) -> None:
        """Raise `ValueError` if the log cannot be of this scenario."""
        if self.dof != len(scenario.rig.dofs):
            raise ValueError(
                f"the log must have a command column for each of the {len(scenario.rig.dofs)} degrees of freedom "
                f"({', '.join(scenario.rig.names)}), got {self.dof}"
            )
        period = scenario.timing.control_period
        for number, episode in enumerate(self.episodes):
            gaps = np.diff(episode.time)
            if len(episode) < 2:
                raise ValueError(f"episode {number} must have at least 2 rows, got {len(episode)}")
            if np.abs(gaps - period).max() > 0.05 * period:
                row = int(np.abs(gaps - period).argmax())
                raise ValueError(
                    f"time must grow by the scenario's control period of {period:g} s from row to row, got "
                    f"{gaps[row]:g} s after row {row} of episode {number}; resample the log"
                )

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read a CSV file. Raises `ValueError` that names the line and column of what is wrong."""
        file = Path(path)
        if file.stat().st_size > _MOST_BYTES:
            raise ValueError(f"{file} is {file.stat().st_size} bytes long, more than the {_MOST_BYTES} of a log")
        with file.open(newline="", encoding="utf-8-sig") as stream:
            lines = [(i, line) for i, line in enumerate(stream, 1) if line.strip() and not line.startswith("#")]
        rows = list(csv.reader(line for _, line in lines))
        if len(rows) < 2:
            raise ValueError(f"{file} must have a header and at least one row, got {len(rows)} lines")
        header = [name.strip() for name in rows[0]]
        table = np.empty((len(rows) - 1, len(header)))
        for k, row in enumerate(rows[1:]):
            where = f"{file}, line {lines[k + 1][0]}"
            if len(row) != len(header):
                raise ValueError(f"{where} must have {len(header)} cells as the header has, got {len(row)}")
            table[k] = [_number(cell, f"{where}, column {name!r}") for name, cell in zip(header, row, strict=True)]
        return cls(_episodes(header, table, str(file)))

    def save(self, path: str | Path) -> None:
        """Write a CSV file."""
        first = self.episodes[0]
        rig = [] if first.rig is None else [f"rig_{i}" for i in range(self.dof)]
        header = ["episode", "time", *(f"command_{i}" for i in range(self.dof)), *rig, *self.columns]
        with Path(path).open("w", newline="", encoding="utf-8") as stream:
            stream.write("# SI units: s, m, rad, A, N, N·m; a row's command is held until the next row\n")
            writer = csv.writer(stream)
            writer.writerow(header)
            for number, episode in enumerate(self.episodes):
                for k in range(len(episode)):
                    placed = ([] if episode.rig is None else list(episode.rig)) if k == 0 else [math.nan] * len(rig)
                    cells = [episode.time[k], *episode.commands[k], *placed]
                    cells += [episode.measured[name][k] for name in self.columns]
                    writer.writerow([number, *("" if math.isnan(x) else f"{x:.9g}" for x in cells)])


def _number(cell: str, where: str) -> float:
    if not cell.strip():
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        raise ValueError(f"{where} must be a number or empty, got {cell!r}") from None
    if math.isinf(value):
        raise ValueError(f"{where} must be finite or empty, got {cell!r}")
    return value


def _episodes(header: Sequence[str], table: np.ndarray, where: str) -> tuple[Episode, ...]:
    place = {name: i for i, name in enumerate(header)}
    if len(place) != len(header):
        raise ValueError(f"{where} must name every column once, got {', '.join(header)}")
    commands = sorted((n for n in place if n.startswith("command_")), key=lambda n: (len(n), n))
    rig = [n.replace("command", "rig") for n in commands]
    if "time" not in place or not commands or commands != [f"command_{i}" for i in range(len(commands))]:
        raise ValueError(f"{where} must have the columns time, command_0, command_1, …, got {', '.join(header)}")
    rig = [n for n in rig if n in place]
    if len(rig) not in (0, len(commands)):
        raise ValueError(f"{where} must have all of rig_0 … rig_{len(commands) - 1} or none, got {', '.join(rig)}")
    measured = [n for n in place if n not in {"episode", "time", *commands, *rig}]
    unknown = [n for n in measured if n not in MEASURED]
    if unknown or not measured:
        got = repr(unknown[0]) if unknown else "none"
        raise ValueError(f"{where} must have columns of what was measured, of {', '.join(MEASURED)}; got {got}")
    for name in measured:
        _in_si(name, table[:, place[name]], where)
    for name in ("time", *commands):
        if np.isnan(table[:, place[name]]).any():
            raise ValueError(f"{where} must have a number in every cell of the column {name!r}")
    numbers = table[:, place["episode"]] if "episode" in place else np.zeros(len(table))
    changes = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
    found = []
    for part in np.split(table, changes):
        at = part[0, [place[n] for n in rig]] if rig else None
        if at is not None and np.isnan(at).any():
            raise ValueError(f"{where} must say in the first row of every episode where the rig stood ({rig[0]} …)")
        found.append(
            Episode(part[:, place["time"]], part[:, [place[n] for n in commands]], at,
                    {n: part[:, place[n]] for n in measured})
        )  # fmt: skip
    return tuple(found)


def _in_si(name: str, values: np.ndarray, where: str) -> None:
    most = _MAGNITUDES[MEASURED[name].unit]
    seen = np.abs(values[np.isfinite(values)])
    if seen.size and seen.max() > most and name.split("_")[0] != "tangent":
        raise ValueError(
            f"{where} must have {name!r} in SI units ({MEASURED[name].unit}), within ±{most:g}, got {seen.max():g}"
        )


def start_of(episode: Episode, scenario: Scenario, number: int = 0) -> float:
    """Where the tip seems to lie in the first row, m along the tract, from its arc length or position."""
    for name in ("tip_arclength", "inserted_length"):
        if name in episode.measured and math.isfinite(episode.measured[name][0]):
            return float(episode.measured[name][0])
    tip = [episode.measured.get(f"tip_{axis}", np.array([math.nan]))[0] for axis in "xyz"]
    if not np.isfinite(tip).all():
        raise ValueError(
            f"the first row of episode {number} must say where the tip is: tip_arclength, or tip_x, tip_y and tip_z"
        )
    return float(scenario.tract.project(np.array([tip]))[0])
