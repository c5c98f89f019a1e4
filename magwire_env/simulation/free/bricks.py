"""A wall of any shape: its signed distance in bricks of a grid, kept only near the wall.

The distance is a quadratic B-spline on a uniform grid, so that its gradient is continuous and piecewise linear. A brick
is 4 × 4 × 4 cells and holds the 6 × 6 × 6 coefficients they need, as float32. A dense index says for every brick of the
box where it stands, or that it lies deep inside (no contact) or far outside (nowhere a wire may be). The inlet is open:
behind it, beyond the box, the wall is a straight tube.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from ...compiled import inlined, kernel
from ..lanes import (
    _BITS,
    _DOUBLES,
    _FLOATS,
    _INTS,
    LANES,
    _call,
    _splat,
    anywhere,
    floor,
    lanes_type,
    load,
    maximum,
    minimum,
    reciprocal,
    spread,
    sqrt,
    where,
)
from .layout import (
    BASE_TX,
    BASE_X,
    GRID_AT,
    GRID_CELL,
    GRID_INLET,
    GRID_NX,
    GRID_NY,
    GRID_NZ,
    GRID_X,
    GRID_Y,
    GRID_Z,
)
from .vectors import diagonal, dot, load3, plus, plus6, select3, select6, square, sub, times

__all__ = ["Bricks", "smooth_union"]

CELLS, KEPT = 4, 6
INSIDE, OUTSIDE = -1.0, -2.0
FAR = 1e6
"""m, the depth of a point where no wire may be: a line search refuses its energy."""


@intrinsic
def gather32(typingctx, array, index, offset):
    """``array[index + offset]`` of a float32 array, `index` a whole number a lane, as float64."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, value=args[0]).data
        first = builder.ptrtoint(builder.gep(data, [args[2]]), ir.IntType(64))
        shift = ir.Constant(_INTS, [2] * LANES)
        where_to = builder.shl(builder.fptosi(args[1], _INTS), shift)
        address = builder.inttoptr(
            builder.add(where_to, _splat(builder, first, _INTS)), ir.VectorType(ir.FloatType().as_pointer(), LANES)
        )
        every, align = ir.Constant(_BITS, [1] * LANES), ir.Constant(ir.IntType(32), 4)
        name = f"llvm.masked.gather.v{LANES}f32.v{LANES}p0"
        value = _call(builder, name, _FLOATS, [address, align, every, ir.Constant(_FLOATS, ir.Undefined)])
        return builder.fpext(value, _DOUBLES)

    return lanes_type(array, lanes_type, types.intp), codegen


@inlined
def behind_inlet(par, x):
    """In the straight tube behind the inlet: depth, its first and second derivatives, and the way past the inlet, m."""
    t = load3(par, BASE_TX)
    r = sub(x, load3(par, BASE_X))
    along = dot(r, t)
    r = plus(r, -along, t)
    distance = sqrt(dot(r, r))
    inv = reciprocal(maximum(distance, 1e-15))
    out = times(inv, r)
    across = plus6(square(-inv, out), -inv, square(1.0, t))
    return distance - load(par, GRID_INLET), out, diagonal(across, inv), along


