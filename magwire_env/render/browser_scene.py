"""The browser page's 3-D scene of one scenario: built once, then moved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..lumen import Branch
from ..lumen.surface import Surface
from ..physics.dipoles import field
from ..scenario import Scenario
from ..simulation.model import supports
from . import meshes, paint
from .meshes import quaternion
from .panels import ForceMap, map_of
from .snapshot import SLEEVE, Snapshot, body_halves, force_scale, load_limit, magnet_rotations
from .views import view_bounds

__all__ = ["Scene3D"]

_FORCE_LENGTH = 0.03
"""m, of the force arrow at the reference force."""

_MAGNET_OPACITY = 0.55
"""Of the magnets, which would hide the tip."""

_CONTACT_LENGTH = 0.02
"""m, of a contact's arrow at the load at which the wire is shaded brightest."""

_MAP_PIXELS = (960, 600)
_TIP_SCALE = 2.5
"""The tip magnet is drawn so many times as large as it is, or nobody would see its poles."""

_WIRE_SIDES = 10

_THINNEST = 1.2e-3
"""The least radius at which the wire is drawn, in shares of the scene's size, or it would not be seen in an aorta."""


class Scene3D:
    """Lumen, target, wire, tip, magnets, field lines, force arrows, and the force map on a board behind them."""

    def __init__(self, server: Any, scenario: Scenario) -> None:
        self.server, self.scenario = server, scenario
        self.low, self.high = view_bounds(scenario)
        self.limit = load_limit(scenario)
        self.reference = paint.nice(force_scale(scenario) / 8)
        self._clouds = [
            m.magnet.dipoles("gauss", 2 if len(scenario.rig.magnets) > 1 else 4) for m in scenario.rig.magnets
        ]
        self._bodies = [np.vstack(body_halves(m.magnet)) for m in scenario.rig.magnets]
        seen = _THINNEST * float(np.linalg.norm(self.high - self.low))
        self._radius = max(scenario.wire.radius, min(seen, 0.3 * scenario.tree.trunk.narrowest[0]))
        self._add_lumen()
        self._add_wire()
        self._add_magnets()
        has_map = len(scenario.rig.dofs) == 1 and supports(scenario, "quasistatic")
        self.board = Board(server, scenario, self.low, self.high) if has_map else None
        size = float(np.linalg.norm(self.high - self.low))
        middle = (self.low + self.high) / 2
        # A little to the right of the scene, since the panel covers the right of the window.
        middle[0] += 0.12 * size
        server.initial_camera.look_at = tuple(middle)
        server.initial_camera.position = tuple(middle + size * np.array([0.0, -0.75, 0.52]))
        server.initial_camera.up = (0.0, 0.0, 1.0)

    def _add_lumen(self) -> None:
        tree, scene = self.scenario.tree, self.server.scene
        shape = {"color": paint.LUMEN_EDGE, "opacity": 0.35, "side": "double", "cast_shadow": False}
        branches: Sequence[Branch] = tree.branches
        if isinstance(tree.wall, Surface):
            scene.add_mesh_simple("/lumen", tree.wall.vertices, tree.wall.faces.astype(np.uint32), **shape)
            branches = ()
        for i, branch in enumerate(branches):
            s = np.linspace(0.0, branch.length, max(60, round(branch.length / 4e-3)))
            vertices, faces = meshes.tube(branch.curve.position(s), branch.radius(s))
            scene.add_mesh_simple(f"/lumen{i or ''}", vertices, faces, **shape)
        reach = 1.15 * (tree.widest if len(tree.branches) == 1 else tree.narrowest[0])
        self._target = scene.add_mesh_simple(
            "/target", *meshes.tube(_ring(reach), 0.12 * reach, 8), color=paint.TARGET, cast_shadow=False
        )
        self._goal = np.full(3, np.nan)

    def _add_wire(self) -> None:
        scene, wire = self.server.scene, self.scenario.wire
        line = np.linspace((0.0, 0.0, 0.0), (wire.length, 0.0, 0.0), wire.segments + 1)
        self._wire = scene.add_mesh_simple(
            "/wire", *meshes.tube(line, self._radius, _WIRE_SIDES), color=paint.WIRE_FREE
        )
        if self.scenario.rig.feed is not None:
            trunk = self.scenario.tree.trunk.curve
            ends = trunk.position(0.0) + np.linspace(-SLEEVE, 0.0, 5)[:, None] * trunk.tangent(0.0)
            scene.add_mesh_simple("/sleeve", *meshes.tube(ends, 1.6 * self._radius, 16), color=paint.FAINT)
        self._tip = scene.add_frame("/tip", show_axes=False)
        halves = body_halves(self.scenario.tip)
        across = max(_TIP_SCALE, 1.5 * self._radius / float(np.abs(halves[0][:, :2]).max()))
        for name, corners, colour in zip(("north", "south"), halves, (paint.NORTH, paint.SOUTH), strict=True):
            scene.add_mesh_simple(
                f"/tip/{name}",
                *meshes.prism(corners * (across, across, _TIP_SCALE)),
                color=colour,
                flat_shading=True,
                side="double",
            )
        nothing = np.zeros((1, 2, 3))
        width = 8e-4
        self._force, self._drive = (
            scene.add_arrows(
                f"/{name}", nothing, colour, shaft_radius=k * width, head_radius=2.5 * k * width, head_length=7 * width
            )
            for name, colour, k in (("force", paint.FORCE, 1.0), ("drive", paint.DRIVE, 1.6))
        )
        self._contacts = None
        if supports(self.scenario, "contact"):
            self._contacts = scene.add_arrows(
                "/contacts", nothing, paint.WIRE_LOADED, shaft_radius=width, head_radius=2.5 * width,
                head_length=5 * width,
            )  # fmt: skip

    def _add_magnets(self) -> None:
        scene, rig = self.server.scene, self.scenario.rig
        self._magnets = []
        for i, mount in enumerate(rig.magnets):
            frame = scene.add_frame(f"/magnet{i}", show_axes=False)
            for name, corners, colour in zip(
                ("north", "south"), body_halves(mount.magnet), (paint.NORTH, paint.SOUTH), strict=True
            ):
                scene.add_mesh_simple(
                    f"/magnet{i}/{name}", *meshes.prism(corners), color=colour, flat_shading=True, side="double",
                    opacity=_MAGNET_OPACITY,
                )  # fmt: skip
            self._magnets.append(frame)
        # A lone magnet carries its lines with it; those of several sources are of the sum, drawn anew as they change.
        self._lone = len(rig.magnets) == 1 and not rig.coils
        reach = max([8e-3, *(m.magnet.reach for m in rig.magnets)])
        self._line_step, self._line_extent = reach / 8, 4 * reach
        segments, size = np.zeros((1, 2, 3)), np.ones(1)
        if self._lone:
            cloud, corners = self._clouds[0], self._bodies[0]
            segments, size = meshes.field_lines(
                lambda points: field(cloud, points),
                lambda points: meshes.within(corners, np.eye(3), np.zeros(3), points),
                meshes.seeds(rig.magnets[0].magnet),
                self._line_step,
                self._line_extent,
            )
        self._lines = scene.add_line_segments(
            "/magnet0/field" if self._lone else "/field", segments, _line_colours(size), thickness=1.2,
            thickness_units="screen",
        )  # fmt: skip
        self._lines_at: np.ndarray | None = None

    def show_lines(self, visible: bool) -> None:
        """Field lines on or off."""
        self._lines.visible = visible

    def update(self, now: Snapshot) -> None:
        """Move everything to where it is now."""
        vertices, _ = meshes.tube(now.nodes, self._radius, _WIRE_SIDES)
        self._wire.vertices = vertices.astype(np.float32)
        self._wire.color = paint.load_colour(float(now.load.max()) / self.limit)
        if self._contacts is not None:
            # The wall's push on the nodes it touches, from the wall to the wire.
            felt = now.load > 0.01 * self.limit
            ends = now.nodes[felt] if felt.any() else now.nodes[-1:]
            push = now.contact[felt] if felt.any() else np.zeros((1, 3))
            length = _CONTACT_LENGTH / self.limit
            self._contacts.points = np.stack([ends - length * push, ends], axis=1).astype(np.float32)
        self._tip.position, self._tip.wxyz = now.tip_position, quaternion(meshes.rotation_to(now.tip_tangent))
        size = _FORCE_LENGTH / self.reference
        for arrow, force in ((self._force, now.tip_force), (self._drive, now.drive_force * now.tip_tangent)):
            arrow.points = np.array([[now.tip_position, now.tip_position + size * force]], dtype=np.float32)
        for frame, rotation, centre in zip(
            self._magnets, magnet_rotations(self.scenario, now.magnet), now.magnet_positions, strict=True
        ):
            frame.position, frame.wxyz = centre, quaternion(rotation)
        if not np.array_equal(now.target, self._goal):
            self._goal = now.target
            self._target.position = now.target
            self._target.wxyz = quaternion(meshes.rotation_to(now.target_way))
        if self.board is not None:
            self.board.update(now)

    def update_lines(self, now: Snapshot) -> None:
        """The field lines of several magnets, anew if a magnet has moved; call it a few times a second."""
        rig = self.scenario.rig
        if self._lone or not rig.magnets or not self._lines.visible:
            return
        if self._lines_at is not None and np.allclose(self._lines_at, now.magnet, atol=1e-4):
            return
        self._lines_at = now.magnet.copy()
        turns, places = magnet_rotations(self.scenario, now.magnet), now.magnet_positions
        clouds = [c.moved(r, p) for c, r, p in zip(self._clouds, turns, places, strict=True)]
        first = len(now.magnet) - len(rig.base) - len(rig.coils)
        currents = now.magnet[first : first + len(rig.coils)]

        def flux(points: np.ndarray) -> np.ndarray:
            total = np.sum([field(cloud, points) for cloud in clouds], axis=0)
            return total + sum(coil.field(points, i) for coil, i in zip(rig.coils, currents, strict=True))

        def inside(points: np.ndarray) -> np.ndarray:
            bodies = zip(self._bodies, turns, places, strict=True)
            return np.any([meshes.within(body, r, p, points) for body, r, p in bodies], axis=0)

        starts = np.concatenate(
            [
                meshes.seeds(m.magnet, (0.3, 0.8), 6) @ r.T + p
                for m, r, p in zip(rig.magnets, turns, places, strict=True)
            ]
        )
        segments, size = meshes.field_lines(flux, inside, starts, 1.6 * self._line_step, self._line_extent, 50)
        self._lines.points, self._lines.colors = segments.astype(np.float32), _line_colours(size)


