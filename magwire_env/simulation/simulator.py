"""The simulator: owns the arrays of a batch of wires and moves them through control periods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..scenario import Scenario
from .locked import algorithm1 as a1
from .locked.arrays import LaneArrays, Library

__all__ = ["Simulator", "SimulatorState", "Trajectories"]


@dataclass(frozen=True, eq=False)
class SimulatorState:
    """The state of n wires, a value: copy, compare, pickle. Arrays are never changed in place.

    arclengths, velocities : (n, nodes) m, m/s, tail to tip; a lane with fewer nodes has its last ones at the right
    magnet : (n, dof) rad or m
    time : (n,) s
    lanes : (n,) the simulator's lane each row came from
    """

    arclengths: np.ndarray
    velocities: np.ndarray
    magnet: np.ndarray
    time: np.ndarray
    lanes: np.ndarray

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SimulatorState):
            return NotImplemented
        return all(np.array_equal(getattr(self, k), getattr(other, k)) for k in self.__dataclass_fields__)

    __hash__ = None  # type: ignore[assignment]

    def __len__(self) -> int:
        return len(self.arclengths)

    def __getitem__(self, rows: int | slice | np.ndarray) -> SimulatorState:
        """The state of some rows, always a batch: ``state[3]`` holds one wire."""
        rows = np.atleast_1d(np.arange(len(self))[rows])
        return SimulatorState(*(getattr(self, k)[rows] for k in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Trajectories:
    """What `Simulator.rollout` returns: every array (n, K, H) after each control period, in SI units.

    `end` holds the n·K final states, plan by plan.
    """

    tip_arclength: np.ndarray
    tip_velocity: np.ndarray
    drive_force: np.ndarray
    lateral_force: np.ndarray
    tip_torque: np.ndarray
    wall_force: np.ndarray
    end: SimulatorState


class Simulator:
    """A batch of guidewires under Algorithm 1.

    scenario : one `Scenario` for all lanes, or a sequence of them, one a lane; the scenarios of a batch may differ in
        everything but their timing and the kinds of their magnets' degrees of freedom
    num_envs : number of lanes; by default the length of the sequence, or 1
    threads : threads a step may use; by default all cores for large batches, one for small
    lane_scenario : (num_envs,) numbers into `scenario`, which is then a pool that lanes draw from with `assign`

    >>> from magwire_env import Scenario, Simulator
    >>> sim = Simulator(Scenario.paper(), num_envs=2)
    >>> sim.reset(tip_arclength=[0.10, 0.12])
    >>> sim.step(np.full((2, 1), 3.5))
    >>> sim.positions.shape
    (2, 17, 3)
    """

    def __init__(
        self,
        scenario: Scenario | Sequence[Scenario],
        num_envs: int | None = None,
        threads: int | None = None,
        lane_scenario: np.ndarray | None = None,
    ) -> None:
        scenarios = [scenario] if isinstance(scenario, Scenario) else list(scenario)
        if not scenarios:
            raise ValueError("scenario must be one scenario or a sequence of at least one, got none")
        n = len(scenarios) if num_envs is None else num_envs
        if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
            raise ValueError(f"num_envs must be a whole number of at least 1, got {num_envs!r}")
        if threads is not None and (isinstance(threads, bool) or not isinstance(threads, int) or threads < 1):
            raise ValueError(f"threads must be a whole number of at least 1, got {threads!r}")
        if lane_scenario is None:
            if len(scenarios) not in (1, n):
                raise ValueError(f"scenario must be one scenario or {n} (num_envs) of them, got {len(scenarios)}")
            unique = list(dict.fromkeys(scenarios))
            number = {sc: i for i, sc in enumerate(unique)}
            lane_scenario = np.array([number[sc] for sc in scenarios] * (n // len(scenarios)))
            scenarios = unique
        self.num_envs = int(n)
        self.library = Library(scenarios)
        self.lane_scenario = np.empty(n, dtype=np.int64)
        self.time = np.zeros(n)
        self._scratch: LaneArrays | None = None
        self.arrays = self._now = LaneArrays(self.library, self.num_envs, threads)
        """What the kernel works on, live: for other compiled code, which must not write but to `command`."""
        self.command = self._now.command[:, : self.num_envs]
        """(dof, n) rad or m, the command of the last or the next step; see `advance`."""
        self.assign(np.arange(n), lane_scenario)
        self.reset()

    # --- what it is -------------------------------------------------------------------------------------------------

    @property
    def scenarios(self) -> tuple[Scenario, ...]:
        """The scenario of every lane."""
        return tuple(self.library.scenarios[i] for i in self.lane_scenario)

    @property
    def dof(self) -> int:
        """Length of one lane's command."""
        return self.library.dof

    @property
    def control_period(self) -> float:
        """s."""
        return self.library.timing.control_period

    def assign(self, lanes: np.ndarray, scenarios: np.ndarray) -> None:
        """Give `lanes` the library's scenarios of these numbers, (n,) each; the lanes must then be reset."""
        scenarios = np.asarray(scenarios, dtype=np.int64)
        if scenarios.size and (scenarios.min() < 0 or scenarios.max() >= len(self.library.scenarios)):
            raise ValueError(f"scenarios must lie in [0, {len(self.library.scenarios) - 1}], got {scenarios.tolist()}")
        self.lane_scenario[lanes] = scenarios
        self._now.take(lanes, scenarios)

    def vary(
        self,
        lanes: np.ndarray,
        friction: np.ndarray,
        stiffness: np.ndarray,
        remanence: np.ndarray,
        placement: np.ndarray,
    ) -> None:
        """Depart from the scenarios in `lanes` until they are next assigned: factors (n,), shifts (n, magnets, 3) m."""
        self._now.vary(lanes, friction, stiffness, remanence, placement)

    # --- moving it --------------------------------------------------------------------------------------------------

    def reset(
        self,
        tip_arclength: np.ndarray | Sequence[float] | float | None = None,
        magnet: np.ndarray | None = None,
        lanes: np.ndarray | None = None,
    ) -> None:
        """Lay wires at rest along their tracts, every segment at its rest length.

        tip_arclength : (n,) or one number, m; by default the wire's length, so that it lies just inside the tract
        magnet : (n, dof) rad or m; by default each degree of freedom's home
        lanes : (n,) which lanes; by default all
        """
        lanes = np.arange(self.num_envs) if lanes is None else np.asarray(lanes, dtype=np.int64)
        n, entries = len(lanes), self.lane_scenario[lanes]
        tip = (
            self.library.wire_length[entries] if tip_arclength is None else np.asarray(tip_arclength, dtype=np.float64)
        )
        if tip.shape not in ((), (n,)) or not np.isfinite(tip).all():
            raise ValueError(f"tip_arclength must be one finite number or {n} of them (in m), got {tip_arclength!r}")
        magnet = self.library.home[entries] if magnet is None else self._checked(magnet, n, "magnet")
        self.lay(lanes, np.broadcast_to(tip, (n,)), magnet)

    def lay(self, lanes: np.ndarray, tip_arclength: np.ndarray, magnet: np.ndarray) -> None:
        """`reset` of `lanes` (n,), unchecked: tips at (n,) m, magnets at (n, dof) rad or m."""
        self._now.lay_at_rest(lanes, tip_arclength)
        self._now.q[:, lanes] = magnet.T
        self._now.refresh(lanes)
        self.time[lanes] = 0.0

    def step(self, command: np.ndarray) -> None:
        """Move every wire through one control period.

        command : (num_envs, dof), rad for turns and m for slides; the servos move there at their limited speeds

        Raises `ValueError`, before anything moves, for a command of another shape or that is not finite.
        """
        self.command[:] = self._checked(command, self.num_envs, "command").T
        self.advance()

    def advance(self) -> None:
        """`step` under what stands in `command`, unchecked: for callers that write it there themselves."""
        self._now.step()
        self.time += self.control_period

    def state(self, lanes: np.ndarray | None = None) -> SimulatorState:
        """A copy of the state of `lanes` (all by default)."""
        lanes = np.arange(self.num_envs) if lanes is None else np.atleast_1d(np.asarray(lanes, dtype=np.int64))
        return SimulatorState(*self._now.read(lanes), self.time[lanes], lanes)

    def load_state(self, state: SimulatorState) -> None:
        """Put a copied state back into the lanes it came from."""
        self._fits(state)
        self._now.write(state.lanes, state.arclengths, state.velocities, state.magnet)
        self._now.refresh(state.lanes)
        self.time[state.lanes] = state.time

    def rollout(self, state: SimulatorState, plans: np.ndarray) -> Trajectories:
        """Try plans out from a state, leaving this simulator's own state alone.

        state : n wires
        plans : (K, H, dof) tried from every wire, or (n, K, H, dof) with own plans for each; rad and m

        Returns `Trajectories` with arrays (n, K, H); for one wire and (K, H, dof) plans (K, H).
        """
        self._fits(state)
        plans = np.asarray(plans, dtype=np.float64)
        single = plans.ndim == 3 and len(state) == 1
        if plans.ndim == 3:
            plans = np.broadcast_to(plans, (len(state), *plans.shape))
        if plans.ndim != 4 or plans.shape[0] != len(state) or plans.shape[3] != self.dof:
            raise ValueError(
                f"plans must have shape (K, H, {self.dof}) or ({len(state)}, K, H, {self.dof}), got {plans.shape}"
            )
        if not np.isfinite(plans).all():
            raise ValueError("plans must be finite (in rad for turns, m for slides), got NaN or infinity")
        n, k, horizon, _ = plans.shape
        source = np.repeat(np.arange(n), k)
        lanes = np.arange(n * k)
        moves = self._scratch_arrays(n * k)
        moves.take(lanes, self.lane_scenario[state.lanes[source]])
        moves.write(lanes, state.arclengths[source], state.velocities[source], state.magnet[source])
        moves.refresh(lanes)
        results = np.empty((6, horizon, n * k))
        commands = plans.reshape(n * k, horizon, self.dof)
        for step in range(horizon):
            moves.command[:, : n * k] = commands[:, step].T
            moves.step()
            for row, field in enumerate((a1.TIP_S, a1.TIP_V, a1.DRIVE, a1.LATERAL, a1.TORQUE, a1.WALL)):
                results[row, step] = moves.result(field)
        shape = (k, horizon) if single else (n, k, horizon)
        arrays = results.transpose(0, 2, 1).reshape(6, *shape)
        time = state.time[source]
        for _ in range(horizon):  # summed as `step` sums it, so that the end equals stepping there
            time = time + self.control_period
        return Trajectories(*arrays, SimulatorState(*moves.read(lanes), time, state.lanes[source]))  # type: ignore[call-arg]

    # --- looking at it ----------------------------------------------------------------------------------------------

    @property
    def tip_arclength(self) -> np.ndarray:
        """(n,) m."""
        return self._now.result(a1.TIP_S)

    @property
    def tip_velocity(self) -> np.ndarray:
        """(n,) m/s along the tract."""
        return self._now.result(a1.TIP_V)

    @property
    def drive_force(self) -> np.ndarray:
        """(n,) N, the magnets' generalised force along the tract, by the scenario's coupling."""
        return self._now.result(a1.DRIVE)

    @property
    def lateral_force(self) -> np.ndarray:
        """(n,) N, size of the magnetic force across the tract."""
        return self._now.result(a1.LATERAL)

    @property
    def tip_torque(self) -> np.ndarray:
        """(n,) N·m, size of the magnetic torque on the tip."""
        return self._now.result(a1.TORQUE)

    @property
    def wall_force(self) -> np.ndarray:
        """(n,) N, lateral force plus the couple's two contacts, |F⊥| + 2 τ/lever."""
        return self._now.result(a1.WALL)

    @property
    def peak_wall_force(self) -> np.ndarray:
        """(n,) N, largest over the substeps of the last control period."""
        return self._now.result(a1.PEAK_WALL)

    @property
    def mean_wall_force(self) -> np.ndarray:
        """(n,) N, mean over the substeps of the last control period."""
        return self._now.result(a1.MEAN_WALL)

    @property
    def peak_lateral_force(self) -> np.ndarray:
        """(n,) N, largest over the substeps of the last control period."""
        return self._now.result(a1.PEAK_LATERAL)

    @property
    def tip_force(self) -> np.ndarray:
        """(n, 3) N, magnetic force on the tip."""
        return self._now.results(a1.FX)

    @property
    def tip_field(self) -> np.ndarray:
        """(n, 3) T, flux density at the tip."""
        return self._now.results(a1.BX)

    @property
    def tip_position(self) -> np.ndarray:
        """(n, 3) m."""
        return self._now.results(a1.TIP_X)

    @property
    def tip_tangent(self) -> np.ndarray:
        """(n, 3), the direction of the tip's moment."""
        return self._now.results(a1.TAN_X)

    @property
    def magnet(self) -> np.ndarray:
        """(n, dof) rad or m, where the degrees of freedom are."""
        return self._now.lanes_first(self._now.q)

    @property
    def magnet_positions(self) -> np.ndarray:
        """(n, magnets, 3) m, the magnets' centres."""
        count = self.library.magnet_count
        centres = self.library.magnets[self.lane_scenario, :count, :3].copy()
        q = self.magnet
        for m, slots in enumerate(self.library.rig[:count]):
            for axis in range(3):
                if slots[2 + axis] >= 0:
                    centres[:, m, axis] += q[:, slots[2 + axis]]
        return centres

    @property
    def tip_trace(self) -> np.ndarray:
        """(n, substeps + 1) m, the tip's arc length through the last control period, its start first."""
        return self._now.lanes_first(self._now.trace)

    def distance_to(self, goal: np.ndarray) -> np.ndarray:
        """Way left along the lumen from the tip to arc lengths `goal` (n,) m → (n,) m, negative once past it."""
        return goal - self.tip_arclength

    def look_ahead(self, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The centreline ahead of the tips: offsets (k,) m along it → points (n, k, 3) m, unit tangents (n, k, 3)."""
        return self.library.centreline(self.lane_scenario, self.tip_arclength[:, None] + np.asarray(offsets))

    @property
    def positions(self) -> np.ndarray:
        """(n, nodes, 3) m, tail to tip; NaN where a lane has fewer nodes than the batch's largest wire."""
        return self.library.positions(self.lane_scenario, self._now.arclengths())

    # --- inside -----------------------------------------------------------------------------------------------------

    def _scratch_arrays(self, n: int) -> LaneArrays:
        """Arrays for a rollout of n wires, kept between calls of the same size."""
        if self._scratch is None or self._scratch.n != n:
            self._scratch = LaneArrays(self.library, n, self._now.threads)
        return self._scratch

    def _fits(self, state: SimulatorState) -> None:
        wanted = (len(state), self.library.nodes)
        if state.arclengths.shape != wanted or state.magnet.shape != (len(state), self.dof):
            raise ValueError(
                f"state must be of this simulator, with arclengths of shape {wanted}, got {state.arclengths.shape}"
            )
        if len(state) and (state.lanes.min() < 0 or state.lanes.max() >= self.num_envs):
            raise ValueError(f"state.lanes must lie in [0, {self.num_envs - 1}], got {state.lanes.tolist()}")

    def _checked(self, value: np.ndarray, n: int, name: str) -> np.ndarray:
        array = np.asarray(value, dtype=np.float64)
        if array.shape != (n, self.dof):
            raise ValueError(f"{name} must have shape ({n}, {self.dof}), got {array.shape}")
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            raise ValueError(
                f"{name}[{row}] must be finite (in rad for turns, m for slides), got {array[row].tolist()}"
            )
        return array