@kernel
def depth_in_bricks(grid, par, x):
    """−φ at a point, its gradient, and its second derivatives (six numbers)."""
    inv = 1.0 / load(par, GRID_CELL)
    px, py, pz = (
        (x[0] - load(par, GRID_X)) * inv, (x[1] - load(par, GRID_Y)) * inv, (x[2] - load(par, GRID_Z)) * inv
    )  # fmt: skip
    ix, iy, iz = floor(px), floor(py), floor(pz)
    fx, fy, fz = px - ix, py - iy, pz - iz
    bx, by, bz = floor(0.25 * ix), floor(0.25 * iy), floor(0.25 * iz)
    nx, ny, nz = load(par, GRID_NX), load(par, GRID_NY), load(par, GRID_NZ)
    within = (bx >= 0.0) & (by >= 0.0) & (bz >= 0.0) & (bx < nx) & (by < ny) & (bz < nz)
    cx, cy, cz = (
        maximum(minimum(bx, nx - 1.0), 0.0), maximum(minimum(by, ny - 1.0), 0.0), maximum(minimum(bz, nz - 1.0), 0.0)
    )  # fmt: skip
    at = load(par, GRID_AT)
    brick = gather32(grid, at + (cx * ny + cy) * nz + cz, 0)
    brick = where(within, brick, OUTSIDE)
    here = brick >= 0.0
    jx, jy, jz = where(here, ix - 4.0 * bx, 0.0), where(here, iy - 4.0 * by, 0.0), where(here, iz - 4.0 * bz, 0.0)
    corner = at + nx * ny * nz + 216.0 * maximum(brick, 0.0) + (jx * 6.0 + jy) * 6.0 + jz
    wx = (0.5 * (1.0 - fx) * (1.0 - fx), 0.5 + fx * (1.0 - fx), 0.5 * fx * fx)
    wy = (0.5 * (1.0 - fy) * (1.0 - fy), 0.5 + fy * (1.0 - fy), 0.5 * fy * fy)
    wz = (0.5 * (1.0 - fz) * (1.0 - fz), 0.5 + fz * (1.0 - fz), 0.5 * fz * fz)
    sx, sy, sz = (fx - 1.0, 1.0 - 2.0 * fx, fx), (fy - 1.0, 1.0 - 2.0 * fy, fy), (fz - 1.0, 1.0 - 2.0 * fz, fz)
    bend = (1.0, -2.0, 1.0)
    phi, gx, gy, gz = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    hxx, hxy, hxz, hyy, hyz, hzz = phi, phi, phi, phi, phi, phi
    if anywhere(here):
        for i in range(3):
            u, v, t = spread(0.0), spread(0.0), spread(0.0)
            vv, vt, tt = spread(0.0), spread(0.0), spread(0.0)
            for j in range(3):
                o = (i * 6 + j) * 6
                a, b, c = gather32(grid, corner, o), gather32(grid, corner, o + 1), gather32(grid, corner, o + 2)
                line = wz[0] * a + wz[1] * b + wz[2] * c
                u = u + wy[j] * line
                v = v + sy[j] * line
                slope = sz[0] * a + sz[1] * b + sz[2] * c
                t = t + wy[j] * slope
                vv, vt, tt = vv + bend[j] * line, vt + sy[j] * slope, tt + wy[j] * (a - 2.0 * b + c)
            phi, gx, gy, gz = phi + wx[i] * u, gx + sx[i] * u, gy + wx[i] * v, gz + wx[i] * t
            hxx, hxy, hxz = hxx + bend[i] * u, hxy + sx[i] * v, hxz + sx[i] * t
            hyy, hyz, hzz = hyy + wx[i] * vv, hyz + wx[i] * vt, hzz + wx[i] * tt
    depth = where(here, -phi, where(brick < -1.5, FAR, -FAR))
    inv2 = inv * inv  # of a lane that has no bricks, all of this may be no number
    first = where(here, -gx * inv, 0.0), where(here, -gy * inv, 0.0), where(here, -gz * inv, 0.0)
    second = (
        where(here, -hxx * inv2, 0.0), where(here, -hxy * inv2, 0.0), where(here, -hxz * inv2, 0.0),
        where(here, -hyy * inv2, 0.0), where(here, -hyz * inv2, 0.0), where(here, -hzz * inv2, 0.0),
    )  # fmt: skip
    beyond = where(within, 0.0, nx) > 0.0  # never in a lane that has no bricks
    if anywhere(beyond):
        straight, out, bent, along = behind_inlet(par, x)
        beyond = beyond & (along < 0.0)
        depth, first = where(beyond, straight, depth), select3(beyond, out, first)
        second = select6(beyond, bent, second)
    return depth, first, second


_TOGETHER = 4096
"""Bricks that are sampled at a time: it bounds the memory."""


