"""The forces of Algorithm 1: the magnet's on the tip, springs' and joints' on the wire, friction round a bend.

A wire says what it feels by what a very short step does to its speeds (`scenes.joint_forces`).
"""

import dataclasses
import math

import numpy as np
import pytest

from magwire_env.lumen.named import circle, paper_spiral
from magwire_env.physics import BlockMagnet, CylinderMagnet, DipoleCloud, field, force
from magwire_env.scenario import ActuatedMagnet, Rig, Scenario, Slide, Timing, Turn
from magwire_env.simulation import Simulator, drive_at
from tests.support.scenes import (
    TIP,
    WIRE,
    at_rest,
    bent,
    elastic_energy,
    joint_forces,
    line,
    lumped_mass,
    placed,
    world,
)

PAPER = Scenario.paper()
BLOCK = PAPER.rig.magnets[0].magnet
GRID = Rig((dataclasses.replace(PAPER.rig.magnets[0], dipoles=("grid", (10, 10, 20))),))
DUAL = Rig(
    (
        ActuatedMagnet(
            BLOCK,
            (0.02, 0.0, 0.13),
            (Turn("x"), Slide("z", -0.02, 0.05), Turn("y"), Slide("x", -0.1, 0.1)),
            ("gauss", 3),
        ),
        ActuatedMagnet(CylinderMagnet(0.03, 0.04, 1.2), (0.0, -0.05, -0.12), (Turn("z"), Turn("x"), Slide("y", -1, 1))),
    )
)


def rotation(axis: str, angle: float) -> np.ndarray:
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    turn = np.eye(3)
    turn[j, j] = turn[k, k] = math.cos(angle)
    turn[k, j] = math.sin(angle)
    turn[j, k] = -turn[k, j]
    return turn


def posed(scenario: Scenario, q: np.ndarray) -> DipoleCloud:
    """Every magnet's cloud in the world, with the rig at q (dof,)."""
    clouds, values = [], iter(q)
    for mount in scenario.rig.magnets:
        turn, shift = np.eye(3), np.array(mount.position)
        for dof in mount.dofs:
            value = next(values)
            if isinstance(dof, Turn):
                turn = rotation(dof.axis, value) @ turn
            else:
                shift["xyz".index(dof.axis)] += value
        clouds.append(mount.magnet.dipoles(*mount.dipoles).moved(turn, shift))
    return DipoleCloud(np.vstack([c.positions for c in clouds]), np.vstack([c.moments for c in clouds]))


# --- i: the magnet ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["force", "wrench"])
@pytest.mark.parametrize("rig", [PAPER.rig, GRID, DUAL], ids=["paper", "2000 dipoles", "two magnets, seven dofs"])
def test_force_field_and_loads_are_those_of_the_dipole_clouds(rig, coupling):
    scenario = PAPER.replace(rig=rig, coupling=coupling, contact__lever=7e-3)
    rng, n = np.random.default_rng(0), 20
    s, q = rng.uniform(-0.01, 0.81, n), rng.uniform(-0.02, 0.05, (n, len(rig.dofs)))
    for d, dof in enumerate(rig.dofs):
        q[:, d] = rng.uniform(-7, 7, n) if isinstance(dof, Turn) else q[:, d]
    sim = Simulator(scenario, num_envs=n)
    sim.reset(tip_arclength=s, magnet=q)
    p, t, tract = sim.tip_position, sim.tip_tangent, scenario.tract
    assert np.allclose(p, tract.position(s), rtol=0, atol=1e-15)
    assert np.allclose(t, tract.tangent(s), rtol=0, atol=1.5e-5)
    m = scenario.tip.moment * t
    f = np.vstack([force(posed(scenario, q[i]), p[i : i + 1], m[i : i + 1]) for i in range(n)])
    b = np.vstack([field(posed(scenario, q[i]), p[i : i + 1]) for i in range(n)])
    assert np.abs(sim.tip_force - f).max() <= 1e-12 * np.abs(f).max()
    assert np.abs(sim.tip_field - b).max() <= 1e-12 * np.abs(b).max()
    along = (f * t).sum(axis=1)
    couple = np.linalg.norm(np.cross(m, b), axis=1)
    lateral = np.linalg.norm(f - along[:, None] * t, axis=1)
    bend = scenario.tip.moment * (tract.curvature_vector(s) * b).sum(axis=1)
    drive = along + (coupling == "wrench") * bend
    assert np.abs(sim.tip_torque - couple).max() <= 1e-12 * couple.max()
    assert np.abs(sim.lateral_force - lateral).max() <= 1e-12 * lateral.max()
    assert np.abs(sim.wall_force - (lateral + 2 * couple / 7e-3)).max() <= 1e-12 * sim.wall_force.max()
    assert np.abs(sim.drive_force - drive).max() <= 2e-5 * np.abs(drive).max()
    assert np.array_equal(drive_at(scenario, q, s), sim.drive_force)


