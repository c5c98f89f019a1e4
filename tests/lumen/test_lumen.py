"""The tree, its routes, and its wall against exact distances."""

import pickle
from itertools import pairwise

import numpy as np
import pytest

from magwire_env.lumen import Tract
from magwire_env.lumen.branch import Branch
from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.named_trees import LUMENS, aortic_arch, box, fork, straight, two_forks

RNG = np.random.default_rng(0)


def slopes(lumen, xyz, h=1e-6):
    """Central differences of the wall distance, (n, 3)."""
    steps = h * np.eye(3)
    return np.stack([(lumen.wall_distance(xyz + e) - lumen.wall_distance(xyz - e)) / (2 * h) for e in steps], axis=1)


# --- exact distances --------------------------------------------------------------------------------------------------


def test_a_tube_has_the_exact_distance_a_round_end_and_an_open_inlet():
    lumen = straight(0.2, 4e-3)
    xyz = RNG.uniform([-0.05, -0.006, -0.006], [0.21, 0.006, 0.006], (4000, 3))
    across = np.hypot(xyz[:, 1], xyz[:, 2])
    exact = 4e-3 - np.where(xyz[:, 0] > 0.2, np.hypot(across, xyz[:, 0] - 0.2), across)
    distance, gradient = lumen.wall_distance_and_gradient(xyz)
    assert np.abs(distance - exact).max() < 1e-9
    inner = across > 1e-4
    assert np.abs(gradient - slopes(lumen, xyz))[inner].max() < 1e-4
    assert np.abs(np.linalg.norm(gradient, axis=1) - 1).max() < 1e-9


@pytest.mark.parametrize("half_angle", [2.0, 6.0, 15.0])
def test_a_cone_has_the_exact_distance_for_the_radii_of_its_inscribed_balls(half_angle):
    a = np.deg2rad(half_angle)
    x = np.linspace(0, 0.06, 31)
    across = 12e-3 - np.tan(a) * x[:, None] * 0.7
    slope = -np.tan(a) * 0.7
    a = np.arctan(slope)
    lumen = Lumen.from_tract(Tract.from_points(np.c_[x, 0 * x, 0 * x], (across[:, 0] * np.cos(a)).tolist()))
    xyz = RNG.uniform([0.015, -0.01, -0.01], [0.045, 0.01, 0.01], (3000, 3))
    exact = (12e-3 + slope * xyz[:, 0] - np.hypot(xyz[:, 1], xyz[:, 2])) * np.cos(a)
    distance, gradient = lumen.wall_distance_and_gradient(xyz)
    assert np.abs(distance - exact).max() < 1e-6
    outward = np.c_[np.full(3000, -np.sin(a)), xyz[:, 1:] / np.hypot(xyz[:, 1], xyz[:, 2])[:, None] * np.cos(a)]
    inner = np.hypot(xyz[:, 1], xyz[:, 2]) > 1e-3
    assert np.abs(gradient + outward)[inner].max() < 2e-3


def test_a_torus_has_the_exact_distance():
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = Lumen.from_tract(Tract.from_points(0.05 * np.c_[np.cos(turn), np.sin(turn), 0 * turn], 6e-3, closed=True))
    xyz = RNG.uniform(-1, 1, (20000, 3)) * [0.062, 0.062, 0.012]
    exact = 6e-3 - np.hypot(np.hypot(xyz[:, 0], xyz[:, 1]) - 0.05, xyz[:, 2])
    near = exact > -6e-3
    distance, gradient = ring.wall_distance_and_gradient(xyz[near])
    assert np.abs(distance - exact[near]).max() < 1e-6  # the spline's own error
    middle = 0.05 * xyz[near] / np.hypot(*xyz[near, :2].T)[:, None] * [1, 1, 0]
    inward = middle - xyz[near]
    off = np.linalg.norm(inward, axis=1)
    aside = off > 1e-4  # on the axis itself the gradient has no direction
    assert np.abs(gradient - inward / off[:, None])[aside].max() < 0.02
    assert np.abs(np.linalg.norm(gradient, axis=1) - 1).max() < 1e-9
    assert ring.leaves == ()


