"""Pictures of what a policy does: a video of an episode, its path over the force map, its arc length over time.

python -m agents.cli.pictures docs/pictures          # what `make pictures` runs
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import CONTROLLERS
from agents.evaluation.evaluator import EVALUATION_SEED
from magwire_env.render.dofs import dofs_of
from magwire_env.render.extra import need
from magwire_env.render.paint import DRIVE, NORTH, SOUTH, TARGET, load_colour
from magwire_env.render.panels import drive_name, map_limit, map_name, map_of
from magwire_env.render.snapshot import Snapshot, snapshots

__all__ = ["Trace", "chosen", "film", "leave_in", "plots", "trace"]

BESIDE = ("MaxForce", "Optimal")
"""Controllers drawn beside a policy, those of them there are: the paper's own, and the par."""

_LAST_FRAME = 1.0
"""s for which a video's last frame stands."""


@dataclass(frozen=True)
class Trace:
    """One episode of a policy, a snapshot before the first control step and after every one."""

    name: str
    moments: tuple[Snapshot, ...]
    success: bool
    seconds: float

    def of(self, field: str) -> np.ndarray:
        """A field of the snapshots, (steps + 1, …)."""
        return np.array([getattr(m, field) for m in self.moments])


def chosen(policy: str, task: str | None, scenario: str | None) -> tuple[Any, str, str, dict[str, Any]]:
    """A run or model folder, or a controller's name → policy (or what makes one), its name, task, env settings.

    Raises `ValueError` if it is neither.
    """
    settings: dict[str, Any] = {} if scenario is None else {"scenario": scenario}
    if policy in CONTROLLERS:
        return CONTROLLERS[policy].from_env, policy, task or "MagWire/Steer-v0", settings
    if not Path(policy).is_dir():
        raise ValueError(f"policy must be a run folder or one of {', '.join(CONTROLLERS)}; got {policy!r}")
    need("stable_baselines3", "a trained model", "train")
    from agents.learning.sb3 import load

    model = load(policy)
    return model, Path(policy).name, task or model.meta["task"], model.meta.get("env", {}) | settings


def _episode(env: gym.Env, policy: Any, seed: int) -> Iterator[tuple[bool, dict[str, Any]]]:
    """Run one episode; yields once after the reset and once after every step: success so far, and the info."""
    observation, info = env.reset(seed=seed)
    if not hasattr(policy, "predict"):
        policy = policy(env)
    state, start, ended = None, np.ones(1, dtype=np.bool_), False
    yield False, info
    while not ended:
        action, state = policy.predict(observation, state=state, episode_start=start, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        start, ended = np.zeros(1, dtype=np.bool_), terminated or truncated
        yield bool(info["is_success"]), info


def trace(policy: Any, name: str, task: str, seed: int = EVALUATION_SEED, **settings: Any) -> Trace:
    """One episode of `policy`, seeded, as snapshots."""
    env = gym.make(task, **settings)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    steps = [(snapshots(core)[0], success, info) for success, info in _episode(env, policy, seed)]
    env.close()
    moments, successes, infos = zip(*steps, strict=True)
    return Trace(name, moments, successes[-1], float(infos[-1]["summary"]["time"]))


def film(policy: Any, path: Path, task: str, seed: int = EVALUATION_SEED, speed: float = 1.0, **settings: Any) -> None:
    """Write one episode as .mp4 or .gif.

    speed : of the film; a GIF shows at most ten frames a second, so it leaves some out
    """
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"out must end in .mp4 or .gif, got {str(path)!r}")
    if speed <= 0:
        raise ValueError(f"speed must be positive, got {speed}")
    need("imageio_ffmpeg" if path.suffix == ".mp4" else "imageio", "a video")
    env = gym.make(task, render_mode="rgb_array", **settings)
    frames = [np.asarray(env.render()) for _ in _episode(env, policy, seed)]
    fps = speed * env.metadata["render_fps"]
    env.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        _write_gif(path, frames, fps)
        return
    frames += frames[-1:] * round(_LAST_FRAME * fps)
    imageio = need("imageio.v2", "a video")
    with imageio.get_writer(path, fps=fps, codec="libx264", quality=8) as writer:
        for frame in frames:
            writer.append_data(frame)


