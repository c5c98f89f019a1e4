"""The plan (x–y) and the side view (x–z) of the scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..scenario import Scenario
from ..scenario.rig import Slide
from . import paint
from .paint import Brush
from .snapshot import SLEEVE, Snapshot, body_halves, force_scale, load_limit, magnet_rotations

__all__ = ["Views", "view_bounds"]

_FORCE_LENGTH = 30.0
"""Pixels (at 640 × 480) of the force arrow at the reference force."""

_LONGEST = 110.0
"""Pixels of the longest force arrow."""

_MARGIN = 8.0


def view_bounds(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner, (3,) m each, of what a view must hold: the lumen and the magnets wherever they go."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for branch in scenario.tree.branches:
        ahead = 0.02 if len(scenario.tree.branches) == 1 else 0.0
        behind = 0.0 if branch.parent else max(0.02, SLEEVE if scenario.rig.feed else 0.0)
        course = branch.curve.position(np.linspace(-behind, branch.length + ahead, 400))
        low = np.minimum(low, course.min(axis=0) - branch.widest)
        high = np.maximum(high, course.max(axis=0) + branch.widest)
    for mount in scenario.rig.magnets:
        reach = max(mount.magnet.reach, 8e-3)
        near, far = np.array(mount.position), np.array(mount.position)
        for dof in mount.dofs:
            if isinstance(dof, Slide):
                near["xyz".index(dof.axis)] += dof.low
                far["xyz".index(dof.axis)] += dof.high
        low, high = np.minimum(low, near - reach), np.maximum(high, far + reach)
    return low, high


class View:
    """One projection: world axes `across` (to the right) and `up` on a rectangle of the frame."""

    def __init__(self, rect: Any, across: int, up: int, centre: np.ndarray, scale: float) -> None:
        self.rect, self.across, self.up, self.scale = rect, across, up, scale
        self.depth = 3 - across - up
        # The viewer looks along −z in the plan and along +y in the side view: x to the right, up upwards.
        self.towards = 1.0 if self.depth == 2 else -1.0
        self._origin = np.array([rect.centerx, rect.centery]) - scale * np.array([centre[across], -centre[up]])

    def px(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 3) m → frame pixels (..., 2), x to the right and y down."""
        points = np.asarray(points)
        return np.stack([points[..., self.across], -points[..., self.up]], axis=-1) * self.scale + self._origin

    def direction(self, vectors: np.ndarray) -> np.ndarray:
        """World vectors (..., 3) → the same in the picture, (..., 2), y down, in the vectors' unit."""
        return np.stack([vectors[..., self.across], -vectors[..., self.up]], axis=-1)

    def nearness(self, points: np.ndarray) -> np.ndarray:
        """Larger for what is nearer to the viewer."""
        return self.towards * points[..., self.depth]


