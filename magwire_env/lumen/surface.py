"""A closed surface as a wall: its signed distance, and what is wrong with it before it can be one."""

from __future__ import annotations

import hashlib
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .extra import anatomy_library

__all__ = ["Surface", "boundary_loops", "edge_uses", "pieces"]


_FEW = 64
"""Points that are simply asked, each for itself."""


class Surface:
    """A closed surface of triangles whose normals point out of the lumen; a wall of a `Lumen`. Equal by value.

    vertices : (n, 3) m
    faces : (m, 3) numbers of vertices, counter-clockwise seen from outside

    The sign of the distance is that of the generalised winding number (Barill et al. 2018), by libigl. Needs the extra
    `anatomy`.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        self.vertices = np.asarray(vertices, dtype=np.float64).copy(order="F")
        self.faces = np.asarray(faces, dtype=np.int64).copy(order="F")
        for name, array in (("vertices", self.vertices), ("faces", self.faces)):
            if array.ndim != 2 or array.shape[1] != 3 or not len(array):
                raise ValueError(f"Surface.{name} must have shape (n, 3) with n > 0, got shape {array.shape}")
            array.flags.writeable = False
        if not np.isfinite(self.vertices).all():
            raise ValueError("Surface.vertices must be finite (in m)")
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise ValueError(f"Surface.faces must name vertices 0 to {len(self.vertices) - 1}")

    @cached_property
    def digest(self) -> str:
        """A hash of the contents."""
        whole = hashlib.sha256(np.ascontiguousarray(self.vertices).tobytes())
        whole.update(np.ascontiguousarray(self.faces).tobytes())
        return whole.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Surface) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        return f"Surface({len(self.vertices)} vertices, {len(self.faces)} faces, {self.digest[:12]})"

    def __getstate__(self) -> dict[str, Any]:
        return {"vertices": self.vertices, "faces": self.faces}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["vertices"], state["faces"])  # type: ignore[misc]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest corner, (3,) m each."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @property
    def volume(self) -> float:
        """The volume inside, m³."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)

    @property
    def handles(self) -> int:
        """How many loops the tube makes: the genus, from Euler's characteristic of the closed surface."""
        edges = len(edge_uses(self.faces)[0])
        used = len(np.unique(self.faces))
        return (2 * pieces(self.faces, len(self.vertices))[0] - (used - edges + len(self.faces))) // 2

    def distance(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance, positive inside, and its gradient: (n, 3) m → (n,) m, (n, 3)."""
        gap, _, closest = self.closest(xyz)
        inside = self._inside_of(xyz, gap)
        away = np.where(inside[:, None], xyz - closest, closest - xyz)
        gradient = np.divide(away, gap[:, None], out=np.zeros_like(away), where=gap[:, None] > 1e-12)
        flat = np.flatnonzero(gap <= 1e-12)
        if flat.size:
            gradient[flat] = -self.normals[self.closest(xyz[flat])[1]]
        return np.where(inside, gap, -gap), gradient

    def closest(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance from the surface, number of the nearest face, nearest point: (n, 3) m → (n,) m, (n,), (n, 3) m."""
        square, face, point = self._tree.squared_distance(self.vertices, self.faces, _fortran(xyz))
        return np.sqrt(square), face, point

    def inside(self, xyz: np.ndarray) -> np.ndarray:
        """Whether points lie inside: (n, 3) m → (n,)."""
        return anatomy_library("igl").fast_winding_number(self.vertices, self.faces, _fortran(xyz)) > 0.5

    def _inside_of(self, xyz: np.ndarray, gap: np.ndarray) -> np.ndarray:
        """As `inside`, for points whose distance from the surface is known: (n, 3) m, (n,) m → (n,).

        A winding number costs several times what a distance does. Two points that are closer to each other than their
        distances from the surface together lie on one side of it, so one point of a cube is asked for its neighbours.
        """
        found = np.empty(len(xyz), dtype=bool)
        left = np.arange(len(xyz))
        edge = float(gap.max(initial=0.0))
        while len(left) > _FEW and edge > 0.0:
            cube = np.floor((xyz[left] - xyz[left].min(axis=0)) / edge).astype(np.int64)
            shape = cube.max(axis=0) + 1
            key = (cube[:, 0] * shape[1] + cube[:, 1]) * shape[2] + cube[:, 2]
            order = np.lexsort((-gap[left], key))
            first = np.r_[True, np.diff(key[order]) != 0]
            if first.sum() > len(left) / 2:
                break
            left = left[order]
            asked = left[first]
            answer = self.inside(xyz[asked])
            which = np.cumsum(first) - 1
            apart = np.linalg.norm(xyz[left] - xyz[asked][which], axis=1)
            sure = first | (apart < 0.999 * (gap[left] + gap[asked][which]))
            found[left[sure]] = answer[which[sure]]
            left, edge = left[~sure], edge / 2
        if len(left):
            found[left] = self.inside(xyz[left])
        return found

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals of the faces, (m, 3)."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        n = np.cross(b - a, c - a)
        size = np.linalg.norm(n, axis=1, keepdims=True)
        return np.divide(n, size, out=np.zeros_like(n), where=size > 0)

    @cached_property
    def areas(self) -> np.ndarray:
        """Areas of the faces, (m,) m²."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    @cached_property
    def _tree(self) -> Any:
        tree = anatomy_library("igl").AABB()
        tree.init(self.vertices, self.faces)
        return tree


def _fortran(xyz: np.ndarray) -> np.ndarray:
    return np.asfortranarray(xyz, dtype=np.float64)


def edge_uses(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges, (e, 2) with the smaller number first, and how many faces use each, (e,)."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    key = ends[:, 0] * (int(faces.max()) + 1) + ends[:, 1]
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    return ends[first], count


def pieces(faces: np.ndarray, vertices: int) -> tuple[int, np.ndarray]:
    """How many pieces hang together by shared vertices, and the piece of each face, (m,)."""
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_matrix((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(vertices, vertices))
    _, label = connected_components(graph, directed=False)
    used, face = np.unique(label[faces[:, 0]], return_inverse=True)
    return len(used), face


def boundary_loops(faces: np.ndarray) -> list[np.ndarray]:
    """The open edges as loops of vertex numbers, each in the direction in which its faces run it.

    Where two loops touch in a vertex, they are walked as they come.
    """
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    top = int(faces.max()) + 1
    key = directed[:, 0] * top + directed[:, 1]
    back = directed[:, 1] * top + directed[:, 0]
    open_edges = directed[~np.isin(key, back)]
    following: dict[int, list[int]] = {}
    for a, b in open_edges.tolist():
        following.setdefault(a, []).append(b)
    loops = []
    while following:
        start = next(iter(following))
        loop, at = [start], start
        while at in following:
            ahead = following[at].pop()
            if not following[at]:
                del following[at]
            at = ahead
            if at == start:
                break
            loop.append(at)
        loops.append(np.array(loop))
    return loops
