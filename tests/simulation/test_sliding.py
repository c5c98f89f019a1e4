"""A wire sliding on a straight tract: sticking, letting go, running on, creeping (PHYSICS.md section 4).

Weight does both: its part across the tract makes the normal load, its part along it the push, the same for every
node, so the wire is the textbook's block. "Exact" is the block's own equation, integrated to ten digits.
"""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from magwire_env.scenario import Scenario, Timing
from magwire_env.simulation import Simulator
from tests.support.scenes import TIP, line, lumped_mass, placed, world

MU, STICK = 0.05, 1e-4
REST = np.zeros((1, 1))


def incline(push: float, friction: float, drag: float = 0.0, mu: float = MU, step: float = 0.05) -> Scenario:
    """Accelerations along the tract, by the push and by friction once sliding, in m/s²."""
    contact = {"contact__friction": mu, "contact__drag": drag, "contact__stick_speed": STICK}
    return world(line(), gravity=(push, 0.0, -friction / mu), timing=Timing(0.1, round(0.1 / step)), **contact)


def slide(scenario: Scenario, speed: float, seconds: float) -> tuple[float, float]:
    """Travel (m) and speed (m/s) at the end."""
    sim = Simulator(scenario)
    sim.reset(tip_arclength=0.2)
    placed(sim, velocities=speed)
    for _ in range(round(seconds / 0.1)):
        sim.step(REST)
    return sim.tip_arclength[0] - 0.2, sim.tip_velocity[0]


def exact(scenario: Scenario, speed: float, seconds: float) -> tuple[float, float]:
    """The same of a block."""
    push, _, weight = scenario.gravity
    rub = -weight * scenario.contact.friction
    drag = scenario.contact.drag * scenario.wire.length / lumped_mass(scenario).sum()

    def rate(_, y):
        return [y[1], push - rub * y[1] / math.hypot(y[1], STICK) - drag * y[1]]

    end = solve_ivp(rate, (0.0, seconds), [0.0, speed], method="Radau", rtol=1e-10, atol=1e-13).y[:, -1]
    return float(end[0]), float(end[1])


# A block that friction slows at 0.192 m/s², over a second: 48 mm of travel when pushed with 1.5 μ n, as in the table.
TABLE = [  # F/μn, speed at the start, travel in mm, error allowed
    (0.5, 0.0115, 0.74, 0.045),
    (0.9, 0.0115, 3.53, 0.005),
    (1.1, 0.0, 9.92, 0.03),
    (1.5, 0.0, 48.1, 0.005),
]


@pytest.mark.parametrize(("ratio", "speed", "travel", "allowed"), TABLE)
def test_travel_near_stick_slip_at_the_default_step(ratio, speed, travel, allowed):
    """PHYSICS.md asks for 5 %. A friction slope lagged by a step gives 14 mm in place of 48, and 12.5 of 3.5."""
    assert Timing().control_period == 0.1
    scenario = incline(ratio * 0.192, 0.192)
    reference = exact(scenario, speed, 1.0)[0]
    assert 1e3 * reference == pytest.approx(travel, rel=0.01)
    assert slide(scenario, speed, 1.0)[0] == pytest.approx(reference, rel=allowed)


@pytest.mark.parametrize("friction", [0.02, 0.1, 0.49, 1.5])
@pytest.mark.parametrize("after", [0.5, 0.9])
def test_pushed_and_let_go_under_the_drag_of_the_paper(friction, after):
    """A second at 1.5 μ n, then one at less: within 1 % of the whole travel, at the default step."""
    pushed, held = (incline(r * friction, friction, drag=0.5) for r in (1.5, after))
    first, speed = slide(pushed, 0.0, 1.0)
    ours = first + slide(held, speed, 1.0)[0]
    first, speed = exact(pushed, 0.0, 1.0)
    assert ours == pytest.approx(first + exact(held, speed, 1.0)[0], rel=0.01)


