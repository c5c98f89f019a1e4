"""From a voxel mask or a level set to a surface, in the file's coordinates."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix

from ..words import counted
from .extra import anatomy_library
from .mending import RawSurface
from .volume_files import Volume

__all__ = ["surface_of"]

_BLUR = 0.6
"""Width of the Gaussian that smooths a mask's steps, voxels."""

_PAD = 3
"""Voxels that are added all round, so that the surface closes."""

_ROUNDS = 15
"""Rounds of smoothing of a mask's surface."""

_SPECK = 0.01
"""Separate pieces of less than this share of the largest one's voxels are dropped, and said."""


def surface_of(
    path: str, volume: Volume, notes: list[str], near: np.ndarray | None = None, invert: bool = False
) -> RawSurface:
    """The surface about the voxels inside, by marching cubes, with normals outwards.

    A mask (whole numbers or truths) is what is not 0; a level set (negative and positive numbers) is what has the
    other sign than the border; fractions between 0 and 1 are cut at a half. near : a point of the piece that is meant.
    invert : the voxels are the material, and the lumen is the hollow in it.
    Raises `ValueError` naming the file and the fault.
    """
    inside, level = _inside_of(path, volume.values, notes)
    if invert:
        inside = _without_outside(~inside)
        level = None
    if not inside.any() or inside.all():
        raise ValueError(
            f"{path} must hold voxels inside and outside, got {'only' if inside.all() else 'no'} voxels inside"
        )
    inside = _one_piece(path, inside, volume, notes, near)
    box = ndimage.find_objects(inside.astype(np.uint8))[0]
    touched = [f"{'ijk'[a]} = {e}" for a in range(3) for e in (0, inside.shape[a] - 1) if inside.take(e, axis=a).any()]
    if touched:
        notes.append(f"the mask reaches the border of its volume ({', '.join(touched)}): it is closed there")
    grow = [(max(s.start - 3, 0), min(s.stop + 3, n)) for s, n in zip(box, inside.shape, strict=True)]
    crop = tuple(slice(a, b) for a, b in grow)
    field = _field(inside[crop], None if level is None else level[crop])
    del inside
    vertices, faces, _, _ = anatomy_library("skimage.measure").marching_cubes(field, 0.0)
    if level is None:
        vertices = _without_steps(vertices.astype(np.float64), faces)
    vertices = vertices.astype(np.float64) - _PAD + [a for a, _ in grow]
    faces = faces.astype(np.int64)
    if np.linalg.det(volume.affine[:3, :3]) > 0:  # marching cubes turns the faces towards the larger values
        faces = faces[:, ::-1]
    return RawSurface(vertices @ volume.affine[:3, :3].T + volume.affine[:3, 3], faces)