def wall_of_fork(lumen, spacing):
    """Points on the fork's outer wall, by brute force: straight tubes with round ends, less what lies in another."""
    points = []
    ends = [(b.curve.position(0.0), b.curve.position(b.length), float(b.radius(0.0))) for b in lumen.branches]

    def depth(xyz, a, b, r):
        u = np.clip((xyz - a) @ (b - a) / ((b - a) @ (b - a)), -np.inf if a is ends[0][0] else 0, 1)
        return r - np.linalg.norm(xyz - a - u[:, None] * (b - a), axis=1)

    for i, (a, b, r) in enumerate(ends):
        along = (b - a) / np.linalg.norm(b - a)
        n1 = np.array([0.0, 0.0, 1.0])
        n2 = np.cross(along, n1)
        turn = np.arange(0, 2 * np.pi, spacing / r)
        ring = np.cos(turn)[:, None] * n1 + np.sin(turn)[:, None] * n2
        s = np.arange(0, np.linalg.norm(b - a), spacing)
        tube = (a + s[:, None, None] * along + r * ring).reshape(-1, 3)
        lift = np.arange(0, np.pi / 2, spacing / r)[:, None, None]
        caps = [
            b + r * (np.sin(lift) * along + np.cos(lift) * ring),
            a + r * (np.cos(lift) * ring - np.sin(lift) * along),
        ]
        piece = np.concatenate([tube, *(c.reshape(-1, 3) for c in caps[: 1 if i == 0 else 2])])
        others = [depth(piece, *e) for j, e in enumerate(ends) if j != i]
        points.append(piece[np.max(others, axis=0) <= 1e-9])
    return np.concatenate(points)


def test_a_fork_has_the_exact_distance_everywhere_within_two_percent_of_the_radius():
    from scipy.spatial import KDTree

    lumen = fork(35.0, 4e-3, 0.03)
    spacing = 5e-5
    tree = KDTree(wall_of_fork(lumen, spacing))
    xyz = RNG.uniform([0.022, -0.014, -0.005], [0.05, 0.014, 0.005], (12000, 3))
    distance, gradient = lumen.wall_distance_and_gradient(xyz)
    exact, at = tree.query(xyz)
    assert np.abs(np.abs(distance) - exact).max() < 0.02 * 3.17e-3
    inside = distance > 0.3e-3
    toward = (xyz - tree.data[at])[inside] / exact[inside, None]
    cosine = (toward * gradient[inside]).sum(axis=1)
    assert np.quantile(cosine, 0.02) > 0.99  # the rest lies half way between two walls, where either is right
    assert (np.abs(np.abs(distance) - exact) < 1e-6 + spacing**2 / np.maximum(exact, 1e-5)).mean() > 0.98


def test_no_wall_stands_inside_a_junction():
    lumen = fork(35.0, 4e-3, 0.03)
    for name in ("left", "right"):
        route = lumen.route("inlet", name)
        x = np.linspace(0.0, route.length, 400)
        assert (lumen.wall_distance(route.position(x)) > 0.99 * route.radius(x).min()).all()
    # a side branch that starts on its parent's axis: the parent's wall is open over its mouth, its cap is not felt
    side = Lumen.from_lines(
        [
            ("trunk", np.linspace((0, 0, 0), (0.06, 0, 0), 9), 5e-3, None),
            ("side", np.linspace((0.03, 0, 0), (0.03, 0.03, 0), 9), 2e-3, "trunk"),
        ]
    )
    y = np.linspace(0.0, 0.03, 300)
    assert (side.wall_distance(np.c_[0 * y + 0.03, y, 0 * y]) > 0.998 * 2e-3).all()
    assert side.wall_distance(np.array([0.03, 0.0, 0.0])) == pytest.approx(5e-3, abs=2e-5)
    assert side.wall_distance(np.array([0.036, 0.0, -0.0049])) == pytest.approx(1e-4, abs=1e-6)


def test_level_sets_at_a_crease_are_round_so_that_the_force_on_a_wire_turns_smoothly():
    lumen = fork(35.0, 4e-3, 0.03)
    crotch = 0.03 + 4e-3 * 0.5 ** (1 / 3) / np.sin(np.deg2rad(35.0))
    turn = np.linspace(np.pi / 2 + 0.7, 3 * np.pi / 2 - 0.7, 200)
    for a in (0.2e-3, 0.6e-3):
        xyz = np.c_[crotch + a * np.cos(turn), a * np.sin(turn), 0 * turn]
        distance, gradient = lumen.wall_distance_and_gradient(xyz)
        assert np.abs(distance - a).max() < 0.03 * a + 1e-5
        angle = np.arccos(np.clip((gradient[1:] * gradient[:-1]).sum(axis=1), -1, 1))
        assert angle.max() < 3 * (turn[1] - turn[0])


def test_the_distance_changes_by_no_more_than_the_way():
    lumen = aortic_arch("III")
    low, high = lumen.bounds
    a = RNG.uniform(low, high, (20000, 3))
    b = a + RNG.normal(0, 5e-4, a.shape)
    change = np.abs(lumen.wall_distance(a) - lumen.wall_distance(b))
    assert (change <= 1.02 * np.linalg.norm(a - b, axis=1) + 2e-5).all()


