"""A lane of a batch moves as it would alone, bit for bit, whatever moves beside it and on however many threads."""

import dataclasses

import numpy as np
import pytest

from magwire_env.lumen.named import circle, helix, small_bowel_loops, straight
from magwire_env.physics import CylinderMagnet, PointDipole
from magwire_env.scenario import ActuatedMagnet, Rig, Scenario, Slide, Turn
from magwire_env.simulation import Simulator
from tests.support.scenes import world

PAPER = Scenario.paper()
MOUNT = PAPER.rig.magnets[0]


def rig(**changes) -> Rig:
    return Rig((dataclasses.replace(MOUNT, dipoles=(), **changes),))


def rule(name: str, n) -> Rig:
    return Rig((dataclasses.replace(MOUNT, dipoles=(name, n)),))


MIXED = [
    PAPER,
    PAPER.replace(coupling="wrench", contact__drag=0.1),
    PAPER.replace(wire__segments=8, wire__length=0.07),
    PAPER.replace(wire__segments=33, wire__length=0.15, contact__friction=0.1),
    PAPER.replace(wire__segments=11, gravity=(1.0, 2.0, -9.81)),
    PAPER.replace(rig=rig(magnet=PointDipole(100.0), position=(0.01, 0.02, 0.08))),
    PAPER.replace(
        rig=rig(magnet=CylinderMagnet(0.04, 0.05, 1.2), position=(0.0, 0.02, 0.09)), contact__lever_friction=True
    ),
    PAPER.replace(rig=rule("gauss", 3)),
    PAPER.replace(rig=rule("grid", (3, 5, 7)), tip__remanence=1.0),
    world(circle(0.5), wire__segments=13, rig=rig(position=(0.0, 0.0, 0.1))),
    world(straight(0.5), coupling="force", rig=rig(position=(0.0, 0.0, 0.1))),
    world(helix(), wire__segments=20, rig=rig(position=(0.0, 0.0, 0.14)), contact__friction=0.02),
    world(small_bowel_loops(), wire__axial_modulus=6e6, rig=rig(position=(0.0, 0.0, 0.12)), contact__stick_speed=1e-3),
]
STARTS = 0.2 + 0.003 * np.arange(len(MIXED))
COMMANDS = np.random.default_rng(0).uniform(-1, 7, (25, len(MIXED), 1))
RESULTS = (
    "tip_arclength", "tip_velocity", "drive_force", "lateral_force", "tip_torque", "wall_force", "peak_wall_force",
    "mean_wall_force", "peak_lateral_force", "tip_force", "tip_field", "tip_position", "tip_tangent", "magnet",
    "remaining_trace",
)  # fmt: skip


def run(scenarios: list[Scenario], columns: np.ndarray, threads: int | None = 1) -> list[np.ndarray]:
    """Every result after every period, (periods, lanes, …), of `MIXED`'s starts and commands of these columns."""
    sim = Simulator(scenarios, threads=threads)
    sim.reset(tip_arclength=STARTS[columns])
    rows = []
    for command in COMMANDS[:, columns]:
        sim.step(command)
        rows.append([getattr(sim, name) for name in RESULTS])
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.fixture(scope="module", name="alone")
def alone_fixture() -> list[list[np.ndarray]]:
    return [run([scenario], np.array([i])) for i, scenario in enumerate(MIXED)]


def differing(batch: list[np.ndarray], lane: int, alone: list[np.ndarray]) -> list[str]:
    """Names of the results in which the lane is not, bit for bit, what it was alone."""
    pairs = zip(RESULTS, batch, alone, strict=True)
    return [name for name, many, one in pairs if not np.array_equal(many[:, lane], one[:, 0])]


def test_lanes_of_one_scenario_are_single_runs():
    """Forty wires, two and a half blocks, each with its own start and commands."""
    n = 40
    starts, commands = np.linspace(0.1, 0.6, n), np.random.default_rng(1).uniform(0, 6, (15, n, 1))
    batch = Simulator(PAPER, num_envs=n)
    batch.reset(tip_arclength=starts)
    for command in commands:
        batch.step(command)
    for lane in range(n):
        single = Simulator(PAPER)
        single.reset(tip_arclength=starts[lane])
        for command in commands[:, lane : lane + 1]:
            single.step(command)
        for name in (*RESULTS, "positions"):
            assert np.array_equal(getattr(batch, name)[lane], getattr(single, name)[0]), (lane, name)


def test_lanes_of_different_scenarios_are_single_runs(alone):
    """Thirteen wires that share nothing: tract, node count, magnet, cloud, coupling, weight, friction."""
    batch = run(MIXED, np.arange(len(MIXED)))
    assert {i: d for i, one in enumerate(alone) if (d := differing(batch, i, one))} == {}
    assert sorted(np.ptp(batch[0], axis=0))[2] > 0.01  # two of them stick, the others move


def test_neither_neighbours_nor_place_nor_threads_matter(alone):
    """The same thirteen in another order, several times over, in several blocks and on one thread and two."""
    order = np.random.default_rng(2).permutation(np.tile(np.arange(len(MIXED)), 11))
    scenarios = [MIXED[i] for i in order]
    one, two = (run(scenarios, order, threads) for threads in (1, 2))
    for name, a, b in zip(RESULTS, one, two, strict=True):
        assert np.array_equal(a, b), name
    assert {lane: d for lane, i in enumerate(order) if (d := differing(two, lane, alone[i]))} == {}


def test_several_magnets_and_slides_are_single_runs_too():
    """Two magnets, turns about two axes and slides along two: lanes alike only in the kinds of their dofs."""
    one = ActuatedMagnet(MOUNT.magnet, (0.0, 0.0, 0.13), (Turn("y"), Slide("x", -0.1, 0.1), Turn("z")), ("gauss", 3))
    two = ActuatedMagnet(PointDipole(80.0), (0.0, 0.03, -0.12), (Turn("x"), Slide("z", -0.02, 0.02, speed=0.05)))
    far = dataclasses.replace(
        one, position=(0.03, 0.0, 0.16), dofs=(Turn("y", speed=1.0), Slide("x", 0.0, 0.1), Turn("z"))
    )
    base = PAPER.replace(coupling="wrench", rig=Rig((one, two)))
    scenarios = [base, base.replace(rig=Rig((far, two)), wire__segments=9), base.replace(coupling="force")]
    commands = np.random.default_rng(3).uniform(-0.1, 0.1, (20, 3, 5)) * np.array([30, 1, 30, 30, 0.3])
    batch = Simulator(scenarios)
    singles = [Simulator(scenario) for scenario in scenarios]
    for command in commands:
        batch.step(command)
        for lane, single in enumerate(singles):
            single.step(command[lane : lane + 1])
    for lane, single in enumerate(singles):
        for name in RESULTS:
            assert np.array_equal(getattr(batch, name)[lane], getattr(single, name)[0]), (lane, name)
    assert np.ptp(batch.magnet_positions[:, 0, 0]) >= 0.01


def test_a_batch_of_unlike_rigs_or_timings_is_refused():
    slow = PAPER.replace(timing__substeps=5)
    with pytest.raises(ValueError, match=r"scenario\[1\]\.timing must be that of the batch"):
        Simulator([PAPER, slow])
    turned = PAPER.replace(rig=rig(dofs=(Turn("x"),)))
    with pytest.raises(ValueError, match=r"scenario\[1\]\.rig must have the batch's degrees of freedom"):
        Simulator([PAPER, turned])
