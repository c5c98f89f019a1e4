"""The tract: an arc-length C² centreline with straight extensions, its nearest points, and what it refuses."""

import math
import pickle

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from magwire_env.lumen.named import circle, paper_spiral, straight
from magwire_env.physics import Tract

PAPER = paper_spiral()
LOOP = Tract.from_points(
    [(0.06 * math.cos(a), 0.05 * math.sin(a), 0.01 * math.sin(2 * a)) for a in np.arange(24) * math.pi / 12],
    closed=True,
)
TRACTS = {"paper": PAPER, "loop": LOOP, "two points": Tract.from_points([(0, 0, 0), (0.1, 0.2, -0.2)])}


@pytest.fixture(params=TRACTS, name="tract")
def tract_fixture(request) -> Tract:
    return TRACTS[request.param]


def places(tract: Tract, n: int, beyond: float = 0.0) -> np.ndarray:
    """Uneven arc lengths over the tract, and `beyond` m past its ends."""
    return np.random.default_rng(1).uniform(-beyond, tract.length + beyond, n)


# --- the curve --------------------------------------------------------------------------------------------------------


def test_s_is_arc_length(tract):
    """|dp/ds| is 1 to 1.5e-5 everywhere and 1e-6 on the whole, and the length is that of a fine polygon."""
    s, h = places(tract, 4000, beyond=0.05), 1e-5
    speed = np.linalg.norm(tract.position(s + h) - tract.position(s - h), axis=1) / (2 * h)
    assert np.abs(speed - 1).max() <= 1.5e-5
    assert np.sqrt(np.mean((speed - 1) ** 2)) <= 1e-6
    fine = tract.position(np.linspace(0.0, tract.length, 200_001))
    assert np.linalg.norm(np.diff(fine, axis=0), axis=1).sum() == pytest.approx(tract.length, rel=1e-8)


def test_the_course_is_the_spline_through_the_control_points(tract):
    """Within 40 nm of the C² spline over chord length; through each control point."""
    xyz = np.asarray(tract.points + (tract.points[:1] if tract.closed else ()))
    chord = np.r_[0.0, np.linalg.norm(np.diff(xyz, axis=0), axis=1).cumsum()]
    curve = CubicSpline(chord, xyz, bc_type="periodic" if tract.closed else "natural")
    p = curve(np.linspace(0.0, chord[-1], 3001))
    assert np.linalg.norm(tract.position(tract.project(p)) - p, axis=1).max() <= 4e-8
    at = tract.project(np.asarray(tract.points))
    assert (np.diff(at) > 0).all()


def test_position_tangent_and_curvature_run_on_without_a_jump(tract):
    """C² across every row of the table, the ends of an open tract included."""
    rows, h = len(tract.table) - 2, tract.row_spacing
    u = np.full((rows - 1, 1), h)
    c = tract.table[1:-1].reshape(rows, 4, 3)
    end_p = c[:-1, 0] + u * (c[:-1, 1] + u * (c[:-1, 2] + u * c[:-1, 3]))
    end_t = c[:-1, 1] + u * (2 * c[:-1, 2] + 3 * u * c[:-1, 3])
    end_k = 2 * c[:-1, 2] + 6 * u * c[:-1, 3]
    assert np.abs(end_p - c[1:, 0]).max() <= 1e-15
    assert np.abs(end_t - c[1:, 1]).max() <= 1e-12
    assert np.abs(end_k - 2 * c[1:, 2]).max() <= 1e-9
    for end in (0.0, tract.length):
        before, after = end - 1e-9, end + 1e-9
        assert np.abs(tract.position(before) - tract.position(after)).max() <= 2.1e-9
        assert np.abs(tract.tangent(before) - tract.tangent(after)).max() <= 1e-7
        assert np.abs(tract.curvature_vector(before) - tract.curvature_vector(after)).max() <= 1e-4