class Board:
    """The force map standing behind the scene, with the present point on it; it says where a ray hits it."""

    def __init__(self, server: Any, scenario: Scenario, low: np.ndarray, high: np.ndarray) -> None:
        brush = paint.Brush(_MAP_PIXELS[1] / 205)
        data = map_of(scenario)
        assert data is not None
        self.map = ForceMap(brush, scenario, brush.pygame.Rect((0, 0), _MAP_PIXELS), data)
        canvas = brush.surface(_MAP_PIXELS, paint.PAPER)
        self.map.background(canvas)
        self.width = 1.4 * float(high[0] - low[0])
        self.height = self.width * _MAP_PIXELS[1] / _MAP_PIXELS[0]
        # Behind the scene (+y), and so high that the magnet leaves it free, its colour bar too.
        self.centre = np.array([(low[0] + high[0]) / 2, high[1] + 0.15 * self.width, low[2] + 0.82 * self.height])
        # The image's own axes: x to its right, y down, z away from the viewer.
        self.axes = np.column_stack([(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
        self.image = server.scene.add_image(
            "/map", paint.pixels(canvas), self.width, self.height, wxyz=quaternion(self.axes), position=self.centre,
            cast_shadow=False, receive_shadow=False, format="png",
        )  # fmt: skip
        size = 0.016 * self.width
        self._point = server.scene.add_icosphere("/map_point", radius=size, color=paint.TIP)
        self._path = server.scene.add_line_segments(
            "/map_path", np.zeros((1, 2, 3), dtype=np.float32), paint.TIP, thickness=2.5, thickness_units="screen"
        )
        self._way: list[np.ndarray] = []
        self._time, self._command, self._last = 0.0, 0.0, np.zeros(3)
        self._line = server.scene.add_box("/map_target", paint.TARGET, (0.3 * size, 0.1 * size, 1.0))

    def world(self, place: float, command: float) -> np.ndarray:
        """The board's point (3,) m for an arc length (m) and a command (rad or m)."""
        return self._at(self.map.axes.px(place, command) / _MAP_PIXELS)

    def _at(self, share: np.ndarray) -> np.ndarray:
        return self.centre + self.axes[:, :2] @ ((share - 0.5) * (self.width, self.height))

    def hit(self, origin: np.ndarray, direction: np.ndarray) -> tuple[float, float] | None:
        """Arc length and command where a ray meets the map, None beside it."""
        normal = self.axes[:, 2]
        slope = float(normal @ direction)
        if abs(slope) < 1e-9:
            return None
        point = np.asarray(origin) + direction * float(normal @ (self.centre - origin)) / slope
        share = self.axes[:, :2].T @ (point - self.centre) / (self.width, self.height) + 0.5
        return self.map.place(tuple(share * _MAP_PIXELS))

    def update(self, now: Snapshot) -> None:
        """Move the present point and the target's line, and draw the way that the episode has come."""
        command = float(self.map.dof.wrapped(now.magnet[0]))
        self._point.position = self.world(now.tip_arclength, command)
        self._lengthen(now.time, command)
        low, high = (self.world(now.goal, end) for end in self.map.axes.y)
        self._line.position = (low + high) / 2
        self._line.scale = (1.0, 1.0, float(np.linalg.norm(high - low)))

    def _lengthen(self, time: float, command: float) -> None:
        """One more piece of the way every tenth of a second; a new episode begins a new one."""
        place = np.array(self._point.position) - 1e-3 * self.width * self.axes[:, 2]  # before the map, not in it
        if time < self._time or time == 0.0:
            self._way = []
            self._path.points = np.zeros((1, 2, 3), dtype=np.float32)
        elif time - self._time < 0.1 - 1e-9:
            return
        else:
            around = self.map.dof.turn and abs(command - self._command) > np.pi
            self._way.append(np.stack([place if around else self._last, place]))
            self._path.points = np.array(self._way, dtype=np.float32)
        self._time, self._command, self._last = time, command, place


def _ring(radius: float) -> np.ndarray:
    angle = np.linspace(0.0, 2 * np.pi, 33)
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def _line_colours(size: np.ndarray) -> np.ndarray:
    """Field lines from pale (1 mT and less) to dark (100 mT and more): (k,) T → (k, 2, 3) uint8."""
    share = np.clip(np.log10(np.maximum(size, 1e-9) / 1e-3) / 2, 0.0, 1.0)[:, None]
    colour = np.array([205, 210, 220]) + share * (np.array([70, 80, 110]) - np.array([205, 210, 220]))
    return np.round(colour).astype(np.uint8)[:, None].repeat(2, axis=1)
