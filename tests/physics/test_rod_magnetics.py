"""Rods that are magnetised along their length: energy, forces, Hessian and the rates by which loads change them."""

import math

import numpy as np
import pytest

from magwire_env.physics import BlockMagnet, CylinderMagnet, FreeRod, Guidewire, PointDipole, field
from magwire_env.physics.rod_energy import Chart, LoadSlope, Shape
from magwire_env.validation.rods import LENGTH, field_unit, force_unit, make_rod, random_turn, random_unit

BLOCK = BlockMagnet((0.0508, 0.0508, 0.0508), 1.3)
TIP = CylinderMagnet(2e-3, 3e-3, 1.37, mass=7.2e-5)


def random_case(seed: int, with_tip: bool = True) -> tuple[FreeRod, np.ndarray, dict]:
    """A rod whose segments hold moments of either sign (some none), bent anyhow, under every kind of load."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 9))
    density = rng.normal(size=n) * 0.1 * (rng.random(n) < 0.7)
    density[1] = 0.07
    wire = Guidewire(LENGTH, 2.5e-3, 600e3, 550e3, 1100.0, n)
    rod = FreeRod(wire, TIP if with_tip else None, magnetisation=density, gravity=rng.normal(size=3))
    d = np.cumsum(rng.normal(size=(n, 3)) * 0.5, axis=0) + np.array([1.0, 0, 0])
    d *= rng.uniform(0.8, 1.2, size=(n, 1)) * wire.segment_length / np.linalg.norm(d, axis=1)[:, None]
    nodes = np.concatenate([np.zeros((1, 3)), np.cumsum(d, axis=0)])
    place = np.array([0.05, 0, 0]) + random_unit(rng) * rng.uniform(0.13, 0.2)
    load = {
        "uniform_field": rng.normal(size=3) * 0.02,
        "tip_force": rng.normal(size=3) * force_unit(rod),
        "cloud": BLOCK.dipoles("gauss", 2).moved(random_turn(rng), place),
    }
    return rod, nodes, load


def magnetic_energy(rod: FreeRod, nodes: np.ndarray, load: dict) -> float:
    """−Σ m d̂·B over the tip and the middles of the segments, one at a time."""
    total = 0.0
    for i in range(rod.wire.segments):
        e = nodes[i + 1] - nodes[i]
        middle = 0.5 * (nodes[i] + nodes[i + 1])
        b = load["uniform_field"] + field(load["cloud"], middle[None])[0]
        total -= rod.segment_moments[i] * (e / np.linalg.norm(e)) @ b
    if rod.tip is not None:
        b = load["uniform_field"] + field(load["cloud"], nodes[-1:])[0]
        total -= rod.tip.moment * (e / np.linalg.norm(e)) @ b
    return total


@pytest.mark.parametrize("with_tip", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_the_segments_moments_add_their_energy_in_the_field(seed, with_tip):
    rod, nodes, load = random_case(seed, with_tip)
    weak = {"tip_force": load["tip_force"]}
    difference = rod.energy(nodes, **load) - rod.energy(nodes, **weak)
    assert difference == pytest.approx(magnetic_energy(rod, nodes, load), rel=1e-9)


@pytest.mark.parametrize("with_tip", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_forces_are_minus_the_gradient_of_the_energy_at_every_node(seed, with_tip):
    rod, nodes, load = random_case(seed, with_tip)
    forces, step = rod.forces(nodes, **load), 1e-7
    for i, j in np.ndindex(rod.wire.segments, 3):
        up, down = nodes.copy(), nodes.copy()
        up[i + 1, j] += step
        down[i + 1, j] -= step
        slope = (rod.energy(up, **load) - rod.energy(down, **load)) / (2 * step)
        assert forces[i + 1, j] == pytest.approx(-slope, abs=1e-7 * np.abs(forces).max())


def test_the_clamp_holds_the_magnets_whole_pull_on_a_rod_magnetised_from_its_base():
    rod = FreeRod(Guidewire(LENGTH, 2.5e-3, 600e3, 550e3, 1100.0, 12), TIP, magnetisation=lambda s: 0 * s + 0.05)
    load = {"cloud": PointDipole(5.0).dipoles().moved(translation=[0.05, 0.12, 0.1]), "uniform_field": (0.0, 0.0, 0.0)}
    nodes = rod.equilibrium(**load)
    far = {"cloud": load["cloud"].moved(translation=-1e-6 * np.eye(3)[2]), "uniform_field": (0.0, 0.0, 0.0)}
    pull = (magnetic_energy(rod, nodes, load) - magnetic_energy(rod, nodes, far)) / 1e-6  # a magnet moved down
    assert rod.forces(nodes, **load)[0, 2] == pytest.approx(pull, rel=1e-3)


@pytest.mark.parametrize("with_tip", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_gradient_and_hessian_of_the_chart(seed, with_tip):
    rod, nodes, load = random_case(seed, with_tip)
    chart = Chart(rod._chain, rod._load(**load), Shape(*rod._shape("nodes", nodes)))
    p, step = 0.4 * np.random.default_rng(seed).normal(size=3 * rod.wire.segments), 1e-6
    lines = step * np.eye(len(p))
    slopes = [(chart.value(p + e)[0] - chart.value(p - e)[0]) / (2 * step) for e in lines]
    curves = [(chart.value(p + e)[1] - chart.value(p - e)[1]) / (2 * step) for e in lines]
    gradient, hessian = chart.value(p)[1], chart.hessian(p)
    np.testing.assert_allclose(gradient, slopes, rtol=0, atol=1e-7 * np.abs(gradient).max())
    np.testing.assert_allclose(hessian, curves, rtol=0, atol=1e-7 * np.abs(hessian).max())


@pytest.mark.parametrize("with_tip", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_rates_of_the_gradient_as_the_load_changes(seed, with_tip):
    """Field, places and moments of the dipoles changing at once, against the difference of two loads."""
    rod, nodes, load = random_case(seed, with_tip)
    shape, middle = Shape(*rod._shape("nodes", nodes)), rod._load(**load)
    rng, step = np.random.default_rng(seed), 1e-5
    rate = LoadSlope(rng.normal(size=3), *(rng.normal(size=(2, *middle.positions.shape)) * [[[1.0]], [[1e-2]]]))
    ends = []
    for t in (step, -step):
        there = rod._load(**load)
        moved = type(there)(
            there.pull, there.couple + t * rate.couple, there.positions + t * rate.positions,
            there.moments + t * rate.moments,
        )  # fmt: skip
        ends.append(rod._chain.first(moved, shape)[1:])
    on_d, on_strains = rod._chain.slope(middle, shape, rate)
    expected = [(a - b) / (2 * step) for a, b in zip(*ends, strict=True)]
    np.testing.assert_allclose(on_d, expected[0], rtol=0, atol=1e-6 * np.abs(on_d).max())
    np.testing.assert_allclose(on_strains, expected[1], rtol=0, atol=1e-5 * np.abs(on_strains).max())


def test_a_moment_in_the_last_segment_bends_the_rod_as_the_tip_magnet_does():
    """In a uniform field only the couple counts, so the same moment in the last segment is the same rod."""
    wire = Guidewire(LENGTH, 2.5e-3, 600e6, 550e3, 1100.0, 60)
    held = np.zeros(60)
    held[-1] = TIP.moment / wire.segment_length
    b = np.array([0.2, 0.6, -0.9]) * field_unit(make_rod(60))
    np.testing.assert_allclose(
        FreeRod(wire, None, magnetisation=held).equilibrium(uniform_field=b),
        FreeRod(wire, TIP).equilibrium(uniform_field=b),
        atol=1e-10,
    )


def test_a_rod_magnetised_all_along_turns_by_the_closed_form_of_a_small_angle():
    """E I φ″ = −q B cos φ with φ(0) = 0, φ′(L) = 0: for small fields φ(L) = q B L²/(2 E I)."""
    wire = Guidewire(LENGTH, 2.5e-3, 600e6, 550e3, 1100.0, 80)
    q = 0.05
    rod = FreeRod(wire, None, magnetisation=lambda s: 0 * s + q)
    b = 0.01 * wire.bending_rigidity / (q * LENGTH**2)
    last = np.diff(rod.equilibrium(uniform_field=(0, 0, b))[-2:], axis=0)[0]
    assert math.atan2(last[2], last[0]) == pytest.approx(0.005, rel=1e-3)


def test_a_function_and_its_numbers_are_the_same_magnetisation():
    wire = Guidewire(LENGTH, 2.5e-3, 600e3, 550e3, 1100.0, 10)
    given = FreeRod(wire, TIP, magnetisation=lambda s: np.where(s > 0.06, 0.2, 0.0))
    numbers = FreeRod(wire, TIP, magnetisation=[0.0] * 6 + [0.2] * 4)
    np.testing.assert_allclose(given.segment_moments, numbers.segment_moments, atol=1e-15)
    assert given.segment_moments.sum() == pytest.approx(0.2 * 0.04)


def test_bad_magnetisations_are_refused_by_name():
    wire = Guidewire(LENGTH, 2.5e-3, 600e3, 550e3, 1100.0, 10)
    with pytest.raises(ValueError, match=r"FreeRod.magnetisation must hold 10 numbers \(in A·m²/m\), one a segment"):
        FreeRod(wire, TIP, magnetisation=[0.1, 0.2])
    with pytest.raises(ValueError, match=r"FreeRod.magnetisation\[1\] must be finite \(in A·m²/m\), got nan"):
        FreeRod(wire, TIP, magnetisation=[0.1, math.nan])
    with pytest.raises(ValueError, match=r"FreeRod.magnetisation must give one number"):
        FreeRod(wire, TIP, magnetisation=lambda s: 0.1)
    with pytest.raises(ValueError, match=r"FreeRod.tip must be a magnet, or FreeRod.magnetisation not zero"):
        FreeRod(wire, None)
