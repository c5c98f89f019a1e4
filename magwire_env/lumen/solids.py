"""From the material about a lumen to the lumen: the channels of a plate, the bore of a thick wall."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from .extra import anatomy_library
from .surface import Surface

__all__ = ["channels_of"]

_CELLS = 160
"""Voxels along the longest side of the grid on which channels are found."""

_FINE = 4.0
"""Voxels across the channel's radius in the grid on which its surface is made."""


def channels_of(path: str, solid: Surface, inlet: np.ndarray | None, notes: list[str]) -> Surface:
    """The surface of the channel in a solid: what of its convex hull it does not fill, closed where the hull ends.

    Of several channels the one nearest to `inlet` is taken, or the largest. Raises `ValueError` naming the file if the
    solid has none.
    """
    try:
        hull = ConvexHull(solid.vertices)
    except QhullError:
        raise ValueError(f"{path} must be a solid, but it is flat") from None
    pitch = float(np.ptp(solid.vertices, axis=0).max()) / _CELLS
    field, origin = _field(solid, hull, *solid.bounds, pitch)
    label, count = ndimage.label(field > 0.5 * pitch)
    if not count:
        raise ValueError(f"{path} must be material with a channel in it, but its convex hull is full")
    sizes = np.bincount(label.ravel())[1:]
    if inlet is None:
        best = int(sizes.argmax()) + 1
    else:
        places = [origin + pitch * np.argwhere(label == k + 1) for k in range(count)]
        best = int(np.argmin([np.linalg.norm(p - inlet, axis=1).min() for p in places])) + 1
    if count > 1:
        notes.append(f"of {count} channels the {'largest' if inlet is None else 'one nearest to the inlet'} is taken")
    inside = np.argwhere(label == best)
    widest = float(field[label == best].max())
    low, high = origin + pitch * (inside.min(axis=0) - 3), origin + pitch * (inside.max(axis=0) + 3)
    fine = max(min(pitch, widest / _FINE), float((high - low).max()) / 400)
    field, origin = _field(solid, hull, low, high, fine)
    label, _ = ndimage.label(field > 0)
    seeds = np.round((_world(inside, pitch, solid) - origin) / fine).astype(int).clip(0, np.array(field.shape) - 1)
    found = label[tuple(seeds.T)]
    piece = np.bincount(found[found > 0]).argmax()
    field = np.where(ndimage.binary_dilation(label == piece, iterations=2), field, -fine)
    vertices, faces, _, _ = anatomy_library("skimage.measure").marching_cubes(
        np.pad(field, 1, constant_values=-fine), 0.0
    )
    made = Surface(origin + fine * (vertices - 1), faces)
    if made.volume < 0:
        made = Surface(made.vertices, made.faces[:, ::-1])
    notes.append(
        f"the channel's ends are closed where the convex hull of the material ends; its surface is made on a grid of "
        f"{fine:.3g}"
    )
    return made


def _world(cells: np.ndarray, pitch: float, solid: Surface) -> np.ndarray:
    return solid.bounds[0] - 2 * pitch + pitch * cells


def _field(
    solid: Surface, hull: ConvexHull, low: np.ndarray, high: np.ndarray, pitch: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the material and from the hull's outside, positive in the channels, on a grid; and its origin."""
    origin = low - 2 * pitch
    shape = np.ceil((high - low) / pitch).astype(int) + 5
    if np.prod(shape.astype(float)) > 3e7:
        raise ValueError(f"a grid of {shape.tolist()} cells is too large")
    field = np.empty(shape, dtype=np.float32)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in shape[1:]), indexing="ij"), axis=-1).reshape(-1, 2)
    for i in range(shape[0]):
        xyz = origin + pitch * np.column_stack([np.full(len(grid), i), grid])
        depth = -(xyz @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        values = depth.copy()
        near = depth > -2 * pitch
        if near.any():
            values[near] = np.minimum(depth[near], -solid.distance(xyz[near])[0])
        field[i] = values.reshape(shape[1:])
    return field, origin
