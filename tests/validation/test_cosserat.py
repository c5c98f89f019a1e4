"""The free rod as a solver of the public benchmark cosseratbench."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from magwire_env.validation.cosserat import FreeRodSolver

bench = pytest.importorskip("cosseratbench", reason="cosseratbench, an extra for tests, is not installed")


def experiment(name: str) -> Any:
    from cosseratbench import registry

    return registry.load_experiment(name)


@pytest.mark.parametrize(
    ("case", "most"),
    [
        ("cantilever", {"tip_deflection_error": 1e-3, "settling_residual": 1e-5}),
        ("catenary", {"shape_error": 1e-3, "sag_error": 1e-3, "settling_residual": 1e-5}),
    ],
)
def test_the_benchmark_finds_small_errors(case, most):
    result = bench.run(experiment(case), FreeRodSolver(), n_frames=11)
    assert (result.outcome, result.failure) == ("completed", None)
    assert set(result.metrics) == set(most)
    assert {name: value for name, value in result.metrics.items() if not value <= most[name]} == {}


def test_a_rope_that_hangs_too_far_slides_off_a_cylinder_and_another_holds():
    for overhang, least, most in ((0.8, -2e-4, 2e-4), (1.5, 1e-2, np.inf)):
        scenario = dataclasses.replace(experiment("capstan").scenario_for(overhang=overhang), duration=0.2)
        found = FreeRodSolver().run(scenario, n_elements=50, n_frames=3)
        light_end = found.positions[0][:, 0, 2]
        assert least <= light_end[-1] - light_end[0] <= most


def test_a_driven_clamp_turns_and_slides_as_it_is_told():
    scenario = dataclasses.replace(experiment("twist").scenario, duration=6.0)
    solver, n = FreeRodSolver(time_step_scale=4.0), 10
    found = solver.run(dataclasses.replace(scenario, rods=scenario.rods[:2]), n_elements=n, n_frames=3)
    from cosseratbench.metrics import twist_angles

    for lane, rod in enumerate(scenario.rods[:2]):
        x, m = found.positions[lane], found.directors[lane]
        np.testing.assert_allclose(m[0], rod.directors(n), atol=1e-12)
        asked = np.array(rod.end_motion.rotation)[-1, 0]
        # Half a segment at each clamp holds the rest of the twist.
        np.testing.assert_allclose(twist_angles(x[-1], m[-1]).sum() * n / (n - 1), asked, rtol=1e-2)
        np.testing.assert_allclose(x[:, -1, 1:], x[0, -1, 1:][None].repeat(3, axis=0), atol=1e-9)
        assert x[-1, -1, 0] > x[0, -1, 0]  # its load draws it out


def test_what_the_rod_does_not_know_is_unsupported_with_the_reason():
    result = bench.run(experiment("pile"), FreeRodSolver(), n_elements=4)
    assert result.outcome == "unsupported"
    assert "plane_contact" in result.missing
    turning = experiment("twist").scenario
    motion = dataclasses.replace(turning.rods[0].end_motion, slides_along=(1.0, 1.0, 0.0), rotation=((0.0,) * 3,) * 121)
    skewed = dataclasses.replace(turning, rods=(dataclasses.replace(turning.rods[0], end_motion=motion),))
    with pytest.raises(NotImplementedError, match="no axis of the world"):
        FreeRodSolver().run(skewed, n_elements=4, n_frames=2)
    rope = experiment("capstan").scenario
    two = dataclasses.replace(rope, obstacles=rope.obstacles * 2)
    with pytest.raises(NotImplementedError, match="other than one cylinder: cylinder, cylinder"):
        FreeRodSolver().run(two, n_elements=4, n_frames=2)
    short = dataclasses.replace(rope.obstacles[0], center=(0.0, 0.2, 0.0))
    beside = dataclasses.replace(rope, obstacles=(short,), duration=0.01)
    with pytest.raises(NotImplementedError, match="passes an end of a cylinder"):
        FreeRodSolver().run(beside, n_elements=20, n_frames=2)


def test_the_command_prints_one_row_a_run(capsys):
    from tests.cosserat.__main__ import main

    assert main(["--cases", "cantilever", "crossing", "--solvers", "magwire"]) == 1  # crossing: rods that touch
    printed = capsys.readouterr().out
    lines = [line.split(" | ") for line in printed.splitlines() if line.startswith("| c")]
    assert [line[0] for line in lines] == ["| case", "| cantilever", "| crossing"]
    assert lines[1][4] == "completed"
    assert lines[2][4].startswith("unsupported: ")
