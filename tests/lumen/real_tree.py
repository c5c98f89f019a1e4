"""The real tree of the shared data: its curves against its surface.

`python -m tests.lumen.real_tree` prints the figures. The axes are matched first: of the 48 ways to permute and turn
them, with a shift, the one after which the curves lie nearest to the surface's centrelines (the median distance; the
shift follows the nearer 70 % of the points).
"""

import os
import warnings
from itertools import permutations, product
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

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
    """Axes (3, 3), a permutation with signs, and shift (3,) m that bring the curves onto the surface's centrelines."""
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
    return best[:2]


def distances(curves: Lumen, surface: Lumen, turn: np.ndarray, shift: np.ndarray) -> dict[str, np.ndarray]:
    """For each curve, how far its points lie from the surface's centrelines, m."""
    tree = KDTree(centreline(surface, 2e-4)[0])
    found = {}
    for b in curves.branches:
        s = np.linspace(0.0, b.length, max(2, round(b.length / 5e-4)))
        found[b.name] = tree.query(b.curve.position(s) @ turn.T + shift)[0]
    return found


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
    print(f"axes {turn.astype(int).tolist()}, shift {(1e3 * shift).round(2)} mm")
    points, radii = centreline(curves)
    room = surface.wall_distance(points @ turn.T + shift)
    tree, wide = centreline(surface, 2e-4)
    gap, at = KDTree(tree).query(points @ turn.T + shift)
    print(f"curve points outside the surface: {100 * (room < 0).mean():.1f} %; room about them in the surface over the "
          f"curves' own radius: {np.quantile(room / radii, [0.1, 0.5, 0.9]).round(2)} (10 %, 50 %, 90 %)")  # fmt: skip
    off = wide[at] - room
    lost = gap > 2e-3
    print(f"points farther than 2 mm from the surface's axis: {100 * lost.mean():.1f} %; of these "
          f"{100 * (off[lost] > 0.5 * gap[lost]).mean():.0f} % lie off the middle of the surface itself")  # fmt: skip
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
