"""The simulator: owns a batch of wires and moves them through control periods; `model` says what moves inside."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..scenario import Scenario
from .library import Library
from .model import Places, WireModel, model_class
from .observed import Observed
from .readout import ROW
from .rig_arrays import RigLanes, aligned_zeros
from .state import SimulatorState, Trajectories

__all__ = ["Simulator", "SimulatorState", "Trajectories"]


class Simulator(Observed):
    """A batch of guidewires.

    scenario : one `Scenario` for all lanes, or a sequence of them, one a lane; the scenarios of a batch may differ in
        everything but their timing, their wire model and the kinds of their rig's degrees of freedom. Also a `Library`,
        with `lane_scenario`, so that several simulators share its rows
    num_envs : number of lanes; by default the length of the sequence, or 1
    threads : threads a step may use; by default all cores for large batches, one for small
    lane_scenario : (num_envs,) numbers into `scenario`, which is then a pool that lanes draw from with `assign`

    Lane numbers are whole numbers from 0 to num_envs − 1 everywhere; others raise `ValueError` before anything moves.
    Calls from several threads wait for one another.

    >>> from magwire_env import Scenario, Simulator
    >>> sim = Simulator(Scenario.paper(), num_envs=2)
    >>> sim.reset(tip_arclength=[0.10, 0.12])
    >>> sim.step(np.full((2, 1), 3.5))
    >>> sim.positions.shape
    (2, 17, 3)
    """

    def __init__(
        self,
        scenario: Scenario | Sequence[Scenario] | Library,
        num_envs: int | None = None,
        threads: int | None = None,
        lane_scenario: np.ndarray | None = None,
    ) -> None:
        if isinstance(scenario, Library):
            scenarios = list(scenario.scenarios)
        else:
            scenarios = [scenario] if isinstance(scenario, Scenario) else list(scenario)
        if not scenarios:
            raise ValueError("scenario must be one scenario or a sequence of at least one, got none")
        if num_envs is None:
            num_envs = len(scenarios) if lane_scenario is None else len(lane_scenario)
        n = num_envs
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
        self.library = scenario if isinstance(scenario, Library) else Library(scenarios)
        self.time = np.zeros(n)
        self._threads, self._period = threads, self.library.control_period
        self._some_step_too_long = bool(self.library.too_long_step.any())
        self._scratch: Simulator | None = None
        self._lock = threading.RLock()
        self.rig = RigLanes(self.library.rigs, self.num_envs)
        self.readout = aligned_zeros(len(ROW), self.rig.lanes)
        """Live rows over the lanes, see `magwire_env.simulation.readout.Readout`: for other compiled code, to read."""
        self.trace = aligned_zeros(self.library.substeps + 1, self.rig.lanes)
        """Live, m: the way left at the start of the last control period and after each of its substeps, a row each."""
        model = model_class(self.library.model)
        self.model: WireModel = model(self.library, self.rig, self.readout, self.trace, threads)
        self._look_at_command()
        self._goal = (np.zeros(n, dtype=np.int64), np.zeros(n))
        self.assign(np.arange(n), lane_scenario)
        self.set_goal(np.arange(n), Places(self.model.route_length(np.arange(n))))
        self.reset()

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k not in ("_lock", "_scratch", "command")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=threading.RLock(), _scratch=None)
        self._look_at_command()

    def _look_at_command(self) -> None:
        self.command = self.rig.command[:, : self.num_envs]
        """(dof, n) rad or m, live: the command of the last or the next step; see `advance`."""

    # --- what it is -------------------------------------------------------------------------------------------------

    @property
    def scenarios(self) -> tuple[Scenario, ...]:
        """The scenario of every lane."""
        return tuple(self.library.scenarios[i] for i in self.lane_scenario)

    @property
    def lane_scenario(self) -> np.ndarray:
        """(n,), the number of every lane's scenario in `library.scenarios`."""
        return self.rig.entry

    @property
    def dof(self) -> int:
        """Length of one lane's command."""
        return self.library.dof

    @property
    def control_period(self) -> float:
        """s."""
        return self.library.control_period

    def supports(self, feature: str) -> bool:
        """Whether the wire model has `feature`, see `magwire_env.simulation.model.FEATURES`."""
        return feature in self.model.supports

    def assign(self, lanes: np.ndarray, scenarios: np.ndarray) -> None:
        """Give `lanes` the library's scenarios of these numbers, (n,) each; the lanes must then be reset."""
        lanes = self._checked_lanes(lanes)
        scenarios = np.asarray(scenarios, dtype=np.int64)
        if scenarios.shape != lanes.shape:
            raise ValueError(f"scenarios must be one number for each of the {len(lanes)} lanes, got {scenarios.shape}")
        if scenarios.size and (scenarios.min() < 0 or scenarios.max() >= len(self.library.scenarios)):
            raise ValueError(f"scenarios must lie in [0, {len(self.library.scenarios) - 1}], got {scenarios.tolist()}")
        with self._lock:
            self.rig.take(lanes, scenarios)
            self.model.take(lanes, scenarios)

    def vary(
        self,
        lanes: np.ndarray,
        friction: np.ndarray,
        stiffness: np.ndarray,
        remanence: np.ndarray,
        placement: np.ndarray,
    ) -> None:
        """Depart from the scenarios in `lanes` until they are next assigned: factors (n,), shifts (n, magnets, 3) m.

        Raises `ValueError` for numbers that are not finite, or factors beyond a thousand, before anything is changed.
        """
        lanes = self._checked_lanes(lanes)
        shift_shape = (len(lanes), self.library.magnet_count, 3)
        given = {"friction": friction, "stiffness": stiffness, "remanence": remanence}
        factors = {name: _numbers(name, value, (len(lanes),), "") for name, value in given.items()}
        shifts = _numbers("placement", placement, shift_shape, "m")
        for name, factor in factors.items():
            if factor.size and not (factor.min() >= 0.0 and factor.max() <= 1e3):
                raise ValueError(f"{name} must lie in [0, 1000], got {factor.min():g} to {factor.max():g}")
        with self._lock:
            self.rig.vary(lanes, factors.pop("remanence"), shifts)
            self.model.vary(lanes, factors)

    # --- moving it --------------------------------------------------------------------------------------------------

    def reset(
        self,
        tip_arclength: np.ndarray | Sequence[float] | float | None = None,
        magnet: np.ndarray | None = None,
        lanes: np.ndarray | None = None,
        places: Places | None = None,
    ) -> None:
        """Lay wires at rest, without stretch.

        tip_arclength : (n,) or one number, m along the first branch; by default the wire just inside the inlet
        places : in place of it, for lumens with branches
        magnet : (n, dof) rad or m; by default each degree of freedom's home
        lanes : (n,) which lanes; by default all
        """
        lanes = np.arange(self.num_envs) if lanes is None else self._checked_lanes(lanes)
        n, entries = len(lanes), self.lane_scenario[lanes]
        if places is None and tip_arclength is None:
            places = self.model.start(entries)
        elif places is None:
            places = Places(_numbers("tip_arclength", tip_arclength, (n,), "m"))
        _check_places(places, "tip_arclength")
        magnet = self.library.home[entries] if magnet is None else self._setting(magnet, n)
        self.lay(lanes, places, magnet)

    def lay(self, lanes: np.ndarray, places: Places, magnet: np.ndarray, goals: Places | None = None) -> None:
        """`reset` of `lanes` (n,), unchecked: tips at `places`, the rig at (n, dof) rad or m, new goals if given."""
        with self._lock:
            self.rig.place(lanes, magnet)
            self.model.lay(lanes, places)
            if goals is not None:
                self._aim(lanes, goals)
            self.model.refresh(lanes)
            self.time[lanes] = 0.0

    def set_rig(self, magnet: np.ndarray, lanes: np.ndarray | None = None) -> None:
        """Put the rig of `lanes` (all by default) to (n, dof) rad or m, as if it had always been there.

        Feed and twist of a wire's base stay as they are: the wire would have to be another one.
        """
        lanes = np.arange(self.num_envs) if lanes is None else self._checked_lanes(lanes)
        magnet = self._setting(magnet, len(lanes))
        with self._lock:
            self.rig.place(lanes, magnet)
            self.model.refresh(lanes)

    def set_goal(self, lanes: np.ndarray, places: Places | np.ndarray) -> None:
        """From now on `remaining` counts the way of `lanes` (n,) to `places`; the readout follows with the next step.

        places : `Places`, or (n,) m along the first branch
        """
        lanes, places = self._checked_lanes(lanes), places if isinstance(places, Places) else Places(places)
        if len(places) != len(lanes):
            raise ValueError(f"places must be one for each of the {len(lanes)} lanes, got {len(places)}")
        _check_places(places, "places")
        self._aim(lanes, places)

    def _aim(self, lanes: np.ndarray, places: Places) -> None:
        with self._lock:
            self._goal[0][lanes], self._goal[1][lanes] = places.branch, places.s
            self.model.set_goal(lanes, places)

    def goals(self, lanes: np.ndarray | None = None) -> Places:
        """The goals of `lanes` (all by default)."""
        branch, s = self._goal
        return Places(s.copy(), branch.copy()) if lanes is None else Places(s[lanes], branch[lanes])

    def goal_of(self, lane: int) -> float:
        """The goal of one lane, m along its branch."""
        return self._goal[1][lane].item()

    def step(self, command: np.ndarray) -> None:
        """Move every wire through one control period.

        command : (num_envs, dof), rad for turns and m for slides; the servos move there at their limited speeds

        Raises `ValueError`, before anything moves, for a command of another shape or that is not finite. Ctrl-C in
        a step takes effect at its end. Calls from several threads take turns.
        """
        command = self._checked(command, self.num_envs, "command").T
        with self._lock:
            self.command[:] = command
            self.advance()

    def advance(self) -> None:
        """`step` under what stands in `command`, unchecked: for callers that write it there themselves."""
        with self._lock:
            try:
                self.model.step()
            finally:  # an interrupt comes when the wires have moved
                self.time += self._period
            if self._some_step_too_long:
                too_long = self.library.too_long_step[self.lane_scenario]
                self.readout[ROW.unconverged, : self.num_envs] += self.library.substeps * too_long

    def refresh(self, lanes: np.ndarray) -> None:
        """Bring the readout of `lanes` (n,) up to date with their state, goals and parameters."""
        with self._lock:
            self.model.refresh(self._checked_lanes(lanes))

    def state(self, lanes: np.ndarray | None = None) -> SimulatorState:
        """A copy of the state of `lanes` (all by default)."""
        lanes = np.arange(self.num_envs) if lanes is None else self._checked_lanes(lanes)
        with self._lock:
            rig = self.rig.q[:, lanes].T.copy()
            return SimulatorState(self.model.read(lanes), rig, self.time[lanes], lanes, self.model.columns)

    def load_state(self, state: SimulatorState) -> None:
        """Put a copied state back into the lanes it came from. Raises `ValueError`, before anything is changed, for a
        state of another simulator's shape or with numbers that are not finite."""
        self._fits(state)
        with self._lock:
            self._write(state.lanes, state)
            self.time[state.lanes] = state.time

    def _write(self, lanes: np.ndarray, state: SimulatorState) -> None:
        self.model.write(lanes, state.wire)
        self.rig.q[:, lanes] = state.magnet.T
        self.model.refresh(lanes)

    def rollout(self, state: SimulatorState, plans: np.ndarray) -> Trajectories:
        """Try plans out from a state, leaving this simulator's own state alone.

        state : n wires
        plans : (K, H, dof) tried from every wire, or (n, K, H, dof) with own plans for each; rad and m; K, H ≥ 1

        Returns `Trajectories` with arrays (n, K, H); for one wire and (K, H, dof) plans (K, H).
        """
        self._fits(state)
        plans = np.asarray(plans, dtype=np.float64)
        single = plans.ndim == 3 and len(state) == 1
        if plans.ndim == 3:
            plans = np.broadcast_to(plans, (len(state), *plans.shape))
        if plans.ndim != 4 or plans.shape[0] != len(state) or plans.shape[3] != self.dof or not plans.size:
            raise ValueError(
                f"plans must have shape (K, H, {self.dof}) or ({len(state)}, K, H, {self.dof}) with K and H at least "
                f"1, got {plans.shape}"
            )
        if not np.isfinite(plans).all():
            raise ValueError("plans must be finite (in rad for turns, m for slides), got NaN or infinity")
        with self._lock:
            return self._tried(state, plans, single)

    def _tried(self, state: SimulatorState, plans: np.ndarray, single: bool) -> Trajectories:
        n, k, horizon, _ = plans.shape
        source = np.repeat(np.arange(n), k)
        lanes, origin = np.arange(n * k), state.lanes[source]
        scratch = self._scratch_for(n * k, self.lane_scenario[origin])
        scratch.set_goal(lanes, self.goals(origin))
        scratch._write(lanes, state[source])
        rows = np.empty((len(_TRIED), horizon, n * k))
        commands = plans.reshape(n * k, horizon, self.dof)
        for step in range(horizon):
            scratch.command[:] = commands[:, step].T
            scratch.advance()
            for row, field in enumerate(_TRIED):
                rows[row, step] = scratch.readout[field, : n * k]
        shape = (k, horizon) if single else (n, k, horizon)
        arrays = rows.transpose(0, 2, 1).reshape(len(_TRIED), *shape)
        time = state.time[source]
        for _ in range(horizon):  # summed as `step` sums it, so that the end equals stepping there
            time = time + self.control_period
        end = dataclasses.replace(scratch.state(), time=time, lanes=origin)
        return Trajectories(*arrays, end)  # type: ignore[call-arg]

    def _scratch_for(self, n: int, entries: np.ndarray) -> Simulator:
        """A simulator for a rollout of n wires, kept between calls of the same size."""
        if self._scratch is None or self._scratch.num_envs != n:
            self._scratch = Simulator(self.library, n, self._threads, entries)
        else:
            self._scratch.assign(np.arange(n), entries)
        return self._scratch

    # --- inside -----------------------------------------------------------------------------------------------------

    def _fits(self, state: SimulatorState) -> None:
        for name in ("wire", "magnet", "time"):
            array = getattr(state, name)
            if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
                raise ValueError(f"state.{name} must be an array of numbers, got {array!r:.80}")
        now = self.state(np.zeros(1, dtype=np.int64))
        wanted = (len(state), now.wire.shape[1])
        if state.wire.shape != wanted or state.magnet.shape != (len(state), self.dof):
            raise ValueError(
                f"state must be of this simulator, with wire of shape {wanted} and magnet of shape "
                f"{(len(state), self.dof)}, got {state.wire.shape} and {state.magnet.shape}"
            )
        self._checked_lanes(state.lanes, "state.lanes")
        self._setting(state.magnet, len(state))
        for name, array in (("wire", state.wire), ("magnet", state.magnet), ("time", state.time)):
            if not np.isfinite(array).all():
                raise ValueError(f"state.{name} must be finite, got NaN or infinity")
        if state.time.shape != (len(state),):
            raise ValueError(f"state.time must have shape ({len(state)},), got {state.time.shape}")

    def _checked_lanes(self, lanes: Any, name: str = "lanes") -> np.ndarray:
        """Whole numbers below `num_envs`: the kernels check no index, so every one that reaches them passes here."""
        array = np.atleast_1d(np.asarray(lanes))
        if array.shape == (0,):
            return array.astype(np.int64)
        if array.ndim != 1 or array.dtype.kind not in "iu":
            raise ValueError(f"{name} must be whole numbers (n,), got {lanes!r}")
        if not array.size or array.min() < 0 or array.max() >= self.num_envs:
            raise ValueError(f"{name} must lie in [0, {self.num_envs - 1}], got {array.tolist()}")
        return array.astype(np.int64, copy=False)

    def _setting(self, value: np.ndarray, n: int) -> np.ndarray:
        """Where a rig is put, (n, dof) rad, m or A."""
        array = self._checked(value, n, "magnet")
        if array.size and np.abs(array).max() > FARTHEST_SETTING:
            raise ValueError(
                f"magnet must lie within ±{FARTHEST_SETTING:g} (rad for turns, m for slides), "
                f"got {array.flat[np.abs(array).argmax()]:g}"
            )
        return array

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


FARTHEST_PLACE = 1e3
"""m, along a tract or its straight extensions."""

FARTHEST_SETTING = 1e6
"""rad, m or A. From farther round, an angle's sine would be lost in rounding."""

_TRIED = (
    ROW.travelled, ROW.remaining, ROW.speed, ROW.drive, ROW.lateral, ROW.torque, ROW.wall, ROW.unconverged,
)  # fmt: skip
"""Rows of the readout that `Trajectories` has, in its order."""


def _check_places(places: Places, name: str) -> None:
    if places.s.size and not np.abs(places.s).max() <= FARTHEST_PLACE:
        raise ValueError(f"{name} must lie within ±{FARTHEST_PLACE:g} m, got {places.s[np.abs(places.s).argmax()]:g}")


def _numbers(name: str, value: Any, shape: tuple[int, ...], unit: str) -> np.ndarray:
    """Finite numbers of one shape, or one number for all."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in ((), shape) or not np.isfinite(array).all():
        many = f"{shape[0]} of them" if len(shape) == 1 else f"an array {shape} of them"
        raise ValueError(f"{name} must be one finite number or {many}{f' (in {unit})' if unit else ''}, got {value!r}")
    return np.broadcast_to(array, shape)
