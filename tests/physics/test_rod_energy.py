"""The free rod's energy, gradient and Hessian, against the springs written out by hand and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magwire_env.physics import (
    BlockMagnet,
    FreeRod,
    field,
)
from magwire_env.physics.rod_energy import Chart, Shape
from magwire_env.validation.rods import LENGTH, field_unit, force_unit, make_rod

BLOCK = BlockMagnet((0.0508, 0.0508, 0.0508), 1.3)


def random_turn(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def written_out_energy(
    rod: FreeRod, nodes: np.ndarray, cloud=None, uniform_field=(0, 0, 0), tip_force=(0, 0, 0)
) -> float:
    """The total energy, one spring at a time."""
    w, total = rod.wire, 0.0
    segments = [nodes[i + 1] - nodes[i] for i in range(w.segments)]
    before = np.array([1.0, 0.0, 0.0])
    for i, e in enumerate(segments):
        total += 0.5 * w.axial_spring * (np.linalg.norm(e) - w.segment_length) ** 2
        spring = w.bending_spring
        if i == 0:
            spring = 2 * w.bending_spring
        elif i == w.segments - 1:
            spring = 1 / (1 / w.bending_spring + 1 / (2 * w.bending_spring))
        cosine = before @ e / np.linalg.norm(before) / np.linalg.norm(e)
        total += 0.5 * spring * math.acos(min(1.0, cosine)) ** 2
        before = e
    b = np.array(uniform_field, dtype=float)
    b = b if cloud is None else b + field(cloud, nodes[-1:])[0]
    total -= rod.tip.moment * (before / np.linalg.norm(before)) @ b + np.dot(tip_force, nodes[-1])
    for i in range(1, w.segments + 1):
        mass = w.mass / w.segments if i < w.segments else w.mass / w.segments / 2 + rod.tip.mass
        total -= mass * np.dot(rod.gravity, nodes[i])
    return total


def random_case(seed: int, with_cloud: bool) -> tuple[FreeRod, np.ndarray, dict]:
    rng = np.random.default_rng(seed)
    rod = make_rod(int(rng.integers(2, 9)), gravity=rng.normal(size=3))
    n = rod.wire.segments
    d = np.cumsum(rng.normal(size=(n, 3)) * 0.5, axis=0) + np.array([1.0, 0, 0])
    d *= rng.uniform(0.8, 1.2, size=(n, 1)) * rod.wire.segment_length / np.linalg.norm(d, axis=1)[:, None]
    nodes = np.concatenate([np.zeros((1, 3)), np.cumsum(d, axis=0)])
    load: dict = {
        "uniform_field": rng.normal(size=3) * field_unit(rod),
        "tip_force": rng.normal(size=3) * force_unit(rod),
    }
    if with_cloud:
        place = nodes[-1] + random_unit(rng) * rng.uniform(0.06, 0.2)
        load["cloud"] = BLOCK.dipoles("gauss", 2).moved(random_turn(rng), place)
    return rod, nodes, load


@pytest.mark.parametrize("with_cloud", [False, True])
@pytest.mark.parametrize("seed", range(10))
def test_energy_and_forces_are_those_of_the_springs_written_out(seed, with_cloud):
    rod, nodes, load = random_case(seed, with_cloud)
    assert rod.energy(nodes, **load) == pytest.approx(written_out_energy(rod, nodes, **load), rel=1e-12)
    forces, step = rod.forces(nodes, **load), 1e-7
    for i, j in np.ndindex(rod.wire.segments, 3):
        up, down = nodes.copy(), nodes.copy()
        up[i + 1, j] += step
        down[i + 1, j] -= step
        slope = (written_out_energy(rod, up, **load) - written_out_energy(rod, down, **load)) / (2 * step)
        assert forces[i + 1, j] == pytest.approx(-slope, abs=1e-7 * np.abs(forces).max())


@pytest.mark.parametrize("with_cloud", [False, True])
@pytest.mark.parametrize("seed", range(10))
def test_gradient_and_hessian_of_the_chart(seed, with_cloud):
    rod, nodes, load = random_case(seed, with_cloud)
    rng = np.random.default_rng(seed)
    chart = Chart(rod._chain, rod._load(**load), Shape(*rod._shape("nodes", nodes)))
    p, step = 0.4 * rng.normal(size=3 * rod.wire.segments), 1e-6
    lines = step * np.eye(len(p))
    slopes = [(chart.value(p + e)[0] - chart.value(p - e)[0]) / (2 * step) for e in lines]
    curves = [(chart.value(p + e)[1] - chart.value(p - e)[1]) / (2 * step) for e in lines]
    gradient, hessian = chart.value(p)[1], chart.hessian(p)
    np.testing.assert_allclose(gradient, slopes, rtol=0, atol=1e-7 * np.abs(gradient).max())
    np.testing.assert_allclose(hessian, curves, rtol=0, atol=1e-7 * np.abs(hessian).max())


@given(
    st.floats(0, math.pi - 1e-4),
    st.floats(-math.pi, math.pi),
    st.floats(-1, 1),
)
@settings(max_examples=200, deadline=None)
def test_joint_energy_is_quadratic_in_the_angle_at_any_angle(phi, turn, height):
    """From straight to folded back, in any direction, the couple at the joint is k φ."""
    rod = make_rod(3)
    cell = rod.wire.segment_length
    a = np.array([math.sqrt(1 - height**2), 0.0, height])
    b = np.array([-a[2], 0.0, a[0]]) * math.cos(turn) + np.array([0.0, 1.0, 0.0]) * math.sin(turn)
    c = math.cos(phi) * a + math.sin(phi) * b
    nodes = np.cumsum([np.zeros(3), a * cell, c * cell, c * cell], axis=0)
    first = math.acos(min(1.0, a[0]))
    expected = 0.5 * rod.wire.bending_spring * (2 * first**2 + phi**2)
    assert rod.energy(nodes) == pytest.approx(expected, rel=1e-9, abs=1e-18)
    # the couple about node 2 of the force on node 3, by which the joint there resists
    couple = np.linalg.norm(np.cross(c * cell, rod.forces(nodes)[3]))
    assert couple == pytest.approx(0.0, abs=1e-12)  # the last joint is straight
    couple = np.linalg.norm(np.cross(c * cell, rod.forces(nodes)[2:].sum(axis=0)))
    assert couple == pytest.approx(rod.wire.bending_spring * phi, rel=1e-6, abs=1e-11)


def test_a_rod_folded_right_back_unfolds():
    """At φ = π the couple has no direction; the energy is still ½ k π², and no equilibrium."""
    rod = make_rod(6)
    for direction in ([1.0, 0, 0], [0, 1.0, 0], [0.6, 0, 0.8]):
        d = np.array(direction)
        places = np.array([0, 1, 2, 3, 2, 1, 0.0]) * rod.wire.segment_length
        folded = places[:, None] * d
        clamp = math.acos(d[0])
        expected = 0.5 * rod.wire.bending_spring * (2 * clamp**2 + math.pi**2)
        assert rod.energy(folded) == pytest.approx(expected, rel=1e-12)
        straight = np.linspace([0, 0, 0], [LENGTH, 0, 0], 7)
        np.testing.assert_allclose(rod.equilibrium(start=folded), straight, atol=1e-9)