def test_wrench_is_the_gradient_of_the_energy_and_force_is_not():
    """Q = d/ds of m t·B(p(s)) within 2 µN of up to 12 mN; F·t differs from it by 14 mN."""
    scenario, h = PAPER.replace(coupling="wrench"), 2e-5
    tract, m = scenario.tract, scenario.tip.moment
    s = np.random.default_rng(0).uniform(1e-3, 0.799, 1000)
    worst = []
    for angle in (0.3, 2.0, 4.0):
        cloud, q = posed(scenario, np.array([angle])), np.full((1000, 1), angle)

        def energy(at, cloud=cloud):
            return -m * (tract.tangent(at) * field(cloud, tract.position(at))).sum(axis=1)

        slope = -(8 * (energy(s + h) - energy(s - h)) - energy(s + 2 * h) + energy(s - 2 * h)) / (12 * h)
        assert np.abs(drive_at(scenario, q, s) - slope).max() <= 2e-6
        worst.append(np.abs(drive_at(PAPER, q, s) - slope).max())
    assert max(worst) == pytest.approx(14e-3, rel=0.02)


def test_work_round_a_closed_tract():
    """A lap of a 6 cm circle, the magnet at rest 7 cm above: nothing by Q, 1.66 mJ by F·t (PHYSICS.md section 1)."""
    tract, n = circle(2 * math.pi * 0.06), 1000
    block = ActuatedMagnet(BlockMagnet((50.8e-3,) * 3, 1.3), (0.0, 0.0, 0.07), (Turn("y"),), ("gauss", 6))
    scenario = world(tract, rig=Rig((block,)))
    s = np.arange(n) * tract.length / n
    work = {}
    for angle in (0.0, 0.7):
        sim = Simulator(scenario, num_envs=n)
        sim.reset(tip_arclength=s, magnet=np.full((n, 1), angle))
        q, along = sim.drive_force, (sim.tip_force * sim.tip_tangent).sum(axis=1)
        work[angle] = along.mean() * tract.length
        there_and_back = np.abs(q).mean() * tract.length
        assert there_and_back >= 2e-5
        assert abs(q.mean() * tract.length) <= 1e-9
    assert work[0.0] == pytest.approx(-1.66e-3, rel=6e-3)
    assert work[0.7] == pytest.approx(-1.264e-3, rel=1e-3)


# --- iv, v: springs and joints ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [16, 120])
def test_springs_and_joints_pull_down_the_slope_of_the_energy(segments):
    """Every node's force is −∂E/∂s_i of the springs', the joints' ½ k φ² and the half cells' at the ends.

    For wires at rest and for wires with each joint out of its place by a hundredth of a segment. The mesh must not
    matter: a force that grows as the segments get shorter would make no limit.
    """
    rng, h = np.random.default_rng(3), 2e-7
    for tract, tips in ((paper_spiral(), (0.15, 0.42, 0.785)), (circle(0.4), (0.1, 0.3)), (bent(0.04, 2.0), (0.3,))):
        scenario = world(tract, wire__segments=segments)
        shift = h * np.eye(segments + 1)
        for tip in tips:
            rest = at_rest(scenario, tip)
            for s in (rest, rest + rng.normal(scale=0.01 * 0.1 / segments, size=rest.shape)):
                near = elastic_energy(scenario, s + shift) - elastic_energy(scenario, s - shift)
                far = elastic_energy(scenario, s + 2 * shift) - elastic_energy(scenario, s - 2 * shift)
                slope = (8 * near - far) / (12 * h)
                ours = joint_forces(scenario, s)
                assert np.abs(ours + slope).max() <= 2e-8 + 5e-7 * np.abs(slope).max()