class Bricks:
    """The distance φ (m, positive inside) of a wall in bricks.

    phi : φ at points (n, 3) m → (n,) m; near the wall a distance, so of gradient 1
    low, high : corners of a box about the lumen, m
    cell : edge of a cell, m; φ is then good to about cell³/(10 R²) where the wall is smooth with radius R
    inside, outside : m, how far from the wall φ is kept
    """

    def __init__(
        self,
        phi: Callable[[np.ndarray], np.ndarray],
        low: Sequence[float],
        high: Sequence[float],
        cell: float,
        inside: float,
        outside: float,
    ) -> None:
        self.cell = cell
        edge = CELLS * cell
        low, high = np.asarray(low, dtype=np.float64) - outside, np.asarray(high, dtype=np.float64) + outside
        self.shape = tuple(int(n) for n in np.maximum(np.ceil((high - low) / edge), 1))
        self.origin = low
        box = np.stack(np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij"), axis=-1).reshape(-1, 3)
        middle = _chunked(phi, low + (box + 0.5) * edge)
        reach = 0.5 * math.sqrt(3.0) * edge
        near = (middle < inside + reach) & (middle > -outside - reach)
        self.index = np.where(middle > 0.0, INSIDE, OUTSIDE)
        self.index[near] = np.arange(near.sum())
        # Samples at the cells' centres, one more all round than the coefficients; neighbouring bricks share most.
        k = np.arange(-2, CELLS + 2)
        offsets = np.stack(np.meshgrid(k, k, k, indexing="ij"), axis=-1).reshape(-1, 3)
        self.coefficients = np.empty((int(near.sum()), KEPT**3), dtype=np.float32)
        corners = CELLS * box[near]
        for i in range(0, len(corners), _TOGETHER):
            cells = (corners[i : i + _TOGETHER, None] + offsets).reshape(-1, 3)
            values = self._sampled(phi, cells).reshape(-1, 8, 8, 8)
            for axis in (1, 2, 3):
                values = _quasi_interpolated(values, axis)
            self.coefficients[i : i + _TOGETHER] = values.reshape(len(values), -1)

    def _sampled(self, phi: Callable[[np.ndarray], np.ndarray], cells: np.ndarray) -> np.ndarray:
        """φ at the centres of cells (n, 3), each asked for once: (n,) m."""
        shape = CELLS * np.array(self.shape) + 4
        keys = np.ravel_multi_index(tuple((cells + 2).T), tuple(shape))
        once, which = np.unique(keys, return_inverse=True)
        at = np.stack(np.unravel_index(once, tuple(shape)), axis=1) - 2
        return _chunked(phi, self.origin + (at + 0.5) * self.cell)[which]

    @classmethod
    def of(cls, origin: np.ndarray, cell: float, index: np.ndarray, coefficients: np.ndarray) -> Bricks:
        """Bricks made before: `index` (nx, ny, nz) and coefficients as they were, see `Bricks`."""
        if coefficients.shape != (np.count_nonzero(index >= 0.0), KEPT**3) or index.ndim != 3:
            raise ValueError(f"coefficients must be of the bricks of the index, got {coefficients.shape}")
        own = cls.__new__(cls)
        own.cell, own.shape, own.origin = cell, tuple(index.shape), origin
        own.index, own.coefficients = index.reshape(-1), coefficients
        return own

    @property
    def data(self) -> np.ndarray:
        """Index and coefficients as the kernel reads them, float32."""
        return np.concatenate([self.index.astype(np.float32), self.coefficients.reshape(-1)])

    def fields(self, at: int = 0) -> dict[str, float]:
        """The lane's parameters that find `data`, standing from `at` on in the kernel's grid."""
        names = ("GRID_X", "GRID_Y", "GRID_Z", "GRID_NX", "GRID_NY", "GRID_NZ")
        numbers = [*map(float, self.origin), *map(float, self.shape)]
        return {**dict(zip(names, numbers, strict=True)), "GRID_CELL": self.cell, "GRID_AT": float(at)}


def smooth_union(distances: Sequence[np.ndarray], blend: float) -> np.ndarray:
    """φ of the union of lumens from their own φ (n,) each, creases rounded where two differ by less than `blend` m."""
    out = np.asarray(distances[0], dtype=np.float64)
    for other in distances[1:]:
        h = np.maximum(blend - np.abs(out - other), 0.0)
        out = np.maximum(out, other) + h * h / (4.0 * blend)
    return out


def _quasi_interpolated(values: np.ndarray, axis: int) -> np.ndarray:
    """Coefficients of a quadratic B-spline from samples at the cells' centres: third order; two fewer along `axis`."""
    v = np.moveaxis(values, axis, 0)
    c = v[1:-1] - (v[:-2] - 2.0 * v[1:-1] + v[2:]) / 8.0
    return np.moveaxis(c, 0, axis)


def _chunked(phi: Callable[[np.ndarray], np.ndarray], points: np.ndarray, size: int = 200_000) -> np.ndarray:
    return np.concatenate([np.asarray(phi(points[i : i + size])) for i in range(0, len(points), size)])
