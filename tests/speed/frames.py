"""Frames a second of `render()` at 640 × 480, and updates a second of the browser page's scene, on one core.

python -m tests.speed.frames
"""

from __future__ import annotations

import time

import gymnasium as gym

import magwire_env

FRAMES = 300


def frame_rate(task: str) -> tuple[float, float]:
    """Frames a second with the env's own step, and the first frame's time in s (everything that stands still)."""
    settings = {} if task in ("MagWire/Steer-v0", "MagWire/Reach-v0", "MagWire/Track-v0") else {"pool_size": 1}
    env = gym.make(task, render_mode="rgb_array", **settings)
    env.reset(seed=0)
    began = time.perf_counter()
    env.render()
    first = time.perf_counter() - began
    spent = 0.0
    for _ in range(FRAMES):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        began = time.perf_counter()
        env.render()
        spent += time.perf_counter() - began
        if terminated or truncated:
            env.reset()
    env.close()
    return FRAMES / spent, first


def page_rate() -> tuple[float, float]:
    """The page's updates a second while a policy runs, and those it could do: nobody looking, the loop alone."""
    import threading

    from agents.controllers import MaxForce
    from magwire_env.render.browser import Page

    page = Page(("MagWire/Steer-v0",), {"its own": None}, {"MaxForce": MaxForce.from_env}, port=8123)
    page.choose_policy("MaxForce")
    page.play(True)
    spent = 0.0
    for _ in range(FRAMES // 2):
        began = time.perf_counter()
        page.update(1 / 30)
        spent += time.perf_counter() - began
    page.reset()
    page.play(True)
    thread = threading.Thread(target=page.run)
    thread.start()
    before, began = page.updates, time.perf_counter()
    time.sleep(5.0)
    rate = (page.updates - before) / (time.perf_counter() - began)
    page.stop()
    thread.join()
    return rate, FRAMES / 2 / spent


if __name__ == "__main__":
    for task in magwire_env.TASK_IDS:
        rate, first = frame_rate(task)
        print(f"{task:22} {rate:6.0f} frames/s   first frame {first:.2f} s")
    rate, possible = page_rate()
    print(f"browser page           {rate:6.1f} updates/s at 30 asked for; {possible:.0f}/s possible")
