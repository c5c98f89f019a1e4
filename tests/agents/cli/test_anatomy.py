"""The command that reads an anatomy: its report, its picture, the file that stands alone, and the scene with a wire."""

import gymnasium as gym
import numpy as np
import pytest

from agents.cli.anatomy import _TASK, report, scene_of, task_of
from agents.cli.main import main as magwire
from magwire_env.envs.task import TASKS
from magwire_env.lumen.lumen import Lumen
from magwire_env.lumen.named_trees import fork, two_forks
from tests.support import lumen_writers as writers


def test_an_anatomy_is_reported_drawn_and_saved(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path / "cache"))
    (tmp_path / "fork.mrk.json").write_bytes(writers.markups(writers.fork_lines()))
    magwire(
        [
            "anatomy",
            str(tmp_path / "fork.mrk.json"),
            "--out",
            str(tmp_path),
            "--wire",
            "0.0065",
            "--inlet",
            "0",
            "0",
            "0",
        ]
    )
    said = capsys.readouterr().out
    assert "fork: 3 branches, 2 ends" in said
    assert "axes LPS" in said
    assert "note: a wire of 6.5 mm does not pass in 'left'" in said
    assert (tmp_path / "fork.png").read_bytes()[:4] == b"\x89PNG"
    kept = Lumen.load(tmp_path / "fork.lumen")
    assert kept.leaves == ("left", "right")
    assert kept == Lumen.load(tmp_path / "fork.lumen")


def test_bad_files_end_in_one_line(tmp_path):
    (tmp_path / "a.stl").write_bytes(b"solid nothing")
    with pytest.raises(SystemExit, match=r"magwire: .*a\.stl"):
        magwire(["anatomy", str(tmp_path / "a.stl"), "--out", str(tmp_path)])
    with pytest.raises(SystemExit, match="magwire: no such file or folder"):
        magwire(["anatomy", str(tmp_path / "b.stl")])
    assert not list(tmp_path.glob("*.lumen"))


def test_the_report_names_what_is_too_narrow():
    lumen = two_forks()
    assert "does not pass" not in report(lumen, 1e-3)
    assert "does not pass in 'upper'" in report(lumen, 6e-3)
    assert [place.branch for place, _ in lumen.too_narrow_for(2.6e-3)] == ["upper", "lower"]
    with pytest.raises(ValueError, match="radius must be greater than 0"):
        lumen.too_narrow_for(0.0)


def test_the_scene_holds_a_wire_that_fits():
    scene = scene_of(fork(radius=0.5e-3, length=0.03))
    assert scene.model == "free"
    assert 2 * scene.wire.radius < 0.8e-3
    assert np.isfinite(scene.rig.feed.home)


@pytest.fixture
def _task_forgotten():
    yield
    TASKS.pop(task_of())
    gym.registry.pop(_TASK)


@pytest.mark.usefixtures("_task_forgotten")
def test_what_the_page_plays_starts_with_the_rig_at_home_over_the_inlet():
    lumen = fork()
    env = gym.make(task_of(), scenario=scene_of(lumen))  # a warning would end the test
    assert task_of() == task_of()
    for seed in range(3):
        env.reset(seed=seed)
        core = env.unwrapped.core
        assert np.array_equal(core.sim.magnet[0, :-1], np.zeros(core.sim.magnet.shape[1] - 1))
        assert np.allclose(core.sim.magnet_positions[0, 0, :2], lumen.position("inlet")[:2])
    assert np.allclose(core.sim.goals().s, lumen.trunk.length - 0.01)
