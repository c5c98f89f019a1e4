"""A second wire model, as small as one can be: a bead that the magnet's drive pushes along the tract, in NumPy.

It proves that environments, controllers and pictures ask the simulator and never the locked wire's own arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from magwire_env.physics import DipoleCloud, force
from magwire_env.scenario import Scenario
from magwire_env.simulation import Library, Places
from magwire_env.simulation.readout import ROW
from magwire_env.simulation.rig_arrays import RigLanes

DRAG = 0.05
"""N·s/m, of the bead: it moves at drive/DRAG."""


class Bead:
    """One node a wire, overdamped: ds/dt = F·t/DRAG, with the rig's dipoles at where the servos have come."""

    name: ClassVar[str] = "bead"
    supports: ClassVar[frozenset[str]] = frozenset()

    def __init__(
        self, library: Library, rig: RigLanes, readout: np.ndarray, trace: np.ndarray, threads: int | None
    ) -> None:
        self.nodes = 1
        self.columns: Mapping[str, slice] = {"place": slice(0, 1)}
        self._scenarios, self._substeps = library.scenarios, library.substeps
        self._h = library.control_period / library.substeps
        self._rig, self._readout, self._trace = rig, readout, trace
        self._s, self._goal = np.zeros(rig.n), np.zeros(rig.n)

    @staticmethod
    def library(scenarios: Sequence[Scenario]) -> Any:
        return None

    def take(self, lanes: np.ndarray, entries: np.ndarray) -> None:
        pass

    def vary(self, lanes: np.ndarray, factors: Mapping[str, np.ndarray]) -> None:
        raise ValueError("Scenario.variation must be empty for the model 'bead'")

    def start(self, entries: np.ndarray) -> Places:
        return Places([self._scenarios[i].wire.length for i in entries])

    def lay(self, lanes: np.ndarray, places: Places) -> None:
        self._s[lanes] = places.s

    def set_goal(self, lanes: np.ndarray, places: Places) -> None:
        self._goal[lanes] = places.s

    def step(self) -> None:
        rig, h, n = self._rig, self._h, self._rig.n
        self._trace[0, :n] = self._goal - self._s
        for k in range(self._substeps):
            most = rig.limits[:, 0, :n] * h
            rig.q[:, :n] += np.clip(rig.command[:, :n] - rig.q[:, :n], -most, most)
            self.refresh(np.arange(n))
            self._s += h * self._readout[ROW.drive, :n] / DRAG
            self._trace[k + 1, :n] = self._goal - self._s
        self.refresh(np.arange(n))
        for peak, now in ((ROW.peak_lateral, ROW.lateral), (ROW.peak_wall, ROW.wall), (ROW.mean_wall, ROW.wall)):
            self._readout[peak, :n] = self._readout[now, :n]

    def refresh(self, lanes: np.ndarray) -> None:
        for lane in lanes:
            sc = self._scenarios[self._rig.entry[lane]]
            point, tangent = sc.tract.position(self._s[lane]), sc.tract.tangent(self._s[lane])
            pull = np.zeros(3)
            for m, mount in enumerate(sc.rig.magnets):
                angle = self._rig.q[m, lane]  # of a rig of magnets with one turn about y each
                c, s = np.cos(angle), np.sin(angle)
                turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
                cloud = mount.magnet.dipoles(*mount.dipoles)
                there = DipoleCloud(np.array(mount.position) + cloud.positions @ turn.T, cloud.moments @ turn.T)
                pull += force(there, point[None], sc.tip.moment * tangent[None])[0]
            drive = pull @ tangent
            out = self._readout[:, lane]
            out[ROW.force_x : ROW.force_x + 3], out[ROW.tip_x : ROW.tip_x + 3] = pull, point
            out[ROW.tangent_x : ROW.tangent_x + 3], out[ROW.drive] = tangent, drive
            out[ROW.lateral] = out[ROW.wall] = np.linalg.norm(pull - drive * tangent)
            out[ROW.speed], out[ROW.travelled] = drive / DRAG, self._s[lane]
            out[ROW.remaining] = self._goal[lane] - self._s[lane]

    def read(self, lanes: np.ndarray) -> np.ndarray:
        return self._s[lanes][:, None]

    def write(self, lanes: np.ndarray, wire: np.ndarray) -> None:
        self._s[lanes] = wire[:, 0]

    def positions(self, lanes: np.ndarray) -> np.ndarray:
        return self._readout[ROW.tip_x : ROW.tip_x + 3, lanes].T[:, None].copy()

    def node_contact(self, lanes: np.ndarray) -> np.ndarray:
        return np.zeros((len(lanes), 1, 3))

    def route_length(self, lanes: np.ndarray) -> np.ndarray:
        return np.array([self._scenarios[i].tract.length for i in self._rig.entry[lanes]])

    def ahead(self, offsets: np.ndarray) -> np.ndarray:
        tracts = [self._scenarios[i].tract for i in self._rig.entry]
        places = self._s[:, None] + offsets
        pairs = list(zip(tracts, places, strict=True))
        return np.concatenate(
            [[f(t, s) for t, s in pairs] for f in (type(tracts[0]).position, type(tracts[0]).tangent)]
            + [[t.curvature_vector(s) for t, s in pairs]],
            axis=2,
        )
