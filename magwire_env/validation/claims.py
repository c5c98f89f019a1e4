"""The paper's main claim as margins, and its limits.

"One magnet and one axis of rotation move the tip in any direction" (Section V). Since F_t(θ + π) = −F_t(θ), some angle
pushes forward wherever the amplitude is not zero: signs cannot fail. What counts is drive beyond resistance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..lumen.named import straight
from ..physics import PointDipole, force
from ..scenario import ActuatedMagnet, Rig, Scenario, Turn, above
from ..simulation import Simulator, best_command, drive_at
from .balance import resistance
from .magnets import TIP
from .report import Row, Size, at_least, at_most

__all__ = ["Margins", "backward_share", "claim", "coupling", "limits", "margins", "places", "resistance"]


@dataclass(frozen=True)
class Margins:
    """Drive beyond resistance along a tract, under the paper's best angle at each place; all (n,) in N but `s` in m.

    drive, resistance : along the direction of travel, positive
    """

    s: np.ndarray
    drive: np.ndarray
    resistance: np.ndarray

    @property
    def margin(self) -> np.ndarray:
        """drive − resistance, N."""
        return self.drive - self.resistance

    @property
    def weakest(self) -> tuple[float, float]:
        """The least margin, N, and the tip's arc length there, m."""
        i = int(self.margin.argmin())
        return float(self.margin[i]), float(self.s[i])


def margins(scenario: Scenario, s: np.ndarray, direction: float) -> Margins:
    """Margins with the tip at `s` (n,) m, moving slowly forward (`direction` +1) or back (−1)."""
    command, drive = best_command(scenario, s, direction)
    sim = Simulator(scenario, num_envs=len(s))
    sim.reset(tip_arclength=s, magnet=command)
    against = np.array([resistance(scenario, at, direction) for at in s])
    return Margins(s, direction * drive, against + scenario.contact.friction * sim.lateral_force)


def greatest_margin(scenario: Scenario, tip: float, direction: float) -> float:
    """The margin at one place under the angle best for the margin itself, N, of half-degree steps."""
    angles = np.linspace(0, 2 * math.pi, 720, endpoint=False)
    sim = Simulator(scenario, num_envs=len(angles))
    sim.reset(tip_arclength=tip, magnet=angles[:, None])
    net = direction * sim.drive_force - scenario.contact.friction * sim.lateral_force
    return float(net.max()) - resistance(scenario, tip, direction)


# --- rows -------------------------------------------------------------------------------------------------------------


def places(scenario: Scenario, size: Size) -> np.ndarray:
    """Arc lengths from the whole wire just inside to the tract's end, (n,) m."""
    return np.linspace(scenario.wire.length, scenario.tract.length, size.places)


def claim(size: Size) -> list[Row]:
    """One magnet, one axis: the drive beats the resistance everywhere on the paper's tract, both ways."""
    scenario = Scenario.paper()
    s = places(scenario, size)
    rows = []
    for name, direction in (("forward", 1.0), ("back", -1.0)):
        found = margins(scenario, s, direction)
        least, at = found.weakest
        against = 1e3 * float(found.resistance[found.margin.argmin()])
        quantity = f"`force`, {name}: drive beyond resistance ({against:.2f} mN), weakest, at s = {at:.3f} m"
        rows.append(at_least(quantity, "mN", 0.0, "the paper's claim", 1e3 * least))
    drive = 1e3 * best_command(scenario, s)[1]
    rows.append(
        at_least(
            "amplitude of F·t over the angle, smallest on the tract",
            "mN",
            2.5,
            "the paper's claim",
            float(drive.min()),
        )
    )
    rows.append(
        at_most(
            "amplitude of F·t over the angle, greatest on the tract",
            "mN",
            15.0,
            "16.4 right below, level",
            float(drive.max()),
        )
    )
    return rows


def limits(size: Size) -> list[Row]:
    """Where the amplitude vanishes for a dipole, and a straight tract under a magnet that stays."""
    tilt = math.acos(1 / math.sqrt(3))
    below = _amplitude((0, 0, -0.07), (0, math.sin(tilt), math.cos(tilt)))
    axis = _amplitude((0, 0.07, 0), (math.cos(0.4), 0, math.sin(0.4)))
    greatest = _amplitude((0, 0, -0.07), (0, 0, 1.0))
    tract, paper = straight(), Scenario.paper()
    mount = ActuatedMagnet(paper.rig.magnets[0].magnet, above(tract, 0.07), (Turn("y", home=math.pi),))
    scenario = Scenario("straight", tract, paper.wire, paper.tip, Rig((mount,)))
    middle = tract.length / 2
    drive = 1e3 * best_command(scenario, np.array([middle, middle + 0.2, tract.length]))[1]
    rows = [
        at_most(
            "amplitude right below, tangent 54.7° off vertical in y–z, of the greatest there",
            "",
            1e-12,
            "a dipole's zero",
            below / greatest,
        ),
        at_most(
            "amplitude on the rotation axis, tangent across it, of the greatest below",
            "",
            1e-12,
            "a dipole's zero",
            axis / greatest,
        ),
    ]
    for name, value, most in (("20 cm from the middle", drive[1], 0.4), ("at its end", drive[2], 0.05)):
        rows.append(
            at_most(
                f"straight 0.8 m tract, best drive {name}",
                "mN",
                most,
                f"of {drive[0]:.1f} mN in the middle",
                float(value),
            )
        )
    end = margins(scenario, np.array([tract.length]), 1.0).margin[0]
    speed = 1e3 * float(end) / (scenario.contact.drag * scenario.wire.length)
    rows.append(at_most("straight 0.8 m tract, speed that drag leaves at its end", "mm/s", 1.0, "crawls", speed))
    return rows


def _amplitude(place: tuple, tangent: tuple) -> float:
    """Greatest F·t over the angle, N, of a dipole of the block's moment turning about y at the origin."""
    cloud = PointDipole(Scenario.paper().rig.magnets[0].magnet.moment).dipoles()
    along = []
    for angle in (0.0, math.pi / 2):
        c, s = math.cos(angle), math.sin(angle)
        turned = cloud.moved(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
        along.append(force(turned, np.array([place]), TIP.moment * np.array([tangent]))[0] @ np.array(tangent))
    return float(np.hypot(*along))


def coupling(size: Size) -> list[Row]:
    """The paper's policy under the energy-consistent drive Q = F·t + m κ n·B."""
    scenario = Scenario.paper()
    s = places(scenario, size)
    wrench = scenario.replace(coupling="wrench")
    share = backward_share(scenario, s)
    best = 1e3 * best_command(wrench, s)[1]
    rows = [
        at_least(
            "places where the paper's best angle pushes backwards by Q", "%", 5.0, "limit of the claim", 100 * share
        ),
        at_most(
            "amplitude of Q over the angle, smallest on the tract", "mN", 0.5, "limit of the claim", float(best.min())
        ),
    ]
    for name, direction in (("forward", 1.0), ("back", -1.0)):
        least, at = min((greatest_margin(wrench, float(x), direction), float(x)) for x in s)
        quantity = f"`wrench`, {name}: drive beyond resistance, any angle, weakest, at s = {at:.3f} m"
        rows.append(at_most(quantity, "mN", 0.0, "limit of the claim", 1e3 * least))
    return rows


def backward_share(scenario: Scenario, s: np.ndarray) -> float:
    """Share of the places `s` (n,) m at which the angle best for F·t has Q < 0."""
    angles, _ = best_command(scenario.replace(coupling="force"), s)
    return float((drive_at(scenario.replace(coupling="wrench"), angles, s) < 0).mean())
