"""The env's and the batch's render modes, in Gymnasium's own ways of using them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import RecordVideo as RecordVideos

from agents.cli.main import main as magwire

ID = "MagWire/Steer-v0"


def test_frames_of_an_env():
    env = gym.make(ID, render_mode="rgb_array")
    with pytest.raises(gym.error.ResetNeeded):
        env.unwrapped.render()
    env.reset(seed=0)
    first = env.render()
    assert first.shape == (480, 640, 3)
    env.step(np.array([0.3], dtype=np.float32))
    assert not np.array_equal(env.render(), first)
    env.close()
    assert env.metadata["render_modes"] == ["rgb_array", "human"]
    assert env.metadata["render_fps"] == 10


def test_rendering_without_a_mode_says_so():
    env = gym.make(ID).unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


def test_a_window_on_no_screen(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make(ID, render_mode="human")
    env.reset(seed=0)
    env.step(np.zeros(1, dtype=np.float32))
    assert env.render() is None
    env.close()
    env.close()


def test_record_video(tmp_path):
    import imageio.v2 as imageio

    env = RecordVideo(gym.make(ID, render_mode="rgb_array", time_limit=0.8), str(tmp_path / "videos"))
    env.reset(seed=0)
    ended = False
    while not ended:
        _, _, terminated, truncated, _ = env.step(np.zeros(1, dtype=np.float32))
        ended = terminated or truncated
    env.close()
    (file,) = tmp_path.glob("videos/*.mp4")
    with imageio.get_reader(file) as video:
        assert video.get_meta_data()["size"] == (640, 480)
        assert video.count_frames() == 9


def test_a_batch_draws_the_lanes_asked_for():
    envs = gym.make_vec(ID, num_envs=40, render_mode="rgb_array", render_lanes=(0, 7))
    envs.reset(seed=5)
    for _ in range(3):
        envs.step(np.zeros((40, 1), dtype=np.float32))
    frames = envs.render()
    assert [f.shape for f in frames] == [(480, 640, 3)] * 2
    (other,) = envs.unwrapped.render(lanes=(7,))
    assert np.array_equal(other, frames[1])
    assert not np.array_equal(frames[0], frames[1])
    single = gym.make(ID, render_mode="rgb_array")
    single.reset(seed=5 + 7)
    for _ in range(3):
        single.step(np.zeros(1, dtype=np.float32))
    alone = single.render()
    # Histories differ (the single env was not drawn on its way either): the whole frame is the same.
    assert np.array_equal(alone, frames[1])


def test_a_batch_refuses_what_it_cannot_draw():
    with pytest.raises(ValueError, match="render_lanes must lie in"):
        gym.make_vec(ID, num_envs=4, render_mode="rgb_array", render_lanes=(4,))
    from magwire_env.envs.vector_env import MagWireVectorEnv

    with pytest.raises(ValueError, match="render_mode must be None or 'rgb_array'"):
        MagWireVectorEnv(4, render_mode="human")


def test_videos_of_a_batch(tmp_path):
    envs = RecordVideos(gym.make_vec(ID, num_envs=2, render_mode="rgb_array"), str(tmp_path / "videos"), video_length=3)
    envs.reset(seed=0)
    for _ in range(4):
        envs.step(np.zeros((2, 1), dtype=np.float32))
    envs.close()
    assert list(tmp_path.glob("videos/*.mp4"))


def test_an_env_without_rendering_imports_none_of_it():
    code = (
        "import sys, gymnasium as gym, magwire_env, numpy as np;"
        f"e = gym.make('{ID}'); e.reset(seed=0); e.step(np.zeros(1, dtype=np.float32));"
        f"v = gym.make_vec('{ID}', num_envs=2); v.reset(seed=0);"
        "print([m for m in sys.modules if m.split('.')[0] in "
        "('pygame', 'viser', 'imageio', 'matplotlib', 'moviepy', 'torch') or m.startswith('magwire_env.render')])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("module", "words"),
    [("pygame", "pygame-ce"), ("viser", "viser"), ("imageio_ffmpeg", "imageio-ffmpeg")],
)
def test_a_missing_package_is_named_in_one_line(monkeypatch, tmp_path, module, words):
    monkeypatch.setitem(sys.modules, module, None)
    arguments = ["view"] if module == "viser" else ["video", "MaxForce", "--out", str(tmp_path / "a.mp4")]
    with pytest.raises(SystemExit) as end:
        magwire(arguments)
    message = str(end.value)
    assert f"needs {words}: pip install 'magwire-env[view]'" in message
    assert "\n" not in message


def test_a_render_mode_without_its_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r"pip install 'magwire-env\[view\]'"):
        gym.make(ID, render_mode="rgb_array")


def test_the_readme_picture_is_there_and_small():
    picture = Path(__file__).parents[2] / "docs" / "pictures" / "steering.gif"
    assert picture.stat().st_size < 1e6
