"""Drawing fluoroscopic images, compiled: the lumen once, wires a lane, noise a pixel.

A wire is a chain of capsules. A pixel is covered by a capsule of half width r px as far as r + 1/2 − d reaches into
[0, 1], with d px from the pixel's middle to the capsule's axis: lines are smooth, and their ends are round.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel

__all__ = ["draw", "fill"]

_RING = 1.4
"""px; width of the target's ring."""

_WHITE = 255.0

_SPREAD = math.sqrt(4 * (256**2 - 1) / 12)
"""Standard deviation of the sum of four bytes."""


@kernel
def fill(balls, thin, occupied):
    """Mark the cells of `occupied` (rows, columns, depths) that lie in one of `balls` (m, 4).

    balls : column, row, depth and radius, in cells; the radius in those along rows and columns
    thin : how often a cell is as wide as it is deep
    """
    rows, columns, depths = occupied.shape
    for m in range(balls.shape[0]):
        column, row, depth, radius = balls[m, 0], balls[m, 1], balls[m, 2], balls[m, 3]
        for i in range(max(0, int(row - radius)), min(rows, int(row + radius) + 1)):
            for j in range(max(0, int(column - radius)), min(columns, int(column + radius) + 1)):
                square = radius * radius - (i + 0.5 - row) ** 2 - (j + 0.5 - column) ** 2
                if square > 0.0:
                    half = thin * math.sqrt(square)
                    first = min(max(0, int(depth - half + 0.5)), depths)
                    last = min(max(0, int(depth + half + 0.5)), depths)
                    for k in range(first, last):
                        occupied[i, j, k] = 1


@kernel
def capsule(still, image, ax, ay, bx, by, half, left):
    """Darken `image` where a capsule from (ax, ay) to (bx, by) of half width `half` px lies over `still`.

    left : share of the light that gets through
    """
    size = image.shape[0]
    reach = half + 0.5
    low_j, high_j = max(0, int(min(ax, bx) - reach)), min(size, int(max(ax, bx) + reach) + 1)
    low_i, high_i = max(0, int(min(ay, by) - reach)), min(size, int(max(ay, by) + reach) + 1)
    wx, wy = bx - ax, by - ay
    scale = 1.0 / max(wx * wx + wy * wy, 1e-12)
    for i in range(low_i, high_i):
        for j in range(low_j, high_j):
            x, y = j + 0.5 - ax, i + 0.5 - ay
            share = min(max((x * wx + y * wy) * scale, 0.0), 1.0)
            dx, dy = x - share * wx, y - share * wy
            covered = min(max(reach - math.sqrt(dx * dx + dy * dy), 0.0), 1.0)
            image[i, j] = min(image[i, j], still[i, j] * (1.0 - covered * (1.0 - left)))


@kernel
def wire_on(nodes, way, sizes, left, still, image):
    """Draw a wire, then the magnet at its tip.

    nodes : (k, 3) m, base to tip; those that are NaN are left out
    way : (2, 4), world to image: px a metre along the columns and rows, and the shift, px
    sizes : half width of the wire, px; half width of the magnet, px; its length, m
    left : shares of the light that get through wire and magnet
    """
    last = nodes.shape[0] - 1
    ahead = (0.0, 0.0)
    rest = sizes[2]
    for b in range(2):  # the magnet is darker and comes last
        for k in range(last, -1, -1):
            x, y, z = nodes[k, 0], nodes[k, 1], nodes[k, 2]
            if math.isnan(x):
                break
            px = way[0, 0] * x + way[0, 1] * y + way[0, 2] * z + way[0, 3]
            py = way[1, 0] * x + way[1, 1] * y + way[1, 2] * z + way[1, 3]
            if k == last:
                ahead = (px, py)
                if last == 0 or b == 1:
                    capsule(still, image, px, py, px, py, sizes[b], left[b])
                continue
            if b == 0:
                capsule(still, image, ahead[0], ahead[1], px, py, sizes[0], left[0])
            else:
                x, y, z = x - nodes[k + 1, 0], y - nodes[k + 1, 1], z - nodes[k + 1, 2]
                length = math.sqrt(x * x + y * y + z * z)
                share = min(1.0, rest / max(length, 1e-12))
                qx, qy = ahead[0] + share * (px - ahead[0]), ahead[1] + share * (py - ahead[1])
                capsule(still, image, ahead[0], ahead[1], qx, qy, sizes[1], left[1])
                rest -= length
                if rest <= 0.0:
                    break
            ahead = (px, py)


@kernel
def ring_on(column, row, radius, image):
    """Draw a white ring."""
    size = image.shape[0]
    reach = radius + 1.0 + _RING
    for i in range(max(0, int(row - reach)), min(size, int(row + reach) + 1)):
        for j in range(max(0, int(column - reach)), min(size, int(column + reach) + 1)):
            x, y = j + 0.5 - column, i + 0.5 - row
            off = abs(math.sqrt(x * x + y * y) - radius)
            covered = min(max(0.5 * (_RING + 1.0) - off, 0.0), 1.0)
            image[i, j] += covered * (_WHITE - image[i, j])


