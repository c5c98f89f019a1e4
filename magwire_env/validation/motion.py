"""Checks of the locked wire in motion: friction, bending, energy, and convergence in step and mesh."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ..lumen.named import circle
from ..physics import CylinderMagnet, Guidewire, PointDipole, Tract, field
from ..scenario import ActuatedMagnet, Contact, Rig, Scenario, Timing, Turn
from ..simulation import Simulator, best_command, drive_at
from .balance import resistance
from .report import Row, Size, at_least, at_most

__all__ = [
    "capstan",
    "closed_tract",
    "convergence",
    "creep_out",
    "energy",
    "friction",
    "generalised_force",
    "release_force",
]

_FAR_AWAY = Rig((ActuatedMagnet(PointDipole(1e-12), (0.0, 0.0, 10.0), (Turn(),), ("gauss", 1)),))


def bench(tract: Tract, wire: Guidewire | None = None, **changes) -> Scenario:
    """A wire in a tract with no magnet to speak of; the paper's tip, or another, rides at its end."""
    paper = Scenario.paper()
    parts: dict[str, Any] = {"tip": paper.tip, "rig": _FAR_AWAY} | changes
    return Scenario("bench", tract, wire or paper.wire, **parts)


def straight_then_arc(bend: float, turn: float, lead: float, spacing: float) -> Tract:
    """A straight lead along +x of `lead` m, an arc of radius `bend` m through `turn` rad, a straight end of 20 cm."""
    straight = np.arange(-lead, -spacing / 2, spacing)
    angle = np.linspace(0, turn, round(bend * turn / spacing) + 1)
    arc = bend * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
    end = np.arange(1, round(0.2 / spacing) + 1)[:, None] * spacing * [math.cos(turn), math.sin(turn), 0]
    return Tract.from_points(np.vstack([straight[:, None] * [1, 0, 0], arc, arc[-1] + end]))


# --- friction ---------------------------------------------------------------------------------------------------------


def friction(_: Size) -> list[Row]:
    """A wire on a straight tract under a push and its own weight, at the default step: Coulomb's law.

    Below μ n it creeps at ε x/√(1 − x²), x = F/μn, the price of the smoothing; above, it accelerates as a block.
    """
    mu, g, seconds = 0.05, 9.81, 1.0
    tract = Tract.from_points([(-1.0, 0, 0), (0, 0, 0), (1.0, 0, 0)])
    rows = []
    for x in (0.5, 0.9, 1.1, 1.5):
        creep = Contact().stick_speed * x / math.sqrt(1 - x**2) if x < 1 else 0.0
        expected = creep * seconds if x < 1 else 0.5 * (x - 1) * mu * g * seconds**2
        scenario = bench(tract, gravity=(x * mu * g, 0, -g), contact=Contact(friction=mu, drag=0.0))
        source = "creep, ε x/√(1 − x²)" if x < 1 else "½ (F − μn) t²/m"
        rows.append(
            Row(
                f"block pushed with {x:g} μn for 1 s, travel",
                "mm",
                1e3 * expected,
                source,
                1e3 * _travel(scenario, seconds),
                0.05,
            )
        )
    start = math.sqrt(2 * 0.1 * mu * g * 3.5e-3)
    scenario = bench(tract, gravity=(0.9 * mu * g, 0, -g), contact=Contact(friction=mu, drag=0.0))
    braked = _travel(scenario, 0.7, start)
    crept = (0.7 - start / (0.1 * mu * g)) * Contact().stick_speed * 0.9 / math.sqrt(0.19)
    rows.append(Row("block under 0.9 μn, way to stop from 18.5 mm/s", "mm", 3.5, "v²/2a", 1e3 * (braked - crept), 0.05))
    return rows


def _travel(scenario: Scenario, seconds: float, speed: float = 0.0) -> float:
    sim = Simulator(scenario)
    sim.reset(tip_arclength=0.5)
    state = sim.state()
    if speed:
        sim.load_state(state.replaced(velocities=state.velocities + speed))
    for _ in range(round(seconds / sim.control_period)):
        sim.step(np.zeros((1, 1)))
    return float(sim.tip_arclength[0] - 0.5)