def test_tangent_and_curvature_are_the_derivatives(tract):
    s, h = places(tract, 2000), 1e-6
    t, k = tract.tangent(s), tract.curvature_vector(s)
    assert np.allclose(np.linalg.norm(t, axis=1), 1, rtol=0, atol=1e-14)
    assert np.abs((tract.position(s + h) - tract.position(s - h)) / (2 * h) - t).max() <= 1.5e-5
    bend = np.maximum(tract.curvature(s), 1.0)  # 1/m, up to 27
    assert (np.linalg.norm((tract.tangent(s + h) - tract.tangent(s - h)) / (2 * h) - k, axis=1) <= 5e-6 * bend).all()
    assert np.abs((t * k).sum(axis=1)).max() <= 1e-12
    assert np.array_equal(tract.curvature(s), np.linalg.norm(k, axis=1))


def test_shapes_follow_those_of_s():
    for shape in ((), (3,), (2, 3, 4)):
        s = np.full(shape, 0.1)
        assert PAPER.position(s).shape == PAPER.tangent(s).shape == PAPER.curvature_vector(s).shape == (*shape, 3)
        assert PAPER.curvature(s).shape == PAPER.radius_at(s).shape == PAPER.project(PAPER.position(s)).shape == shape
    assert np.array_equal(PAPER.position(0.1), PAPER.position(np.array([0.1]))[0])


def test_the_tract_of_the_paper():
    """0.8 m long, 15 mm wide, and of the spiral's smallest bend radius, 37.7 mm (PHYSICS.md section 3).

    Two centimetres from the inner end, where the spline comes off its free end, it is 37.3 mm.
    """
    assert PAPER.length == pytest.approx(0.8, rel=1e-9)
    assert PAPER.radius == PAPER.widest == 7.5e-3
    s = np.linspace(0.0, PAPER.length, 20_001)
    bend = 1 / PAPER.curvature(s).max()
    assert bend == pytest.approx(37.7e-3, rel=0.012)
    assert bend == pytest.approx(37.26e-3, abs=1e-5)


def test_straight_and_round_tracts_are_straight_and_round():
    line = straight(0.5)
    s = np.linspace(-0.1, 0.6, 71)
    assert np.allclose(line.position(s), np.stack([s - 0.25, 0 * s, 0 * s], axis=1), rtol=0, atol=1e-15)
    assert np.abs(line.curvature(s)).max() <= 1e-10
    ring = circle(0.5)
    s = np.linspace(0.0, 0.5, 500)
    assert np.allclose(ring.curvature(s) * 0.5 / (2 * math.pi), 1, rtol=0, atol=1.5e-3)
    assert np.allclose(np.linalg.norm(ring.position(s), axis=1), 0.5 / (2 * math.pi), rtol=2e-6)


# --- beyond the ends --------------------------------------------------------------------------------------------------


def test_an_open_tract_goes_on_straight():
    for end, way in ((0.0, -1), (PAPER.length, 1)):
        s = end + way * np.array([1e-3, 0.05, 7.0])
        t = PAPER.tangent(end)
        assert np.allclose(PAPER.position(s), PAPER.position(end) + (s - end)[:, None] * t, rtol=0, atol=1e-13)
        assert np.allclose(PAPER.tangent(s), t, rtol=0, atol=1e-14)
        assert (PAPER.curvature(s) == 0).all()


def test_a_loop_wraps_round():
    s = places(LOOP, 200)
    for laps in (-2, -1, 1, 3):
        assert np.allclose(LOOP.position(s + laps * LOOP.length), LOOP.position(s), rtol=0, atol=1e-14)
        assert np.allclose(LOOP.tangent(s + laps * LOOP.length), LOOP.tangent(s), rtol=0, atol=1e-13)
    assert np.allclose(LOOP.position(LOOP.length), LOOP.points[0], rtol=0, atol=1e-9)
    assert circle(0.5).length == pytest.approx(0.5, rel=1e-9)


# --- the nearest point ------------------------------------------------------------------------------------------------


def test_projecting_a_point_of_the_centreline_gives_its_arc_length(tract):
    s = places(tract, 500)
    assert np.abs(tract.project(tract.position(s)) - s).max() <= 1e-12


