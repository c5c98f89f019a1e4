"""The free rod against closed forms and PyElastica; its equilibria under random loads.

The checks that stand in the validation table are in `magwire_env.validation.rods`; here they are held more tightly.
"""

import math

import numpy as np
import pytest

from magwire_env.physics import DipoleCloud, FreeRod, Guidewire, NotConverged, PointDipole, force
from magwire_env.validation import Row
from magwire_env.validation.magnets import BLOCK, TIP
from magwire_env.validation.rods import (
    LENGTH,
    buckling,
    convergence_order,
    elastica,
    elastica_rows,
    end_couple,
    end_couple_rows,
    field_unit,
    force_unit,
    make_rod,
    pyelastica_tip,
    random_turn,
    random_unit,
    sweep,
    tip_angle,
)


def assert_rows(rows: list[Row], tolerance: float) -> None:
    wrong = [row for row in rows if not row.error <= tolerance]
    assert not wrong, wrong


def test_closed_forms_are_those_of_the_literature():
    table = {1: (26.434, 0.30172), 2: (44.791, 0.49346), 5: (69.635, 0.71379), 10: (81.949, 0.81061)}
    for load, row in table.items():
        np.testing.assert_allclose(elastica(load), row, rtol=2e-5)
    np.testing.assert_allclose(end_couple(1.0, 90.0)[::2], (42.347, 0.35302), rtol=2e-5)


def test_elastica():
    assert_rows(elastica_rows(200), 5e-5)


def test_tip_dipole_in_a_uniform_field():
    assert_rows(end_couple_rows(200), 5e-5)


def test_tip_angle_in_a_uniform_field_is_exact_at_any_number_of_segments():
    angles = [row for row in end_couple_rows(3) if row.quantity.endswith("tip angle")]
    assert len(angles) == 5
    assert_rows(angles, 1e-6)


def test_buckling():
    assert_rows(buckling(40), 2e-3)


@pytest.mark.parametrize(
    "rows_of", [lambda n: elastica_rows(n, stretch=1e6), end_couple_rows], ids=["cantilever", "field"]
)
def test_second_order_in_the_number_of_segments(rows_of):
    orders = [order for order in convergence_order(rows_of, 100) if not math.isnan(order)]
    assert len(orders) >= 8
    assert min(orders) > 1.95, orders


def test_segments_are_springs_in_series():
    rod = make_rod(12)
    nodes = rod.equilibrium(tip_force=(0.5, 0, 0))
    np.testing.assert_allclose(nodes[-1], [LENGTH + 12 * 0.5 / rod.wire.axial_spring, 0, 0], rtol=1e-9, atol=1e-12)


def test_gravity():
    g = 1e-3
    rod = make_rod(50, gravity=(0, 0, -g))
    w, stiffness = rod.wire, rod.wire.bending_rigidity
    sag = w.mass * g * LENGTH**3 / (8 * stiffness) + TIP.mass * g * LENGTH**3 / (3 * stiffness)
    assert rod.equilibrium()[-1, 2] == pytest.approx(-sag, rel=2e-3)
    hung = make_rod(50, gravity=(g, 0, 0)).equilibrium()[-1, 0] - LENGTH
    assert hung == pytest.approx((w.mass / 2 + TIP.mass) * g * LENGTH / w.axial_rigidity, rel=1e-6)


@pytest.mark.filterwarnings("default")
def test_pyelastica_agrees():
    load = np.array([0.0, 1.2, 1.6])  # P = 2, in no coordinate plane
    pytest.importorskip("elastica", reason="PyElastica, an extra for tests, is not installed")
    theirs = pyelastica_tip(load)
    rod = FreeRod(Guidewire(1.0, 0.03, 1e6, 1e6, 1e3, 100), TIP)
    ours = rod.equilibrium(tip_force=load * force_unit(rod))[-1]
    moved = np.linalg.norm(theirs - [1, 0, 0])
    assert moved > 0.4
    assert np.linalg.norm(ours - theirs) < 0.01 * moved


def assert_equilibrium(rod: FreeRod, nodes: np.ndarray, load: dict) -> None:
    """Forces balance at every free node, and every small displacement costs energy."""
    forces = rod.forces(nodes, **load)
    scale = force_unit(rod) * rod.wire.segments
    assert np.abs(forces[1:]).max() < 1e-7 * scale
    rng = np.random.default_rng(0)
    here = rod.energy(nodes, **load)
    for _ in range(20):
        moved = (
            nodes + np.concatenate([np.zeros((1, 3)), np.cumsum(rng.normal(size=(len(nodes) - 1, 3)), axis=0)]) * 1e-6
        )
        assert rod.energy(moved, **load) > here


