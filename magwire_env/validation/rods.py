"""Checks of the free rod: elliptic integrals, arcs, buckling, a snap in closed form, PyElastica, random loads.

Closed forms are inextensible: they are compared with a thousandfold axial modulus.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from ..physics import MU0, DipoleCloud, FreeRod, Guidewire, NotConverged, PointDipole
from .magnets import BLOCK, TIP
from .report import Row, Size, at_least, at_most

__all__ = [
    "axial_snap",
    "buckling",
    "cosserat",
    "elastica_rows",
    "end_couple_rows",
    "order_in_segments",
    "random_loads",
    "series_springs",
]

LENGTH = 0.1


def make_rod(segments: int, stretch: float = 1.0, **options) -> FreeRod:
    """The paper's wire; `stretch` multiplies its axial modulus, a thousandfold makes it inextensible."""
    return FreeRod(Guidewire(LENGTH, 2.5e-3, stretch * 600e3, 550e3, 1100.0, segments), TIP, **options)


def force_unit(rod: FreeRod) -> float:
    """E·I/L², N."""
    return rod.wire.bending_rigidity / rod.wire.length**2


def field_unit(rod: FreeRod) -> float:
    """E·I/(m L), T: the field at which β = 1."""
    return rod.wire.bending_rigidity / (rod.wire.length * rod.reference_moment)


def tip_angle(nodes: np.ndarray) -> float:
    """Angle of the last segment to the x axis, degrees."""
    last = nodes[-1] - nodes[-2]
    return math.degrees(math.atan2(math.hypot(last[1], last[2]), last[0]))


def random_turn(rng: np.random.Generator) -> np.ndarray:
    """A rotation (3, 3)."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_unit(rng: np.random.Generator) -> np.ndarray:
    """A direction (3,)."""
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


# --- closed forms -----------------------------------------------------------------------------------------------------


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


# --- rows -------------------------------------------------------------------------------------------------------------


def elastica_rows(segments: int, loads: Iterable[float] = (1, 2, 5, 10), stretch: float = 1000) -> list[Row]:
    """Cantilever under a transverse dead load at its tip."""
    rod = make_rod(segments, stretch)
    source = "elliptic integrals"
    rows = []
    for load in loads:
        nodes = rod.equilibrium(tip_force=(0, 0, load * force_unit(rod)))
        angle, deflection = elastica(load)
        rows += [Row(f"cantilever P = {load:g}, tip angle", "°", angle, source, tip_angle(nodes), 1e-3)]
        rows += [Row(f"cantilever P = {load:g}, deflection/L", "", deflection, source, nodes[-1, 2] / LENGTH, 1e-3)]
    return rows


def end_couple_rows(segments: int, angles: Iterable[float] = (30, 60, 90, 120, 150), beta: float = 1.0) -> list[Row]:
    """Tip dipole in a uniform field, in a plane of its own for each angle, none of them a coordinate plane."""
    rod = make_rod(segments, stretch=1000)
    rows = []
    for angle in angles:
        a = math.radians(angle)
        across = np.array([0.0, math.cos(angle), math.sin(angle)])
        b = beta * field_unit(rod) * (math.cos(a) * np.array([1.0, 0, 0]) + math.sin(a) * across)
        nodes = rod.equilibrium(uniform_field=b)
        phi, x, deflection = end_couple(beta, angle)
        name, source = f"tip dipole β = {beta:g}, field at {angle:g}°", "arc of a circle"
        rows += [Row(f"{name}, tip angle", "°", phi, source, tip_angle(nodes), 1e-3)]
        rows += [Row(f"{name}, x/L", "", x, source, nodes[-1, 0] / LENGTH, 1e-3)]
        rows += [Row(f"{name}, deflection/L", "", deflection, source, float(nodes[-1] @ across) / LENGTH, 1e-3)]
    return rows


def buckling(segments: int) -> list[Row]:
    """The antiparallel field, and the dead axial load, from which on the rod does not stay straight."""
    rod = make_rod(segments, stretch=1000)
    beta = _buckles(rod, 0.8, 1.2, lambda b: {"uniform_field": (-b * field_unit(rod), 0, 0)})
    load = _buckles(rod, 2.0, 3.0, lambda p: {"tip_force": (-p * force_unit(rod), 0, 0)})
    bent = tip_angle(rod.equilibrium(uniform_field=(-1.5 * field_unit(rod), 0, 0)))
    phi = math.degrees(brentq(lambda p: p - 1.5 * math.sin(p), 0.1, 3, xtol=1e-14))
    return [
        Row("antiparallel field, buckling β", "", 1.0, "φ = β sin φ", beta, 1e-2),
        Row("antiparallel field β = 1.5, tip angle", "°", phi, "φ = β sin φ", bent, 1e-3),
        Row("axial load, buckling P", "", math.pi**2 / 4, "Euler", load, 1e-2),
    ]


def _buckles(rod: FreeRod, low: float, high: float, load_of: Callable[[float], dict]) -> float:
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        straight = tip_angle(rod.equilibrium(**load_of(middle))) < 1e-3
        low, high = (middle, high) if straight else (low, middle)
    return 0.5 * (low + high)


def convergence_order(rows_of: Callable[[int], list[Row]], segments: int) -> list[float]:
    """Observed order of each row between `segments` and twice as many; NaN where the error is rounding."""
    errors = [(c.error, f.error) for c, f in zip(rows_of(segments), rows_of(2 * segments), strict=True)]
    return [math.log2(c / f) if min(c, f) > 1e-7 else math.nan for c, f in errors]


def order_in_segments(segments: int) -> list[Row]:
    """Second order: half-cell joints at clamp and tip."""
    rows = []
    forms: tuple[tuple[str, Callable[[int], list[Row]]], ...] = (
        ("cantilever", lambda n: elastica_rows(n, stretch=1e6)),
        ("tip dipole in a field", end_couple_rows),
    )
    for name, rows_of in forms:
        slowest = float(np.nanmin(convergence_order(rows_of, segments // 2)))
        rows += [
            at_least(
                f"{name}, lowest order in the segments, {segments // 2} to {segments}",
                "",
                1.9,
                "2 in theory",
                slowest,
            )
        ]
    return rows


def series_springs(segments: int) -> list[Row]:
    """N springs in series pulled by F stretch by N F/k."""
    rod = make_rod(segments)
    stretch = rod.equilibrium(tip_force=(0.5, 0, 0))[-1, 0] - LENGTH
    expected = segments * 0.5 / rod.wire.axial_spring
    return [
        Row(f"{segments} springs in series, pulled by 0.5 N", "mm", 1e3 * expected, "N F/k", 1e3 * float(stretch), 1e-8)
    ]


def axial_snap_place(rod: FreeRod, strength: float) -> float:
    """Distance from the clamp at which a coaxial, aligned dipole snaps the tip to itself, m.

    The rod is then a spring k = E·A/L against F = 3μ0 m1 m2/(2π d⁴): a fold where k = −dF/dd = 4F/d, the tip being
    drawn out by F/k = d/4, so that the dipole stands at L + 5d/4.
    """
    k = rod.wire.axial_rigidity / LENGTH
    d = (12 * MU0 * strength * rod.reference_moment / (2 * math.pi * k)) ** 0.2
    return LENGTH + 1.25 * d


def axial_snap(segments: int) -> list[Row]:
    """The place of the snap as `FreeRod.path` says it, by bisection."""

    def dipole(x: float) -> DipoleCloud:
        return DipoleCloud(np.array([[x, 0, 0]]), np.array([[5.0, 0, 0]]))

    rod = make_rod(segments)
    expected = axial_snap_place(rod, 5.0)
    near, far = expected - 5e-3, expected + 5e-3
    start = {"cloud": dipole(expected + 0.02)}
    while far - near > 1e-6:
        x = 0.5 * (near + far)
        snapped = rod.path([start, {"cloud": dipole(x)}]).snap is not None
        near, far = (x, far) if snapped else (near, x)
    return [
        Row(
            "coaxial dipole of 5 A·m² coming nearer, snap at",
            "mm",
            1e3 * expected,
            "fold 4F/d = E·A/L",
            500 * (near + far),
            1e-3,
        )
    ]


# --- an independent rod -----------------------------------------------------------------------------------------------


def cosserat(segments: int) -> list[Row]:
    """A static cantilever in no coordinate plane, P = 2, against PyElastica's Cosserat rod."""
    load = np.array([0.0, 1.2, 1.6])
    theirs = pyelastica_tip(load)
    rod = FreeRod(Guidewire(1.0, 0.03, 1e6, 1e6, 1e3, segments), TIP)
    ours = rod.equilibrium(tip_force=load * force_unit(rod))[-1]
    moved = np.linalg.norm(theirs - [1, 0, 0])
    gap = 100 * float(np.linalg.norm(ours - theirs) / moved)
    return [
        at_most("cantilever P = 2, tip off PyElastica's, of its way", "%", 1.0, "PyElastica", gap),
        Row(
            "cantilever P = 2, way of the tip/L",
            "",
            float(moved),
            "PyElastica",
            float(np.linalg.norm(ours - [1, 0, 0])),
            1e-2,
        ),
    ]