@pytest.mark.parametrize(("segments", "degrees", "error"), [(6, 30, 2e-6), (3, 60, 3e-4)])
def test_joints_bend_by_half_k_phi_squared_up_to_large_angles(segments, degrees, error):
    """The kernel's series of φ/sin φ is good to 6e-6 at 30° and 4e-4 at 60°; next to no axial stiffness hides it."""
    radius, h = 0.05, 1e-6
    length = segments * 2 * radius * math.sin(math.radians(degrees) / 2)
    scenario = world(
        circle(2 * math.pi * radius), wire__length=length, wire__segments=segments, wire__axial_modulus=1.0
    )
    s = at_rest(scenario, 0.2) + 2e-3 * np.cos(np.arange(segments + 1) ** 2)
    shift = h * np.eye(segments + 1)
    slope = (elastic_energy(scenario, s + shift) - elastic_energy(scenario, s - shift)) / (2 * h)
    assert np.abs(slope).max() >= 5e-4
    assert np.abs(joint_forces(scenario, s) + slope).max() <= error * np.abs(slope).max()


def test_springs_in_series_stretch_n_times_one():
    """Pulled by ±F at its ends and nowhere else, a wire of N springs is longer by N F/k."""
    for segments in (2, 16):
        scenario = world(line(), wire__segments=segments)
        k, pull = scenario.wire.axial_spring, 0.02
        s = 0.3 + np.linspace(0.0, 0.1 + segments * pull / k, segments + 1)
        expected = np.zeros(segments + 1)
        expected[0], expected[-1] = pull, -pull
        assert np.allclose(joint_forces(scenario, s), expected, rtol=0, atol=1e-11)


def test_a_heavy_tip_sinking_through_syrup_stretches_every_spring_by_its_own_load():
    """The wire trails behind at the speed where drag bears the tip's weight; each spring bears what is behind it."""
    tip = dataclasses.replace(TIP, mass=5e-3)
    scenario = world(
        line(), tip=tip, wire__density=1.0, gravity=(9.81, 0.0, 0.0), contact__drag=10.0, timing=Timing(0.1, 20)
    )
    sim = Simulator(scenario)
    for _ in range(5):
        sim.step(np.zeros((1, 1)))
    state = sim.state()
    s, v = state.arclengths[0], state.velocities[0]
    weight = lumped_mass(scenario).sum() * 9.81
    assert np.allclose(v, weight / (10.0 * 0.1), rtol=1e-9)
    behind = 10.0 * v[0] * (np.arange(16) + 0.5) * 0.1 / 16
    behind -= 9.81 * np.cumsum(lumped_mass(scenario)[:-1])
    stretch = np.diff(s) - 0.1 / 16
    assert np.allclose(stretch, behind / scenario.wire.axial_spring, rtol=1e-8)
    assert s[-1] - s[0] - 0.1 == pytest.approx(behind.sum() / scenario.wire.axial_spring, rel=1e-8)


def test_entering_a_bend_costs_half_ei_kappa_squared():
    """Head in an arc, tail in the straight: the wire is pushed out with ½ E I κ², the closer the finer the mesh."""
    for radius, expected in ((0.0377, 5.936e-3), (0.05, 3.3748e-3)):
        errors = []
        for segments in (8, 16, 32, 64):
            scenario = world(bent(radius, math.pi), wire__segments=segments)
            s = at_rest(scenario, 0.26)
            assert scenario.tract.curvature(s[0]) <= 1e-5
            assert scenario.tract.curvature(s[-1]) == pytest.approx(1 / radius, rel=2e-4)
            cost = 0.5 * scenario.wire.bending_rigidity * scenario.tract.curvature(s[-1]) ** 2
            assert cost == pytest.approx(expected, rel=5e-4)
            errors.append(abs(joint_forces(scenario, s).sum() / cost + 1))
        assert errors[0] <= 3e-3
        assert (np.array(errors[:-1]) >= 3.7 * np.array(errors[1:])).all()


def test_a_wire_wholly_within_an_arc_is_not_pushed_along():
    scenario = world(bent(0.05, math.pi), wire__length=0.08)
    s = at_rest(scenario, 0.32)
    assert abs(joint_forces(scenario, s).sum()) <= 2e-3 * 0.5 * WIRE.bending_rigidity / 0.05**2


# --- friction, weight and drag ----------------------------------------------------------------------------------------


def test_weight_and_drag_act_on_every_node_by_its_share():
    scenario = world(line(), gravity=(1.0, 2.0, -3.0), contact__drag=0.5)
    s = np.linspace(0.3, 0.4, 17)
    mass = lumped_mass(scenario)
    assert np.allclose(joint_forces(scenario, s), mass * 1.0, rtol=1e-7, atol=0)
    share = np.r_[0.5, np.ones(15), 0.5] / 16
    expected = mass * 1.0 - 0.5 * 0.1 * share * 0.2
    assert np.allclose(joint_forces(scenario, s, velocities=0.2, period=1e-7), expected, rtol=1e-5, atol=0)


