"""Small worlds for the tests, and forces as a wire itself feels them."""

import numpy as np

from magwire_env.physics import CylinderMagnet, Guidewire, PointDipole, Tract
from magwire_env.scenario import ActuatedMagnet, Contact, Rig, Scenario, Timing, Turn
from magwire_env.simulation import Simulator

FAR = ActuatedMagnet(PointDipole(1e-6), (0.0, 0.0, 90.0), (Turn("y"),))
"""A magnet that pulls with less than 1e-20 N."""

WIRE = Guidewire(length=0.1, radius=2.5e-3, axial_modulus=600e3, bending_modulus=550e3, density=1100.0, segments=16)
TIP = CylinderMagnet(diameter=2e-3, height=3e-3, remanence=1.37, mass=7.2e-5)
SLICK = Contact(friction=0.0, drag=0.0)


def world(tract: Tract, **changes) -> Scenario:
    """The paper's wire in `tract`, without magnet, friction or drag, but for `changes`."""
    base = Scenario(name="world", tract=tract, wire=WIRE, tip=TIP, rig=Rig((FAR,)), contact=SLICK, coupling="wrench")
    return base.replace(**changes)


def line(length: float = 1.0) -> Tract:
    """Straight along x from the origin."""
    return Tract.from_points([(0.0, 0.0, 0.0), (length / 2, 0.0, 0.0), (length, 0.0, 0.0)])


def bent(radius: float, angle: float, lead: float = 0.2, trail: float = 0.2, ease: float = 0.06) -> Tract:
    """Straight along x for `lead` m, round an arc in the x–z plane, downwards by `angle` rad, and straight again.

    Curvature eases in and out over `ease` m either way, about where a sharp bend would begin and end.
    """
    fine = 1e-5
    s = np.arange(0.0, lead + radius * angle + trail, fine) + fine / 2
    into, out = ((s - at) / ease + 0.5 for at in (lead, lead + radius * angle))
    smooth = [x - np.sin(2 * np.pi * x) / (2 * np.pi) for x in (np.clip(into, 0, 1), np.clip(out, 0, 1))]
    heading = np.cumsum((smooth[0] - smooth[1]) / radius) * fine
    steps = fine * np.stack([np.cos(heading), 0 * s, -np.sin(heading)], axis=1)
    xyz = np.vstack([np.zeros(3), steps.cumsum(axis=0)])
    return Tract.from_points(xyz[:: round(2.5e-3 / fine)])


def lumped_mass(scenario: Scenario) -> np.ndarray:
    """(nodes,) kg: a segment's mass a node, half at the ends, and the tip magnet's at the tip."""
    wire = scenario.wire
    share = np.r_[0.5, np.ones(wire.segments - 1), 0.5] * wire.mass / wire.segments
    share[-1] += scenario.tip.mass
    return share


def placed(sim: Simulator, arclengths=None, velocities=None, magnet=None) -> Simulator:
    """The simulator with its first lane's state set."""
    state = sim.state([0])
    given = {"arclengths": arclengths, "velocities": velocities, "magnet": magnet}
    new = {k: np.broadcast_to(v, getattr(state, k).shape).astype(float) for k, v in given.items() if v is not None}
    sim.load_state(state.replaced(**new))
    return sim


def joint_forces(scenario: Scenario, arclengths, velocities=0.0, magnet=None, period: float = 1e-9) -> np.ndarray:
    """Force along the tract on every node, (nodes,) N, from what a step of `period` s does to its speed."""
    sim = placed(Simulator(scenario.replace(timing=Timing(period, 1))), arclengths, velocities, magnet)
    before = sim.state()
    sim.step(before.magnet)
    return (sim.state().velocities - before.velocities)[0] * lumped_mass(scenario) / period


def at_rest(scenario: Scenario, tip_arclength: float) -> np.ndarray:
    """Arc lengths (nodes,) m of a wire laid out at rest."""
    sim = Simulator(scenario)
    sim.reset(tip_arclength=tip_arclength)
    return sim.state().arclengths[0]


def elastic_energy(scenario: Scenario, s: np.ndarray) -> np.ndarray:
    """Springs, joints ½ k φ² and the ends' half cells: arc lengths (..., nodes) m → (...) J."""
    wire, tract = scenario.wire, scenario.tract
    chord = np.diff(tract.position(s), axis=-2)
    length = np.linalg.norm(chord, axis=-1)
    u = chord / length[..., None]
    axial = 0.5 * wire.axial_spring * (length - wire.segment_length) ** 2
    joints = 0.5 * wire.bending_spring * _angle(u[..., :-1, :], u[..., 1:, :]) ** 2
    ends = _angle(u[..., 0, :], tract.tangent(s[..., 0])) ** 2 + _angle(u[..., -1, :], tract.tangent(s[..., -1])) ** 2
    return axial.sum(axis=-1) + joints.sum(axis=-1) + wire.bending_spring * ends


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))
