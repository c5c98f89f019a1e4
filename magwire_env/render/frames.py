"""Frames: two views of the scene, strips over time, the force map, as arrays or in a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..envs.core import SteeringCore
from ..scenario import Scenario
from ..simulation.model import supports
from . import paint
from .dofs import dofs_of, number
from .paint import Brush
from .panels import ForceMap, History, Strips, drive_name, map_of, strip_limit
from .snapshot import Snapshot, snapshots
from .views import Views

__all__ = ["Frames", "Picture", "Window"]

SIZE = (640, 480)

_IN_A_LINE = 3
"""Degrees of freedom whose settings stand in one line of a view."""

_KEPT = 32
"""Scenarios whose picture is kept: some megabytes each."""


class Picture:
    """Draws snapshots of one scenario; everything that stands still is drawn once.

    size : width and height, pixels; 4 : 3, at least 640 × 480 to be legible
    """

    def __init__(self, scenario: Scenario, size: tuple[int, int] = SIZE) -> None:
        width, height = size
        if 3 * width != 4 * height or width < 320:
            raise ValueError(f"size must be 4 : 3 and at least 320 × 240 pixels, got {width} × {height}")
        self.brush = Brush(height / 480)
        k, rect = self.brush.scale, self.brush.pygame.Rect
        self.scenario, self._dofs = scenario, dofs_of(scenario)
        self.surface = self.brush.surface(size, paint.PAPER)
        self.views = Views(
            self.brush,
            scenario,
            rect(round(4 * k), round(22 * k), round(314 * k), round(234 * k)),
            rect(round(322 * k), round(22 * k), round(314 * k), round(234 * k)),
        )
        data = map_of(scenario)
        below = rect(0, round(280 * k), round(314 * k) if data else width, height - round(282 * k))
        self.strips = Strips(self.brush, scenario, below, strip_limit(scenario, data))
        self.map = None
        if data:
            self.map = ForceMap(
                self.brush, scenario, rect(round(318 * k), below.y, width - round(318 * k), below.height), data
            )
        self._background = self._still()

    def _still(self) -> Any:
        out = self.surface.copy()
        self.views.background(out)
        self._legend(out)
        return out

    def _legend(self, surface: Any) -> None:
        """One line under the views: what the colours and arrows mean, with the forces' scale."""
        brush, k, views = self.brush, self.brush.scale, self.views
        x, y = 8 * k, 261 * k
        middle = y + 7 * k
        pygame = brush.pygame

        def arrow(words: str, colour: paint.Colour, width: float, x: float) -> float:
            brush.arrow(surface, np.array([x, middle]), np.array([x + 30 * k, middle]), colour, width, 8.0)
            return brush.text(surface, words, (x + 34 * k, y), 11).right + 14 * k

        x = arrow(f"force on the tip, {1e3 * views.reference:g} mN", paint.FORCE, 2.0, x)
        x = arrow(
            "its projection" if self.scenario.coupling == "force" else "drive along the tract", paint.DRIVE, 4.0, x
        )
        x = arrow("tip moment", paint.NORTH, 2.0, x)
        pygame.draw.line(surface, paint.TARGET, (x, middle - 6 * k), (x, middle + 6 * k), max(3, round(3 * k)))
        x = brush.text(surface, "target", (x + 6 * k, y), 11).right + 14 * k
        shade = "contact 0" if supports(self.scenario, "contact") else "wall 0"
        x = brush.text(surface, shade, (x, y), 11).right + 4 * k
        for i in range(round(40 * k)):
            colour = paint.load_colour(i / (40 * k))
            pygame.draw.line(surface, colour, (x + i, middle - 3 * k), (x + i, middle + 3 * k))
        brush.text(surface, f"{1e3 * views.limit:g} mN", (x + 44 * k, y), 11)

    def draw(self, now: Snapshot, past: History, note: str = "") -> Any:
        """The frame's surface, good until the next call.

        note : words at the right of the head line, such as a score
        """
        self.surface.blit(self._background, (0, 0))
        self._head(now, note)
        self.views.draw(self.surface, now)
        self.strips.draw(self.surface, past, now)
        if self.map:
            self.map.draw(self.surface, past, now)
        return self.surface

    def caption(self, verdict: str, hints: str) -> None:
        """On the last frame drawn: bands across the views with a verdict and with hints, where there are any."""
        brush, k = self.brush, self.brush.scale
        plan, side = self.views.frames
        bands = ((verdict, plan.y + 20 * k, 30, 16, paint.TARGET), (hints, plan.bottom - 24 * k, 22, 12, paint.FAINT))
        for words, y, height, size, colour in bands:
            if words:
                band = brush.pygame.Rect(plan.left, y, side.right - plan.left, height * k)
                brush.pygame.draw.rect(self.surface, paint.PAPER, band)
                brush.pygame.draw.rect(self.surface, colour, band, 2)
                brush.text(self.surface, words, (band.centerx, y + (height - size) / 2 * k), size, paint.INK, "centre")

    def _head(self, now: Snapshot, note: str) -> None:
        brush, k = self.brush, self.brush.scale
        parts = (
            (8, f"t {number(now.time, 1)} s"),
            (64, f"{'off' if now.scenario.rig.clamped else 'tip'} {number(1e3 * now.tip_arclength)} mm"),
            (176, f"{drive_name(self.scenario)} {number(1e3 * now.drive_force, 1)} mN"),
            (290, f"lateral {1e3 * now.lateral_force:.1f} mN"),
            (388, f"wall {1e3 * now.wall_force:.0f} mN"),
        )
        for x, words in parts:
            brush.text(self.surface, words, (x * k, 5 * k), 12)
        brush.text(self.surface, note, (632 * k, 5 * k), 12, paint.INK, "right")
        rect = self.views.frames[1]
        settings = [dof.text(value) for dof, value in zip(self._dofs, now.magnet, strict=True)]
        for i in range(0, len(settings), _IN_A_LINE):
            row, y = "   ".join(settings[i : i + _IN_A_LINE]), rect.y + 4 + 14 * k * (i // _IN_A_LINE)
            brush.text(self.surface, row, (rect.right - 6 * k, y), 12, paint.INK, "right")


class Frames:
    """Frames of an env's lanes: pictures by scenario, histories by lane."""

    def __init__(self, core: SteeringCore, size: tuple[int, int] = SIZE) -> None:
        self.core, self.size = core, size
        self._pictures: dict[Scenario, Picture] = {}
        self._past: dict[int, History] = {}
        Brush(1.0)  # says at once if pygame is missing

    def array(self, lanes: Sequence[int] = (0,)) -> list[np.ndarray]:
        """The present of `lanes`, (height, width, 3) uint8 each."""
        return [
            paint.pixels(self.surface(lane, now)) for lane, now in zip(lanes, snapshots(self.core, lanes), strict=True)
        ]

    def surface(self, lane: int, now: Snapshot, note: str = "") -> Any:
        """The frame of one lane as a pygame surface, good until the next call."""
        past = self._past.setdefault(lane, History())
        past.add(now)
        return self.picture(now.scenario).draw(now, past, note)

    def picture(self, scenario: Scenario) -> Picture:
        """What draws the lanes of one scenario."""
        if scenario not in self._pictures:
            while len(self._pictures) >= _KEPT:  # the oldest goes
                self._pictures.pop(next(iter(self._pictures)))
            self._pictures[scenario] = Picture(scenario, self.size)
        return self._pictures[scenario]

    def forget(self, lanes: Sequence[int] | np.ndarray) -> None:
        """Begin new histories: the lanes' episodes have begun anew."""
        for lane in lanes:
            self._past.pop(int(lane), None)


class Window:
    """A window on the screen that shows surfaces at a steady rate."""

    def __init__(self, size: tuple[int, int] = SIZE, title: str = "magwire") -> None:
        self.pygame = pygame = paint.need("pygame", "a window")
        pygame.display.init()
        self._screen = pygame.display.set_mode(size)
        pygame.display.set_caption(title)
        self._clock = pygame.time.Clock()

    def show(self, surface: Any, fps: float) -> list[Any]:
        """Show a frame, wait for its time to pass; returns the window's events."""
        self._screen.blit(surface, (0, 0))
        self.pygame.display.flip()
        self._clock.tick(fps)
        return self.pygame.event.get()

    def close(self) -> None:
        """Take the window away."""
        self.pygame.display.quit()
