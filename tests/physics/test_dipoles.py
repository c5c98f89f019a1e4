"""Field, force and torque of dipoles: the paper's formulas, and the laws they must obey (PHYSICS.md section 1)."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magwire_env.physics import MU0, BlockMagnet, DipoleCloud, field, field_gradient, force, torque

RNG_SEEDS = st.integers(0, 2**32 - 1)


def random_cloud(rng: np.random.Generator, dipoles: int, centre=(0.0, 0.0, 0.0)) -> DipoleCloud:
    """Dipoles within 5 mm of `centre`, moments of about 1 A·m² any way."""
    return DipoleCloud(np.asarray(centre) + rng.uniform(-5e-3, 5e-3, (dipoles, 3)), rng.normal(size=(dipoles, 3)))


def random_points(rng: np.random.Generator, n: int) -> np.ndarray:
    """Points 2 to 20 cm from the origin."""
    p = rng.normal(size=(n, 3))
    return p * (rng.uniform(0.02, 0.2, n) / np.linalg.norm(p, axis=1))[:, None]


def paper_force(m1: np.ndarray, m2: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Section III-A, letter by letter: force on dipole 2 at d from dipole 1."""
    size, n1, n2 = math.sqrt(d @ d), m1 @ d, m2 @ d
    return 3 * MU0 / (4 * math.pi * size**5) * (n1 * m2 + n2 * m1 + (m1 @ m2) * d - 5 / size**2 * n1 * n2 * d)


