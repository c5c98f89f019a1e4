"""How fast a large file becomes a lumen: `python -m tests.lumen.speed` prints seconds and peak memory, on one core.

It makes its own files: an aortic arch as a surface of about 100 000 triangles, and as a mask of 256³ voxels. Each is
loaded by a process of its own, without and then with the cache, as is the second time in another process. Seconds are
of the call alone; memory is the process's largest resident size, the interpreter and its libraries in it. The first
call of all compiles what is compiled, if it was not before: `--cold` throws that away.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from magwire_env.lumen import named_trees
from magwire_env.lumen.lumen import Lumen
from tests.support import lumen_writers as writers

TRIANGLES = 100_000
VOXELS = 256

LOAD = """
import os, resource, sys, time, warnings
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
warnings.simplefilter("ignore")
from magwire_env.lumen.lumen import Lumen
inlet = tuple(map(float, sys.argv[2:]))
start = time.perf_counter()
lumen = Lumen.load(sys.argv[1], unit="mm" if sys.argv[1].endswith(".stl") else None, inlet=inlet, progress=False)
seconds = time.perf_counter() - start
print(seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, len(lumen.branches), len(lumen.leaves))
"""


def surface(known: Lumen, path: Path, triangles: int = TRIANGLES) -> int:
    """Write the wall of a known lumen, open at its inlet, to an STL of about so many triangles; their number."""
    pitch, count = known.narrowest[0] / 3, 0
    for _ in range(2):  # the number goes with the square of the fineness
        vertices, faces = writers.meshed(known, pitch)
        count = len(faces)
        pitch *= (count / triangles) ** 0.5
    faces = writers.opened(known, vertices, faces)
    path.write_bytes(writers.stl_binary(vertices, faces))
    return len(faces)


def mask(known: Lumen, path: Path, voxels: int = VOXELS) -> int:
    """Write what lies inside a known lumen to a NIfTI mask of voxels³; the number of voxels inside."""
    low, high = known.bounds
    pitch = float((high - low).max()) / (voxels - 8)
    origin = (low + high) / 2 - pitch * (voxels - 1) / 2
    inside = np.zeros((voxels,) * 3, dtype=np.uint8)
    plane = np.stack(np.meshgrid(np.arange(voxels), np.arange(voxels), indexing="ij"), axis=-1).reshape(-1, 2)
    for i in range(voxels):
        xyz = origin + pitch * np.column_stack([np.full(len(plane), i), plane])
        within = known.contains(xyz) & ((xyz - known.position("inlet")) @ known.tangent("inlet") > 0)
        inside[i] = within.reshape(voxels, voxels)
    affine = np.diag([1e3 * pitch] * 3 + [1.0])
    affine[:3, 3] = 1e3 * origin
    path.write_bytes(writers.nifti(inside, affine, packed=True))
    return int(inside.sum())


def loading(path: Path, inlet: np.ndarray, cache: Path, compiled: Path | None = None) -> list[float]:
    """Seconds, MB at most, branches and ends of one call in a process of its own, on one core."""
    environment = {**os.environ, "MAGWIRE_CACHE": str(cache), "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    if compiled is not None:
        environment["NUMBA_CACHE_DIR"] = str(compiled)
    command = [sys.executable, "-c", LOAD, str(path), *(f"{x:.6f}" for x in inlet)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


def main() -> None:
    """Make the files, load them, print a table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--cold", action="store_true", help="nothing is compiled before the first call")
    cold = options.parse_args().cold
    known = named_trees.aortic_arch("II")
    inlet = 1e3 * known.position("inlet")
    print(f"{'file':12s} {'size':>22s} {'s':>6s} {'MB':>5s} {'again s':>8s} {'MB':>5s}  branches, ends")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, path in (("surface", folder / "arch.stl"), ("mask", folder / "arch.nii.gz")):
            size = surface(known, path) if kind == "surface" else mask(known, path)
            about = f"{size:,} triangles" if kind == "surface" else f"{VOXELS}³, {size:,} inside"
            compiled = folder / f"compiled_{kind}" if cold else None
            if compiled is None:
                loading(path, inlet, folder / "thrown_away")  # compiles
            first = loading(path, inlet, folder / "kept", compiled)
            again = loading(path, inlet, folder / "kept", compiled)
            print(f"{kind:12s} {about:>22s} {first[0]:6.1f} {first[1]:5.0f} {again[0]:8.3f} {again[1]:5.0f}  "
                  f"{first[2]:.0f}, {first[3]:.0f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
