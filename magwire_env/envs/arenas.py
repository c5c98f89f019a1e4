"""Scenarios of the tasks with a free wire: fed into a tree, or dragged along a tract, and what steers its tip."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

from ..lumen import LUMENS, Lumen
from ..lumen.curve import Tract
from ..physics.guidewire import Guidewire
from ..physics.magnets import BlockMagnet, CylinderMagnet
from ..physics.profile import Profile
from ..quasistatic.rigs import following
from ..scenario import ActuatedMagnet, Coil, Contact, Current, Feed, Rig, Scenario, Slide, Timing, Turn

__all__ = [
    "arch",
    "clamped",
    "dragged",
    "following_magnet",
    "in_narrow_tree",
    "in_tree",
    "in_tree_with_coils",
    "soft_tipped",
]


def soft_tipped(length: float, segments: int, shaft: float, tip: float, soft: float) -> Guidewire:
    """A wire of 0.9 mm with a soft end: E I of the shaft and of the last `soft` m, N·m²; E A 600 N, 3000 kg/m³.

    Over 80 mm behind the soft end E I grows evenly: a sudden step would need a thrust of half its size times the
    curvature squared to pass a bend, and stands still there.
    """
    radius = 0.45e-3
    axial = 600.0 / (math.pi * radius**2)
    bending = Profile((0.0, length - soft - 0.08, length - soft, length), (shaft, shaft, tip, tip))
    return Guidewire(length, radius, axial, shaft / (math.pi * radius**4 / 4), 3000.0, segments, bending=bending)


def following_magnet(lumen: Lumen, edge: float, height: float, speed: float) -> ActuatedMagnet:
    """A cube in front of the lumen, (z = `height` m), that turns to any direction and slides over all of it.

    edge : m, of the cube, remanence 1.3 T
    speed : m/s, of its slides along x and y
    """
    low, high = lumen.bounds
    middle = [round(float(v), 3) for v in (low + high) / 2]
    reach = [[round(float(v[i]) - middle[i], 3) for v in (low, high)] for i in range(2)]
    slides = [Slide(axis, *ends, speed=speed) for axis, ends in zip("xy", reach, strict=True)]  # type: ignore[misc]
    turns = (Turn("y", home=math.pi / 2, speed=2 * math.pi), Turn("z", speed=2 * math.pi))
    return ActuatedMagnet(BlockMagnet((edge,) * 3, 1.3), (middle[0], middle[1], height), (*turns, *slides))


@lru_cache(maxsize=4)
def arch(kind: str = "I") -> Scenario:
    """The aortic arch of type "I", "II" or "III" (`magwire_env.lumen.LUMENS`), a wire fed from the descending aorta.

    The wire: a shaft of 6e-5 N·m² (a nitinol core of 0.38 mm) that tapers to 8e-6 N·m² in its last 60 mm, and a tip
    magnet of 9.7 mA·m². The magnet: a cube of 100 mm and 1034 A·m², 170 mm in front of the arch, which makes
    20 to 50 mT at the tip (a magnetic navigation system of the clinic makes 80 mT: Carpi and Pappone 2009). The
    numbers are ours, chosen so that the tip can be turned into any branch, and needs to be.
    """
    lumen = LUMENS["aortic_arch"](kind)
    magnet = following_magnet(lumen, 0.1, 0.17, 0.1)
    return Scenario(
        name=f"aortic arch {kind}",
        lumen=lumen,
        wire=soft_tipped(0.4, 40, 6e-5, 8e-6, 0.06),
        tip=CylinderMagnet(diameter=1.2e-3, height=8e-3, remanence=1.35),
        rig=Rig((magnet,), feed=Feed(0.04, low=0.05, home=0.10)),
        contact=Contact(friction=0.05, per_segment=2),
        timing=Timing(0.1, 5),
        model="free",
    )


@lru_cache(maxsize=1)
def dragged() -> Scenario:
    """The paper's tract, wire and magnet; the wire is free, and the magnet slides above the tip.

    The lumen of 15 mm leaves the wire of 5 mm a clearance of 5 mm all round. The magnet slides at 0.2 m/s at most along
    x and y, 70 mm above the highest point of the tract and up to 30 mm beyond it, and turns about y at π rad/s at most.
    Nothing feeds the wire: its magnetic tip drags it. A magnet that stays cannot do that, see docs/physics.md,
    "What the lock hides".
    """
    paper = Scenario.paper()
    return paper.replace(name="paper, dragged", coupling="wrench", model="free", rig=following(paper.tract))


def _three_coils(most: float, speed: float) -> tuple[Coil, ...]:
    """A pair of coils along each axis, 1 mT/A: up to ± `most` mT along each, which changes by `speed` mT/s."""
    return tuple(Coil(axis, 1e-3, current=Current(-most, most, speed=speed)) for axis in "xyz")


@lru_cache(maxsize=1)
def clamped() -> Scenario:
    """The paper's wire, clamped along x at the origin, in free space: the lumen about it is too wide to be touched.

    Three pairs of coils make a uniform field of any direction, up to 25 mT along each axis. With 25 mT across it the
    tip's couple m B L/(E I) is 1.5: the wire bends into an arc of 53°. The currents cross their range in a second.
    """
    paper = Scenario.paper()
    space = Tract.from_points([(0.0, 0.0, 0.0), (0.06, 0.0, 0.0), (0.12, 0.0, 0.0)], 0.11)
    rig = Rig(coils=_three_coils(25.0, 50.0), clamped=True)
    return paper.replace(name="clamped in free space", tract=space, rig=rig, coupling="wrench", model="free")


WIRE_IN_TREES = 0.36
"""m of wire that the feed of `in_tree` has."""


def in_tree(lumen: Lumen) -> Scenario:
    """A generated tree about the origin, and the wire, tip magnet and following magnet of `arch`.

    The wire is 0.36 m long, and its feed slips beyond 0.5 N. The magnet's centre is 170 mm above the origin, 125 to
    215 mm above the tip: across the way to the tip its field is 53 to 10 mT, along it twice that.
    """
    return arch().replace(
        name=lumen.name,
        lumen=lumen,
        wire=soft_tipped(WIRE_IN_TREES, 36, 6e-5, 8e-6, 0.06),
        rig=Rig((following_magnet(lumen, 0.1, 0.17, 0.1),), feed=Feed(0.04, low=0.05, home=0.07, force=0.5)),
    )


def in_narrow_tree(lumen: Lumen) -> Scenario:
    """As `in_tree`, where the wall should bear no more than 40 mN: what a narrow tree's bends take, and little more."""
    plain = in_tree(lumen)
    return plain.replace(contact=replace(plain.contact, wall_force_limit=0.04))


def in_tree_with_coils(lumen: Lumen) -> Scenario:
    """As `in_tree`, with three pairs of coils in place of the magnet: a uniform field of any direction.

    Up to 20 mT along each axis, reached in 0.2 s. It turns the tip and does not pull it.
    """
    magnetic = in_tree(lumen)
    return magnetic.replace(rig=Rig(coils=_three_coils(20.0, 100.0), feed=magnetic.rig.feed))