def _inside_of(path: str, values: np.ndarray, notes: list[str]) -> tuple[np.ndarray, np.ndarray | None]:
    """Which voxels are inside, and the level that is positive there; None for a mask."""
    level = None
    if values.dtype.kind == "f":
        finite = np.isfinite(values)
        if not finite.all():
            where = np.argwhere(~finite)[0].tolist()
            raise ValueError(f"{path} must hold finite numbers, got {values[tuple(where)]} at voxel {where}")
        low, high = float(values.min()), float(values.max())
        if low < 0 < high:
            level = _inside_positive(values)
            notes.append("a level set: the inside is where its sign differs from the border's")
            inside = level > 0
        elif high <= 1.0 and low >= 0.0 and ((values > 0) & (values < 1)).any():
            inside = values > 0.5
            level = values.astype(np.float32) - np.float32(0.5)
        else:
            inside = values != 0
    else:
        inside = values != 0
        labels = np.unique(values[:: max(1, values.shape[0] // 64)])
        if len(labels[labels != 0]) > 1:
            notes.append(f"a label map with the labels {labels[labels != 0][:8].tolist()}: all of them are inside")
    return inside, level


def _field(inside: np.ndarray, level: np.ndarray | None) -> np.ndarray:
    """What is positive inside, `_PAD` voxels wider on all sides: the level, or the mask smoothed."""
    if level is None:
        mask = np.pad(inside, _PAD).astype(np.float32)
        return ndimage.gaussian_filter(mask, _BLUR, truncate=4.0) - np.float32(0.5)
    outside = float(min(level.min(), -1e-3))
    kept = np.where(inside | ~ndimage.binary_dilation(inside, iterations=2), level, -np.abs(level))
    field = np.where(level <= 0, np.minimum(level, 0), kept)
    return np.pad(field, _PAD, constant_values=outside).astype(np.float32)


def _without_steps(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The vertices smoothed by Taubin's two steps, which take the voxels' steps off and keep the volume."""
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ones = np.ones(len(ends), dtype=np.float32)
    near = coo_matrix((ones, (ends[:, 0], ends[:, 1])), shape=(len(vertices),) * 2).tocsr()
    count = np.maximum(np.asarray(near.sum(axis=1)), 1.0)
    start = vertices
    for _ in range(_ROUNDS):
        for step in (0.5, -0.53):
            vertices = vertices + step * (near @ vertices / count - vertices)
    moved = vertices - start
    size = np.linalg.norm(moved, axis=1, keepdims=True)
    return start + moved * np.minimum(1.0, 0.7 / np.maximum(size, 1e-12))  # not farther than a voxel's step


def _inside_positive(values: np.ndarray) -> np.ndarray:
    """A level set whose inside is positive: the border is outside."""
    border = np.concatenate([values[s].ravel() for a in range(3) for s in (_face(a, 0), _face(a, -1))])
    return (-values if np.mean(border > 0) > 0.5 else values).astype(np.float32)


def _without_outside(empty: np.ndarray) -> np.ndarray:
    """What of the empty voxels does not hang together with the border."""
    label, _ = ndimage.label(empty)
    border = np.unique(np.concatenate([label[_face(a, e)].ravel() for a in range(3) for e in (0, -1)]))
    return empty & ~np.isin(label, border)


def _face(axis: int, at: int) -> tuple:
    return tuple(at if a == axis else slice(None) for a in range(3))


def _one_piece(path: str, inside: np.ndarray, volume: Volume, notes: list[str], near: np.ndarray | None) -> np.ndarray:
    label, count = ndimage.label(inside)
    if count == 1:
        return inside
    sizes = np.bincount(label.ravel())[1:]
    large = np.flatnonzero(sizes >= _SPECK * sizes.max()) + 1
    if count > len(large):
        notes.append(
            f"dropped: {counted(count - len(large), 'small separate piece')}, "
            f"{counted(int(sizes.sum() - sizes[large - 1].sum()), 'voxel')}"
        )
    if len(large) > 1:
        found = ndimage.find_objects(label)
        middles = [_place(volume, [(s.start + s.stop - 1) / 2 for s in found[k - 1]]) for k in large]
        if near is None:
            shown = "; ".join(
                f"{sizes[k - 1]} voxels about ({m[0]:.6g}, {m[1]:.6g}, {m[2]:.6g})"
                for k, m in zip(large, middles, strict=True)
            )
            raise ValueError(
                f"{path} holds {len(large)} separate pieces of similar size ({shown}); join them, or choose one with "
                "inlet=(x, y, z)"
            )
        voxel = np.linalg.inv(volume.affine) @ np.append(near, 1.0)
        gaps = [
            np.abs(np.argwhere(label[found[k - 1]] == k) + [s.start for s in found[k - 1]] - voxel[:3])
            .sum(axis=1)
            .min()
            for k in large
        ]
        large = large[[int(np.argmin(gaps))]]
        notes.append("of several separate pieces the one nearest to the inlet is taken")
    return np.isin(label, large)


def _place(volume: Volume, voxel: list[float]) -> np.ndarray:
    return (volume.affine @ np.append(voxel, 1.0))[:3]