def _write_gif(path: Path, frames: list[np.ndarray], fps: float) -> None:
    """At most ten frames a second, in one palette without dithering, which keeps it small."""
    image = need("PIL.Image", "a GIF")
    skip = max(1, round(fps / 10))
    kept = [*frames[:-1:skip], frames[-1]]
    # The colours that carry meaning cover little of a frame: a swatch of them keeps them in the palette.
    ramp = [load_colour(share) for share in np.linspace(0.0, 1.0, 16)]
    swatch = np.array([NORTH, SOUTH, TARGET, DRIVE, *ramp], dtype=np.uint8)[:, None].repeat(frames[0].shape[1], axis=1)
    sample = np.vstack([*kept[:: max(1, len(kept) // 4)], swatch.repeat(12, axis=0)])
    palette = image.fromarray(sample).quantize(255, dither=image.Dither.NONE)
    pictures = [image.fromarray(f).quantize(palette=palette, dither=image.Dither.NONE) for f in kept]
    durations = [round(1000 * skip / fps)] * (len(pictures) - 1) + [round(2000 * _LAST_FRAME)]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=True)


def plots(policy: Any, name: str, folder: Path, task: str, seed: int = EVALUATION_SEED, **settings: Any) -> list[Path]:
    """path.png (the way over the force map; not for rigs of several freedoms) and arclength.png, one episode."""
    folder.mkdir(parents=True, exist_ok=True)
    traces = [trace(policy, name, task, seed, **settings)]
    # What a trained model sees and how it acts is its own: a controller takes the task's observation and action.
    settings = {k: v for k, v in settings.items() if k not in ("observe", "action_mode")}
    for other in BESIDE:
        if other in CONTROLLERS and other != name:
            traces.append(trace(CONTROLLERS[other].from_env, other, task, seed, **settings))
    written = [_arclength_plot(traces, task, folder / "arclength.png")]
    data = map_of(traces[0].moments[0].scenario)
    if data is not None:
        written.append(_path_plot(traces, data, task, folder / "path.png"))
    return written


def leave_in(folder: Path, name: str, task: str, **settings: Any) -> list[Path]:
    """What train.py leaves in a run folder: plots and a video of its best model."""
    policy = chosen(str(folder), task, None)[0]
    written = plots(policy, name, folder, task, **settings)
    film(policy, folder / "episode.mp4", task, **settings)
    return [*written, folder / "episode.mp4"]


# --- plots ------------------------------------------------------------------------------------------------------------

_STYLES = (("-", "black"), ("--", "#56B4E9"), (":", "#009E73"))


def _pyplot() -> Any:
    need("matplotlib", "plotting", "train").use("Agg")
    return need("matplotlib.pyplot", "plotting", "train")


def _hex(colour: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _arclength_plot(traces: list[Trace], task: str, path: Path) -> Path:
    """Arc length, projected force and wall force over time, the policies beside one another."""
    plt = _pyplot()
    figure, (way, force, wall) = plt.subplots(
        3, 1, sharex=True, figsize=(7, 6.6), layout="constrained", height_ratios=(2, 1, 1)
    )
    scenario = traces[0].moments[0].scenario
    for one, (line, colour) in zip(traces, _STYLES, strict=False):
        time = one.of("time")
        label = f"{one.name}, goal in {one.seconds:.2f} s" if one.success else f"{one.name}, not reached"
        way.plot(time, 1e3 * one.of("tip_arclength"), line, color=colour, label=label)
        force.plot(time, 1e3 * one.of("drive_force"), line, color=colour)
        wall.plot(time, 1e3 * one.of("wall_force"), line, color=colour)
    way.axhline(1e3 * traces[0].moments[0].goal, color=_hex(TARGET), lw=1, label="target")
    way.set(ylabel="tip arc length [mm]", title=f"{task}, one episode from the same start")
    force.axhline(0, color="0.6", lw=0.8)
    force.set(ylabel=f"{drive_name(scenario)}\nforce [mN]")
    wall.axhline(1e3 * scenario.contact.wall_force_limit, color=_hex(NORTH), lw=1, label="limit of the wall force")
    wall.set(ylabel="wall force [mN]", xlabel="time [s]")
    handles = [*way.get_legend_handles_labels()[0], *wall.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    for axes in (way, force, wall):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
    plt.close(figure)
    return path


def _path_plot(traces: list[Trace], data: tuple, task: str, path: Path) -> Path:
    """The force map with every policy's way on it."""
    plt = _pyplot()
    from matplotlib.colors import LinearSegmentedColormap

    commands, places, values = data
    dof = dofs_of(traces[0].moments[0].scenario)[0]
    factor = dof.factor
    limit = 1e3 * map_limit(values)
    colours = LinearSegmentedColormap.from_list("drive", [_hex(SOUTH), "#ffffff", _hex(NORTH)])
    figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
    mesh = axes.pcolormesh(
        1e3 * places, factor * commands, 1e3 * values, cmap=colours, vmin=-limit, vmax=limit, shading="gouraud"
    )
    axes.contour(1e3 * places, factor * commands, values, levels=[0.0], colors="0.5", linewidths=0.7)
    for one, (line, colour) in zip(traces, _STYLES, strict=False):
        command = dof.wrapped(one.of("magnet")[:, 0])
        if dof.turn:
            # A way across the seam is drawn in two pieces.
            command[1:][np.abs(np.diff(command)) > np.pi] = np.nan
        axes.plot(1e3 * one.of("tip_arclength"), factor * command, line, color=colour, lw=1.6, label=one.name)
    axes.axvline(1e3 * traces[0].moments[0].goal, color=_hex(TARGET), lw=2, label="target")
    axes.set(
        xlabel="tip arc length [mm]",
        ylabel=map_name(dof),
        title=f"{task}: the way over the force map",
        xlim=(0, 1e3 * places[-1]),
        ylim=(factor * commands[0], factor * commands[-1]),
    )
    if dof.turn:
        axes.set_yticks(np.linspace(factor * commands[0], factor * commands[-1], 5))
    figure.legend(loc="outside lower center", ncols=len(traces) + 1)
    figure.colorbar(mesh, label=f"{drive_name(traces[0].moments[0].scenario)} force [mN]")
    figure.savefig(path, dpi=120)
    plt.close(figure)
    return path


def main(folder: Path) -> None:
    """The README's picture: the paper's own policy on the paper's scenario."""
    film(CONTROLLERS["MaxForce"].from_env, folder / "steering.gif", "MagWire/Steer-v0", seed=0, speed=2.0)
    print(folder / "steering.gif")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
