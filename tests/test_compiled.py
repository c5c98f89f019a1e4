"""The compiled cache: an edit anywhere below a kernel compiles it anew; damage and read-only folders are survived."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile

import magwire_env
from magwire_env.compiled import _say_once, kernel, precise, source_stamp

PACKAGE = Path(magwire_env.__file__).parent

PROGRAM = """
import json, warnings
import gymnasium as gym, numpy as np
import magwire_env
env = gym.make("MagWire/Steer-v0")
env.reset(seed=0, options={"magnet_angle": 3.6, "tip_arclength": 0.3})
for _ in range(3):
    observation, reward, *_, info = env.step(np.array([0.3], dtype=np.float32))
print(json.dumps([*observation.tolist(), reward, info["wall_force"], info["cost"], info["reward/wall"]]))
"""


def run(tree: Path, program: str = PROGRAM, **environment: str) -> subprocess.CompletedProcess[str]:
    """`program` with the package at `tree`, and its compiled code in the package's own folders."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    return subprocess.run(
        [sys.executable, "-c", program], cwd=tree, env={**clean, "PYTHONPATH": str(tree), **environment}, text=True,
        capture_output=True, check=False,
    )  # fmt: skip


def numbers(done: subprocess.CompletedProcess[str]) -> list[float]:
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def edit(file: Path, before: str, after: str) -> None:
    """Change a file without any change of its time, as a checkout or an unpacked archive may."""
    text, times = file.read_text(encoding="utf-8"), file.stat()
    assert before in text
    file.write_text(text.replace(before, after), encoding="utf-8")
    os.utime(file, (times.st_atime, times.st_mtime))


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package, without compiled code."""
    folder = tmp_path_factory.mktemp("tree")
    shutil.copytree(PACKAGE, folder / "magwire_env", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def test_an_edit_in_another_file_is_compiled(tree: Path) -> None:
    simulation = tree / "magwire_env" / "simulation"
    first = numbers(run(tree))
    assert list(tree.rglob("*.nbc"))  # the cache is warm
    # The order of the readout's rows: the reward's kernel reads them, in another folder.
    rows = ["    peak_lateral: int\n", "    peak_wall: int\n"]
    edit(simulation / "readout.py", "".join(rows), "".join(reversed(rows)))
    edit(simulation / "readout.py", "OF_STATE = ROW.peak_lateral", "OF_STATE = ROW.peak_wall")
    assert numbers(run(tree)) == pytest.approx(first, rel=1e-9, abs=1e-12)
    edit(simulation / "lanes.py", "LANES = 16", "LANES = 8")
    assert numbers(run(tree)) == pytest.approx(first, rel=1e-9, abs=1e-12)
    edit(simulation / "vectors.py", "return c * a[0] + s * a[2], a[1], c * a[2] - s * a[0]", "return a[0], a[1], a[2]")
    assert numbers(run(tree)) != pytest.approx(first, rel=1e-3)  # the magnet turns no more


LUMEN = """
import numpy as np
from magwire_env.lumen import LUMENS
print(LUMENS["fork"]().wall_distance([[-5e-3, 1e-3, 0.0]]).tolist())
"""


def test_an_edit_of_a_lumens_kernel_is_compiled_even_if_file_and_time_look_the_same(tree: Path) -> None:
    def distance() -> float:
        return numbers(run(tree, LUMEN))[0]

    assert distance() == pytest.approx(3e-3)  # 4 mm wide, before the inlet
    kernels = tree / "magwire_env" / "lumen"
    assert list(kernels.rglob("tube_kernels.deepest*.nbc"))
    edit(kernels / "tube_kernels.py", "return radius[row, 0] - across, along", "return radius[row, 0] + across, along")
    assert distance() == pytest.approx(5e-3)


KERNEL = """
from magwire_env.compiled import kernel


@kernel
def more(x):
    return x + 1.0
"""

KILLED = """
import os
from numba.core.caching import IndexDataCacheFile
IndexDataCacheFile._save_data = lambda *_: os._exit(3)
"""


def test_a_process_that_is_killed_while_it_saves_leaves_no_old_code(tmp_path: Path) -> None:
    """Numba's index is written first: under the new stamp it must not find the machine code of the old one."""
    program = "from mine import more; print([more(1.0)])"
    (tmp_path / "mine.py").write_text(KERNEL)
    told = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{PACKAGE.parent}"}
    assert numbers(run(tmp_path, program, **told)) == [2.0]
    edit(tmp_path / "mine.py", "x + 1.0", "x + 2.0")
    assert run(tmp_path, KILLED + program, **told).returncode == 3
    assert numbers(run(tmp_path, program, **told)) == [3.0]
    assert len(list(tmp_path.rglob("*.nbc"))) == 1  # the old one is swept


def test_damaged_and_unwritable_caches_cost_a_compilation_and_no_error(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    script = tmp_path / "one.py"
    script.write_text(
        "from magwire_env.compiled import kernel\n\n\n@kernel\ndef twice(x):\n    return 2.0 * x\n\n\n"
        "if __name__ == '__main__':\n    print(twice(21.0))\n",
        encoding="utf-8",
    )

    def answer(**environment: str) -> subprocess.CompletedProcess[str]:
        settings = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(PACKAGE.parent), **environment}
        return subprocess.run([sys.executable, str(script)], env=settings, text=True, capture_output=True, check=False)

    assert answer().stdout == "42.0\n"
    for kind in ("*.nbc", "*.nbi"):
        files = list(cache.rglob(kind))
        assert files
        for file in files:
            file.write_bytes(file.read_bytes()[:40])
        done = answer()
        assert (done.returncode, done.stdout) == (0, "42.0\n"), done.stderr
        assert all(file.stat().st_size > 40 for file in files)  # and is mended


def test_without_a_folder_that_can_be_written_a_kernel_works_uncached(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])  # neither the package's nor the user's
    assert kernel(lambda x: 2.0 * x)(21.0) == 42.0


def test_a_full_disk_is_said_once_and_the_kernel_works(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(IndexDataCacheFile, "save", full)
    _say_once.cache_clear()
    with pytest.warns(UserWarning, match=r"cannot be cached .OSError.*No space left.*Set NUMBA_CACHE_DIR"):
        assert kernel(lambda x: 3.0 * x)(14.0) == 42.0
    assert kernel(lambda x: 6.0 * x)(7.0) == 42.0  # a second warning would be an error


def test_the_stamp_covers_the_floors_below_and_the_kernels_own_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("x = 1\n", encoding="utf-8")
    before = source_stamp(tmp_path)
    source_stamp.cache_clear()
    (tmp_path / "mine.py").write_text("x = 2\n", encoding="utf-8")
    assert source_stamp(tmp_path) != before
    floors = ("physics", "lumen", "simulation", "envs")
    assert len({source_stamp(PACKAGE / floor) for floor in floors}) == len(floors)
    source_stamp.cache_clear()


@precise
def _compensated(a: float, b: float) -> float:
    return (a + b) - a - b


@kernel
def _calls_it_first(a: float, b: float) -> float:
    return _compensated(a, b)


def test_a_precise_function_stays_so_when_a_fast_one_needs_it_first():
    """It once took the flags of its first caller, and was kept on disk so: a lumen's distances lost their accuracy."""
    assert _calls_it_first(1.0, 1e-17) == -1e-17
    (signature,) = _compensated.signatures
    assert "reassoc" not in _compensated.inspect_llvm(signature)