def test_projection_finds_the_closest_point_of_all(tract):
    rng = np.random.default_rng(2)
    p = tract.position(places(tract, 300)) + rng.normal(scale=5e-3, size=(300, 3))
    s = tract.project(p)
    gap = tract.position(s) - p
    inside = (s > 0) & (s < tract.length)
    assert np.abs((gap * tract.tangent(s)).sum(axis=1)[inside]).max() <= 1e-12
    dense = tract.position(np.linspace(0.0, tract.length, 20_001))
    brute = np.array([((dense - q) ** 2).sum(axis=1).min() ** 0.5 for q in p])
    assert (np.linalg.norm(gap, axis=1) <= brute + 1e-12).all()


def test_projection_stops_at_the_ends_of_an_open_tract():
    behind = PAPER.position(0.0) - 0.03 * PAPER.tangent(0.0)
    ahead = PAPER.position(0.8) + 0.01 * PAPER.tangent(0.8)
    assert PAPER.project(np.stack([behind, ahead])).tolist() == [0.0, PAPER.length]


# --- the lumen, and being a value -------------------------------------------------------------------------------------


def test_radius_is_linear_between_control_points():
    xyz = np.asarray(PAPER.points)
    radii = np.linspace(5e-3, 9e-3, len(xyz))
    tract = Tract.from_points(xyz, radii)
    at = tract.project(xyz)
    assert np.allclose(tract.radius_at(at), radii, rtol=0, atol=1e-9)
    middle = (at[40] + at[41]) / 2
    assert tract.radius_at(middle) == pytest.approx((radii[40] + radii[41]) / 2, rel=1e-6)
    assert tract.radius_at([-1.0, 9.0]).tolist() == [5e-3, 9e-3]
    assert tract.widest == 9e-3
    ring = Tract.from_points(LOOP.points, [4e-3, *[6e-3] * 23], closed=True)
    assert ring.radius_at(ring.length * (1 - 1 / 48)) == pytest.approx(5e-3, rel=0.02)  # back towards the first
    assert ring.radius_at(ring.length) == pytest.approx(4e-3)


def test_a_tract_is_a_value():
    again = Tract.from_points(PAPER.points, PAPER.radius)
    assert again == PAPER
    assert hash(again) == hash(PAPER)
    assert len({PAPER, again, straight()}) == 2
    assert Tract.from_points(PAPER.points, 7e-3) != PAPER
    assert pickle.loads(pickle.dumps(PAPER)) == PAPER
    with pytest.raises(ValueError, match="read-only"):
        PAPER.table[0, 0] = 1.0
    with pytest.raises(AttributeError):
        PAPER.radius = 1.0  # type: ignore[misc]


STEPS = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.2, 0.01, 0.0), (0.3, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: Tract.from_points(STEPS[:1]), r"Tract\.points must hold at least 2 points, got 1"),
        (lambda: Tract.from_points(STEPS[:3], closed=True), r"Tract\.points must hold at least 4 points, got 3"),
        (lambda: Tract.from_points([(0, 0), (1, 1)]), r"xyz must have shape \(n, 3\) \(in m\)"),
        (lambda: Tract.from_points([*STEPS, (0.4, math.nan, 0.0)]), r"xyz\[4\] must be finite"),
        (lambda: Tract.from_points([*STEPS, STEPS[-1]]), r"Tract\.points\[4\] must differ from the point before it"),
        (lambda: Tract.from_points([*STEPS, STEPS[0]], closed=True), r"Tract\.points\[0\] must differ"),
        (
            lambda: Tract.from_points([*STEPS, (0.2, 0.0, 0.0)]),
            r"Tract\.points\[3\] must not turn .* 75°, got 1[78]\d°",
        ),
        (lambda: Tract.from_points(STEPS, radius=0.0), r"Tract\.radius must be greater than 0 \(in m\), got 0"),
        (lambda: Tract.from_points(STEPS, radius=[5e-3, 5e-3, -5e-3, 5e-3]), r"Tract\.radius\[2\] must be greater"),
        (lambda: Tract.from_points(STEPS, radius=[5e-3, 5e-3]), r"Tract\.radius must be one number or one for each"),
        (lambda: Tract.from_points(STEPS, radius=math.inf), r"Tract\.radius must be finite"),
    ],
)
def test_impossible_tracts_are_refused_by_name(build, named):
    with pytest.raises(ValueError, match=named):
        build()
