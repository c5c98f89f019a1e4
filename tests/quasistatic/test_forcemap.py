"""What the rig can do along the tract: the force map (Figure 6) and the best command (Figure 7)."""

import dataclasses
import math

import numpy as np
import pytest

from magwire_env.physics import MU0, BlockMagnet, PointDipole, Tract, field_gradient
from magwire_env.scenario import ActuatedMagnet, Rig, Scenario, Slide, Turn
from magwire_env.simulation import Simulator, best_command, drive_at, force_map
from tests.support.scenes import world

PAPER = Scenario.paper()
BLOCK = PAPER.rig.magnets[0].magnet
POINT = Rig((ActuatedMagnet(PointDipole(BLOCK.moment), PAPER.rig.magnets[0].position, (Turn("y", home=math.pi),)),))
ANGLES = np.linspace(0.0, 2 * np.pi, 36, endpoint=False)
PLACES = np.linspace(0.0, 0.8, 41)


def below(way, magnet=BLOCK, height: float = 0.07) -> Scenario:
    """A straight tract through the origin along `way`, the magnet `height` m above."""
    way = np.asarray(way) / np.linalg.norm(way)
    tract = Tract.from_points([-0.4 * way, np.zeros(3), 0.4 * way])
    mount = ActuatedMagnet(magnet, (0.0, 0.0, height), (Turn("y"),), ("gauss", 12))
    return world(tract, coupling="force", rig=Rig((mount,)))


# --- the map ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["force", "wrench"])
def test_the_map_is_the_drive_the_simulator_feels(coupling):
    scenario = PAPER.replace(coupling=coupling)
    drive = force_map(scenario, ANGLES, PLACES)
    assert drive.shape == (36, 41)
    sim = Simulator(scenario, num_envs=41)
    for i in (0, 7, 20):
        sim.reset(tip_arclength=PLACES, magnet=np.full((41, 1), ANGLES[i]))
        assert np.array_equal(drive[i], sim.drive_force)


@pytest.mark.parametrize("coupling", ["force", "wrench"])
def test_the_map_of_a_point_dipole_is_a_sinusoid_in_the_angle(coupling):
    """F = A(s) cos(θ − φ(s)): nothing but the first harmonic, so F(θ + π) = −F(θ)."""
    drive = force_map(PAPER.replace(rig=POINT, coupling=coupling), ANGLES, PLACES)
    harmonics = np.abs(np.fft.rfft(drive, axis=0)) / 18
    assert (harmonics[1] >= 9e-5).all()
    assert np.delete(harmonics, 1, axis=0).max() <= 1e-16
    assert np.abs(drive[:18] + drive[18:]).max() <= 1e-16


def test_the_block_adds_small_odd_harmonics():
    """Of the drive's 14.7 mN the fifth has 0.74 mN, the third 0.14 mN, the seventh 0.01 mN; even ones none."""
    for rule in (("fitted", 21), ("gauss", 8)):
        block = Rig((dataclasses.replace(PAPER.rig.magnets[0], dipoles=rule),))
        drive = force_map(PAPER.replace(rig=block), ANGLES, PLACES)
        harmonics = (np.abs(np.fft.rfft(drive, axis=0)) / 18).max(axis=1)
        assert harmonics[::2].max() <= 1e-16
        assert harmonics[1:8:2] == pytest.approx([14.74e-3, 0.142e-3, 0.7425e-3, 0.010e-3], rel=0.06)


def test_maps_that_cannot_be_drawn_are_refused():
    two = Rig((dataclasses.replace(PAPER.rig.magnets[0], dofs=(Turn("y"), Turn("z"))),))
    with pytest.raises(ValueError, match=r"one degree of freedom for a force map, got 2"):
        force_map(PAPER.replace(rig=two), ANGLES, PLACES)


# --- the numbers of PHYSICS.md ----------------------------------------------------------------------------------------


def test_seven_centimetres_to_the_centre_or_to_the_face():
    """Directly below, along the magnet's turning plane: 16.35 mN against 4.86 mN."""
    for height, expected in ((0.07, 16.35e-3), (0.07 + 0.0254, 4.86e-3)):
        drive = best_command(below((1, 0, 0), height=height), np.array([0.4]))[1]
        assert drive[0] == pytest.approx(expected, rel=2e-3)
    centre, face = (Scenario.paper(measured_to=m).rig.magnets[0] for m in ("centre", "face"))
    s = np.linspace(0.0, 0.8, 4001)
    assert centre.distance_to(PAPER.tract.position(s)) == pytest.approx(0.07, abs=1e-6)
    assert face.distance_to(PAPER.tract.position(s)) == pytest.approx(0.0954, abs=1e-6)


def test_a_straight_tract_cannot_be_steered_by_a_fixed_magnet():
    """17.4 mN below a dipole fall to 0.37 mN at 20 cm; 3 μ0 m M/(4π d⁴) is what a dipole gives."""
    scenario = below((1, 0, 0), PointDipole(BLOCK.moment))
    drive = best_command(scenario, np.array([0.4, 0.6]))[1]
    assert drive[0] == pytest.approx(3 * MU0 * BLOCK.moment * scenario.tip.moment / (4 * math.pi * 0.07**4), rel=1e-6)
    assert drive == pytest.approx([17.4e-3, 0.37e-3], rel=5e-3)


