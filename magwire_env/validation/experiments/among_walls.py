"""E2 among vessels: the magnetic continuum robot pushed through a lumen, following the measured poses in turn.

The model's walls are not in the data of the poses. The robot's authors publish them as a surface,
``mesh/flat_models/flat_model_vessels.stl`` in ethz-msrl/mCR_simulator, in mm, and in ``config/video_9976.yaml`` how it
lies in the frame of the poses: turned by 89.5° about z. A lumen in any file that `Lumen.load` reads is taken in that
surface's own frame; of a surface the wall is taken to be the plate about the channels.

Inserted length and the field's angle are unknown at each pose, as in the open. Here they cannot be fitted pose by pose,
since where the robot lies depends on its way there. So it is followed: from its best state at one pose, a batch of
lengths and angles is tried out, and the one that comes nearest to the next pose is where it goes on from.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from ...lumen.lumen import Lumen
from ...physics.guidewire import Guidewire
from ...physics.magnets import CylinderMagnet
from ...scenario import Coil, Contact, Current, Feed, Rig, Scenario
from ...simulation.readout import ROW
from ...simulation.simulator import Simulator
from ...simulation.state import SimulatorState

__all__ = ["INLET", "followed", "in_lumen", "in_the_model", "load_lumen"]

TURN = math.radians(89.5)
"""rad, of the model about z in the frame of the poses."""
OFFSET = np.array([-1e-3, 4e-3])
"""m, that the authors' evaluation adds to the measured places."""
SHEATH = np.array([-25e-3, -90e-3])
"""m, in the frame of the poses: where the sheath ends and the lumen's inlet must be."""
FRICTION = 0.01
"""Of the authors' simulation."""

_LENGTH, _SEGMENTS = 0.35, 70
_TESLA = 1e-3  # T/A of both coils
_REACH = 12e-3, math.radians(45.0)  # m and rad, from one pose to the next at most
_TRIES = 7  # of either
_ROUNDS, _SHRINK = 3, 0.35
_PERIODS = 3  # for the robot to get there


def in_the_model(poses: np.ndarray) -> np.ndarray:
    """Poses (n, 3) m, m, rad (heading from +y to +x) in the frame of the model."""
    c, s = math.cos(TURN), math.sin(TURN)
    x, y = (poses[:, :2] + OFFSET).T
    return np.column_stack([c * x + s * y, -s * x + c * y, poses[:, 2] + TURN])


INLET = in_the_model(np.array([[*(SHEATH - OFFSET), 0.0]]))[0, :2]
"""m, (2,), in the frame of the model."""


def load_lumen(file: Path) -> Lumen:
    """The vessel model's lumen, in the frame of its surface. Raises `ValueError` if its inlet is not at `INLET`."""
    surface = file.suffix.lower() in (".stl", ".obj", ".ply")
    lumen = Lumen.load(file, "mm", inlet=(*(1e3 * INLET), 0.0), invert=True) if surface else Lumen.load(file)
    begins = lumen.trunk.curve.position(np.zeros(1))[0]
    if (off := float(np.hypot(*(begins[:2] - INLET)))) > 20e-3:
        place = ", ".join(f"{1e3 * v:.1f}" for v in INLET)
        raise ValueError(
            f"lumen must begin within 20 mm of ({place}) mm, where the sheath ends in the frame of the model; the one "
            f"of {file} begins {1e3 * off:.0f} mm from there"
        )
    return lumen


def in_lumen(lumen: Lumen) -> Scenario:
    """The robot under a uniform field in its plane. Commands: currents along x and y (A, 1 mT each), the feed (m)."""
    current = Current(-300.0, 300.0, speed=1e4)
    return Scenario(
        name="magnetic continuum robot",
        lumen=lumen,
        wire=Guidewire.two_rings(_LENGTH, _SEGMENTS, ring_from_tip=30e-3),
        tip=CylinderMagnet(1.0145e-3, 4e-3, 1.45),
        rig=Rig(coils=(Coil("x", _TESLA, current=current), Coil("y", _TESLA, current=current)), feed=Feed(speed=0.1)),
        contact=Contact(friction=FRICTION, drag=0.05),
        coupling="wrench",
        model="free",
    )


def commands_of(lengths: np.ndarray, angles: np.ndarray, field: float) -> np.ndarray:
    """Commands (n, 3) for inserted lengths (n,) m and angles (n,) rad, from +y to +x, of a field of `field` T."""
    return np.column_stack([field / _TESLA * np.sin(angles), field / _TESLA * np.cos(angles), lengths])


def tips_of(sim: Simulator) -> np.ndarray:
    """Tips (n, 3): x, y m and heading rad."""
    x = sim.positions
    way = x[:, -1] - x[:, -2]
    return np.column_stack([x[:, -1, :2], np.arctan2(way[:, 0], way[:, 1])])


def followed(poses: np.ndarray, lumen: Lumen, field: float, weights: tuple[float, float]) -> tuple[np.ndarray, int]:
    """The robot that follows poses (n, 3) in the lumen's own frame.

    field : T; weights : m and rad that count as much as each other

    Returns its gaps (n, 3) in x, y (m) and heading (rad), and how many of the integration steps tried out did not
    converge; those lanes do not count.
    """
    scenario = in_lumen(lumen)
    sim = Simulator(scenario, _TRIES**2, threads=1)
    feed = scenario.rig.feed
    assert feed is not None  # filled in by the scenario, as its limits are
    assert feed.low is not None
    assert feed.high is not None
    begins = lumen.trunk.curve.position(np.zeros(1))[0, :2]
    length, angle = float(np.clip(np.hypot(*(poses[0, :2] - begins)), feed.low, feed.high)), float(poses[0, 2])
    steps = np.linspace(-1.0, 1.0, _TRIES)
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    sim.step(np.broadcast_to(commands_of(np.array([length]), np.array([angle]), field), (len(grid), 3)))
    state, gaps, unconverged = sim.state(np.array([0])), np.zeros((len(poses), 3)), 0
    for number, pose in enumerate(poses):
        reach, best = np.array(_REACH), (math.inf, length, angle, state)
        for _ in range(_ROUNDS):
            tried = np.array(best[1:3]) + reach * grid
            tried[:, 0] = np.clip(tried[:, 0], feed.low, feed.high)
            sim.load_state(_in_all_lanes(state, len(grid)))
            failed = np.zeros(len(grid))
            for _k in range(_PERIODS):
                sim.step(commands_of(tried[:, 0], tried[:, 1], field))
                failed += sim.readout[ROW.unconverged, : len(grid)]
            unconverged += int(failed.sum())
            found = tips_of(sim) - pose
            found[:, 2] = (found[:, 2] + math.pi) % (2 * math.pi) - math.pi
            cost = np.hypot(found[:, 0], found[:, 1]) ** 2 / weights[0] ** 2 + found[:, 2] ** 2 / weights[1] ** 2
            cost[failed > 0.0] = math.inf
            one = int(cost.argmin())
            if cost[one] < best[0]:
                best = (float(cost[one]), float(tried[one, 0]), float(tried[one, 1]), sim.state(np.array([one])))
                gaps[number] = found[one]
            reach = _SHRINK * reach
        _, length, angle, state = best
    return gaps, unconverged


def _in_all_lanes(state: SimulatorState, lanes: int) -> SimulatorState:
    return dataclasses.replace(state[np.zeros(lanes, dtype=np.int64)], lanes=np.arange(lanes))
