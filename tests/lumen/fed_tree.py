"""A wire fed to named ends of the real tree of the shared data, and drawn.

`python -m tests.lumen.fed_tree ENDS… [--out PICTURE.png]` prints one row for each end. Three coils point the field at a
place ahead on the route while the feed goes on at a steady pace: nothing is learnt and nothing is planned.
"""

import argparse
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from magwire_env import Scenario, Simulator
from magwire_env.lumen.lumen import Lumen
from magwire_env.physics import CylinderMagnet, Guidewire
from magwire_env.plotting import BLUE, GREY, ORANGE, RED, blank, styled
from magwire_env.scenario import Coil, Current, Feed, Rig
from magwire_env.simulation.model import Places
from tests.lumen.real_tree import folder

ENDS = ("4", "7", "6")
PERIODS_WITHOUT_GAIN = 80
NEAR = 2e-3  # m, of the end


@dataclass
class Run:
    """One wire: way left (m), control periods, largest wall force (N), and its nodes past the inlet (n, 3) m."""

    end: str
    route: float
    left: float
    periods: int
    force: float
    unconverged: int
    wire: np.ndarray

    @property
    def reached(self) -> bool:
        return self.left < NEAR


def scene(lumen: Lumen, end: str, diameter: float = 0.6e-3, stiffness: float = 2e-6) -> Scenario:
    """A wire long enough for the end, with a magnet at its tip, under three coils of 1 mT/A; stiffness in N m²."""
    length = lumen.route("inlet", end).length + 0.02
    area, inertia = np.pi * (diameter / 2) ** 2, np.pi * (diameter / 2) ** 4 / 4
    wire = Guidewire(length, diameter / 2, 600.0 / area, stiffness / inertia, 1100.0, round(length / 6e-3))
    coils = tuple(Coil(axis, 1e-3, current=Current(-60, 60, 0, 400)) for axis in "xyz")
    tip = CylinderMagnet(0.9 * diameter, 8e-3, 1.35)
    return Scenario(name=end, lumen=lumen, wire=wire, tip=tip, rig=Rig((), coils, feed=Feed(0.03)), model="free")


def fed(
    lumen: Lumen, end: str, pace: float = 3e-3, ahead: float = 10e-3, field: float = 50e-3, stiffness: float = 2e-6
) -> Run:
    """Feed a wire to an end; pace : m a control period; ahead : m on the route, where a field of `field` T points."""
    route = lumen.route("inlet", end)
    scenario = scene(lumen, end, stiffness=stiffness)
    sim, one = Simulator(scenario), np.arange(1)
    sim.reset()
    sim.set_goal(one, Places(np.array([lumen.branch(end).length]), np.array([lumen.index(end)])))
    sim.refresh(one)
    length, out = scenario.wire.length, sim.magnet[0, -1]
    force, unconverged, best, gained, period = 0.0, 0, np.inf, 0, 0
    while sim.remaining[0] >= NEAR and period - gained < PERIODS_WITHOUT_GAIN:
        period += 1
        aim = route.position(min(route.length - sim.remaining[0] + ahead, route.length)) - sim.tip_position[0]
        out = min(out + pace, length)
        sim.step(np.array([[*(1e3 * field * aim / np.linalg.norm(aim)), out]]))
        force, unconverged = max(force, sim.peak_wall_force[0]), unconverged + int(sim.unconverged[0])
        if sim.remaining[0] < best - 1e-4:
            best, gained = sim.remaining[0], period
    return Run(end, route.length, sim.remaining[0], period, force, unconverged, _inside(sim))


def _inside(sim: Simulator) -> np.ndarray:
    """The nodes of the first wire that are past the inlet, (n, 3) m."""
    segment = sim.library.scenarios[0].wire.segment_length
    return sim.positions[0, -1 - int(sim.inserted_length[0] // segment) :].copy()


def picture(lumen: Lumen, runs: list[Run], path: Path) -> Path:
    """Draw the tree, the wires and their ends along two axes."""
    with styled():
        figure, panels = blank(1, 2, (10.0, 6.0))
        for panel, (i, j) in zip(np.ravel(panels), ((0, 2), (1, 2)), strict=True):
            for b in lumen.branches:
                s = np.linspace(0.0, b.length, max(30, round(b.length / 1e-3)))
                line, r = 1e3 * b.curve.position(s), 1e3 * b.radius(s)
                for x, y, size in zip(line[:, i], line[:, j], r, strict=True):
                    panel.add_patch(_disc((x, y), size))
                panel.plot(line[:, i], line[:, j], color=GREY, linewidth=0.6, zorder=2)
            for run, colour in zip(runs, (BLUE, ORANGE, RED) * len(runs), strict=False):
                panel.plot(*(1e3 * run.wire[:, [i, j]]).T, color=colour, linewidth=1.4, zorder=4, label=run.end)
                at = 1e3 * lumen.position(run.end)
                panel.plot(at[i], at[j], "o", color=colour, markersize=5, zorder=5)
                panel.annotate(run.end, (at[i], at[j]), xytext=(5, 3), textcoords="offset points", fontsize=9, zorder=6)
            at = 1e3 * lumen.position("inlet")
            panel.plot(at[i], at[j], "s", color="black", zorder=5)
            panel.annotate("inlet", (at[i], at[j]), xytext=(5, 3), textcoords="offset points", fontsize=9, zorder=6)
            panel.set(aspect="equal", xlabel=f"{'xyz'[i]} (mm)", ylabel=f"{'xyz'[j]} (mm)")
            panel.autoscale_view()
        figure.suptitle("A wire fed to named ends of the real tree")
        figure.savefig(path)
    return path


def _disc(at: tuple[float, float], radius: float) -> Any:
    from matplotlib.patches import Circle

    return Circle(at, radius, facecolor="#e8eef4", linewidth=0, zorder=1)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("ends", nargs="*", default=list(ENDS))
    options.add_argument("--out", type=Path)
    options.add_argument("--pace", type=float, default=3e-3, help="m a control period")
    options.add_argument("--ahead", type=float, default=10e-3, help="m")
    options.add_argument("--field", type=float, default=50e-3, help="T")
    options.add_argument("--stiffness", type=float, default=2e-6, help="N m²")
    options = options.parse_args()
    at = folder()
    if at is None:
        raise SystemExit("the data are absent: set MAGWIRE_DATA")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        lumen = Lumen.load(at)
    runs = []
    for end in options.ends:
        r = fed(lumen, end, options.pace, options.ahead, options.field, options.stiffness)
        runs.append(r)
        print(
            f"{r.end:6s} route {1e3 * r.route:5.1f} mm: {'reached' if r.reached else 'stalled'} after {r.periods} "
            f"periods, {1e3 * r.left:.1f} mm left, wall force at most {1e3 * r.force:.1f} mN, "
            f"{r.unconverged} unconverged",
            flush=True,
        )
    if options.out:
        print(picture(lumen, runs, options.out))


if __name__ == "__main__":
    main()
