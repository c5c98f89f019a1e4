"""How well a tree is found again in a mesh of its wall: `python -m tests.lumen.accuracy` prints a table.

A known lumen is meshed (marching cubes on its exact distance), written as STL, cut open at its inlet, and loaded.
"""

import sys
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from scipy.stats import qmc

from magwire_env.lumen import named_trees
from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.random_trees import grow
from magwire_env.lumen.surface import Surface
from tests.support import lumen_writers as writers


@dataclass
class Accuracy:
    """Errors in shares of the largest ball that fits into the known lumen at the place in question, or of the radius.

    centre : the farthest any point of the found centrelines lies from the known ones, and the other way round, outside
        the tube of the branch's parent
    mouth : the same inside the parent's tube, where a branch has no wall of its own: its line there is a convention
    radius : the largest error of a found radius, and the one that 99 % keep, where its ball touches no other known tube
    ends : the farthest a found end lies from the known one, in radii of that end
    topology : whether the ends are the same, and any two of them share the same way from the inlet, to a radius
    volume : of the found lumen over that of the capped mesh, minus one
    mesh, tubes : of the mesh, and of the balls along the found lines, over that of the known lumen, minus one
    """

    centre: float
    mouth: float
    radius: float
    radius_99: float
    ends: float
    topology: bool
    volume: float
    mesh: float
    tubes: float


def meshed(known: Lumen, fineness: float, path: Path, closed: bool = False) -> Surface:
    """Write the known wall to an STL in mm, `fineness` cells to the narrowest radius; the surface with its caps."""
    vertices, faces = writers.meshed(known, known.narrowest[0] / fineness)
    written = faces if closed else writers.opened(known, vertices, faces)
    path.write_bytes(writers.stl_binary(vertices, written))
    return Surface(1e-3 * vertices, faces)


def loaded(known: Lumen, path: Path) -> Lumen:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        inlet = 1e3 * known.position("inlet")
        return Lumen.load(path, unit="mm", inlet=inlet, cache=False, progress=False)


def compared(known: Lumen, found: Lumen, mesh: Surface, samples: int = 60_000) -> Accuracy:
    points, _, own_wall = _lines(known)
    other, other_radii, apart = _lines(found)
    forth = KDTree(points).query(other)[0] / known.wall_distance(other)
    back = KDTree(other).query(points)[0] / known.wall_distance(points)
    beside = known.tubes.depths(other)
    own = np.array([known.branches[b].radius(s) for b, s in zip(beside.branch[:, 0], beside.arc[:, 0], strict=True)])
    alone = apart & (beside.depth[:, 1] <= -own)
    wrong = np.abs(other_radii / own - 1)[alone]
    places = np.array([known.position(leaf) for leaf in known.leaves])
    gaps, which = KDTree([found.position(leaf) for leaf in found.leaves]).query(places)
    gaps /= [float(known.branch(leaf).radius(known.branch(leaf).length)) for leaf in known.leaves]
    same = len(found.leaves) == len(known.leaves) == len(set(which.tolist())) and gaps.max() < 0.5
    if same:
        mine, its = _shared(known, known.leaves), _shared(found, [found.leaves[k] for k in which])
        same = bool((np.abs(mine - its) < 1.2 * known.widest).all())
    xyz = even(*known.bounds, samples)
    xyz = xyz[(xyz - known.position("inlet")) @ known.tangent("inlet") > 0]
    inside, in_mesh = known.contains(xyz).sum(), mesh.inside(xyz).sum()
    tubes = found.replace(wall=None).contains(xyz).sum()
    centre = max(forth[apart].max(), back[own_wall].max())
    mouth = max(forth[~apart].max(initial=0.0), back[~own_wall].max(initial=0.0))
    return Accuracy(centre, mouth, wrong.max(), float(np.quantile(wrong, 0.99)), gaps.max(), same,
                    found.contains(xyz).sum() / in_mesh - 1, in_mesh / inside - 1, tubes / inside - 1)  # fmt: skip


def even(low: np.ndarray, high: np.ndarray, samples: int) -> np.ndarray:
    """Points spread evenly in a box (Sobol), (samples, 3) m; samples is rounded up to a power of two."""
    return low + (high - low) * qmc.Sobol(3, rng=0).random_base2(int(np.ceil(np.log2(samples))))


def _lines(lumen: Lumen) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of all centrelines, radii there, and whether they lie outside the parent's tube."""
    points, radii, apart = [], [], []
    for i, b in enumerate(lumen.branches):
        s = np.linspace(0, b.length, max(20, int(b.length / (0.05 * b.narrowest[0]))))
        points.append(b.curve.position(s))
        radii.append(b.radius(s))
        if i:
            parent = Lumen((lumen.branches[lumen.parents[i]].__class__("p", lumen.branches[lumen.parents[i]].curve),))
            apart.append(~parent.contains(points[-1]))
        else:
            apart.append(np.ones(len(s), dtype=bool))
    return np.concatenate(points), np.concatenate(radii), np.concatenate(apart)


def _shared(lumen: Lumen, leaves) -> np.ndarray:
    """How far the ways from the inlet to any two ends run together, m."""
    ways = [lumen.route("inlet", leaf) for leaf in leaves]
    shared = np.zeros((len(ways), len(ways)))
    for i, a in enumerate(ways):
        for j, b in enumerate(ways):
            between = lumen.route(leaves[i], leaves[j]).length if i != j else 0.0
            shared[i, j] = (a.length + b.length - between) / 2
    return shared


CASES = {
    "tube": named_trees.straight, "fork": named_trees.fork, "two forks": named_trees.two_forks,
    "arch I": named_trees.aortic_arch, "arch III": lambda: named_trees.aortic_arch("III"),
    "circle of Willis": named_trees.circle_of_willis, "left bronchus": named_trees.left_bronchus,
    **{f"vessels {seed}": lambda seed=seed: grow(seed) for seed in range(1, 5)},
}  # fmt: skip


def main(names: list[str]) -> None:
    print(f"{'tree':18s} {'faces':>7s} {'s':>5s} {'centre':>7s} {'mouth':>6s} {'radius':>7s} {'99 %':>6s} "
          f"{'ends':>5s} {'same tree':>9s} {'volume':>8s} {'mesh':>8s} {'tubes':>8s}")  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for name in names or CASES:
            known = CASES[name]()
            path = Path(folder) / "known.stl"
            mesh = meshed(known, 4.0, path)
            start = time.process_time()
            found = loaded(known, path)
            seconds = time.process_time() - start
            a = compared(known, found, mesh)
            print(f"{name:18s} {len(mesh.faces):7d} {seconds:5.1f} {a.centre:7.3f} {a.mouth:6.3f} {a.radius:7.3f} "
                  f"{a.radius_99:6.3f} {a.ends:5.2f} {a.topology!s:>9s} {a.volume:+8.4f} {a.mesh:+8.4f} "
                  f"{a.tubes:+8.4f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1:])
