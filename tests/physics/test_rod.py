"""The free rod against closed forms and PyElastica; its equilibria under random loads.

The checks that belong in a validation table are functions of a size and return rows (quantity, expected, ours).
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from magwire_env.physics import (
    BlockMagnet,
    CylinderMagnet,
    DipoleCloud,
    FreeRod,
    Guidewire,
    NotConverged,
    PointDipole,
    force,
)

LENGTH = 0.1
TIP = CylinderMagnet(2e-3, 3e-3, 1.37)
BLOCK = BlockMagnet((0.0508,) * 3, 1.3)

Row = tuple[str, float, float]


def make_rod(segments: int, stretch: float = 1.0, **options) -> FreeRod:
    """The paper's wire; `stretch` multiplies its axial modulus, a thousandfold makes it inextensible."""
    return FreeRod(Guidewire(LENGTH, 2.5e-3, stretch * 600e3, 550e3, 1100.0, segments), TIP, **options)


def force_unit(rod: FreeRod) -> float:
    """E·I/L², N."""
    return rod.wire.bending_rigidity / rod.wire.length**2


def field_unit(rod: FreeRod) -> float:
    """E·I/(m L), T: the field at which β = 1."""
    return rod.wire.bending_rigidity / (rod.wire.length * rod.tip.moment)


def tip_angle(nodes: np.ndarray) -> float:
    """Angle of the last segment to the x axis, degrees."""
    last = nodes[-1] - nodes[-2]
    return math.degrees(math.atan2(math.hypot(last[1], last[2]), last[0]))


