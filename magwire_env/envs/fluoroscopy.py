"""How a fluoroscopic image is taken: its options, and the parallel projection of a C-arm.

Angles are those of the clinic, as DICOM counts them (PS3.3, C.8.7.5, positioner's primary and secondary angle): LAO and
cranial are positive, RAO and caudal negative. At 0°, 0° the detector stands in front of the patient, whose left is then
at the right of the image and whose head is up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np

from ..lumen import Lumen
from ..physics.checks import in_range, positive, whole

__all__ = ["FLUOROSCOPY", "Fluoroscopy", "Projection", "projection", "split"]

FLUOROSCOPY = "fluoroscopy"
"""What `observe` names for an image with the default options."""

_AXES = {
    "": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "LPS": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "RAS": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
}
"""By `Lumen.axes`: the directions of the patient's left and of the head. Those of unknown axes are of the lumens that
come with the package, see `magwire_env.lumen.named_trees`."""

_MARGIN = 0.04
"""Share of the image's side that stays free about the anatomy."""

_SMALLEST, _LARGEST = 16, 512
"""px; of an image's side."""


@dataclass(frozen=True)
class Fluoroscopy:
    """An image in the observation: wire and lumen as a C-arm sees them, `(1, size, size)` uint8.

    size : px, of both sides; 16 to 512
    lao : degrees of the detector to the patient's left, negative for RAO; −180 to 180
    cranial : degrees of the detector to the head, negative for caudal; −90 to 90
    lumen : show the lumen, filled with contrast medium (a roadmap)
    noise : standard deviation of the quantum noise where nothing absorbs, as a share of the brightness there; 0 to 0.5.
        It falls with the root of the brightness, as that of a number of photons does
    target : mark the goal with a white ring, or draw the wanted shape as a white line
    field : m, side of the square that is seen, about the anatomy's middle; by default as much as holds all of it

    Parallel projection: no magnification, and the patient does not move. Frozen and equal by value.

    >>> import gymnasium as gym, magwire_env
    >>> from magwire_env.envs.fluoroscopy import Fluoroscopy
    >>> env = gym.make("MagWire/Steer-v1", observe=(Fluoroscopy(lao=30, noise=0.02), "magnet"))
    >>> {name: space.shape for name, space in env.observation_space.items()}
    {'image': (1, 84, 84), 'state': (2,)}
    """

    size: int = 84
    lao: float = 0.0
    cranial: float = 0.0
    lumen: bool = True
    noise: float = 0.0
    target: bool = True
    field: float | None = None

    def __post_init__(self) -> None:
        size = whole("Fluoroscopy.size", self.size, _SMALLEST)
        if size > _LARGEST:
            raise ValueError(f"Fluoroscopy.size must be at most {_LARGEST} (in px), got {size}")
        put = {
            "size": size,
            "lao": in_range("Fluoroscopy.lao", self.lao, -180.0, 180.0, "degrees"),
            "cranial": in_range("Fluoroscopy.cranial", self.cranial, -90.0, 90.0, "degrees"),
            "noise": in_range("Fluoroscopy.noise", self.noise, 0.0, 0.5),
            "field": None if self.field is None else positive("Fluoroscopy.field", self.field, "m"),
        }
        for name in ("lumen", "target"):
            value = getattr(self, name)
            if not isinstance(value, (bool, np.bool_)):
                raise ValueError(f"Fluoroscopy.{name} must be True or False, got {value!r}")
            put[name] = bool(value)
        for name, value in put.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, given: Fluoroscopy | Mapping[str, Any]) -> Fluoroscopy:
        """The options, or a dict of some of them. Raises `ValueError` for an option that does not exist."""
        if isinstance(given, Fluoroscopy):
            return given
        names = [f.name for f in fields(cls)]
        if unknown := sorted(map(str, set(given) - set(names))):
            raise ValueError(f"Fluoroscopy takes {', '.join(names)}; got {unknown[0]!r}")
        return cls(**given)

    def plain(self) -> str | dict[str, Any]:
        """What `observe` takes in its place and JSON can hold: its name, or the options that are not the defaults."""
        default = asdict(Fluoroscopy())
        return {k: v for k, v in asdict(self).items() if v != default[k]} or FLUOROSCOPY