def paper_field(m1: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Section III-A, letter by letter: field of dipole 1 at d from it."""
    size = math.sqrt(d @ d)
    return MU0 / (4 * math.pi) * (3 * d / size**5 * (m1 @ d) - m1 / size**3)


@settings(deadline=None, derandomize=True, max_examples=30)
@given(RNG_SEEDS)
def test_field_force_and_torque_are_the_sums_of_the_paper(seed):
    rng = np.random.default_rng(seed)
    cloud, points, moments = random_cloud(rng, 7), random_points(rng, 5), rng.normal(size=(5, 3))
    b, f = np.zeros((5, 3)), np.zeros((5, 3))
    for i in range(5):
        for k in range(7):
            b[i] += paper_field(cloud.moments[k], points[i] - cloud.positions[k])
            f[i] += paper_force(cloud.moments[k], moments[i], points[i] - cloud.positions[k])
    assert np.allclose(field(cloud, points), b, rtol=1e-12, atol=1e-12 * np.abs(b).max())
    assert np.allclose(force(cloud, points, moments), f, rtol=1e-12, atol=1e-12 * np.abs(f).max())
    assert np.allclose(torque(cloud, points, moments), np.cross(moments, b), rtol=1e-12, atol=1e-12 * np.abs(b).max())


@settings(deadline=None, derandomize=True, max_examples=30)
@given(RNG_SEEDS)
def test_force_is_the_gradient_of_the_energy(seed):
    """F = ∇(μ·B) and ∂B/∂x by fourth-order differences; ∇·B = 0 and ∇×B = 0, so the gradient is symmetric."""
    rng = np.random.default_rng(seed)
    cloud, points, moments = random_cloud(rng, 5), random_points(rng, 6), rng.normal(size=(6, 3))
    step = 1e-3 * np.linalg.norm(points, axis=1)[:, None]
    columns = []
    for e in np.eye(3):
        near = field(cloud, points + e * step) - field(cloud, points - e * step)
        far = field(cloud, points + 2 * e * step) - field(cloud, points - 2 * e * step)
        columns.append((8 * near - far) / (12 * step))
    gradient = np.stack(columns, axis=2)
    size = np.linalg.norm(gradient, axis=(1, 2))
    ours = field_gradient(cloud, points)
    assert (np.linalg.norm(ours - gradient, axis=(1, 2)) <= 1e-9 * size).all()
    energy_gradient = np.einsum("ni,nij->nj", moments, gradient)
    error = np.linalg.norm(force(cloud, points, moments) - energy_gradient, axis=1)
    assert (error <= 1e-9 * size * np.linalg.norm(moments, axis=1)).all()
    assert (np.abs(np.trace(ours, axis1=1, axis2=2)) <= 1e-14 * size).all()
    assert (np.abs(ours - ours.transpose(0, 2, 1)).max(axis=(1, 2)) <= 1e-14 * size).all()


@settings(deadline=None, derandomize=True, max_examples=30)
@given(RNG_SEEDS)
def test_action_equals_reaction_and_no_torque_is_left_over(seed):
    rng = np.random.default_rng(seed)
    one, two = random_cloud(rng, 6), random_cloud(rng, 4, centre=(0.04, -0.02, 0.03))
    on_two, on_one = force(one, two.positions, two.moments), force(two, one.positions, one.moments)
    scale = np.abs(on_two).sum() + np.abs(on_one).sum()
    assert np.abs(on_two.sum(axis=0) + on_one.sum(axis=0)).max() <= 1e-14 * scale
    about = rng.uniform(-0.1, 0.1, 3)
    total = np.zeros(3)
    for source, body, forces in ((one, two, on_two), (two, one, on_one)):
        total += torque(source, body.positions, body.moments).sum(axis=0)
        total += np.cross(body.positions - about, forces).sum(axis=0)
    assert np.abs(total).max() <= 1e-14 * scale


def test_field_and_force_on_and_across_the_axis():
    """B = μ0 m/2πd³ ahead, −μ0 m/4πd³ abeam; coaxial moments attract with 3 μ0 mM/2πd⁴, abreast repel with half."""
    cloud = DipoleCloud(np.zeros((1, 3)), np.array([[0, 0, 2.0]]))
    points = np.array([[0, 0, 0.1], [0.1, 0, 0]])
    b = MU0 * 2.0 / (4 * math.pi * 0.1**3)
    assert np.allclose(field(cloud, points), [[0, 0, 2 * b], [0, 0, -b]], rtol=1e-14)
    f = 3 * MU0 * 2.0 * 0.5 / (4 * math.pi * 0.1**4)
    ours = force(cloud, points, np.array([[0, 0, 0.5], [0, 0, 0.5]]))
    assert np.allclose(ours, [[0, 0, -2 * f], [f, 0, 0]], rtol=1e-14)


def test_a_moved_cloud_carries_its_field_along():
    rng = np.random.default_rng(5)
    cloud, points = random_cloud(rng, 8), random_points(rng, 20)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    shift = np.array([0.3, -0.2, 0.1])
    carried = field(cloud.moved(turn, shift), points @ turn.T + shift)
    assert np.allclose(carried, field(cloud, points) @ turn.T, rtol=1e-11, atol=1e-16)
    assert np.array_equal(cloud.moved().positions, cloud.positions)
    assert np.array_equal(cloud.moved(translation=shift).moments, cloud.moments)


def test_large_sums_are_cut_up_without_changing_them():
    cloud = BlockMagnet((0.05,) * 3, 1.3).dipoles("grid", (10, 10, 20))
    points = 3 * random_points(np.random.default_rng(3), 250) + [0.2, 0, 0]  # 500 000 pairs: three chunks
    moments = np.ones((250, 3))
    alone = np.array([force(cloud, p[None], m[None])[0] for p, m in zip(points[::50], moments[::50], strict=True)])
    assert np.allclose(force(cloud, points, moments)[::50], alone, rtol=1e-12)
    assert field(cloud, np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda c: field(c, [0.0, 0.0, 0.1]), r"points must have shape \(n, 3\) \(in m\)"),
        (lambda c: field(c, [[0.0, math.nan, 0.1]]), r"points\[0\] must be finite \(in m\)"),
        (lambda c: field(c, c.positions[:1]), r"points must not coincide with a dipole"),
        (lambda c: force(c, [[0.0, 0.0, 0.1]], np.ones((2, 3))), r"moments must have the shape of points"),
        (lambda c: torque(c, [[0.0, 0.0, 0.1]], [[0.0, math.inf, 0.0]]), r"moments\[0\] must be finite \(in A·m²\)"),
        (lambda c: DipoleCloud(np.zeros((2, 3)), np.ones((3, 3))), r"moments must have the shape of positions"),
        (lambda c: DipoleCloud("here", np.ones((3, 3))), r"positions must be an \(n, 3\) array \(in m\)"),
    ],
)
def test_bad_input_is_refused_by_name(call, named):
    cloud = random_cloud(np.random.default_rng(0), 3)
    with pytest.raises(ValueError, match=named):
        call(cloud)