class Views:
    """Both views of one scenario: a background drawn once, and what moves drawn on top."""

    def __init__(self, brush: Brush, scenario: Scenario, plan: Any, side: Any) -> None:
        self.brush, self.scenario = brush, scenario
        low, high = view_bounds(scenario)
        extent, centre = high - low, (low + high) / 2
        margin, title = 2 * _MARGIN * brush.scale, 16 * brush.scale
        room = [
            (rect.width - margin) / extent[0] for rect in (plan, side)
        ] + [(plan.height - margin - title) / extent[1], (side.height - margin - title) / extent[2]]  # fmt: skip
        scale = min(room)
        below = brush.pygame.Rect(plan).move(0, round(title / 2)), brush.pygame.Rect(side).move(0, round(title / 2))
        self.plan, self.side = View(below[0], 0, 1, centre, scale), View(below[1], 0, 2, centre, scale)
        self.frames = (plan, side)
        self.reference = paint.nice(force_scale(scenario) / 8)
        self.limit = load_limit(scenario)
        self._bodies = [body_halves(m.magnet) for m in scenario.rig.magnets]
        self._wire = max(3.0 * brush.scale, 2 * scenario.wire.radius * scale)

    # --- what stands still ------------------------------------------------------------------------------------------

    def background(self, surface: Any) -> None:
        """Panels, lumen, scale bars and titles."""
        for view, rect, title in ((self.plan, self.frames[0], "plan  x–y"), (self.side, self.frames[1], "side  x–z")):
            self.brush.pygame.draw.rect(surface, paint.PANEL, rect)
            self._lumen(surface, view, rect)
            self.brush.text(surface, title, (rect.x + 6, rect.y + 4), 11, paint.INK)
            self._scale_bar(surface, view, rect)

    def _lumen(self, surface: Any, view: View, rect: Any) -> None:
        """The tube as ribbons from far to near, drawn four times as large and scaled down, which smooths its edges."""
        if self.scenario.rig.clamped:
            return  # a wire in free space
        pygame, big = self.brush.pygame, 4
        layer = self.brush.surface((rect.width * big, rect.height * big), paint.PANEL)
        near, far = np.array(paint.LUMEN_NEAR), np.array(paint.LUMEN_FAR)
        pieces = [self._ribbon(branch, view, rect, big) for branch in self.scenario.tree.branches]
        depth = np.concatenate([ribbon[0] for ribbon in pieces])
        tone = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
        order = [(i, k) for i, ribbon in enumerate(pieces) for k in range(len(ribbon[0]))]
        for number in np.argsort(depth):
            i, k = order[number]
            _, flat, side, size = pieces[i]
            colour = tuple(np.round(far + tone[number] * (near - far)).astype(int).tolist())
            left, right = (flat + side)[k : k + 2], (flat - side)[k : k + 2]
            pygame.draw.polygon(layer, colour, [*left, *right[::-1]])
            # A tube seen end on has no ribbon: a disk stands for it, and rounds the joints.
            pygame.draw.circle(layer, colour, flat[k], size[k] - 3)
            for edge in (left, right):
                pygame.draw.line(layer, paint.LUMEN_EDGE, edge[0], edge[1], 5)
        if len(pieces) > 1:  # no branch's edge goes on inside another
            for _, flat, _, size in pieces:
                for at, radius in zip(flat, size, strict=True):
                    pygame.draw.circle(layer, paint.LUMEN_NEAR, at, max(radius - 5, 1.0))
        surface.blit(pygame.transform.smoothscale(layer, rect.size), rect)

    @staticmethod
    def _ribbon(branch: Any, view: View, rect: Any, big: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A branch's pieces: depth (n − 1,); of its stations middle (n, 2), half width (n, 2), radius (n,) pixels."""
        s = np.linspace(0.0, branch.length, max(200, math.ceil(branch.length / 1.5e-3)))
        points = branch.curve.position(s)
        size = branch.curve.radius_at(s) * view.scale * big
        flat = (view.px(points) - rect.topleft) * big
        along = view.direction(branch.curve.tangent(s))
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        return view.nearness(points)[:-1], flat, across * size[:, None], size

    def _scale_bar(self, surface: Any, view: View, rect: Any) -> None:
        length = paint.nice(0.16 * rect.width / view.scale)
        y, x = rect.bottom - 8, rect.x + 8
        width = round(length * view.scale)
        self.brush.pygame.draw.line(surface, paint.INK, (x, y), (x + width, y), max(2, round(2 * self.brush.scale)))
        self.brush.text(surface, f"{1e3 * length:g} mm", (x + width + 5, y - 8 * self.brush.scale), 11)

    # --- what moves -------------------------------------------------------------------------------------------------

    def draw(self, surface: Any, now: Snapshot) -> None:
        """Magnets, target, wire, tip and forces."""
        for view, rect in zip((self.plan, self.side), self.frames, strict=True):
            surface.set_clip(rect)
            self._magnets(surface, view, now)
            self._route(surface, view, now)
            self._target(surface, view, now)
            self._sleeve(surface, view)
            self._wire_line(surface, view, now)
            self._forces(surface, view, now)
            self._tip(surface, view, now)
        surface.set_clip(None)

    def _route(self, surface: Any, view: View, now: Snapshot) -> None:
        """Of a tree, the way to the target as dashes along the centrelines."""
        points = view.px(now.route)
        for a, b in zip(points[0:-1:2], points[1::2], strict=False):
            self.brush.pygame.draw.line(surface, paint.TARGET, a, b, max(1, round(1.5 * self.brush.scale)))

    def _target(self, surface: Any, view: View, now: Snapshot) -> None:
        """A bar right across the lumen, with a dot: seen end on, the dot is left."""
        at = view.px(now.target)
        along = view.direction(now.target_way)
        size = float(np.hypot(*along))
        reach = 1.5 * now.target_radius * view.scale
        if size > 0.1:
            across = np.array([-along[1], along[0]]) / size * reach
            self.brush.pygame.draw.line(
                surface, paint.TARGET, at - across, at + across, max(3, round(3 * self.brush.scale))
            )
        self.brush.pygame.draw.circle(surface, paint.TARGET, at, 4 * self.brush.scale)

    def _sleeve(self, surface: Any, view: View) -> None:
        """The sleeve at the inlet that a wire is fed through."""
        if self.scenario.rig.feed is None:
            return
        trunk = self.scenario.tree.trunk.curve
        ends = view.px(np.array([trunk.position(0.0) - SLEEVE * trunk.tangent(0.0), trunk.position(0.0)]))
        width = self._wire + 4 * self.brush.scale
        self._stroke(surface, ends, [paint.INK] * 2, width)
        self._stroke(surface, ends, [paint.FAINT] * 2, width - 2 * self.brush.scale)

    def _magnets(self, surface: Any, view: View, now: Snapshot) -> None:
        pygame, brush = self.brush.pygame, self.brush
        rotations = magnet_rotations(self.scenario, now.magnet)
        for halves, rotation, centre in zip(self._bodies, rotations, now.magnet_positions, strict=True):
            layer = brush.surface(view.rect.size)
            corner = np.array(view.rect.topleft)
            poles = []
            for corners, colour, letter in zip(halves, (paint.NORTH, paint.SOUTH), "NS", strict=True):
                world = corners @ rotation.T + centre
                poles.append((float(view.nearness(world).mean()), view.px(world), colour, letter))
            poles.sort(key=lambda pole: pole[0])
            middles = [hull.mean(axis=0) for _, hull, _, _ in poles]
            for _, points, colour, _ in poles:
                pygame.draw.polygon(layer, (*colour, 96), convex_hull(points - corner))
            surface.blit(layer, corner)
            for _, points, colour, _ in poles:
                pygame.draw.polygon(surface, colour, convex_hull(points), max(2, round(2 * brush.scale)))
            near_only = float(np.hypot(*(middles[0] - middles[1]))) < 14 * brush.scale
            for (_, _, _, letter), at in list(zip(poles, middles, strict=True))[1 if near_only else 0 :]:
                brush.text(surface, letter, (at[0], at[1] - 7 * brush.scale), 14, paint.INK, "centre")

    def _wire_line(self, surface: Any, view: View, now: Snapshot) -> None:
        nodes = view.px(now.nodes)
        self._stroke(surface, nodes, [paint.WIRE_EDGE] * len(nodes), self._wire)
        colours = [paint.load_colour(c / self.limit) for c in now.load]
        self._stroke(surface, nodes, colours, self._wire - 2 * max(1.0, 0.75 * self.brush.scale))

    def _tip(self, surface: Any, view: View, now: Snapshot) -> None:
        """The tip magnet, larger than life, its moment as an arrow from it."""
        pygame, scale = self.brush.pygame, self.brush.scale
        tip = view.px(now.tip_position)
        along = view.direction(now.tip_tangent)
        for colour, way in ((paint.SOUTH, -1.0), (paint.NORTH, 1.0)):
            end = tip + way * 8 * scale * along
            pygame.draw.line(surface, colour, tip, end, max(4, round(5 * scale)))
        self.brush.arrow(surface, tip + 7 * scale * along, tip + 19 * scale * along, paint.NORTH, 2.0, 6.0)
        pygame.draw.circle(surface, paint.TIP, tip, 2.5 * scale)

    def _stroke(self, surface: Any, points: np.ndarray, colours: list, width: float) -> None:
        """A thick line with round joints, the colour of each piece that of its second node."""
        pygame = self.brush.pygame
        ways = np.diff(points, axis=0)
        length = np.maximum(np.hypot(ways[:, 0], ways[:, 1]), 1e-9)
        across = np.stack([-ways[:, 1], ways[:, 0]], axis=1) * (width / 2 / length)[:, None]
        left, right = points[:-1] + across, points[:-1] - across
        left_end, right_end = points[1:] + across, points[1:] - across
        for i, colour in enumerate(colours[1:]):
            pygame.draw.polygon(surface, colour, (left[i], left_end[i], right_end[i], right[i]))
            pygame.draw.circle(surface, colour, points[i + 1], width / 2)

    def _forces(self, surface: Any, view: View, now: Snapshot) -> None:
        """The magnetic force and what of it drives the tip along the tract, joined by a thin line."""
        tip = view.px(now.tip_position)
        forces = np.stack([now.tip_force, now.drive_force * now.tip_tangent])
        # Forces beyond the longest arrow are drawn as long as that; the head line has their numbers.
        longest = float(np.linalg.norm(forces, axis=1).max()) / self.reference * _FORCE_LENGTH
        size = _FORCE_LENGTH * min(1.0, _LONGEST / max(longest, 1e-9)) * self.brush.scale / self.reference
        force, drive = tip + size * view.direction(forces)
        self.brush.pygame.draw.aaline(surface, paint.FAINT, force, drive)
        self.brush.arrow(surface, tip, force, paint.FORCE, 2.0, 8.0)
        self.brush.arrow(surface, tip, drive, paint.DRIVE, 4.0, 9.0)


def convex_hull(points: np.ndarray) -> list[tuple[float, float]]:
    """The hull of points (k, 2), in order round it."""
    order = sorted(set(map(tuple, np.round(points, 3).tolist())))
    if len(order) < 3:
        return [*order, *order[:1] * (3 - len(order))]
    chains: list[list[tuple[float, float]]] = []
    for sequence in (order, order[::-1]):
        chain: list[tuple[float, float]] = []
        for p in sequence:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return chains[0] + chains[1]


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
