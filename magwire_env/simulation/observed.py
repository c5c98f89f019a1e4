"""What a simulator lets others see: the wires' readings, one array over the lanes each."""

from __future__ import annotations

import numpy as np

from .library import Library
from .model import WireModel, require
from .readout import ROW
from .rig_arrays import RigLanes

__all__ = ["Observed"]


class Observed:
    """The readings of a batch of n wires; `Simulator` has all of them. Arrays are copies.

    num_envs : n
    library, readout, trace, rig, model : as of `Simulator`
    """

    num_envs: int
    library: Library
    readout: np.ndarray
    trace: np.ndarray
    rig: RigLanes
    model: WireModel

    @property
    def travelled(self) -> np.ndarray:
        """(n,) m, way from the inlet to the tip along the route."""
        return self._row(ROW.travelled)

    @property
    def tip_arclength(self) -> np.ndarray:
        """(n,) m, as `travelled`: along a tract without branches the two are the same."""
        return self._row(ROW.travelled)

    @property
    def remaining(self) -> np.ndarray:
        """(n,) m, way left along the route to the goal, negative once past it.

        In a wrong branch the way back to the route counts too.
        """
        return self._row(ROW.remaining)

    @property
    def remaining_trace(self) -> np.ndarray:
        """(n, substeps + 1) m, the way left through the last control period, its start first."""
        return self.trace[:, : self.num_envs].T.copy()

    @property
    def tip_branch(self) -> np.ndarray:
        """(n,) number of the lumen's branch that the tip is in; where two overlap, that of the route."""
        return self._row(ROW.branch).astype(np.int64)

    @property
    def astray(self) -> np.ndarray:
        """(n,) m, from a tip in a wrong branch back to the route; 0 on the route."""
        return self._row(ROW.astray)

    @property
    def route_length(self) -> np.ndarray:
        """(n,) m, from the inlet along the route to its end."""
        return self.model.route_length(np.arange(self.num_envs))

    @property
    def tip_velocity(self) -> np.ndarray:
        """(n,) m/s, the tip's speed along its way: of the locked wire along the tract."""
        return self._row(ROW.speed)

    @property
    def drive_force(self) -> np.ndarray:
        """(n,) N, the magnets' generalised force along the tip's way, by the scenario's coupling."""
        return self._row(ROW.drive)

    @property
    def lateral_force(self) -> np.ndarray:
        """(n,) N, size of the magnetic force across the tip's way."""
        return self._row(ROW.lateral)

    @property
    def tip_torque(self) -> np.ndarray:
        """(n,) N·m, size of the magnetic torque on the tip."""
        return self._row(ROW.torque)

    @property
    def wall_force(self) -> np.ndarray:
        """(n,) N, on the wall; of the locked wire lateral force plus the couple's two contacts, |F⊥| + 2 τ/lever."""
        return self._row(ROW.wall)

    @property
    def peak_wall_force(self) -> np.ndarray:
        """(n,) N, largest over the substeps of the last control period."""
        return self._row(ROW.peak_wall)

    @property
    def mean_wall_force(self) -> np.ndarray:
        """(n,) N, mean over the substeps of the last control period."""
        return self._row(ROW.mean_wall)

    @property
    def peak_lateral_force(self) -> np.ndarray:
        """(n,) N, largest over the substeps of the last control period."""
        return self._row(ROW.peak_lateral)

    @property
    def unconverged(self) -> np.ndarray:
        """(n,) substeps of the last control period whose solve did not converge; their motion is not to be trusted."""
        return self._row(ROW.unconverged).astype(np.int64)

    @property
    def tip_force(self) -> np.ndarray:
        """(n, 3) N, magnetic force on the tip."""
        return self._rows(ROW.force_x)

    @property
    def tip_field(self) -> np.ndarray:
        """(n, 3) T, flux density at the tip."""
        return self._rows(ROW.field_x)

    @property
    def tip_position(self) -> np.ndarray:
        """(n, 3) m."""
        return self._rows(ROW.tip_x)

    @property
    def tip_tangent(self) -> np.ndarray:
        """(n, 3), the direction of the tip's moment."""
        return self._rows(ROW.tangent_x)

    @property
    def magnet(self) -> np.ndarray:
        """(n, dof) rad or m, where the rig's degrees of freedom are."""
        return self.rig.q[:, : self.num_envs].T.copy()

    @property
    def magnet_positions(self) -> np.ndarray:
        """(n, magnets, 3) m, the magnets' centres as the scenario places them, plus their slides.

        What `vary` shifted them by is not in it: policies, controllers and pictures know the rig as it was set up.
        """
        return self.rig.centres()

    @property
    def positions(self) -> np.ndarray:
        """(n, nodes, 3) m, tail to tip; NaN where a lane has fewer nodes than the batch's longest wire."""
        return self.model.positions(np.arange(self.num_envs))

    @property
    def contact_forces(self) -> np.ndarray:
        """(n, nodes, 3) N, what the wall exerts on every node; of the locked wire known at the tip alone."""
        return self.model.node_contact(np.arange(self.num_envs))

    @property
    def base_force(self) -> np.ndarray:
        """(n, 3) N, what the feed exerts on the wire; 0 of a wire whose base is free. Models without a base refuse."""
        require(self.library.scenarios[0], "base", "base_force")
        return self._rows(ROW.base_force_x)

    @property
    def base_torque(self) -> np.ndarray:
        """(n, 3) N·m, what the sleeve exerts on the wire; as `base_force`."""
        require(self.library.scenarios[0], "base", "base_torque")
        return self._rows(ROW.base_torque_x)

    @property
    def inserted_length(self) -> np.ndarray:
        """(n,) m of wire inside the lumen; as `base_force`."""
        require(self.library.scenarios[0], "base", "inserted_length")
        return self._row(ROW.inserted)

    def ahead(self, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The route's centreline ahead of the tips: offsets (k,) m along it → points (m), unit tangents and curvature
        vectors κ n (1/m), (n, k, 3) each."""
        found = self.model.ahead(np.asarray(offsets, dtype=np.float64))
        return found[..., :3], found[..., 3:6], found[..., 6:]

    def _row(self, row: int) -> np.ndarray:
        return self.readout[row, : self.num_envs].copy()

    def _rows(self, first: int) -> np.ndarray:
        return self.readout[first : first + 3, : self.num_envs].T.copy()
