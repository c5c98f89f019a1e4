"""States of wires as values, and what a rollout returns."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

__all__ = ["SimulatorState", "Trajectories"]


@dataclass(frozen=True, eq=False)
class SimulatorState:
    """The state of n wires, a value: copy, compare, pickle. Arrays are never changed in place.

    wire : (n, k), the model's own numbers, whose columns `columns` names; of the locked wire the nodes' arc lengths
        (m) and speeds (m/s), tail to tip, where a lane with fewer nodes has its last ones at the right
    magnet : (n, dof) rad, m or A
    time : (n,) s
    lanes : (n,) the simulator's lane each row came from
    """

    wire: np.ndarray
    magnet: np.ndarray
    time: np.ndarray
    lanes: np.ndarray
    columns: Mapping[str, slice] = field(default_factory=dict)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SimulatorState):
            return NotImplemented
        return all(np.array_equal(getattr(self, k), getattr(other, k)) for k in _ARRAYS) and dict(self.columns) == dict(
            other.columns
        )

    __hash__ = None  # type: ignore[assignment]

    def __len__(self) -> int:
        return len(self.wire)

    def __getitem__(self, rows: int | slice | np.ndarray) -> SimulatorState:
        """The state of some rows, always a batch: ``state[3]`` holds one wire."""
        rows = np.atleast_1d(np.arange(len(self))[rows])
        return dataclasses.replace(self, **{k: getattr(self, k)[rows] for k in _ARRAYS})

    def part(self, name: str) -> np.ndarray:
        """The columns of this name, (n, …). Raises `ValueError` if the wire model has none of that name."""
        if name not in self.columns:
            raise ValueError(f"state must be of a wire model with {name!r}, got one with {', '.join(self.columns)}")
        return self.wire[:, self.columns[name]]

    @property
    def arclengths(self) -> np.ndarray:
        """(n, nodes) m, of the locked wire."""
        return self.part("arclengths")

    @property
    def velocities(self) -> np.ndarray:
        """(n, nodes) m/s, of the locked wire."""
        return self.part("velocities")

    def replaced(self, magnet: np.ndarray | None = None, **parts: np.ndarray) -> SimulatorState:
        """A copy with another rig, or with other numbers in the columns of these names: (n, k) as `part` gives them, or
        what broadcasts to that. Raises `ValueError` for another shape or name."""
        wire = self.wire.copy()
        for name, value in parts.items():
            column = self.part(name)
            try:
                np.broadcast_to(value, column.shape)
            except ValueError:
                raise ValueError(f"{name} must have shape {column.shape}, got {np.shape(value)}") from None
            wire[:, self.columns[name]] = value
        return dataclasses.replace(self, wire=wire, magnet=self.magnet if magnet is None else np.asarray(magnet))


_ARRAYS = ("wire", "magnet", "time", "lanes")


@dataclass(frozen=True, eq=False)
class Trajectories:
    """What `Simulator.rollout` returns: every array (n, K, H) after each control period, in SI units.

    travelled, remaining : m, way from the inlet to the tip, and from there to the lane's goal
    unconverged : substeps of each control period whose solve did not converge
    end : the n·K final states, plan by plan
    """

    travelled: np.ndarray
    remaining: np.ndarray
    tip_velocity: np.ndarray
    drive_force: np.ndarray
    lateral_force: np.ndarray
    tip_torque: np.ndarray
    wall_force: np.ndarray
    unconverged: np.ndarray
    end: SimulatorState

    @property
    def tip_arclength(self) -> np.ndarray:
        """As `travelled`: along a tract without branches the two are the same."""
        return self.travelled
