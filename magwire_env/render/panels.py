"""Below the views: force and arc length over time, and the force map with the present point on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..quasistatic.forcemap import force_map
from ..scenario import Scenario
from ..simulation.model import supports
from . import paint
from .dofs import Dof, dofs_of, number
from .paint import Brush
from .snapshot import Snapshot, force_scale, place_name

__all__ = ["ForceMap", "History", "Strips", "drive_name", "map_limit", "map_name", "map_of", "strip_limit"]

_SPANS = (10.0, 20.0, 30.0, 60.0, 120.0, 300.0)
"""s, lengths of the time axis."""


@dataclass
class History:
    """What has been seen of an episode, one entry a frame: s, N, m, m, rad or m."""

    time: list[float] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    arclength: list[float] = field(default_factory=list)
    goal: list[float] = field(default_factory=list)
    command: list[float] = field(default_factory=list)

    def add(self, now: Snapshot) -> None:
        """Remember a moment; one before the last begins a new episode, and the same one again counts once."""
        if self.time and now.time < self.time[-1]:
            self.clear()
        if self.time and now.time == self.time[-1]:
            return
        for kept, value in (
            (self.time, now.time),
            (self.force, now.drive_force),
            (self.arclength, now.tip_arclength),
            (self.goal, now.goal),
            (self.command, float(now.magnet[0])),
        ):
            kept.append(value)

    def clear(self) -> None:
        """Forget everything."""
        for kept in (self.time, self.force, self.arclength, self.goal, self.command):
            kept.clear()


class Axes:
    """A plot's rectangle with its limits; draws frame, ticks and title once."""

    def __init__(self, rect: Any, x: tuple[float, float], y: tuple[float, float]) -> None:
        self.rect, self.x, self.y = rect, x, y

    def px(self, x: np.ndarray | float, y: np.ndarray | float) -> np.ndarray:
        """Data → pixels (..., 2), kept inside the rectangle."""
        u = np.clip((np.asarray(x) - self.x[0]) / (self.x[1] - self.x[0]), 0.0, 1.0)
        v = np.clip((np.asarray(y) - self.y[0]) / (self.y[1] - self.y[0]), 0.0, 1.0)
        across, down = np.broadcast_arrays(u * (self.rect.width - 1), (1 - v) * (self.rect.height - 1))
        return np.stack([self.rect.left + across, self.rect.top + down], axis=-1)

    def ticks(
        self, brush: Brush, surface: Any, x: list[float], y: list[float], x_unit: str = "", name_x: bool = True,
        x_factor: float = 1.0, y_factor: float = 1.0, grid: bool = True,
    ) -> None:  # fmt: skip
        """Lines and numbers at `x` and `y`, numbers times a factor; the unit stands after the last number of x."""
        pygame, rect, scale = brush.pygame, self.rect, brush.scale
        for value in y:
            at = self.px(self.x[0], value)[1]
            if grid:
                pygame.draw.line(surface, paint.GRID, (rect.left, at), (rect.right - 1, at))
            brush.text(surface, number(value * y_factor), (rect.left - 4, at - 6 * scale), 11, paint.INK, "right")
        for i, value in enumerate(x):
            at = self.px(value, self.y[0])[0]
            if grid:
                pygame.draw.line(surface, paint.GRID, (at, rect.top), (at, rect.bottom - 1))
            if name_x:
                words = number(value * x_factor) + (f" {x_unit}" if i == len(x) - 1 else "")
                # The last one ends at the frame's edge, so that it is not cut off.
                edge = at > rect.right - 12 * scale
                place = (rect.right if edge else at, rect.bottom + 2)
                brush.text(surface, words, place, 11, paint.INK, "right" if edge else "centre")
        pygame.draw.rect(surface, paint.FAINT, rect, 1)


def _plot_rect(brush: Brush, rect: Any, left: float, top: float, bottom: float) -> Any:
    k = brush.scale
    return brush.pygame.Rect(
        rect.left + left * k, rect.top + top * k, rect.width - (left + 8) * k, rect.height - (top + bottom) * k
    )


