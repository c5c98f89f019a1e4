"""Walls in bricks: each sample is taken once, and a large tree with a narrow end has a bound, which is said."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from magwire_env import Scenario, Simulator
from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.named_trees import fork
from magwire_env.physics import BlockMagnet
from magwire_env.scenario import ActuatedMagnet, Rig, Turn
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.free.bricks import CELLS, FAR, Bricks, depth_in_bricks
from magwire_env.simulation.free.vectors import load3, store3
from magwire_env.simulation.free.walls import _cell_of
from magwire_env.simulation.lanes import LANES, store
from tests.support.free import TIP, soft_wire


@njit
def found(grid, par, x, out):
    """Depth, gradient and second derivatives, ten numbers a lane."""
    depth, gradient, second = depth_in_bricks(grid, par, load3(x, 0))
    store(out, 0, depth)
    store3(out, LANES, gradient)
    store3(out, 4 * LANES, (second[0], second[1], second[2]))
    store3(out, 7 * LANES, (second[3], second[4], second[5]))


def test_second_derivatives_of_bricks_are_differences_of_their_gradient() -> None:
    """In a ball of 4 mm: points near its wall, and a lane that has no bricks."""
    radius, cell = 4e-3, 0.5e-3

    def depth(xyz: np.ndarray) -> np.ndarray:
        return radius - np.linalg.norm(xyz, axis=1)

    bricks = Bricks(depth, [-radius] * 3, [radius] * 3, cell, 2e-3, 1e-3)
    par = np.zeros(at.PAR_SIZE)
    for name, value in bricks.fields().items():
        par[getattr(at, name) : getattr(at, name) + LANES] = value
        par[getattr(at, name) + LANES - 1] = 0.0  # the last lane has none
    rng, axes = np.random.default_rng(1), ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    ways = rng.standard_normal((LANES, 3))
    points = ways / np.linalg.norm(ways, axis=1)[:, None] * rng.uniform(0.9, 1.05, (LANES, 1)) * radius

    def probe(shift: np.ndarray) -> np.ndarray:
        out = np.zeros(10 * LANES)
        found(bricks.data, par, np.ascontiguousarray((points + shift).T).reshape(-1), out)
        return out.reshape(10, LANES)

    step, middle = 1e-7, probe(np.zeros(3))
    assert np.isfinite(middle).all()
    assert middle[1:, -1].tolist() == [0.0] * 9
    lanes = slice(0, LANES - 1)
    assert middle[0, lanes] == pytest.approx(-depth(points)[lanes], abs=1e-5)
    for k, (i, j) in enumerate(axes):
        shift = step * np.eye(3)[j]
        slope = (probe(shift)[1 + i] - probe(-shift)[1 + i]) / (2 * step)
        assert middle[4 + k, lanes] == pytest.approx(slope[lanes], abs=1e-4 / radius)
        outwards = points / np.linalg.norm(points, axis=1)[:, None]
        ball = (float(i == j) - outwards[:, i] * outwards[:, j]) / np.linalg.norm(points, axis=1)
        assert middle[4 + k, lanes] == pytest.approx(ball[lanes], abs=0.15 / radius)


def test_a_wall_is_sampled_once_at_each_place() -> None:
    lumen, asked = fork(length=0.02), 0

    def depth(xyz: np.ndarray) -> np.ndarray:
        nonlocal asked
        asked += len(xyz)
        return lumen.wall_distance(xyz)

    low, high = lumen.bounds
    bricks = Bricks(depth, low.tolist(), high.tolist(), 1e-3, 1.5e-3, 3e-3)
    assert asked < 2.5 * CELLS**3 * len(bricks.coefficients)  # each brick by itself would ask 8 times a cell


def test_a_large_tree_with_a_narrow_end_is_kept_in_coarser_cells_and_says_so() -> None:
    lines = [("trunk", [(0, 0, 0), (0.2, 0, 0), (0.4, 0, 0)], 12e-3, None),
             ("twig", [(0.2, 0, 0), (0.2, 0.02, 0), (0.2, 0.04, 0)], 0.3e-3, "trunk")]  # fmt: skip
    with pytest.warns(UserWarning, match=r"cells of 0\.\d+ mm.*less than 0\.\d+ mm radius only roughly"):
        cell = _cell_of(Lumen.from_lines(lines, "large"), 0.2e-3)
    assert 0.3e-3 < cell < 0.8e-3
    assert _cell_of(fork(), 0.4e-3) == pytest.approx(fork().narrowest[0] / 5)


def test_behind_the_inlet_the_wall_goes_on_as_a_straight_tube_beyond_the_bricks() -> None:
    """Along a slanted inlet; a point beyond the bricks elsewhere stays where no wire may be."""
    radius, along = 4e-3, np.array([0.6, 0.0, 0.8])

    def depth(xyz: np.ndarray) -> np.ndarray:
        return radius - np.linalg.norm(xyz - (xyz @ along)[:, None] * along, axis=1)

    bricks = Bricks(depth, [-0.01] * 3, [0.01] * 3, 0.5e-3, 2e-3, 1e-3)
    par, base = np.zeros(at.PAR_SIZE), np.array([1e-3, 0.0, -1e-3])
    inlet = base - (base @ along) * along  # any point of the axis will do
    given = {"GRID_INLET": radius, **bricks.fields()}
    given |= dict(zip(("BASE_X", "BASE_Y", "BASE_Z"), inlet, strict=True))
    given |= dict(zip(("BASE_TX", "BASE_TY", "BASE_TZ"), along, strict=True))
    for name, value in given.items():
        par[getattr(at, name) : getattr(at, name) + LANES] = value
    behind = inlet - 0.05 * along
    across = np.array([0.8, 0.0, -0.6]), np.array([0.0, 1.0, 0.0])
    points = np.tile(behind + 5e-3 * across[0], (LANES, 1))
    points[1] = behind + 3e-3 * across[1]
    points[LANES - 1] = inlet + 0.05 * along
    out = np.zeros(10 * LANES)
    found(bricks.data, par, np.ascontiguousarray(points.T).reshape(-1), out)
    told = out.reshape(10, LANES)
    true = radius - np.hypot(*np.array([(points - inlet) @ way for way in across]))
    assert told[0, :2] == pytest.approx(-true[:2], abs=1e-15)
    assert told[1:4, 0] == pytest.approx(across[0], abs=1e-12)
    assert told[1:4, 1] == pytest.approx(across[1], abs=1e-12)
    bend = np.outer(across[1], across[1]) / 5e-3
    assert told[4:, 0] == pytest.approx(bend[np.triu_indices(3)], abs=1e-9)
    assert told[0, LANES - 1] == FAR


@pytest.mark.parametrize(("friction", "down"), [(0.0, 0.0), (0.2, 9.81)])
def test_a_wire_that_falls_out_of_the_inlet_goes_on_as_in_a_straight_tube(friction: float, down: float) -> None:
    """A loose wire in a fork, under gravity back along the trunk and onto its wall: a = g − μ g across."""
    far = ActuatedMagnet(BlockMagnet((1e-3,) * 3, 1.3), (0.0, 0.0, 3.0), (Turn("y"),))
    scenario = Scenario(
        name="out", lumen=fork(), wire=soft_wire(0.05, 10), tip=TIP, rig=Rig((far,)), model="free",
        gravity=(-9.81, 0.0, -down),
    ).replace(contact__friction=friction, contact__drag=0.0)  # fmt: skip
    sim = Simulator(scenario, num_envs=1)
    places = []
    for _ in range(6):
        sim.step(sim.magnet.copy())
        assert sim.unconverged[0] == 0
        places.append(sim.state().part("positions").reshape(-1, 3)[-1])
    assert places[-1][0] < -0.8  # far beyond the bricks
    assert sim.wall_force[0] == pytest.approx(scenario.wire.mass * down + TIP.mass * down, rel=1e-3, abs=1e-12)
    again = np.diff(np.array(places)[1:, 0], n=2) / scenario.timing.control_period**2
    assert again == pytest.approx(-(9.81 - friction * down), rel=1e-4)