Shown = str | Fluoroscopy | Mapping[str, Any]
"""One thing to observe: a channel's name, "fluoroscopy", or the options of an image."""


def split(observe: Shown | Sequence[Shown]) -> tuple[tuple[str, ...], Fluoroscopy | None]:
    """The channels that `observe` asks for, and the image, if there is one.

    Raises `ValueError` for two images, and for something that is neither a name nor an image's options.
    """
    if isinstance(observe, (str, Fluoroscopy, Mapping)):
        observe = (observe,)
    if not isinstance(observe, Sequence):
        raise ValueError(f"observe must be a sequence of channels' names, {FLUOROSCOPY!r} or both, got {observe!r}")
    names: list[str] = []
    images: list[Fluoroscopy] = []
    for one in observe:
        if one == FLUOROSCOPY:
            images.append(Fluoroscopy())
        elif isinstance(one, (Fluoroscopy, Mapping)):
            images.append(Fluoroscopy.of(one))
        elif isinstance(one, str):
            names.append(one)
        else:
            raise ValueError(f"observe must hold channels' names, {FLUOROSCOPY!r} or a Fluoroscopy, got {one!r}")
    if len(images) > 1:
        raise ValueError(f"observe must ask for one image at most, got {len(images)}")
    return tuple(names), images[0] if images else None


@dataclass(frozen=True, eq=False)
class Projection:
    """A parallel projection on an image.

    across, down : (3,) unit vectors in the world along the image's columns and rows
    depth : (3,) unit vector from the detector to the patient
    pixel : m, the side of a pixel
    shift : (2,) px; a point's place in the image is (across·x, down·x)/pixel + shift, (0, 0) the upper left corner
    """

    across: np.ndarray
    down: np.ndarray
    depth: np.ndarray
    pixel: float
    shift: np.ndarray

    def place(self, xyz: np.ndarray) -> np.ndarray:
        """Points in the image, column and row in px: (..., 3) m → (..., 2). The pixel (i, j) has its middle at
        (j + 1/2, i + 1/2)."""
        xyz = np.asarray(xyz, dtype=np.float64)
        return np.stack([xyz @ self.across, xyz @ self.down], axis=-1) / self.pixel + self.shift


def directions(axes: str, lao: float, cranial: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors in the world along an image's columns and rows and from the detector to the patient, (3,) each.

    axes : of the coordinates, see `magwire_env.lumen.Lumen.axes`
    lao, cranial : degrees

    Raises `ValueError` for axes that do not say where the patient's left and head are.
    """
    if axes not in _AXES:
        known = ", ".join(map(repr, _AXES))
        raise ValueError(f"an image needs a lumen whose axes are one of {known}, got {axes!r}; Lumen.replace sets them")
    left, head = (np.array(way) for way in _AXES[axes])
    front = np.cross(left, head)
    a, b = np.deg2rad(lao), np.deg2rad(cranial)
    across = np.cos(a) * left - np.sin(a) * front
    out = np.cos(a) * front + np.sin(a) * left
    up = np.cos(b) * head - np.sin(b) * out
    return across, -up, -(np.cos(b) * out + np.sin(b) * head)


@lru_cache(maxsize=1024)
def projection(lumen: Lumen, options: Fluoroscopy) -> Projection:
    """The projection of an anatomy: about its middle, and by default as wide as holds all of it."""
    across, down, depth = directions(lumen.axes, options.lao, options.cranial)
    ways = np.stack([across, down])
    low, high = extent(lumen, ways)
    field = options.field or float((high - low).max()) / (1.0 - 2.0 * _MARGIN)
    pixel = field / options.size
    return Projection(across, down, depth, pixel, options.size / 2 - (low + high) / 2 / pixel)


def extent(lumen: Lumen, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From where to where the space inside reaches along unit vectors (k, 3), (k,) m each."""
    if lumen.wall is not None:
        low, high = lumen.bounds
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3) @ ways.T
        return corners.min(axis=0), corners.max(axis=0)
    ends = []
    for b in lumen.branches:
        s = np.linspace(0.0, b.length, len(b.radius_table) + 1)
        along, r = b.curve.position(s) @ ways.T, b.radius(s)[:, None]
        ends.append(((along - r).min(axis=0), (along + r).max(axis=0)))
    lows, highs = zip(*ends, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)
