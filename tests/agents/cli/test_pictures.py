"""Videos and plots: what a training leaves behind, and what the commands write."""

from __future__ import annotations

import sys

import pytest

from agents.catalogue import CONTROLLERS
from agents.cli.main import main as magwire
from agents.cli.pictures import _beside, plots, trace
from agents.cli.train import train
from agents.controllers import MaxForce
from agents.learning.config import Config
from magwire_env import Scenario
from magwire_env.envs.task import TASKS

ID = "MagWire/Steer-v0"


def test_a_trace_is_the_episode():
    one = trace(MaxForce.from_env, "MaxForce", ID, seed=0)
    assert one.success
    assert len(one.moments) == round(one.of("time")[-1] / 0.1) + 1
    assert one.of("tip_arclength")[-1] > one.moments[-1].goal > one.of("tip_arclength")[0]
    assert one.of("time")[-1] - 0.1 < one.seconds < one.of("time")[-1]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """The folder of a run that this module changes."""
    folder = tmp_path_factory.mktemp("runs") / "small"
    train(Config(run=folder, timesteps=2048, n_envs=32, evaluations=1, episodes=2, progress=False))
    return folder


def test_training_leaves_pictures(drawn):
    for name in ("path.png", "arclength.png", "learning_curve.png"):
        assert (drawn / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert (drawn / "episode.mp4").read_bytes()[4:8] == b"ftyp"


def test_training_without_the_extra_says_so_in_one_line(drawn, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pygame", None)
    (drawn / "episode.mp4").unlink()
    train(Config(run=drawn, resume=True, episodes=2, progress=False))
    last = capsys.readouterr().out.strip().splitlines()[-1]
    assert last == "no video: rendering needs pygame-ce: pip install 'magwire-env[view]'"
    assert not (drawn / "episode.mp4").exists()


def test_plot_and_video_of_a_run(drawn, tmp_path, capsys):
    out = tmp_path / "plots"
    magwire(["plot", str(drawn), "--out", str(out)])
    assert {p.name for p in out.iterdir()} == {"path.png", "arclength.png", "learning_curve.png"}
    magwire(["video", str(drawn), "--out", str(tmp_path / "a.gif"), "--speed", "4"])
    assert (tmp_path / "a.gif").read_bytes()[:6] == b"GIF89a"
    assert str(tmp_path / "a.gif") in capsys.readouterr().out


def test_a_fed_wire_is_drawn_beside_the_controllers_of_trees(tmp_path):
    written = plots(CONTROLLERS["Forward"].from_env, "Forward", tmp_path, "MagWire/Navigate-v0", time_limit=1.0)
    assert [path.name for path in written] == ["arclength.png"]  # a free wire has no force map, and no par


def test_the_par_is_drawn_where_the_wire_has_one():
    assert _beside("MagWire/Navigate-v0", TASKS["MagWire/Navigate-v0"].scenario()) == ["FollowRoute"]
    assert _beside(ID, Scenario.paper()) == ["MaxForce", "Optimal"]
    assert _beside(ID, Scenario.paper().replace(model="free")) == ["MaxForce"]


def test_what_cannot_be_filmed_is_refused(tmp_path):
    for arguments, words in (
        (["nobody"], "policy must be a run's or policy's folder, trained/…, an SB3 .zip, module:thing or one of"),
        (["MaxForce", "--out", str(tmp_path / "a.avi")], "must end in .mp4 or .gif"),
        (["MaxForce", "--out", str(tmp_path / "a.gif"), "--speed", "0"], "speed must be positive"),
    ):
        with pytest.raises(SystemExit, match=words):
            magwire(["video", *arguments])