def test_the_clamp_holds_the_whole_load():
    rod = make_rod(16, gravity=(0, 0, -9.81))
    load = {"tip_force": (2e-3, 1e-3, 0), "cloud": PointDipole(5.0).dipoles().moved(translation=[0.12, 0.15, 0.1])}
    nodes = rod.equilibrium(**load)
    last = nodes[-1] - nodes[-2]
    magnetic = force(load["cloud"], nodes[-1:], TIP.moment * last[None] / np.linalg.norm(last))[0]
    weight = (rod.wire.mass * (1 - 0.5 / 16) + TIP.mass) * np.array(rod.gravity)
    np.testing.assert_allclose(
        rod.forces(nodes, **load)[0], magnetic + weight + load["tip_force"], rtol=1e-6, atol=1e-12
    )
    assert_equilibrium(rod, nodes, load)


def test_a_load_turned_about_the_rod_turns_the_rod():
    rod = make_rod(10)
    cloud = BLOCK.dipoles("gauss", 2).moved(random_turn(np.random.default_rng(4)), [0.05, 0.02, 0.25])
    f, b = np.array([-2.0, 1, 3]) * force_unit(rod), np.array([0.4, 2.0, -1.0]) * field_unit(rod)
    nodes = rod.equilibrium(cloud, b, f)
    for angle in (0.5, 2.0, math.pi, 4.5):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])
        np.testing.assert_allclose(rod.equilibrium(cloud.moved(turn), turn @ b, turn @ f), nodes @ turn.T, atol=1e-9)


def test_beyond_buckling_the_straight_rod_is_not_returned():
    rod = make_rod(16)
    for load in ({"uniform_field": (-3 * field_unit(rod), 0, 0)}, {"tip_force": (-8 * force_unit(rod), 0, 0)}):
        straight = np.linspace([0, 0, 0], [LENGTH, 0, 0], 17)
        for start in (None, straight):
            nodes = rod.equilibrium(**load, start=start)
            assert tip_angle(nodes) > 90
            assert rod.energy(nodes, **load) < rod.energy(straight, **load)
            np.testing.assert_allclose(rod.forces(nodes, **load)[1:], 0, atol=1e-9 * force_unit(rod) * 16)


def test_start_selects_among_several_equilibria():
    """Between two equal magnets the rod may lean to either, or stay straight."""
    rod = make_rod(12)
    cloud = DipoleCloud([[0.06, 0, 0.16], [0.06, 0, -0.16]], [[0, 0, 60.0], [0, 0, -60.0]])
    turn = np.linspace(0, 1.3, 12)
    steps = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=1) * rod.wire.segment_length
    start = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    up, down = rod.equilibrium(cloud, start=start), rod.equilibrium(cloud, start=start * [1, 1, -1])
    assert up[-1, 2] > 0.05
    np.testing.assert_allclose(down, up * [1, 1, -1], atol=1e-9)
    for nodes in (up, down, rod.equilibrium(cloud)):
        assert_equilibrium(rod, nodes, {"cloud": cloud})
    np.testing.assert_allclose(rod.equilibrium(cloud)[:, 1:], 0, atol=1e-9)


def test_a_load_that_would_turn_segments_inside_out_is_not_an_equilibrium():
    """Pushed harder than E·A, a linear spring shortens beyond zero length: there the model ends, and it says so."""
    rod = make_rod(12, stretch=1e-3)
    with pytest.raises(NotConverged, match="no stable equilibrium") as caught:
        rod.equilibrium(tip_force=(-2.5 * rod.wire.axial_rigidity, 0, 0))
    assert 1 < caught.value.residual < math.inf


def test_two_hundred_segments_in_a_cloud():
    rod = make_rod(200)
    load = {"cloud": BLOCK.dipoles("grid", (10, 10, 20)).moved(translation=[0.16, 0, 0.12])}
    fine, coarse = rod.equilibrium(**load), make_rod(50).equilibrium(**load)
    np.testing.assert_allclose(coarse[-1], fine[-1], atol=2e-3 * LENGTH)
    assert np.abs(rod.forces(fine, **load)[1:]).max() < 1e-6 * force_unit(rod)


def test_random_valid_loads_converge():
    converged, touched, worst = sweep(200)
    assert converged >= 198
    assert touched == 0
    assert worst < 1e-6


def random_near_magnet(rng: np.random.Generator, rod: FreeRod) -> dict:
    """The paper's block 7 to 15 cm from the tip at rest, where many a wire is drawn into it."""
    place = np.array([rod.wire.length, 0, 0]) + random_unit(rng) * rng.uniform(0.07, 0.15)
    return {"cloud": BLOCK.dipoles("gauss", 4).moved(random_turn(rng), place)}


def test_magnets_within_reach_balance_or_say_so():
    converged, touched, worst = sweep(40, random_near_magnet)
    assert converged + touched == 40
    assert min(converged, touched) > 4
    assert worst < 1e-6