def capstan(size: Size) -> list[Row]:
    """Tensions before and after a bend, drawn through it slowly by a heavy tip: T2 = T1 e^{μφ}.

    Drag c v on the wire before the bend makes T1. In the bend dT/ds = μ κ T + c v, so that what grows by e^{μφ} is
    T + c v/(μ κ), which is what is compared. The wire has no weight and hardly any bending stiffness.
    """
    bend, turn, mu, drag = 0.05, math.pi, 0.2, 1.0
    tract = straight_then_arc(bend, turn, 0.5, 2.5e-3)
    wire = Guidewire(0.5, 2.5e-3, 600e3, 1e-3, 1.0, 50 * size.halvings)
    pull = 10e-3
    scenario = bench(
        tract,
        wire,
        tip=CylinderMagnet(2e-3, 3e-3, 1.37, mass=1e-3),
        gravity=(1e3 * pull * math.cos(turn), 1e3 * pull * math.sin(turn), 0.0),
        contact=Contact(friction=mu, drag=drag, stick_speed=1e-8),
        timing=Timing(0.05, 20),
    )
    sim = Simulator(scenario)
    sim.reset(tip_arclength=0.5 + bend * turn + 0.05)
    for _ in range(6):
        sim.step(np.zeros((1, 1)))
    nodes, s = sim.positions[0], sim.state().arclengths[0]
    tension = wire.axial_spring * (np.linalg.norm(np.diff(nodes, axis=0), axis=1) - wire.segment_length)
    middle = 0.5 * (s[1:] + s[:-1])
    tail = drag * sim.tip_velocity[0] * bend / mu
    inside = np.flatnonzero((middle > 0.5 + wire.segment_length) & (middle < 0.5 + bend * turn - wire.segment_length))
    first, last = inside[0], inside[-1]
    phi = (middle[last] - middle[first]) / bend
    ratio = (tension[last] + tail) / (tension[first] + tail)
    return [
        Row(
            f"capstan, T2/T1 over {math.degrees(phi):.0f}°, μ = {mu}",
            "",
            math.exp(mu * phi),
            "e^{μφ}",
            float(ratio),
            5e-3,
        )
    ]


# --- bending ----------------------------------------------------------------------------------------------------------


def release_force(size: Size) -> list[Row]:
    """What a bend pushes back with on a wire whose head is in it and whose tail is straight: ½ E I κ².

    Measured as the momentum one very short step from rest gives the wire; the mean over 5 mm of travel, a whole
    number of segments.
    """
    bend = 0.0377
    tract = straight_then_arc(bend, 2.0, 0.15, 2.5e-3)
    paper = Scenario.paper().wire
    expected = -0.5e3 * paper.bending_rigidity / bend**2
    rows = []
    for segments in [20 * 2**k for k in range(size.halvings)]:
        wire = Guidewire(0.1, 2.5e-3, 600e3, 550e3, 1100.0, segments)
        scenario = bench(tract, wire, contact=Contact(friction=0.0, drag=0.0), timing=Timing(1e-6, 1))
        tips = 0.195 + 5e-3 * np.arange(16) / 16
        sim = Simulator(scenario, num_envs=16)
        sim.reset(tip_arclength=tips)
        sim.step(np.zeros((16, 1)))
        momentum = sim.state().velocities @ _masses(scenario)
        ours = 1e3 * float(momentum.mean()) / 1e-6
        rows.append(
            Row(
                f"release force from a straight into an arc of 37.7 mm, N = {segments}",
                "mN",
                expected,
                "−½ E I κ²",
                ours,
                2e-2,
            )
        )
    return rows


def creep_out(size: Size) -> list[Row]:
    """A wire let go with its head in a bend creeps out of it at the speed at which its static balance closes.

    Bending pushes, drag and the friction of the spring tensions hold: the balance by which the paper's claim is
    judged, against the simulator.
    """
    tract = straight_then_arc(0.05, math.pi, 0.3, 2.5e-3)
    wire = Guidewire(0.1, 2.5e-3, 600e3, 550e3, 1100.0, 20 * size.halvings)
    rows = []
    for mu in (0.0, 0.1, 0.2):
        contact = Contact(friction=mu, drag=5.0, stick_speed=1e-7)
        scenario = bench(tract, wire, contact=contact, timing=Timing(2e-3, 4))
        sim = Simulator(scenario)
        sim.reset(tip_arclength=0.36)
        for _ in range(100):
            sim.step(np.zeros((1, 1)))
        tip = float(sim.tip_arclength[0])
        expected = float(brentq(lambda v, sc, at: resistance(sc, at, -1.0, v), 0.0, 1.0, (scenario, tip)))
        ours = -1e3 * float(sim.tip_velocity[0])
        rows.append(
            Row(f"wire creeping out of a bend, μ = {mu:g}, speed", "mm/s", 1e3 * expected, "static balance", ours, 3e-2)
        )
    return rows


def _masses(scenario: Scenario) -> np.ndarray:
    """Of the nodes, kg: half a segment at either end, the tip magnet at the last."""
    wire = scenario.wire
    share = np.r_[0.5, np.ones(wire.segments - 1), 0.5] * wire.mass / wire.segments
    share[-1] += scenario.tip.mass or 0.0
    return share


