"""The accuracy at which the free wire's speed is quoted: five scenes, commands replayed against a converged run.

`python -m tests.speed.free_accuracy` prints one row a scene: the largest error of the tip on the way (allowed 0.5 mm)
and the error of the wall force, a mean over each control period, as an rms over its peak (allowed 15 %). The converged
run has four times the segments, and steps of 1 ms.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from magwire_env.lumen import Tract
from magwire_env.lumen.named_trees import fork
from magwire_env.physics import BlockMagnet, CylinderMagnet, Guidewire, Profile
from magwire_env.scenario import ActuatedMagnet, Feed, Rig, Scenario, Slide, Turn
from magwire_env.simulation import Simulator
from magwire_env.simulation.readout import ROW

TIP_LIMIT = 0.5e-3
FORCE_LIMIT = 0.15
FINER, REFERENCE_STEP = 4, 1e-3

BLOCK = BlockMagnet((50.8e-3,) * 3, 1.3)
TIP = CylinderMagnet(0.8e-3, 8e-3, 1.35)
"""4.3 mA·m²."""


@dataclass(frozen=True)
class Scene:
    """A scenario and what is commanded: step number and simulator → (1, dof)."""

    name: str
    scenario: Scenario
    steps: int
    command: Callable[[int, Simulator], np.ndarray]
    start: float | None = None


@dataclass(frozen=True)
class Errors:
    """Largest error of the tip, m; rms error of the wall force over its peak; largest wall force, N; failed steps."""

    scene: str
    tip: float
    force: float
    peak: float
    unconverged: int

    @property
    def passes(self) -> bool:
        return self.tip <= TIP_LIMIT and self.force <= FORCE_LIMIT and self.unconverged == 0


def soft_wire(length: float, segments: int, rigidity: float = 2e-6) -> Guidewire:
    """Radius 0.45 mm, E I 2e-6 N·m², E A 600 N."""
    radius = 0.45e-3
    return Guidewire(
        length, radius, 600.0 / (math.pi * radius**2), rigidity / (math.pi * radius**4 / 4), 1100.0, segments
    )


def above_fork() -> Rig:
    """A magnet 80 mm above the fork that turns in its plane and follows along it, and a feed of 20 mm/s."""
    mount = ActuatedMagnet(
        BLOCK, (0.06, 0.0, 0.08), (Turn("y", home=math.pi / 2), Turn("z"), Slide("x", -0.06, 0.06, speed=0.03))
    )
    return Rig((mount,), feed=Feed(0.02, home=0.03))


def follow(step: int, sim: Simulator) -> np.ndarray:
    """The magnet follows the tip, its moment along the trunk at first, then 35° and more to the left; 90 mm are fed."""
    turn = 0.0 if step < 8 else 0.9
    x = float(np.clip(sim.tip_position[0, 0] - 0.06, -0.06, 0.06))
    return np.array([[math.pi / 2, turn, x, min(0.03 + 2e-3 * (step + 1), 0.10)]])


def five_scenes() -> list[Scene]:
    """A fork; the paper's tract with a magnet that slides; an arch; friction 0.2; a soft wire close to buckling."""
    first = Scenario(
        name="fork", lumen=fork(), wire=soft_wire(0.2, 40), tip=TIP, rig=above_fork(), model="free",
        contact=replace(Scenario.paper().contact, friction=0.02),
    )  # fmt: skip
    return [
        Scene("a fork, the magnet follows", first, 40, follow),
        _on_the_paper_s_tract(),
        _in_the_arch(),
        Scene("the fork with friction 0.2", first.replace(contact__friction=0.2), 40, follow),
        _close_to_buckling(),
    ]


def _on_the_paper_s_tract() -> Scene:
    paper = Scenario.paper()
    rides = replace(
        paper.rig.magnets[0], position=(0.0, 0.0, 0.08), dipoles=(),
        dofs=(Turn("y", home=math.pi), Slide("x", -0.1, 0.1), Slide("y", -0.1, 0.1)),
    )  # fmt: skip
    wire = replace(paper.wire, bending_modulus=55e3, segments=32)
    scenario = paper.replace(name="paper, free", model="free", wire=wire, rig=Rig((rides,)))

    def command(step: int, sim: Simulator) -> np.ndarray:
        """The magnet stands a little ahead of the tip, and turns slowly."""
        _, ways, _ = sim.ahead(np.array([0.02]))
        place = sim.tip_position[0] + 0.03 * ways[0, 0]
        return np.array([[math.pi + 0.4 * math.sin(0.2 * step), *np.clip(place[:2], -0.1, 0.1)]])

    return Scene("the paper's tract, a magnet that slides", scenario, 30, command, 0.10)