@kernel
def shape_on(nodes, way, still, image):
    """Draw a white line through `nodes` (k, 3) m; way as in `wire_on`."""
    size, reach = image.shape[0], 1.0
    for k in range(nodes.shape[0] - 1):
        px, py, qx, qy = 0.0, 0.0, 0.0, 0.0
        for axis in range(3):
            px, qx = px + way[0, axis] * nodes[k, axis], qx + way[0, axis] * nodes[k + 1, axis]
            py, qy = py + way[1, axis] * nodes[k, axis], qy + way[1, axis] * nodes[k + 1, axis]
        px, qx, py, qy = px + way[0, 3], qx + way[0, 3], py + way[1, 3], qy + way[1, 3]
        wx, wy = qx - px, qy - py
        scale = 1.0 / max(wx * wx + wy * wy, 1e-12)
        for i in range(max(0, int(min(py, qy) - reach)), min(size, int(max(py, qy) + reach) + 1)):
            for j in range(max(0, int(min(px, qx) - reach)), min(size, int(max(px, qx) + reach) + 1)):
                x, y = j + 0.5 - px, i + 0.5 - py
                share = min(max((x * wx + y * wy) * scale, 0.0), 1.0)
                dx, dy = x - share * wx, y - share * wy
                covered = min(max(reach - math.sqrt(dx * dx + dy * dy), 0.0), 1.0)
                image[i, j] = max(image[i, j], still[i, j] + covered * (_WHITE - still[i, j]))


@kernel
def mixed(x):
    """A 32-bit number whose every bit depends on all bits of `x` (the finaliser of MurmurHash3)."""
    x = np.uint32(x)
    x = np.uint32(np.uint32(x ^ (x >> np.uint32(16))) * np.uint32(0x85EBCA6B))
    x = np.uint32(np.uint32(x ^ (x >> np.uint32(13))) * np.uint32(0xC2B2AE35))
    return np.uint32(x ^ (x >> np.uint32(16)))


@kernel
def develop(image, noise, first, second, out):
    """The image as whole grey values, with quantum noise.

    noise : standard deviation where a pixel is white, as a share of white; it goes with the root of the brightness. A
        pixel's number is the sum of four even ones, which is normal within 3.4 standard deviations: half the time of
        a table of normal numbers
    first, second : two 32-bit numbers that fix the noise
    """
    flat, bare = out.reshape(out.size), image.reshape(image.size)
    half, top = np.float32(0.5), np.float32(_WHITE)
    if noise == 0.0:
        for p in range(flat.size):
            flat[p] = np.uint8(np.int32(bare[p] + half))
        return
    size, byte = np.float32(noise * math.sqrt(_WHITE) / _SPREAD), np.uint32(255)
    first, second = np.uint32(first), np.uint32(second)
    for p in range(flat.size):
        x = mixed(mixed(np.uint32(p) + first) ^ second)
        four = (x & byte) + ((x >> np.uint32(8)) & byte) + ((x >> np.uint32(16)) & byte) + (x >> np.uint32(24))
        grey = bare[p] + size * np.sqrt(bare[p]) * np.float32(np.int32(four) - 510) + half
        flat[p] = np.uint8(np.int32(min(max(grey, np.float32(0.0)), top)))


@kernel
def draw(lanes, nodes, entry, ways, sizes, left, still, goals, ring, wanted, noise, keys, steps, image, out):
    """Draw the images of `lanes` (m,), each into its own of `out` (n, 1, size, size).

    nodes : (n, k, 3) m
    entry : (n,) which row of ways (entries, 2, 4), sizes (entries, 3) and still (entries, size, size) a lane has
    goals : (n, 2) px, column and row of the targets; NaN for none
    ring : px, radius of the target's ring
    wanted : (n, nodes, 3) m, shapes that are wanted; (0, 0, 3) for none
    keys, steps : (n, 2) of 32 bits and (n,), of the episode and within it, which fix the noise
    image : (size, size) float32, to work on
    """
    for lane in lanes:
        e = entry[lane]
        image[:] = still[e]
        if not math.isnan(goals[lane, 0]):
            ring_on(goals[lane, 0], goals[lane, 1], ring, image)
        if wanted.shape[0] > 0:
            shape_on(wanted[lane], ways[e], still[e], image)
        wire_on(nodes[lane], ways[e], sizes[e], left, still[e], image)
        first = mixed(keys[lane, 0] + steps[lane] * 0x9E3779B9)
        develop(image, noise, first, mixed(keys[lane, 1] ^ first), out[lane, 0])