def test_friction_opposes_motion_by_mu_times_the_lateral_load():
    """Weight and spring tension make the load of a node; the bending reaction does not; the speed is smoothed by ε."""
    tract, mu, gravity = paper_spiral(), 0.2, np.array([0.5, 1.0, -9.81])
    rough = world(tract, gravity=tuple(gravity), contact__friction=mu)
    smooth = rough.replace(contact__friction=0.0)
    s = at_rest(rough, 0.5) * 1.002
    chord = np.diff(tract.position(s), axis=0)
    length = np.linalg.norm(chord, axis=1)[:, None]
    tension = WIRE.axial_spring * (length - WIRE.segment_length) * chord / length
    load = lumped_mass(rough)[:, None] * gravity
    load[:-1] += tension
    load[1:] -= tension
    t = tract.tangent(s)
    normal = np.linalg.norm(load - (load * t).sum(axis=1)[:, None] * t, axis=1)
    for v in (0.05, -0.05, 1e-4, -3e-5):
        ours = joint_forces(rough, s, v, period=1e-11) - joint_forces(smooth, s, v, period=1e-11)
        assert np.allclose(ours, -mu * normal * v / math.hypot(v, 1e-4), rtol=2e-4, atol=0)


def test_the_couple_of_the_tip_rubs_only_with_lever_friction():
    scenario = PAPER.replace(contact__drag=0.0, contact__friction=0.1)
    s, v = at_rest(scenario, 0.4), 0.05
    slick, levered = scenario.replace(contact__friction=0.0), scenario.replace(contact__lever_friction=True)
    free, rough, rougher = (joint_forces(sc, s, v, [[2.0]], period=1e-8) for sc in (slick, scenario, levered))
    sim = placed(Simulator(scenario), s, v, [[2.0]])
    assert (free - rough)[-1] == pytest.approx(0.1 * sim.lateral_force[0], rel=1e-3)
    assert (free - rougher)[-1] == pytest.approx(0.1 * sim.wall_force[0], rel=1e-3)
    assert np.allclose(rough[:-1], rougher[:-1], rtol=0, atol=1e-8)
    assert sim.wall_force[0] >= 5 * sim.lateral_force[0]


def test_a_rope_round_a_bend_obeys_the_capstan_equation():
    """T2/T1 = e^{μφ}, without bending stiffness, as the mesh gets finer: 0.21 % off with 60 segments.

    A light rope lies straight and round half a turn; a heavy tip hangs off the other end and pulls it through. Drag in
    the tail makes T1. It also acts within the arc, c v a metre, with which the law is (T2 + d)/(T1 + d) = e^{μφ},
    d = c v R/μ.
    """
    mu, radius, lead, drag, errors = 0.3, 0.05, 0.5, 5.0, []
    for segments in (30, 60):
        wire = dataclasses.replace(WIRE, length=0.6, bending_modulus=1e-3, density=1.0, segments=segments)
        scenario = world(
            bent(radius, math.pi, lead, 0.35, ease=0.02),
            wire=wire,
            tip=dataclasses.replace(TIP, mass=0.01),
            gravity=(-9.81, 0.0, 0.0),
            timing=Timing(0.05, 10),
            contact__friction=mu,
            contact__drag=drag,
        )
        sim, out = Simulator(scenario), lead + radius * math.pi
        sim.reset(tip_arclength=out + 0.06)
        for _ in range(20):
            sim.step(np.zeros((1, 1)))
        s, pull = sim.state().arclengths[0], drag * sim.state().velocities[0].mean()
        tension = wire.axial_spring * (np.linalg.norm(np.diff(sim.positions[0], axis=0), axis=1) - wire.segment_length)
        middle = (s[1:] + s[:-1]) / 2
        before, after = np.searchsorted(middle, lead - 0.02) - 1, np.searchsorted(middle, out + 0.02)
        t1, t2 = tension[before] + pull * (lead - middle[before]), tension[after] - pull * (middle[after] - out)
        d = pull * radius / mu
        errors.append((t2 + d) / (t1 + d) / math.exp(mu * math.pi) - 1)
        assert t2 / t1 >= 3
    assert abs(errors[0]) <= 7e-3
    assert abs(errors[1]) <= 3e-3