def test_a_box_is_exact_and_open_only_at_its_inlet():
    lumen = box((0.1, 0.06, 0.04), opening=2e-3)
    assert lumen.wall_distance(np.array([0.05, 0.02, 0.0])) == pytest.approx(0.01)
    assert lumen.wall_distance(np.array([0.11, 0.04, 0.0])) == pytest.approx(-np.hypot(0.01, 0.01))
    assert lumen.wall_distance(np.array([0.0, 0.0, 0.0])) == pytest.approx(2e-3)
    assert lumen.wall_distance(np.array([0.001, 0.015, 0.0])) == pytest.approx(1e-3)
    assert not lumen.contains(np.array([-0.001, 0.015, 0.0]))
    assert lumen.contains(np.array([-0.05, 0.001, 0.0]))
    xyz = RNG.uniform([0.005, -0.04, -0.03], [0.12, 0.04, 0.03], (2000, 3))
    gradient = lumen.wall_distance_and_gradient(xyz)[1]
    assert (
        np.abs(gradient - slopes(lumen, xyz)).max(axis=1) < 1e-4
    ).mean() > 0.99  # the rest lies at an edge's bisector


# --- the tree ---------------------------------------------------------------------------------------------------------


def test_a_route_runs_through_the_tree_and_the_way_left_counts_back_out_of_a_wrong_branch():
    lumen = two_forks(35.0, 4e-3, 0.06)
    route = lumen.route("inlet", "upper")
    assert route.length == pytest.approx(0.18)
    assert [lumen.branches[leg.branch].name for leg in route.legs] == ["trunk", "left", "upper"]
    assert route.place(0.1) == ("left", pytest.approx(0.04))
    assert np.allclose(route.position(0.1), lumen.branch("left").curve.position(0.04))
    assert route.remaining("left", 0.01) == pytest.approx(0.11)
    assert route.remaining("right", 0.02) == pytest.approx(0.12 + 0.02)
    assert route.remaining("lower", 0.03) == pytest.approx(0.06 + 0.03)
    assert route.remaining("trunk", -0.01) == pytest.approx(0.19)
    assert route.travelled("upper", 0.06) == pytest.approx(0.18)
    short = lumen.route("inlet", ("left", 0.02))
    assert short.remaining([1, 1, 3, 4, 2], [0.01, 0.03, 0.0, 0.01, 0.0]) == pytest.approx(
        [0.01, -0.01, -0.04, -0.05, 0.02]
    )
    assert short.passed("left", 0.02)
    assert not short.passed("left", 0.019)


def test_a_route_may_lead_back_and_out_again():
    lumen = two_forks()
    route = lumen.route("lower", "right")
    assert [leg[1:] for leg in route.legs] == [
        (pytest.approx(0.06), 0.0),
        (pytest.approx(0.06), 0.0),
        (0.0, pytest.approx(0.06)),
    ]
    x = np.linspace(0, route.length, 500)
    steps = np.linalg.norm(np.diff(route.position(x), axis=0), axis=1)
    assert (steps <= 1.0001 * (x[1] - x[0])).all()
    assert (steps < 0.99 * (x[1] - x[0])).sum() <= 2
    ahead = route.position(x[:-1] + 1e-6) - route.position(x[:-1])
    assert ((ahead * route.tangent(x[:-1])).sum(axis=1) > 0.99e-6).all()
    branch, s = route.leg_at(x)
    assert route.remaining(branch, s) == pytest.approx(route.length - x)
    assert route.remaining("trunk", 0.02) == pytest.approx(0.06 + 0.04)
    back = lumen.route("upper", ("trunk", 0.03))
    assert back.remaining("trunk", [0.01, 0.03, 0.05]) == pytest.approx([-0.02, 0.0, 0.02])


@pytest.mark.parametrize("name", list(LUMENS))
def test_every_named_lumen_is_sound(name):
    lumen = LUMENS[name]()
    assert lumen == LUMENS[name]()
    assert hash(lumen) == hash(LUMENS[name]())
    assert pickle.loads(pickle.dumps(lumen)) == lumen
    low, high = lumen.bounds
    for leaf in lumen.leaves:
        route = lumen.route("inlet", leaf)
        x = np.linspace(0.0, route.length, 50)
        inner = lumen.wall_distance(route.position(x))
        room = name == "box"  # its centreline ends on the wall
        assert (inner[:-1] > 0).all() if room else (inner > 0.9 * route.radius(x).min()).all()
        assert (route.position(x) >= low - 1e-9).all()
        assert (route.position(x) <= high + 1e-9).all()
        branch, s = route.leg_at(x)
        assert route.remaining(branch, s) == pytest.approx(route.length - x, abs=1e-12)
        smooth = route.tract()
        apart = np.linalg.norm(smooth.position(np.linspace(0, smooth.length, 50)) - route.position(x), axis=1)
        assert apart.max() < 3 * lumen.widest


