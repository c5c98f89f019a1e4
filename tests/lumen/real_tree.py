"""The real tree of the shared data: its curves against its surface.

`python -m tests.lumen.real_tree` prints the figures. The axes are matched first: of the 48 ways to permute and turn
them, with a shift, the one after which the curves lie nearest to the surface's centrelines (the median distance; the
shift follows the nearer 70 % of the points). Then the curves are moved as a rigid body onto the surface's centrelines
(iterative closest points, the nearer 80 %).

The curves do not lie in the middle of this surface, which is a coarse one for collisions. So a second figure is
printed: the distance from the surface's centrelines to its own middle beside each curve, which is where the room is
largest across the curve, found by climbing.
"""

import os
import warnings
from itertools import permutations, product
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from magwire_env.lumen import Branch
from magwire_env.lumen.lumen import Lumen


def folder() -> Path | None:
    """Where the real tree lies; None where the data are absent."""
    data = Path(os.environ.get("MAGWIRE_DATA") or Path(__file__).parents[3] / "shared" / "data")
    found = data / "anatomies"
    return found if found.is_dir() else None


def both(at: Path) -> tuple[Lumen, Lumen]:
    """The lumen of the curves, and that of the surface."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Lumen.load(at), Lumen.load(at / "steve_vessel_collision.obj")


def centreline(lumen: Lumen, spacing: float = 5e-4) -> tuple[np.ndarray, np.ndarray]:
    points, radii = [], []
    for b in lumen.branches:
        s = np.linspace(0.0, b.length, max(2, round(b.length / spacing)))
        points.append(b.curve.position(s))
        radii.append(b.radius(s))
    return np.concatenate(points), np.concatenate(radii)


def matched(curves: Lumen, surface: Lumen) -> tuple[np.ndarray, np.ndarray]:
    """Turn (3, 3), about one of the 48 of the axes, and shift (3,) m that bring the curves onto the surface's lines."""
    points = centreline(curves, 3e-3)[0]
    tree = KDTree(centreline(surface, 5e-4)[0])
    low, high = surface.bounds
    best = None
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            turn = np.diag(signs).astype(float)[:, list(order)]
            moved = points @ turn.T
            shift = (low + high) / 2 - (moved.min(axis=0) + moved.max(axis=0)) / 2
            for _ in range(15):
                gap, near = tree.query(moved + shift)
                good = gap <= np.quantile(gap, 0.7)
                shift = shift + (tree.data[near] - moved - shift)[good].mean(axis=0)
            score = float(np.median(tree.query(moved + shift)[0]))
            if best is None or score < best[2]:
                best = turn, shift, score
    return _rigid(points, tree, *best[:2])


def _rigid(points: np.ndarray, tree: KDTree, turn: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The turn and shift after iterative closest points (Besl and McKay 1992), of the nearer 80 %."""
    for _ in range(60):
        moved = points @ turn.T + shift
        gap, near = tree.query(moved)
        good = gap <= np.quantile(gap, 0.8)
        own, other = points[good].mean(axis=0), tree.data[near[good]].mean(axis=0)
        left, _, right = np.linalg.svd((tree.data[near[good]] - other).T @ (points[good] - own))
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        shift = other - turn @ own
    return turn, shift


def middles(surface: Lumen, points: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """Where, across the way (n, 3), the room in the surface is largest: up from points (n, 3) m, which lie inside."""
    some = np.eye(3)[np.abs(tangents).argmin(axis=1)]
    one = np.cross(tangents, some)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = np.cross(tangents, one)
    angle = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)[:, None, None]
    ways, row = np.cos(angle) * one + np.sin(angle) * other, np.arange(len(points))
    points, best = points.copy(), surface.wall_distance(points)
    step = np.full(len(points), 1e-3)
    while step.max() > 1e-5:
        tries = points + step[None, :, None] * ways
        room = surface.wall_distance(tries)
        way = room.argmax(axis=0)
        better = room[way, row] > best + 1e-7
        points, best = np.where(better[:, None], tries[way, row], points), np.where(better, room[way, row], best)
        step = np.where(better, step, step / 2)
    return points


def distances(curves: Lumen, surface: Lumen, turn: np.ndarray, shift: np.ndarray) -> dict[str, np.ndarray]:
    """For each curve, how far its points lie from the surface's centrelines, m."""
    tree = KDTree(centreline(surface, 2e-4)[0])
    found = {}
    for b in curves.branches:
        s = np.linspace(0.0, b.length, max(2, round(b.length / 5e-4)))
        found[b.name] = tree.query(b.curve.position(s) @ turn.T + shift)[0]
    return found


def course(b: Branch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, radii and directions along a branch, every half millimetre."""
    s = np.linspace(0.0, b.length, max(2, round(b.length / 5e-4)))
    return b.curve.position(s), b.radius(s), b.curve.tangent(s)


def main() -> None:
    at = folder()
    if at is None:
        raise SystemExit("the data are absent: set MAGWIRE_DATA")
    curves, surface = both(at)
    print(
        f"curves: {len(curves.branches)} branches, {len(curves.leaves)} ends; "
        f"surface: {len(surface.branches)} branches, {len(surface.leaves)} ends, {len(surface.wall.faces)} faces"
    )
    turn, shift = matched(curves, surface)
    axes = turn.round()
    angle = np.degrees(np.arccos(np.clip((np.trace(turn @ axes.T) - 1) / 2, -1, 1)))
    print(f"axes {axes.astype(int).tolist()}, turned by {angle:.2f}°, shift {(1e3 * shift).round(2)} mm")
    points, radii, tangents = (np.concatenate(x) for x in zip(*map(course, curves.branches), strict=True))
    points = points @ turn.T + shift
    room = surface.wall_distance(points)
    tree = KDTree(centreline(surface, 2e-4)[0])
    inside = room > 0
    middle = middles(surface, points[inside], tangents[inside] @ turn.T)
    off, gap = np.linalg.norm(middle - points[inside], axis=1), tree.query(middle)[0]
    print(f"curve points outside the surface: {100 * (room < 0).mean():.1f} %; room about them in the surface over the "
          f"curves' own radius: {np.quantile(room / radii, [0.1, 0.5, 0.9]).round(2)} (10 %, 50 %, 90 %)")  # fmt: skip
    print(f"curve points inside, farther than 2 mm from the surface's own middle: {100 * (off > 2e-3).mean():.1f} %")
    print(f"that middle from the surface's centrelines: median {1e3 * np.median(gap):.2f} mm, within 2 mm "
          f"{100 * (gap < 2e-3).mean():.1f} %")  # fmt: skip
    found = distances(curves, surface, turn, shift)
    for b in curves.branches:
        d = 1e3 * found[b.name]
        where = b.curve.position(np.linspace(0, b.length, len(d)))[d.argmax()] @ turn.T + shift
        radius = 1e3 * np.median(b.radius(np.linspace(0, b.length, 50)))
        print(
            f"{b.name:6s} {1e3 * b.length:6.1f} mm long, radius {radius:5.2f} mm: "
            f"median {np.median(d):5.2f}, 95 % {np.quantile(d, 0.95):5.2f}, most {d.max():5.2f} mm "
            f"at {(1e3 * where).round(1)}"
        )
    whole = 1e3 * np.concatenate(list(found.values()))
    print(
        f"all: median {np.median(whole):.2f} mm, 95 % {np.quantile(whole, 0.95):.2f}, within 2 mm "
        f"{100 * (whole < 2).mean():.1f} %"
    )


if __name__ == "__main__":
    main()
