"""The resolution at which speed is quoted is accurate: no clock here, only the motion (PHYSICS.md section 4)."""

import numpy as np
import pytest

from tests.speed import accuracy as acc

SCENARIOS = {scenario.name: scenario for scenario in acc.five_scenarios()}
MEASURED = {  # largest error of the arc length on the way in m, of the lateral load as a share of its peak
    "paper": (2.3e-3, 0.072),
    "no friction": (3.1e-3, 0.087),
    "friction 0.1": (1.8e-3, 0.051),
    "0.2 m wire": (1.7e-3, 0.058),
    "translating magnet": (0.4e-3, 0.010),
}


def converged(scenario) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Recorded commands, and their replay at 120 segments a decimetre and 1 ms."""
    commands = acc.recorded_commands(scenario)
    finest = acc.refined(scenario, acc.REFERENCE_SEGMENTS, acc.REFERENCE_STEP)
    return commands, acc.replay(finest, commands)


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_default_resolution_is_accurate_on_every_scenario(name):
    """5 mm and 10 % are asked; a tenth over what was measured is allowed."""
    scenario = SCENARIOS[name]
    commands, reference = converged(scenario)
    row = acc.accuracy(scenario, commands, reference)
    assert row.passes
    assert row.arclength_error <= 1.1 * MEASURED[name][0]
    assert row.load_error <= min(1.1 * MEASURED[name][1], acc.LOAD_LIMIT)
    assert reference[0][-1] - reference[0][0] >= 0.25


def test_the_reference_is_converged_and_a_coarse_run_is_told_apart():
    """Half the resolution moves the reference by a fiftieth of the limits; one step a period is out of them."""
    scenario = SCENARIOS["paper"]
    commands, reference = converged(scenario)
    half = acc.accuracy(acc.refined(scenario, 60, 2e-3), commands, reference)
    assert half.arclength_error <= acc.ARCLENGTH_LIMIT / 50
    assert half.load_error <= acc.LOAD_LIMIT / 50
    assert not acc.accuracy(acc.refined(scenario, 16, 0.1), commands, reference).passes
    assert len(commands) * 0.1 == pytest.approx(7.5, abs=0.2)