class Strips:
    """Projected force and arc length over the episode's time."""

    def __init__(self, brush: Brush, scenario: Scenario, rect: Any, force_limit: float) -> None:
        self.brush, self.rect, self.force_limit = brush, rect, force_limit
        self.name, self.place = drive_name(scenario), place_name(scenario)
        tree = scenario.tree
        lone = len(tree.branches) == 1
        self.length = tree.trunk.length if lone else max(tree.length_of(leaf) for leaf in tree.leaves)
        self._drawn: dict[float, tuple[Any, Axes, Axes]] = {}

    def _axes(self, span: float) -> tuple[Any, Axes, Axes]:
        """Background and axes for a time axis of `span` s."""
        if span not in self._drawn:
            brush, pygame = self.brush, self.brush.pygame
            surface = brush.surface(self.rect.size, paint.PAPER)
            half = self.rect.height // 2
            top, bottom = pygame.Rect(0, 0, self.rect.width, half), pygame.Rect(0, half, self.rect.width, half)
            limit, times = self.force_limit, [span * i / 5 for i in range(6)]
            force = Axes(_plot_rect(brush, top, 34, 15, 2), (0.0, span), (-limit, limit))
            force.ticks(brush, surface, times, [-limit, 0.0, limit], name_x=False, y_factor=1e3)
            way = Axes(_plot_rect(brush, bottom, 34, 15, 15), (0.0, span), (0.0, self.length))
            way.ticks(brush, surface, times, round_ticks(self.length)[::2], "s", y_factor=1e3)
            brush.text(surface, f"{self.name} force [mN]", (force.rect.left, top.top + 1), 11, paint.INK)
            brush.text(surface, f"{self.place} [mm], target", (way.rect.left, bottom.top + 1), 11, paint.INK)
            self._drawn[span] = surface, force, way
        return self._drawn[span]

    def draw(self, surface: Any, past: History, now: Snapshot) -> None:
        """The strips with what has been so far."""
        span = next((s for s in _SPANS if s >= now.time), _SPANS[-1])
        background, force, way = self._axes(span)
        canvas = surface.subsurface(self.rect)
        canvas.blit(background, (0, 0))
        pygame, width = self.brush.pygame, max(1, round(1.5 * self.brush.scale))
        # The target so far, and on from now as it is.
        target = way.px(np.array([0.0, *past.time, span]), np.array([past.goal[0], *past.goal, now.goal]))
        pygame.draw.lines(canvas, paint.TARGET, False, target, max(2, round(2 * self.brush.scale)))
        for axes, values, colour in ((force, past.force, paint.DRIVE), (way, past.arclength, paint.INK)):
            points = axes.px(np.array(past.time), np.array(values))
            if len(points) > 1:
                pygame.draw.lines(canvas, colour, False, points, width)
            pygame.draw.circle(canvas, colour, points[-1], 3 * self.brush.scale)