# --- the magnetic drive -----------------------------------------------------------------------------------------------


def generalised_force(size: Size) -> list[Row]:
    """`wrench`: the drive is d/ds of m t·B along the tract, by fourth-order differences.

    In the middle of the spline's pieces: at their ends dκ/ds jumps, and differences across a jump mean little. What is
    left is the spline's own parameter, which is arc length to 1.4e-5.
    """
    scenario = Scenario.paper().replace(coupling="wrench")
    pieces = round(scenario.tract.length / scenario.tract.row_spacing)
    s = (np.arange(0, pieces, max(1, 400 // size.places)) + 0.5) * scenario.tract.row_spacing
    worst, greatest = 0.0, 0.0
    for angle in np.linspace(0, 2 * math.pi, 8, endpoint=False):
        drive = drive_at(scenario, np.full((len(s), 1), angle), s)
        h = 1e-4
        near = tip_energy(scenario, angle, s + h) - tip_energy(scenario, angle, s - h)
        far = tip_energy(scenario, angle, s + 2 * h) - tip_energy(scenario, angle, s - 2 * h)
        worst = max(worst, float(np.abs(drive + (8 * near - far) / (12 * h)).max()))
        greatest = max(greatest, float(np.abs(drive).max()))
    return [at_most("Q less d/ds of m t·B, share of the greatest Q", "", 1e-5, "finite differences", worst / greatest)]


def tip_energy(scenario: Scenario, angle: float, s: np.ndarray) -> np.ndarray:
    """−m t·B of the tip at arc lengths `s` (n,) m, the magnet turned by `angle` rad about y → (n,) J."""
    mount = scenario.rig.magnets[0]
    c, n = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0, n], [0, 1, 0], [-n, 0, c]])
    cloud = mount.magnet.dipoles(*mount.dipoles).moved(turn, np.array(mount.position))
    return -scenario.tip.moment * np.einsum(
        "ni,ni->n", scenario.tract.tangent(s), field(cloud, scenario.tract.position(s))
    )


def closed_tract(size: Size) -> list[Row]:
    """Round a circle with the magnet at rest Q does no work, F·t does: why closed tracts take `wrench` only."""
    paper = Scenario.paper()
    tract = circle(2 * math.pi * 0.06)
    mount = ActuatedMagnet(paper.rig.magnets[0].magnet, (0.03, 0.02, 0.08))
    scenario = Scenario("circle", tract, paper.wire, paper.tip, Rig((mount,)), coupling="wrench")
    n = size.places
    s = np.arange(n) * tract.length / n
    sim = Simulator(scenario, num_envs=n)
    sim.reset(tip_arclength=s, magnet=np.full((n, 1), 0.7))
    ds = tract.length / n
    q, f = sim.drive_force, np.einsum("ni,ni->n", sim.tip_force, sim.tip_tangent)
    return [
        at_most(
            "∮ Q ds round a circle, share of the work to and fro",
            "",
            1e-5,
            "energy",
            abs(float(q.sum() / np.abs(q).sum())),
        ),
        at_least(
            "∮ F·t ds round the same circle, size",
            "mJ",
            0.1,
            "not conservative",
            1e3 * abs(float(f.sum() * ds)),
        ),
    ]


# --- energy -----------------------------------------------------------------------------------------------------------


def total_energy(scenario: Scenario, sim: Simulator) -> float:
    """Kinetic, axial, bending and magnetic energy of a wire under a magnet at rest, J; an account of its own."""
    state = sim.state()
    s, v, wire = state.arclengths[0], state.velocities[0], scenario.wire
    segments = np.diff(scenario.tract.position(s), axis=0)
    lengths = np.linalg.norm(segments, axis=1)
    ends = scenario.tract.tangent(s[[0, -1]])
    directions = np.vstack([ends[:1], segments / lengths[:, None], ends[1:]])
    phi = 2 * np.arcsin(np.minimum(1.0, np.linalg.norm(np.diff(directions, axis=0), axis=1) / 2))
    joints = np.full(len(phi), wire.bending_spring)
    joints[[0, -1]] *= 2
    return float(
        0.5 * _masses(scenario) @ v**2
        + 0.5 * wire.axial_spring * ((lengths - wire.segment_length) ** 2).sum()
        + 0.5 * joints @ phi**2
        + tip_energy(scenario, state.magnet[0, 0], s[-1:])[0]
    )