@pytest.mark.parametrize("ratio", [1.1, 1.5])
@pytest.mark.parametrize("friction", [0.1, 0.49, 1.5])
def test_from_rest_under_the_drag_of_the_paper(ratio, friction):
    scenario = incline(ratio * friction, friction, drag=0.5)
    assert slide(scenario, 0.0, 1.0)[0] == pytest.approx(exact(scenario, 0.0, 1.0)[0], rel=0.03)


@pytest.mark.parametrize("ratio", [-0.99, -0.5, 0.5, 0.9, 0.99])
def test_below_mu_n_it_holds_but_for_the_creep(ratio):
    """Held under r μ n it creeps at ε r/√(1 − r²): 58 µm/s at r = 0.5 and 0.21 mm/s at 0.9 (1.7 and 6.2 mm in 30 s)."""
    scenario = incline(ratio * 0.5, 0.5)
    creep = STICK * ratio / math.sqrt(1 - ratio**2)
    travel, speed = slide(scenario, 0.0, 30.0)
    assert speed == pytest.approx(creep, rel=1e-4)
    assert travel == pytest.approx(30 * creep, rel=3e-3)


@pytest.mark.parametrize("ratio", [-1.01, 1.01, 1.1])
def test_above_mu_n_it_runs_away(ratio):
    push = ratio * 0.5
    first, speed = slide(incline(push, 0.5), 0.0, 5.0)
    assert speed == pytest.approx(math.copysign((abs(ratio) - 1) * 0.5 * 5.0, ratio), rel=0.06)
    assert abs(first) >= 0.05


def test_a_sliding_wire_stops_and_stays():
    """With no push, friction takes a moving wire to rest, never backwards, and there it stays."""
    sim = Simulator(incline(0.0, 0.5))
    placed(sim, velocities=0.1)
    speeds = []
    for _ in range(20):
        sim.step(REST)
        speeds.append(sim.tip_velocity[0])
    assert (np.diff(speeds) <= 1e-15).all()
    assert abs(speeds[-1]) <= 1e-12


def test_without_friction_or_drag_motion_is_uniform_or_falls_freely():
    assert slide(world(line()), 0.07, 2.0) == pytest.approx((0.14, 0.07), rel=1e-9)
    falling = world(line(), gravity=(0.3, 0.0, 0.0))
    assert slide(falling, -0.1, 1.0) == pytest.approx((-0.1 + 0.15, 0.2), rel=1e-9)


def test_drag_alone_is_exact_in_speed_whatever_the_step():
    """v = v0 e^{−ct/m} at 5, 50 and 100 ms, and the terminal speed under a push."""
    bare = dataclasses.replace(TIP, mass=0.0)  # so that every node's drag is to its mass as the wire's
    for step in (0.005, 0.05, 0.1):
        scenario = world(line(), tip=bare, contact__drag=0.5, timing=Timing(0.1, round(0.1 / step)))
        rate = 0.5 * 0.1 / lumped_mass(scenario).sum()
        assert slide(scenario, 0.1, 0.3)[1] == pytest.approx(0.1 * math.exp(-0.3 * rate), rel=1e-9)
        assert slide(scenario.replace(gravity=(0.2, 0.0, 0.0)), 0.0, 3.0)[1] == pytest.approx(0.2 / rate, rel=1e-9)


@pytest.mark.parametrize("drag", [0.0, 0.5])
@pytest.mark.parametrize(("ratio", "order"), [(0.9, 1.8), (1.1, 1.15)])
def test_travel_near_stick_slip_converges_with_the_step(drag, ratio, order):
    """First order below μ n. Just above, what is lost in breaking loose takes ε/a = 3 ms, which long steps skip."""
    scenario = incline(ratio * 0.3, 0.3, drag)
    reference = exact(scenario, 0.0, 1.0)[0]
    errors = []
    for step in (0.05, 0.025, 0.0125, 0.00625):
        finer = scenario.replace(timing=Timing(0.1, round(0.1 / step)))
        errors.append(abs(slide(finer, 0.0, 1.0)[0] - reference))
    assert errors[0] <= 0.03 * reference
    assert (np.array(errors[:-1]) >= order * np.array(errors[1:])).all()