def random_turn(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def elastica(load: float) -> tuple[float, float]:
    """Tip angle (degrees) and deflection/L of the inextensible cantilever under a dead load P = F L²/(E·I).

    Elliptic integrals (Bisshopp and Drucker 1945): with p² = (1 + sin φ_L)/2 and sin θ = 1/(p √2),
    √P = K(p) − F(p, θ) and δ/L = 1 − 2 (E(p) − E(p, θ))/√P.
    """

    def length_excess(m: float) -> float:
        return ellipk(m) - ellipkinc(math.asin(1 / math.sqrt(2 * m)), m) - math.sqrt(load)

    m = brentq(length_excess, 0.5 + 1e-12, 1 - 1e-12, xtol=1e-15)
    theta = math.asin(1 / math.sqrt(2 * m))
    deflection = 1 - 2 * (ellipe(m) - ellipeinc(theta, m)) / math.sqrt(load)
    return math.degrees(math.asin(2 * m - 1)), deflection


def end_couple(beta: float, angle: float) -> tuple[float, float, float]:
    """Tip angle (degrees), x/L and deflection/L of a rod with a tip moment in a uniform field at `angle` degrees.

    The field exerts a couple alone, so the rod is an arc of a circle: φ = β sin(α − φ), x/L = sin φ/φ,
    δ/L = (1 − cos φ)/φ.
    """
    alpha = math.radians(angle)
    phi = brentq(lambda p: p - beta * math.sin(alpha - p), 1e-9, alpha, xtol=1e-14)
    return math.degrees(phi), math.sin(phi) / phi, (1 - math.cos(phi)) / phi


def elastica_rows(segments: int, loads=(1, 2, 5, 10), stretch: float = 1000) -> list[Row]:
    rod = make_rod(segments, stretch)
    rows: list[Row] = []
    for load in loads:
        nodes = rod.equilibrium(tip_force=(0, 0, load * force_unit(rod)))
        angle, deflection = elastica(load)
        rows += [(f"cantilever P = {load}, tip angle, deg", angle, tip_angle(nodes))]
        rows += [(f"cantilever P = {load}, deflection/L", deflection, nodes[-1, 2] / LENGTH)]
    return rows


def end_couple_rows(segments: int, angles=(30, 60, 90, 120, 150), beta: float = 1.0) -> list[Row]:
    rod = make_rod(segments, stretch=1000)
    rows: list[Row] = []
    for angle in angles:
        a = math.radians(angle)
        # in a plane of its own for each angle, none of them a coordinate plane
        across = np.array([0.0, math.cos(angle), math.sin(angle)])
        b = beta * field_unit(rod) * (math.cos(a) * np.array([1.0, 0, 0]) + math.sin(a) * across)
        nodes = rod.equilibrium(uniform_field=b)
        phi, x, deflection = end_couple(beta, angle)
        rows += [(f"tip dipole β = {beta:g}, field at {angle} deg, tip angle, deg", phi, tip_angle(nodes))]
        rows += [(f"tip dipole β = {beta:g}, field at {angle} deg, x/L", x, nodes[-1, 0] / LENGTH)]
        rows += [
            (f"tip dipole β = {beta:g}, field at {angle} deg, deflection/L", deflection, nodes[-1] @ across / LENGTH)
        ]
    return rows


def buckling_rows(segments: int) -> list[Row]:
    """The antiparallel field from which on the rod does not stay straight, and its angle well beyond."""
    rod = make_rod(segments, stretch=1000)
    low, high = 0.8, 1.2
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        nodes = rod.equilibrium(uniform_field=(-middle * field_unit(rod), 0, 0))
        low, high = (middle, high) if tip_angle(nodes) < 1e-3 else (low, middle)
    bent = tip_angle(rod.equilibrium(uniform_field=(-1.5 * field_unit(rod), 0, 0)))
    phi = math.degrees(brentq(lambda p: p - 1.5 * math.sin(p), 0.1, 3, xtol=1e-14))
    return [("antiparallel field, buckling β", 1.0, 0.5 * (low + high)), ("β = 1.5, tip angle, deg", phi, bent)]


def euler_rows(segments: int) -> list[Row]:
    """The dead axial load from which on the cantilever does not stay straight: P = π²/4."""
    rod = make_rod(segments, stretch=1000)
    low, high = 2.0, 3.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        nodes = rod.equilibrium(tip_force=(-middle * force_unit(rod), 0, 0))
        low, high = (middle, high) if tip_angle(nodes) < 1e-3 else (low, middle)
    return [("axial load, buckling P", math.pi**2 / 4, 0.5 * (low + high))]


def convergence_order(rows_of, segments: int) -> list[float]:
    """Observed order of each row between `segments` and twice as many; NaN where the error is rounding."""
    coarse, fine = rows_of(segments), rows_of(2 * segments)
    errors = [(abs(c[2] / c[1] - 1), abs(f[2] / f[1] - 1)) for c, f in zip(coarse, fine, strict=True)]
    return [math.log2(c / f) if min(c, f) > 1e-7 else math.nan for c, f in errors]


def assert_rows(rows: list[Row], tolerance: float) -> None:
    wrong = [row for row in rows if not abs(row[2] / row[1] - 1) <= tolerance]
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
    angles = [row for row in end_couple_rows(3) if row[0].endswith("tip angle, deg")]
    assert len(angles) == 5
    assert_rows(angles, 1e-6)


def test_buckling():
    assert_rows(buckling_rows(20), 1e-3)
    assert_rows(euler_rows(40), 2e-3)


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


def pyelastica_tip(load: np.ndarray, elements: int = 20) -> np.ndarray:
    """Tip/L of PyElastica's Cosserat rod under a dead load P (3,) in E·I/L², after damped motion has died down.

    Its clamp holds the first element rigid, so the rod is free from that element's middle on: the rod is made half
    an element longer and set back by as much, which puts the clamp at the origin.
    """
    ea = pytest.importorskip("elastica", reason="PyElastica, an extra for tests, is not installed")

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    radius, modulus, density = 0.03, 1e6, 1e3
    rigidity = modulus * math.pi * radius**4 / 4
    pulsation = 3.516 * math.sqrt(rigidity / (density * math.pi * radius**2))
    cell = 1 / (elements - 0.5)
    step = 0.4 * cell * math.sqrt(density / modulus)
    rod = ea.CosseratRod.straight_rod(
        elements,
        np.array([-cell / 2, 0, 0]),
        np.array([1.0, 0, 0]),
        np.array([0, 0, 1.0]),
        elements * cell,
        radius,
        density,
        youngs_modulus=modulus,
        shear_modulus=modulus,
    )
    simulator = Simulator()
    simulator.append(rod)
    clamp = {"constrained_position_idx": (0,), "constrained_director_idx": (0,)}
    simulator.constrain(rod).using(ea.OneEndFixedBC, **clamp)
    pull = ea.EndpointForces, np.zeros(3), np.asarray(load) * rigidity
    simulator.add_forcing_to(rod).using(*pull, ramp_up_time=2 / pulsation)
    damping = {"uniform_damping_constant": 2 * pulsation, "time_step": step}
    simulator.dampen(rod).using(ea.AnalyticalLinearDamper, **damping)
    simulator.finalize()
    duration = 14 / pulsation
    ea.integrate(ea.PositionVerlet(), simulator, duration, int(duration / step), progress_bar=False)
    assert np.abs(rod.velocity_collection).max() < 1e-4 * pulsation
    return rod.position_collection[:, -1]


@pytest.mark.filterwarnings("default")
def test_pyelastica_agrees():
    load = np.array([0.0, 1.2, 1.6])  # P = 2, in no coordinate plane
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


def random_load(rng: np.random.Generator, rod: FreeRod) -> dict:
    """A valid load: forces up to P = 10, fields up to β = 10, and magnets that the wire cannot reach, in any mix.

    The magnet is the paper's block or a dipole of up to 100 A·m², turned anyhow, 1.5 to 4 wire lengths from the
    clamp in any direction.
    """
    load: dict = {}
    mix = rng.integers(1, 8)
    if mix & 1:
        load["tip_force"] = random_unit(rng) * rng.uniform(0, 10) * force_unit(rod)
    if mix & 2:
        load["uniform_field"] = random_unit(rng) * rng.uniform(0, 10) * field_unit(rod)
    if mix & 4:
        magnet = BLOCK if rng.random() < 0.5 else PointDipole(10 ** rng.uniform(-1, 2))
        place = random_unit(rng) * rng.uniform(1.5, 4.0) * rod.wire.length
        load["cloud"] = magnet.dipoles("gauss", 4).moved(random_turn(rng), place)
    return load


def sweep(count: int, load_of=random_load, seed: int = 0, segments: int = 20) -> tuple[int, int, float]:
    """Random loads: how many converge, how many end in contact, and the worst unbalanced force in units of E·I/L².

    The rest are those that say they did not converge; any other error passes through.
    """
    rng, rod = np.random.default_rng(seed), make_rod(segments)
    converged, touched, worst = 0, 0, 0.0
    for _ in range(count):
        load = load_of(rng, rod)
        try:
            nodes = rod.equilibrium(**load)
        except NotConverged as error:
            touched += error.touched
            continue
        converged += 1
        worst = max(worst, np.abs(rod.forces(nodes, **load)[1:]).max() / force_unit(rod))
    return converged, touched, worst


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