def energy(size: Size) -> list[Row]:
    """`wrench`, magnet at rest: without loss the energy's error shrinks with the step and does not drift.

    The tip swings to and fro in a well of the magnetic energy. Errors are shares of the greatest kinetic energy. A
    hundredfold axial modulus keeps the sudden start from ringing along the wire, which the implicit springs damp.
    """
    steps = [20e-3 / 2**k for k in range(size.halvings)]
    free = Contact(friction=0.0, drag=0.0)
    runs = [_energies(free, h, size.seconds, 100.0) for h in steps]
    errors = [float(np.abs(e - e[0]).max()) for e in runs]
    order = math.log2(errors[0] / errors[-1]) / (len(errors) - 1)
    half = len(runs[-1]) // 2
    drift = float(abs(runs[-1][half:].mean() - runs[-1][:half].mean())) / errors[-1]
    rung = float(np.abs(np.diff(_energies(free, steps[-1], size.seconds)[[0, -1]]))[0])
    lossy = _energies(Contact(friction=0.05, drag=0.5), steps[-1], size.seconds)
    name = f"energy, `wrench`, magnet at rest, {size.seconds:g} s"
    return [
        at_most(f"{name}: greatest error, step {1e3 * steps[-1]:g} ms", "", 2e-3, "conservation", errors[-1]),
        at_least(f"{name}: its order in the step from {1e3 * steps[0]:g} ms", "", 1.5, "2 in theory", order),
        at_most(f"{name}: drift between halves, of it", "", 1.0, "no secular drift", drift),
        at_most(f"{name}: lost to the start's ringing, paper's modulus", "", 2e-3, "axial waves damped", rung),
        at_most(f"{name}: greatest rise under drag and friction", "", 1e-6, "only falls", float(np.diff(lossy).max())),
        at_least(f"{name}: lost to drag and friction", "", 0.5, "only falls", float(lossy[0] - lossy[-1])),
    ]


def _energies(contact: Contact, step: float, seconds: float, axial: float = 1.0) -> np.ndarray:
    """Energy every 20 ms of a wire let go in the paper's tract, in units of its greatest kinetic energy on the way."""
    paper, period = Scenario.paper(), 20e-3
    wire = {"wire__axial_modulus": axial * paper.wire.axial_modulus}
    scenario = paper.replace(coupling="wrench", contact=contact, timing=Timing(period, round(period / step)), **wire)
    command = np.array([[4.8]])
    sim = Simulator(scenario)
    sim.reset(tip_arclength=0.5, magnet=command)
    energies, kinetic = [total_energy(scenario, sim)], 0.0
    for _ in range(round(seconds / period)):
        sim.step(command)
        energies.append(total_energy(scenario, sim))
        kinetic = max(kinetic, float(0.5 * _masses(scenario) @ sim.state().velocities[0] ** 2))
    return np.array(energies) / kinetic


# --- convergence ------------------------------------------------------------------------------------------------------


def convergence(size: Size) -> list[Row]:
    """Commands of the paper's policy, recorded once and replayed with finer steps, and on finer wires.

    The tip's arc length after each command, greatest difference from that of the finest; friction and all.
    """
    commands = _recorded(seconds=6.0)
    doubled = range(size.halvings + 1)
    steps = [_replayed(commands, 32, 4 * 2**k) for k in doubled]
    meshes = [_replayed(commands, 10 * 2**k, 20) for k in doubled]
    rows = []
    for name, runs, finest in (
        ("step, from 25 ms", steps, f"{25 / 2 ** doubled[-1]:g} ms"),
        ("segments, from 10", meshes, f"N = {10 * 2 ** doubled[-1]}"),
    ):
        gaps = [float(np.abs(a - b).max()) for a, b in itertools.pairwise(runs)]
        order = math.log2(gaps[0] / gaps[-1]) / (len(gaps) - 1)
        rows.append(at_least(f"order of the tip's arc length in the {name}", "", 1.0, "first order or better", order))
        rows.append(at_most(f"last change of the tip's arc length, {finest}", "mm", 1.0, "converges", 1e3 * gaps[-1]))
    return rows


def _recorded(seconds: float) -> np.ndarray:
    scenario = Scenario.paper().replace(wire__segments=40, timing__substeps=20)
    places = np.linspace(0, scenario.tract.length, 401)
    best, _ = best_command(scenario, places)
    sim = Simulator(scenario)
    commands = []
    for _ in range(round(seconds / sim.control_period)):
        commands.append([np.interp(sim.tip_arclength[0], places, best[:, 0])])
        sim.step(np.array(commands[-1:]))
    return np.array(commands)


def _replayed(commands: np.ndarray, segments: int, substeps: int) -> np.ndarray:
    sim = Simulator(Scenario.paper().replace(wire__segments=segments, timing__substeps=substeps))
    arcs = []
    for command in commands:
        sim.step(command[None])
        arcs.append(sim.tip_arclength[0])
    return np.array(arcs)