def test_published_dimensions_of_the_arch_are_kept():
    for kind, low, high in (("I", 0, 1), ("II", 1, 2), ("III", 2, 9)):
        arch = aortic_arch(kind)
        starts = {b.name: b.start for b in arch.branches if b.parent == "aorta"}
        assert starts["BCT"] - starts["LCCA"] == pytest.approx(21.8e-3, abs=3e-4)
        assert starts["LCCA"] - starts["LSA"] == pytest.approx(14.3e-3, abs=3e-4)
        aorta = arch.trunk
        s = np.linspace(0, aorta.length, 600)
        wall = aorta.curve.position(s)[:, 1] + aorta.radius(s)
        at = aorta.curve.position(starts["BCT"])
        out = arch.branch("BCT").curve.tangent(0.0)
        mouth = (at + out * aorta.radius(starts["BCT"]))[1]
        assert low <= (wall.max() - mouth) / 8.28e-3 <= high


def test_projection_finds_the_branch_the_arc_length_and_the_offset():
    lumen = fork(35.0, 4e-3, 0.03)
    for name in ("trunk", "left", "right"):
        b = lumen.branch(name)
        s = RNG.uniform(0.009, 0.029, 200) if name != "trunk" else RNG.uniform(-0.02, 0.025, 200)
        off = RNG.uniform(0.0, 2e-3, 200)
        xyz = b.curve.position(s) + off[:, None] * np.array([0.0, 0.0, 1.0])
        branch, arc, gap = lumen.project(xyz)
        assert (branch == lumen.index(name)).all()
        assert arc == pytest.approx(s, abs=1e-9)
        assert gap == pytest.approx(off, abs=1e-9)
    near_fork = lumen.branch("left").curve.position(0.002)
    assert lumen.project(near_fork, prefer=[lumen.index("right")])[0] == lumen.index("right")
    with pytest.raises(ValueError, match=r"xyz\[1\] must be finite"):
        lumen.project(np.array([[0, 0, 0], [np.nan, 0, 0]]))


def test_branches_that_begin_beside_the_axis_are_led_to_it():
    trunk = ("trunk", np.linspace((0, 0, 0), (0.1, 0, 0), 11), 6e-3, None)
    tree = Lumen.from_lines(
        [("b", np.array([(0.05, 0.004, 0), (0.05, 0.02, 0), (0.05, 0.04, 0)]), 2e-3, "trunk"), trunk]
    )
    assert [b.name for b in tree.branches] == ["trunk", "b"]
    assert tree.branch("b").start == pytest.approx(0.05)
    assert np.allclose(tree.position(("b", 0.0)), (0.05, 0, 0))
    with pytest.raises(ValueError, match="must begin inside its parent"):
        Lumen.from_lines([trunk, ("b", np.array([(0.05, 0.007, 0), (0.05, 0.02, 0)]), 2e-3, "trunk")])


def test_bad_trees_are_refused_by_name():
    line = Tract.from_points([(0, 0, 0), (0.1, 0, 0)], 5e-3)
    other = Tract.from_points([(0.05, 0.01, 0), (0.05, 0.1, 0)], 5e-3)
    trunk = Branch("a", line)
    for branches, words in (
        ((), "at least one branch"),
        ((trunk, Branch("a", other, "a", 0.05)), "twice"),
        ((trunk, Branch("b", other)), "must be a branch"),
        ((trunk, Branch("b", other, "c", 0.05)), "branch before it"),
        ((trunk, Branch("b", other, "a", 0.2)), "must lie in"),
        ((trunk, Branch("b", other, "a", 0.05)), "must begin on the axis"),
    ):
        with pytest.raises(ValueError, match=words):
            Lumen(branches)
    for make, words in (
        (lambda: Branch("", line), "not empty"),
        (lambda: straight().route("inlet", "nowhere"), "must be one of 'trunk'"),
        (lambda: straight().route("inlet", ("trunk", 9.0)), "must lie in"),
        (lambda: fork(angle=120), "angle must lie in"),
        (lambda: aortic_arch("IV"), "kind must be one of"),
    ):
        with pytest.raises(ValueError, match=words):
            make()


def test_a_tract_is_a_lumen_of_one_branch():
    tract = Tract.from_points([(0, 0, 0), (0.05, 0.01, 0), (0.1, 0, 0)], (4e-3, 5e-3, 6e-3))
    lumen = Lumen.from_tract(tract)
    s = np.linspace(0, tract.length, 40)
    assert lumen.trunk.curve is tract
    assert lumen.leaves == ("trunk",)
    assert lumen.trunk.radius(s) == pytest.approx(tract.radius_at(s), abs=1e-4)
    h = 1e-7
    inner = s[1:-1]
    slope = (lumen.trunk.radius(inner + h) - lumen.trunk.radius(inner - h)) / (2 * h)
    assert lumen.trunk.radius_slope(inner) == pytest.approx(slope, abs=1e-6)
    assert all(a < b for a, b in pairwise(lumen.trunk.radius(s)))