def pyelastica_tip(load: np.ndarray, elements: int = 20) -> np.ndarray:
    """Tip/L of PyElastica's Cosserat rod under a dead load P (3,) in E·I/L², after damped motion has died down.

    Its clamp holds the first element rigid, so the rod is free from that element's middle on: the rod is made half
    an element longer and set back by as much, which puts the clamp at the origin.
    """
    import elastica as ea

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    radius, modulus, density = 0.03, 1e6, 1e3
    rigidity = modulus * math.pi * radius**4 / 4
    pulsation = 3.516 * math.sqrt(rigidity / (density * math.pi * radius**2))
    cell = 1 / (elements - 0.5)
    step = 0.4 * cell * math.sqrt(density / modulus)
    start, along, normal = np.array([-cell / 2, 0, 0]), np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    moduli: dict[str, Any] = {"youngs_modulus": modulus, "shear_modulus": modulus}
    rod = ea.CosseratRod.straight_rod(elements, start, along, normal, elements * cell, radius, density, **moduli)
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
    with contextlib.redirect_stdout(io.StringIO()):  # it reports its final time
        ea.integrate(ea.PositionVerlet(), simulator, duration, int(duration / step), progress_bar=False)
    if np.abs(rod.velocity_collection).max() > 1e-4 * pulsation:
        raise RuntimeError("PyElastica's rod has not come to rest")
    return rod.position_collection[:, -1]


# --- random loads -----------------------------------------------------------------------------------------------------


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


def sweep(
    count: int, load_of: Callable[[np.random.Generator, FreeRod], dict] = random_load, seed: int = 0, segments: int = 20
) -> tuple[int, int, float]:
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


def random_loads(size: Size) -> list[Row]:
    """Each converges to balanced forces or says that it did not."""
    converged, _, worst = sweep(size.loads)
    share = 100 * converged / size.loads
    return [
        at_least(f"{size.loads} random loads, converged", "%", 99.0, "required of the solver", share),
        at_most("largest unbalanced force among them, of E·I/L²", "", 1e-6, "required of the solver", worst),
    ]
