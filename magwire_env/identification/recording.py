"""Making logs: from the simulator, with noise; from Minari data sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..physics.checks import in_range, non_negative, one_of, positive, whole
from ..quasistatic import best_command
from ..scenario import Scenario, Turn
from ..simulation import Simulator
from .logs import MEASURED, Episode, Log

__all__ = ["Excitation", "Recorder", "from_minari", "record", "turns_of"]


def turns_of(scenario: Scenario) -> np.ndarray:
    """(dof,) 1 for turns, 0 for slides and currents."""
    return np.array([float(isinstance(d, Turn)) for d in scenario.rig.dofs])


class Excitation:
    """Commands that tell parameters apart: to and fro along the tract, with holds, turning off the best angle.

    Forward and back by the command of greatest drive, so that friction and bending change sides; now and then the rig
    is led slowly past the command, so that the wire comes to rest and breaks loose again.

    reach : (lowest, highest) arc length of the tip, m
    """

    def __init__(self, scenario: Scenario, reach: tuple[float, float] | None = None) -> None:
        length = scenario.tract.length
        low, high = reach or (scenario.wire.length, 0.9 * length)
        self.low = in_range("reach[0]", low, 0.0, length, "m")
        self.high = in_range("reach[1]", high, self.low, length, "m")
        self._places = np.linspace(0.0, length, 161)
        self._commands = [best_command(scenario, self._places, sign)[0] for sign in (-1.0, 1.0)]
        self._forward, self._turns = True, turns_of(scenario)

    def __call__(self, sim: Simulator, step: int) -> np.ndarray:
        """(1, dof) the command of control period `step`."""
        tip, seconds = float(sim.travelled[0]), step * sim.control_period
        if tip > self.high:
            self._forward = False
        elif tip < self.low:
            self._forward = True
        ahead = self._forward if seconds % 5.0 < 3.5 else not self._forward
        best = self._commands[int(ahead)][np.abs(self._places - tip).argmin()]
        aside = 0.9 * np.sin(2 * np.pi * 0.23 * seconds) * self._turns
        return (best + aside)[None]


class Recorder:
    """Collects one episode of one lane: `note` before every step with the command, and once more at the end.

    columns : of `MEASURED`
    noise : kind of measurement → standard deviation of white noise, SI
    """

    def __init__(self, columns: Sequence[str], noise: Mapping[str, float], rng: np.random.Generator) -> None:
        self.columns = tuple(one_of("columns", c, tuple(MEASURED)) for c in columns)
        self._noise = {one_of("noise", k, tuple({MEASURED[c].kind for c in columns})): v for k, v in noise.items()}
        for kind, value in self._noise.items():
            non_negative(f"noise[{kind!r}]", value)
        self._rng = rng
        self._rows: list[tuple[float, np.ndarray, list[float]]] = []
        self._rig: np.ndarray | None = None

    def note(self, sim: Simulator, command: np.ndarray) -> None:
        """A row: what lane 0 of `sim` is now, and its command (dof,)."""
        if self._rig is None:
            self._rig = sim.magnet[0].copy()
        seen = []
        for name in self.columns:
            quantity = MEASURED[name]
            seen.append(float(quantity.of(sim)[0]) + self._noise.get(quantity.kind, 0.0) * self._rng.standard_normal())
        self._rows.append((float(sim.time[0]), np.array(command, dtype=float), seen))

    def episode(self) -> Episode:
        """What was collected."""
        times, commands, seen = zip(*self._rows, strict=True)
        columns = np.array(seen)
        return Episode(
            np.array(times), np.array(commands), self._rig, {n: columns[:, i] for i, n in enumerate(self.columns)}
        )


def record(
    scenario: Scenario,
    commands: np.ndarray | Callable[[Simulator, int], np.ndarray] | None = None,
    seconds: float = 20.0,
    start: float | None = None,
    columns: Sequence[str] = ("tip_x", "tip_y", "tip_z"),
    noise: Mapping[str, float] | None = None,
    seed: int = 0,
    episodes: int = 1,
) -> Log:
    """A log that the simulator makes.

    commands : (T, dof) rad, m or A; or (simulator, number of the control period) → (1, dof); by default `Excitation`
    start : m, where the tip lies at first, by default 1.5 times the wire's length; of several episodes the first, and
        the others begin farther on, evenly spread up to 0.7 of the tract
    columns : what is measured, of `MEASURED`
    noise : kind of measurement → standard deviation, SI; by default 1 mm for positions and nothing for others
    """
    positive("seconds", seconds, "s")
    whole("episodes", episodes, 1)
    sim = Simulator(scenario, 1, threads=1)
    steps = max(1, round(seconds / sim.control_period))
    if commands is None:
        commands = Excitation(scenario)
    if not callable(commands):
        commands = np.asarray(commands, dtype=np.float64)
        steps = min(steps, len(commands))
    start = min(1.5 * scenario.wire.length, 0.5 * scenario.tract.length) if start is None else start
    in_range("start", start, 0.0, scenario.tract.length, "m")
    if noise is None:
        noise = {"position": 1e-3} if any(MEASURED[c].kind == "position" for c in columns if c in MEASURED) else {}
    rng, found = np.random.default_rng(seed), []
    last = max(start, 0.7 * scenario.tract.length)
    for begins in np.linspace(start, last, episodes):
        sim.reset(tip_arclength=begins)
        recorder = Recorder(columns, noise, rng)
        for step in range(steps):
            command = commands(sim, step) if callable(commands) else commands[step][None]
            recorder.note(sim, command[0])
            sim.step(command)
        recorder.note(sim, command[0])
        found.append(recorder.episode())
    return Log(tuple(found))


def from_minari(dataset: Any) -> Log:
    """A log from a Minari data set of one of our environments.

    dataset : a `minari.MinariDataset`, or the id of a local one

    Actions become commands by the data set's own environment; of the observation those numbers become measurements that
    show a quantity of `MEASURED` in the simulator's unit. Raises `ValueError` for a data set of other environments, of
    action mode "rate" (whose commands depend on where the rig is), or without such numbers.
    """
    if isinstance(dataset, str):
        try:
            import minari
        except ImportError as error:
            raise ValueError("dataset must be a data set unless the package minari is installed, got an id") from error
        dataset = minari.load_dataset(dataset)
    env = dataset.recover_environment()
    core = getattr(env.unwrapped, "core", None)
    if core is None:
        raise ValueError(f"dataset must be of a MagWire environment, got one of {env!r}")
    if core.actuation.mode == "rate":
        raise ValueError("dataset must have absolute actions (action_mode 'angle' or 'direction'), got 'rate'")
    columns = _seen_columns(core)
    home = core.sim.library.home[0]
    found = []
    for episode in dataset.iterate_episodes():
        observed = np.asarray(episode.observations, dtype=np.float64)
        commands = np.array([core.actuation.command(action[None])[0] for action in np.asarray(episode.actions)])
        commands = np.vstack([commands, commands[-1:]])
        measured = {name: scale * observed[:, at] for name, (at, scale) in columns.items()}
        time = core.sim.control_period * np.arange(len(observed))
        found.append(Episode(time, commands, _first_rig(core, observed[0], home), measured))
    env.close()
    return Log(tuple(found))


def _seen_columns(core: Any) -> dict[str, tuple[int, float]]:
    """Measured column → its place in the observation, and what one there stands for."""
    from ..envs import kernels
    from ..simulation.readout import ROW

    rows = {ROW.tip_x: "tip_x", ROW.tip_y: "tip_y", ROW.tip_z: "tip_z", ROW.speed: "tip_speed",
            ROW.drive: "drive_force", ROW.lateral: "lateral_force", ROW.wall: "wall_force", ROW.torque: "tip_torque",
            ROW.tangent_x: "tangent_x", ROW.tangent_y: "tangent_y", ROW.tangent_z: "tangent_z"}  # fmt: skip
    found: dict[str, tuple[int, float]] = {}
    for at, number in enumerate(core.observer.numbers):
        if number.kind == kernels.TRAVELLED:
            found["tip_arclength"] = at, float(core.sim.route_length[0])
        elif number.kind == kernels.RESULT and number.row in rows:
            found[rows[number.row]] = at, number.scale
    if not found:
        raise ValueError(f"dataset must show a measured quantity in its observation, got {core.observer.names}")
    return found


def _first_rig(core: Any, observed: np.ndarray, home: np.ndarray) -> np.ndarray:
    """Where the rig stood, from the observation's sines and cosines; its home where they are not shown."""
    from ..envs import kernels

    rig, limits = home.copy(), core.sim.library.limits
    for at, number in enumerate(core.observer.numbers):
        if number.kind == kernels.SINE:
            rig[number.row] = home[number.row] + np.arctan2(observed[at], observed[at + 1])
        elif number.kind == kernels.SLIDE:
            low, high = limits.low[0, number.row], limits.high[0, number.row]
            rig[number.row] = 0.5 * (low + high) + 0.5 * (high - low) * observed[at]
    return rig
