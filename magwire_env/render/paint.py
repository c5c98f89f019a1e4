"""Colours and the few drawing tools that the pictures share; the palette is that of `plotting`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..plotting import BLUE, GREEN, PURPLE, RED, YELLOW, rgb
from .extra import need

__all__ = ["Brush", "diverging", "load_colour", "nice", "pixels"]

Colour = tuple[int, int, int]

PAPER: Colour = (255, 255, 255)
PANEL: Colour = (246, 247, 249)
INK: Colour = (34, 34, 34)
FAINT: Colour = (150, 154, 160)
GRID: Colour = (222, 225, 230)
LUMEN_NEAR: Colour = (250, 236, 224)
LUMEN_FAR: Colour = (226, 208, 192)
LUMEN_EDGE: Colour = (170, 140, 118)
NORTH: Colour = rgb(RED)
SOUTH: Colour = rgb(BLUE)
TARGET: Colour = rgb(GREEN)
FORCE: Colour = (20, 20, 24)
DRIVE: Colour = rgb(PURPLE)
TIP: Colour = (0, 0, 0)
WIRE_EDGE: Colour = (60, 60, 66)
WIRE_FREE: Colour = (84, 96, 122)
WIRE_LOADED: Colour = rgb(YELLOW)


def load_colour(share: float) -> Colour:
    """The wire's colour at a share of the limit of the wall force: dark where free, light where loaded."""
    share = min(max(share, 0.0), 1.0)
    return tuple(round(a + share * (b - a)) for a, b in zip(WIRE_FREE, WIRE_LOADED, strict=True))  # type: ignore[return-value]


def diverging(values: np.ndarray, limit: float) -> np.ndarray:
    """Blue below zero, white at zero, orange above: values (...) → (..., 3) uint8, full colour at ± `limit`."""
    share = np.clip(np.asarray(values) / limit, -1.0, 1.0)[..., None]
    ends = np.where(share < 0, np.array(SOUTH, dtype=float), np.array(NORTH, dtype=float))
    return np.round(255 + np.abs(share) * (ends - 255)).astype(np.uint8)


def nice(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten, at least `value`."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-12)))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= value * (1 - 1e-9)))


def pixels(surface: Any) -> np.ndarray:
    """A surface as (height, width, 3) uint8."""
    pygame = need("pygame", "rendering")
    width, height = surface.get_size()
    return np.frombuffer(pygame.image.tobytes(surface, "RGB"), dtype=np.uint8).reshape(height, width, 3).copy()


class Brush:
    """pygame with fonts, for surfaces `scale` times as large as the 640 × 480 the sizes are meant for."""

    def __init__(self, scale: float) -> None:
        self.pygame = need("pygame", "rendering")
        self.pygame.font.init()
        self.scale = scale
        self._fonts: dict[int, Any] = {}
        self._texts: dict[tuple, Any] = {}

    def surface(self, size: tuple[int, int], fill: Colour | None = None) -> Any:
        """A surface without a display; transparent where `fill` is None."""
        flags = 0 if fill else self.pygame.SRCALPHA
        out = self.pygame.Surface(size, flags, 32)
        out.fill(fill or (0, 0, 0, 0))
        return out

    def text(
        self,
        surface: Any,
        words: str,
        at: tuple[float, float],
        size: int = 12,
        colour: Colour = INK,
        align: str = "left",
    ) -> Any:
        """Write on `surface`; `at` is the text's top left, top centre or top right by `align`.

        Returns the rectangle written on.
        """
        if not words:
            return self.pygame.Rect(round(at[0]), round(at[1]), 0, 0)
        key = (words, size, colour)
        if key not in self._texts:
            if len(self._texts) > 500:  # numbers that change with every frame pass through here
                self._texts.clear()
            self._texts[key] = self._written(words, size, colour)
        image = self._texts[key]
        x = at[0] - {"left": 0, "centre": image.get_width() / 2, "right": image.get_width()}[align]
        return surface.blit(image, (round(x), round(at[1])))

    def _written(self, words: str, size: int, colour: Colour) -> Any:
        """Text in the font pygame brings along, scaled down from four times the size: so small, hinting tears words."""
        if size not in self._fonts:
            self._fonts[size] = self.pygame.font.Font(None, round(4 * 1.35 * size * self.scale))
        large = self._fonts[size].render(words, True, colour)
        small = (max(1, round(large.get_width() / 4)), max(1, round(large.get_height() / 4)))
        return self.pygame.transform.smoothscale(large, small)

    def arrow(
        self, surface: Any, start: np.ndarray, end: np.ndarray, colour: Colour, width: float = 2.0, head: float = 7.0
    ) -> None:
        """An arrow from pixel to pixel; shorter than its own head it is left out."""
        way = np.asarray(end, dtype=float) - start
        length = float(np.hypot(*way))
        head *= self.scale
        if length < 0.6 * head:
            return
        along = way / length
        across = np.array([-along[1], along[0]]) * head * 0.45
        neck = end - along * min(head, length)
        half = np.array([-along[1], along[0]]) * width * self.scale / 2
        self.pygame.draw.polygon(surface, colour, [start - half, start + half, neck + half, neck - half])
        self.pygame.draw.polygon(surface, colour, [end, neck + across, neck - across])