def test_where_no_angle_pushes():
    """Straight below, with the tangent 54.7° from the vertical in the y–z plane; at 45° some angle does."""
    lean = math.acos(1 / math.sqrt(3))
    blocked = below((0, math.sin(lean), math.cos(lean)), PointDipole(BLOCK.moment))
    assert best_command(blocked, np.array([0.4]))[1][0] <= 1e-10
    assert best_command(below((0, 1, 1), PointDipole(BLOCK.moment)), np.array([0.4]))[1][0] >= 1e-3


def test_the_tract_of_the_paper_can_be_steered_all_along():
    """Figure 7 as read here: 2.86 to 14.26 mN; the best angle stays within ± 1.02 rad of home."""
    commands, drive = best_command(PAPER, np.linspace(0.0, 0.8, 401))
    assert drive.min() == pytest.approx(2.86e-3, rel=5e-3)
    assert drive.max() == pytest.approx(14.26e-3, rel=5e-3)
    assert np.abs(commands - math.pi).max() == pytest.approx(1.02, abs=0.01)


# --- the best command -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("scenario", [PAPER, PAPER.replace(coupling="wrench")], ids=["force", "wrench"])
def test_best_command_is_the_maximum_of_a_dense_scan(scenario, direction):
    """Against 7200 angles, 0.05° apart: never below, and within rounding of what the command itself gives."""
    places = PLACES[::2]
    commands, drive = best_command(scenario, places, direction)
    assert commands.shape == (len(places), 1)
    dense = direction * force_map(scenario, np.linspace(0.0, 2 * np.pi, 7200, endpoint=False), places)
    assert (np.sign(drive) == direction).all()
    assert (direction * drive >= dense.max(axis=0)).all()
    assert (direction * drive <= dense.max(axis=0) * (1 + 1e-6)).all()
    assert np.array_equal(drive_at(scenario, commands, places), drive)
    assert (np.abs(commands - math.pi) <= math.pi + 0.1).all()


def test_best_direction_of_a_dipole_that_turns_any_way():
    """The drive is m · G, G its gradient in the moment: the best is |m| |G|, to the search's 1e-4 of the range."""
    position = PAPER.rig.magnets[0].position
    rig = Rig((ActuatedMagnet(PointDipole(BLOCK.moment), position, (Turn("y"), Turn("z"))),))
    s = np.linspace(0.05, 0.75, 15)
    p, t = PAPER.tract.position(s), PAPER.tract.tangent(s)
    slopes = []
    for axis in np.eye(3):
        cloud = PointDipole(BLOCK.moment).dipoles().moved(translation=np.array(position))
        turned = dataclasses.replace(cloud, moments=BLOCK.moment * axis[None])
        slopes.append(PAPER.tip.moment * np.einsum("ni,nij,nj->n", t, field_gradient(turned, p), t))
    limit = np.linalg.norm(slopes, axis=0)
    drive = best_command(PAPER.replace(rig=rig), s)[1]
    assert (drive <= limit * (1 + 2e-5)).all()
    assert (drive >= limit * (1 - 1e-5)).all()


def test_best_command_of_a_magnet_that_slides_and_turns():
    """Within its limits, never below a scan of 40 × 40 × 24 commands, and better than the fixed magnet."""
    dofs = (Turn("y", home=math.pi), Slide("x", -0.1, 0.1), Slide("y", -0.05, 0.1))
    mount = ActuatedMagnet(BLOCK, (0.0, 0.0, 0.085), dofs)
    scenario = PAPER.replace(rig=Rig((mount,)), coupling="wrench")
    axes = (np.linspace(0, 2 * np.pi, 40, endpoint=False), np.linspace(-0.1, 0.1, 40), np.linspace(-0.05, 0.1, 24))
    scan = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    s = np.array([0.1, 0.35, 0.6])
    commands, drive = best_command(scenario, s)
    for i, place in enumerate(s):
        assert drive[i] >= drive_at(scenario, scan, np.full(len(scan), place)).max()
    assert (np.abs(commands[:, 1]) <= 0.1).all()
    assert ((commands[:, 2] >= -0.05) & (commands[:, 2] <= 0.1)).all()
    assert (drive > 1.5 * best_command(PAPER.replace(coupling="wrench"), s)[1]).all()


def test_drive_is_linear_in_the_strength_of_the_magnet():
    weak = PAPER.replace(
        rig=Rig((dataclasses.replace(PAPER.rig.magnets[0], magnet=BlockMagnet((50.8e-3,) * 3, 0.65)),))
    )
    commands = np.full((41, 1), 2.0)
    assert np.allclose(2 * drive_at(weak, commands, PLACES), drive_at(PAPER, commands, PLACES), rtol=1e-12, atol=1e-18)