def _in_the_arch() -> Scene:
    length = 0.5
    shaft = Profile.steps((length - 0.08, 4e-4), (0.08, 2e-5))
    wire = Guidewire(length, 0.45e-3, 5e9, 5e9, 3000.0, 50, bending=shaft)
    turn = np.linspace(np.pi, 0.0, 13)
    up, down = np.linspace(-0.12, 0.0, 13)[:-1], np.linspace(0.0, -0.22, 23)[1:]
    bend = 36e-3
    points = [(-bend, y, 0.0) for y in up] + [(bend * np.cos(a), bend * np.sin(a), 0.0) for a in turn]
    way = Tract.from_points(points + [(bend, y, 0.0) for y in down], 12e-3)
    mount = ActuatedMagnet(BLOCK, (0.0, 0.05, 0.14), (Turn("y"),))
    scenario = Scenario(
        name="arch", tract=way, wire=wire, tip=TIP, model="free",
        rig=Rig((mount,), feed=Feed(0.08, home=0.05)),
        contact=replace(Scenario.paper().contact, stiffness=1e6),
    )  # fmt: skip

    def command(step: int, sim: Simulator) -> np.ndarray:
        return np.array([[0.02 * step, min(0.05 + 8e-3 * (step + 1), 0.40)]])

    return Scene("an arch, 0.4 m fed in", scenario, 50, command)


def _close_to_buckling() -> Scene:
    tract = Tract.from_points([(0, 0, 0), (0.05, 0, 0), (0.1, 0, 0)], 4e-3)
    mount = ActuatedMagnet(BLOCK, (0.10, 0.0, 0.09), (Turn("y", home=math.pi / 2),))
    scenario = Scenario(
        name="close to buckling", tract=tract, wire=soft_wire(0.15, 30, 4e-7), tip=TIP, model="free",
        rig=Rig((mount,), feed=Feed(0.01, home=0.06)), gravity=(0.0, 0.0, -9.81),
    )  # fmt: skip

    def command(step: int, sim: Simulator) -> np.ndarray:
        return np.array([[math.pi / 2 + 0.3 * math.sin(0.15 * step), min(0.06 + 1e-3 * (step + 1), 0.102)]])

    return Scene("a soft wire pressed against an end", scenario, 55, command)


def refined(scene: Scene, finer: float, step: float) -> Scene:
    """The scene with `finer` times the segments, and integration steps of `step` s."""
    scenario = scene.scenario
    count = round(finer * scenario.wire.segments)
    feed = scenario.rig.feed
    rig = scenario.rig if feed is None else replace(scenario.rig, feed=replace(feed, low=None))
    substeps = round(scenario.timing.control_period / step)
    return replace(scene, scenario=scenario.replace(wire__segments=count, timing__substeps=substeps, rig=rig))


def record(scene: Scene) -> np.ndarray:
    """The commands, (steps, dof), given to the scene as it stands."""
    sim = _laid(scene)
    commands = []
    for step in range(scene.steps):
        commands.append(scene.command(step, sim)[0])
        sim.step(commands[-1][None])
    return np.array(commands)


def replay(scene: Scene, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Tip (steps, 3) m and wall force (steps,) N after each command, and failed steps."""
    sim = _laid(scene)
    tips, forces, failed = np.empty((len(commands), 3)), np.empty(len(commands)), 0
    for i, command in enumerate(commands):
        sim.step(command[None])
        tips[i], forces[i] = sim.tip_position[0], sim.readout[ROW.mean_wall, 0]
        failed += int(sim.unconverged[0])
    return tips, forces, failed


def _laid(scene: Scene) -> Simulator:
    sim = Simulator(scene.scenario)
    if scene.start is not None:
        sim.reset(tip_arclength=scene.start)
    return sim


def errors(scene: Scene, commands: np.ndarray, reference: tuple[np.ndarray, np.ndarray, int]) -> Errors:
    """Errors of a scene as it stands against a converged replay."""
    tips, forces, failed = replay(scene, commands)
    peak = float(reference[1].max())
    return Errors(
        scene.name,
        float(np.linalg.norm(tips - reference[0], axis=1).max()),
        float(np.sqrt(np.mean((forces - reference[1]) ** 2)) / peak),
        peak,
        failed,
    )


def references(scenes: list[Scene] | None = None) -> list[tuple[Scene, np.ndarray, tuple[np.ndarray, np.ndarray, int]]]:
    """Each scene with its recorded commands and its converged replay."""
    rows = []
    for scene in scenes or five_scenes():
        commands = record(scene)
        rows.append((scene, commands, replay(refined(scene, FINER, REFERENCE_STEP), commands)))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--finer", type=float, nargs="+", default=[1.0], help="segments over the scene's own")
    parser.add_argument("--step", type=float, nargs="+", default=[10e-3], help="s, of the integration")
    options = parser.parse_args()
    print("| scene | segments | step | tip, max | wall force, rms of peak | peak | failed steps | passes |")
    print("|---|---|---|---|---|---|---|---|")
    for scene, commands, reference in references():
        for finer in options.finer:
            for step in options.step:
                tested = refined(scene, finer, step)
                row = errors(tested, commands, reference)
                print(
                    f"| {row.scene} | {tested.scenario.wire.segments} | {1e3 * step:g} ms | {1e3 * row.tip:.2f} mm "
                    f"| {row.force:.1%} | {1e3 * row.peak:.1f} mN | {row.unconverged} "
                    f"| {'yes' if row.passes else 'no'} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
