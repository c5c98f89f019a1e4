"""The accuracy at which speed is quoted: recorded commands replayed against a converged run, on five scenarios.

`python -m tests.speed.accuracy` prints one row a scenario: the largest error of the tip's arc length on the way
(allowed 5 mm) and of the lateral load as a share of its peak (allowed 10 %).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from magwire_env.scenario import Rig, Scenario, Slide, Turn
from magwire_env.simulation import Simulator, best_command

ARCLENGTH_LIMIT = 5e-3
LOAD_LIMIT = 0.10
REFERENCE_SEGMENTS, REFERENCE_STEP = 120, 1e-3
GOAL = 0.79


@dataclass(frozen=True)
class Accuracy:
    """Largest errors on the way: arc length in m, lateral load as a share of its peak."""

    scenario: str
    arclength_error: float
    load_error: float

    @property
    def passes(self) -> bool:
        return self.arclength_error <= ARCLENGTH_LIMIT and self.load_error <= LOAD_LIMIT


def five_scenarios() -> list[Scenario]:
    """Paper; without friction; with twice the friction; a longer wire; a magnet that follows the tip under `wrench`."""
    paper = Scenario.paper()
    mount = paper.rig.magnets[0]
    # The magnet rides at a fixed height over the plane of the spiral: 80 mm above its mean.
    rides = replace(
        mount,
        position=(0.0, 0.0, 0.08),
        dofs=(Turn("y", home=np.pi), Slide("x", -0.1, 0.1), Slide("y", -0.1, 0.1)),
        dipoles=(),
    )
    return [
        paper,
        paper.replace(name="no friction", contact__friction=0.0),
        paper.replace(name="friction 0.1", contact__friction=0.1),
        paper.replace(name="0.2 m wire", wire__length=0.2, wire__segments=20),
        paper.replace(name="translating magnet", coupling="wrench", rig=Rig((rides,))),
    ]


def recorded_commands(scenario: Scenario, seconds: float = 12.0) -> np.ndarray:
    """Commands of the paper's policy, (steps, dof), as recorded on a fine mesh until the goal or the time limit."""
    grid = np.linspace(0.0, scenario.tract.length, 401 if len(scenario.rig.dofs) == 1 else 101)
    best, _ = best_command(scenario, grid)
    sim = Simulator(refined(scenario, 40, 5e-3))
    sim.reset(tip_arclength=_start(scenario))
    commands = []
    while sim.tip_arclength[0] < GOAL and len(commands) * scenario.timing.control_period < seconds:
        commands.append([np.interp(sim.tip_arclength[0], grid, column) for column in best.T])
        sim.step(np.array(commands[-1:]))
    return np.array(commands)


def refined(scenario: Scenario, segments: int, step: float) -> Scenario:
    """The scenario with `segments` a decimetre of wire and integration steps of `step` s."""
    count = round(segments * scenario.wire.length / 0.1)
    return scenario.replace(wire__segments=count, timing__substeps=round(scenario.timing.control_period / step))


def replay(scenario: Scenario, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip arc length and lateral load after each command, (steps,) m and N."""
    sim = Simulator(scenario)
    sim.reset(tip_arclength=_start(scenario))
    s, load = np.empty(len(commands)), np.empty(len(commands))
    for i, command in enumerate(commands):
        sim.step(command[None])
        s[i], load[i] = sim.tip_arclength[0], sim.lateral_force[0]
    return s, load


def accuracy(scenario: Scenario, commands: np.ndarray, reference: tuple[np.ndarray, np.ndarray]) -> Accuracy:
    """Errors of `scenario` as it stands against a converged replay."""
    s, load = replay(scenario, commands)
    s_ref, load_ref = reference
    way = s_ref <= GOAL  # the last command carries the tip past the goal, some out of the tract: not the task any more
    return Accuracy(
        scenario.name,
        float(np.abs(s - s_ref)[way].max()),
        float(np.abs(load - load_ref)[way].max() / load_ref[way].max()),
    )


def references() -> list[tuple[Scenario, np.ndarray, tuple[np.ndarray, np.ndarray]]]:
    """Each scenario with its recorded commands and its converged replay."""
    rows = []
    for scenario in five_scenarios():
        commands = recorded_commands(scenario)
        rows.append((scenario, commands, replay(refined(scenario, REFERENCE_SEGMENTS, REFERENCE_STEP), commands)))
    return rows


def _start(scenario: Scenario) -> float:
    return max(0.1, scenario.wire.length)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--segments", type=int, help="segments a decimetre of wire; by default the scenario's own")
    parser.add_argument("--substeps", type=int, help="steps in a control period; by default the scenario's own")
    options = parser.parse_args()
    print("| scenario | crossing | arc length, max error | lateral load, max error of peak | within 5 mm and 10 % |")
    print("|---|---|---|---|---|")
    for scenario, commands, reference in references():
        tested = scenario
        if options.segments or options.substeps:
            tested = refined(
                scenario,
                options.segments or round(scenario.wire.segments * 0.1 / scenario.wire.length),
                scenario.timing.control_period / (options.substeps or scenario.substeps),
            )
        row = accuracy(tested, commands, reference)
        period = scenario.timing.control_period
        print(
            f"| {row.scenario} | {len(commands) * period:.1f} s to {reference[0][-1]:.3f} m "
            f"| {row.arclength_error * 1e3:.2f} mm | {row.load_error:.1%} | {'yes' if row.passes else 'no'} |"
        )


if __name__ == "__main__":
    main()