def map_of(scenario: Scenario, across: int = 161, up: int = 121) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Commands (up,), arc lengths (across,) and the force map (up, across) N.

    None for a rig of several degrees of freedom, and for a wire model without such a map.
    """
    if len(scenario.rig.dofs) != 1 or not supports(scenario, "quasistatic"):
        return None
    dof = dofs_of(scenario)[0]
    commands = np.linspace(dof.low, dof.high, up)
    places = np.linspace(0.0, scenario.tract.length, across)
    return commands, places, force_map(scenario, commands, places)


class ForceMap:
    """F(s, θ) as a picture, with the episode's path and the present point on it."""

    def __init__(self, brush: Brush, scenario: Scenario, rect: Any, data: tuple) -> None:
        self.brush, self.rect = brush, rect
        commands, places, values = data
        self.dof = dofs_of(scenario)[0]
        self.limit = map_limit(values)
        self.axes = Axes(
            _plot_rect(brush, brush.pygame.Rect((0, 0), rect.size), 34, 15, 27),
            (places[0], places[-1]), (commands[0], commands[-1]),
        )  # fmt: skip
        self._background = brush.surface(rect.size, paint.PAPER)
        self._paint(places, commands, values)

    def _paint(self, places: np.ndarray, commands: np.ndarray, values: np.ndarray) -> None:
        brush, surface, k = self.brush, self._background, self.brush.scale
        box = self.axes.rect
        picture = paint.diverging(values[::-1], self.limit)
        small = brush.pygame.surfarray.make_surface(picture.swapaxes(0, 1))
        surface.blit(brush.pygame.transform.smoothscale(small, box.size), box)
        ticks = np.linspace(commands[0], commands[-1], 5)
        along = round_ticks(float(places[-1]))
        self.axes.ticks(brush, surface, along, list(ticks), "", True, 1e3, self.dof.factor, grid=False)
        brush.text(surface, f"{map_name(self.dof)} over tip arc length [mm]", (box.left, 1), 11, paint.INK)
        # The colours' meaning, in a row under the axis.
        y, width = box.bottom + 15 * k, round(60 * k)
        bar = paint.diverging(np.linspace(-1, 1, width), 1.0)[:, None].repeat(max(1, round(8 * k)), axis=1)
        words = f"F  {number(-1e3 * self.limit)}", f"+{1e3 * self.limit:g} mN"
        place = brush.text(surface, words[0], (box.left, y), 11)
        surface.blit(brush.pygame.surfarray.make_surface(bar), (place.right + 5, y + 1))
        brush.text(surface, words[1], (place.right + 10 + width, y), 11)

    def background(self, canvas: Any) -> None:
        """The map alone, with its axes, on a surface of its own size."""
        canvas.blit(self._background, (0, 0))

    def place(self, at: tuple[float, float]) -> tuple[float, float] | None:
        """Arc length and command under a pixel of the frame; None outside the map."""
        box = self.axes.rect.move(self.rect.topleft)
        if not box.collidepoint(at):
            return None
        (s0, s1), (c0, c1) = self.axes.x, self.axes.y
        u, v = (at[0] - box.left) / (box.width - 1), (at[1] - box.top) / (box.height - 1)
        return s0 + u * (s1 - s0), c1 - v * (c1 - c0)

    def draw(self, surface: Any, past: History, now: Snapshot) -> None:
        """The map with the path so far, the target and the present point."""
        canvas, pygame, k = surface.subsurface(self.rect), self.brush.pygame, self.brush.scale
        self.background(canvas)
        top, bottom = self.axes.px(now.goal, np.array(self.axes.y))
        pygame.draw.line(canvas, paint.TARGET, top, bottom, max(2, round(2 * k)))
        path = self.dof.wrapped(np.array(past.command))
        points = self.axes.px(np.array(past.arclength), path)
        seams = np.abs(np.diff(path)) > (np.pi if self.dof.turn else np.inf)
        for piece in np.split(points, np.flatnonzero(seams) + 1):
            if len(piece) > 1:
                pygame.draw.lines(canvas, paint.INK, False, piece, max(1, round(1.5 * k)))
        here = self.axes.px(now.tip_arclength, self.dof.wrapped(now.magnet[0]))
        pygame.draw.circle(canvas, paint.PAPER, here, 5 * k)
        pygame.draw.circle(canvas, paint.TIP, here, 3.5 * k)


def round_ticks(end: float) -> list[float]:
    """Three to six round numbers from 0 up to `end`."""
    step = paint.nice(end / 4.9)
    return [i * step for i in range(int(end / step * (1 + 1e-9)) + 1)]


def map_name(dof: Dof) -> str:
    """What the force map's upright axis is called."""
    words = {"°": "magnet angle θ", "mm": "magnet offset", "A": "current"}
    return f"{words[dof.unit]} [{dof.unit}]"


def map_limit(values: np.ndarray) -> float:
    """N at full colour: the map's largest force, rounded up."""
    largest = max(float(np.abs(values).max()), 1e-6)
    power = 10.0 ** np.floor(np.log10(largest))
    return float(next(m * power for m in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if m * power >= largest))


def drive_name(scenario: Scenario) -> str:
    """What the drive along the tract is called: under the coupling "force" it is the force's projection."""
    return "projected" if scenario.coupling == "force" else "drive"


def strip_limit(scenario: Scenario, data: tuple | None) -> float:
    """N at the ends of the force strip."""
    return map_limit(data[2]) if data is not None else paint.nice(0.6 * force_scale(scenario))
