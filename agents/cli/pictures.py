"""Pictures of what a policy does: a video of an episode, its path over the force map, its arc length over time.

python -m agents.cli.pictures docs/pictures          # this is what `make pictures` runs
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from agents.catalogue import CONTROLLERS, PAR, REFERENCE, compared_with, has_par, resolve
from agents.env_kwargs import world
from agents.evaluation.episodes import EVALUATION_SEED, built, episodes
from magwire_env.envs.fluoroscopy import Fluoroscopy
from magwire_env.plotting import BLACK, BLUE, GREEN, ORANGE, RED, SKY, blank, broken, styled
from magwire_env.render.dofs import dofs_of
from magwire_env.render.extra import need
from magwire_env.render.paint import DRIVE, INK, NORTH, SOUTH, TARGET, load_colour
from magwire_env.render.panels import drive_name, map_limit, map_name, map_of
from magwire_env.render.snapshot import Snapshot, place_name, snapshots
from magwire_env.scenario import Scenario
from magwire_env.simulation.model import supports

__all__ = ["Trace", "film", "fluoroscopy", "leave_in", "plots", "trace"]

_IN_A_TREE = EVALUATION_SEED + 3
"""Seed of the README's episode in a tree of the test split."""

_LAST_FRAME = 1.0
"""Time for which the last frame of a video is shown, s."""


@dataclass(frozen=True)
class Trace:
    """One episode of a policy: a snapshot before the first control step and after every step."""

    name: str
    moments: tuple[Snapshot, ...]
    success: bool
    seconds: float
    error: float | None = None
    """m, RMS error of a tracking task, whose goals are a reference; None elsewhere."""

    @property
    def verdict(self) -> str:
        """How it went, for a legend."""
        if self.error is not None:
            return f"RMS error {1e3 * self.error:.1f} mm"
        return f"goal in {self.seconds:.2f} s" if self.success else "not reached"

    def of(self, field: str) -> np.ndarray:
        """A field of all snapshots, (steps + 1, …)."""
        return np.array([getattr(m, field) for m in self.moments])


def trace(policy: Any, name: str, task: str, seed: int = EVALUATION_SEED, **settings: Any) -> Trace:
    """The episode of `policy` with this seed, as snapshots."""
    env = gym.make(task, **settings)
    core = env.unwrapped.core  # type: ignore[attr-defined]
    observation, _ = env.reset(seed=seed)
    moments, info = [snapshots(core)[0]], {}
    for step in episodes(env, built(policy, env), observation):
        moments.append(snapshots(core)[0])
        info = step.info
    env.close()
    summary = info["summary"]
    error = summary.get("rms_error")
    return Trace(name, tuple(moments), bool(info["is_success"]), float(summary["time"]), error)


def film(policy: Any, path: Path, task: str, seed: int = EVALUATION_SEED, speed: float = 1.0, **settings: Any) -> None:
    """Write one episode as .mp4 or .gif.

    speed : of the film, times real time; a GIF has at most ten frames a second, so it may leave some out
    """
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"out must end in .mp4 or .gif, got {str(path)!r}")
    if speed <= 0:
        raise ValueError(f"speed must be positive, got {speed}")
    need("imageio_ffmpeg" if path.suffix == ".mp4" else "imageio", "a video")
    env = gym.make(task, render_mode="rgb_array", **settings)
    observation, _ = env.reset(seed=seed)
    frames = [np.asarray(env.render())]
    for _ in episodes(env, built(policy, env), observation):
        frames.append(np.asarray(env.render()))
    if speed != 1:
        frames = [_stamped(frame, f"{speed:g}x speed") for frame in frames]
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


def _stamped(frame: np.ndarray, text: str) -> np.ndarray:
    """A frame with a text in its upper right corner, which a film leaves free."""
    image, draw = need("PIL.Image", "a film that says its speed"), need("PIL.ImageDraw", "a film that says its speed")
    picture = image.fromarray(frame)
    pen = draw.Draw(picture)
    size = frame.shape[0] / 40
    pen.text((picture.width - 8, 4), text, fill=INK, font_size=size, anchor="ra")
    return np.asarray(picture)


def _write_gif(path: Path, frames: list[np.ndarray], fps: float) -> None:
    """At most ten frames a second, in one palette without dithering, which keeps it small."""
    image = need("PIL.Image", "a GIF")
    skip = max(1, round(fps / 10))
    kept = [*frames[:-1:skip], frames[-1]]
    # Colours with a meaning cover little of a frame; a swatch of them makes sure that the palette has them.
    ramp = [load_colour(share) for share in np.linspace(0.0, 1.0, 16)]
    swatch = np.array([NORTH, SOUTH, TARGET, DRIVE, *ramp], dtype=np.uint8)[:, None].repeat(frames[0].shape[1], axis=1)
    sample = np.vstack([*kept[:: max(1, len(kept) // 4)], swatch.repeat(12, axis=0)])
    palette = image.fromarray(sample).quantize(255, dither=image.Dither.NONE)
    pictures = [image.fromarray(f).quantize(palette=palette, dither=image.Dither.NONE) for f in kept]
    durations = [round(1000 * skip / fps)] * (len(pictures) - 1) + [round(2000 * _LAST_FRAME)]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=True)


def plots(policy: Any, name: str, folder: Path, task: str, seed: int = EVALUATION_SEED, **settings: Any) -> list[Path]:
    """Draw one episode beside the task's reference and its par, where it has one.

    arclength.png and, for a rig with one degree of freedom, path.png over its force map.
    """
    folder.mkdir(parents=True, exist_ok=True)
    traces = [trace(policy, name, task, seed, **settings)]
    # A trained model may have its own observation and action; a controller takes the task's.
    settings = world(settings)
    for other in _beside(task, traces[0].moments[0].scenario):
        if other != name:
            traces.append(trace(CONTROLLERS[other].from_env, other, task, seed, **settings))
    written = [_arclength_plot(traces, task, folder / "arclength.png")]
    data = map_of(traces[0].moments[0].scenario)
    if data is not None:
        written.append(_path_plot(traces, data, task, folder / "path.png"))
    return written


def _beside(task: str, scenario: Scenario) -> list[str]:
    """The controllers drawn beside a policy: the reference, and the par where the wire model has one."""
    par = supports(scenario, "quasistatic") and has_par(task)
    return [compared_with(task, par=False)[0], *((PAR,) if par else ())]


def leave_in(folder: Path, name: str, task: str, **settings: Any) -> list[Path]:
    """Draw what train.py adds to a run folder: plots and a video of its best model."""
    policy = resolve(str(folder)).policy
    written = plots(policy, name, folder, task, **settings)
    film(policy, folder / "episode.mp4", task, **settings)
    return [*written, folder / "episode.mp4"]


# --- plots ------------------------------------------------------------------------------------------------------------

_STYLES = (("-", BLACK), ("--", SKY), (":", ORANGE))
_TARGET = GREEN


def _arclength_plot(traces: list[Trace], task: str, path: Path) -> Path:
    """Arc length, projected force and wall force over time, for all policies."""
    scenario = traces[0].moments[0].scenario
    with styled():
        figure, (place, force, wall) = blank(3, 1, size=(7, 6.6), sharex=True, height_ratios=(2, 1, 1))
        for one, (line, colour) in zip(traces, _STYLES, strict=False):
            time = one.of("time")
            place.plot(time, 1e3 * one.of("tip_arclength"), line, color=colour, label=f"{one.name}, {one.verdict}")
            force.plot(time, 1e3 * one.of("drive_force"), line, color=colour)
            wall.plot(time, 1e3 * one.of("wall_force"), line, color=colour)
        if traces[0].error is None:
            place.axhline(1e3 * traces[0].moments[0].goal, color=_TARGET, lw=1, label="target")
        else:
            place.plot(traces[0].of("time"), 1e3 * traces[0].of("goal"), color=_TARGET, lw=1, label="reference")
        place.set(ylabel=f"{place_name(scenario)} [mm]", title=f"{task}, one episode from the same start")
        force.axhline(0, color="0.6", lw=0.8)
        force.set(ylabel=f"{drive_name(scenario)}\nforce [mN]")
        wall.axhline(1e3 * scenario.contact.wall_force_limit, color=RED, lw=1, label="limit of the wall force")
        wall.set(ylabel="wall force [mN]", xlabel="time [s]")
        handles = [*place.get_legend_handles_labels()[0], *wall.get_legend_handles_labels()[0]]
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
        figure.savefig(path)
    return path


def _path_plot(traces: list[Trace], data: tuple[Any, ...], task: str, path: Path) -> Path:
    """The force map with the path of every policy on it."""
    from matplotlib.colors import LinearSegmentedColormap

    commands, places, values = data
    scenario = traces[0].moments[0].scenario
    dof = dofs_of(scenario)[0]
    factor, limit = dof.factor, 1e3 * map_limit(values)
    colours = LinearSegmentedColormap.from_list("drive", [BLUE, "#ffffff", RED])
    with styled():
        figure, axes = blank(size=(7, 4.2))
        axes.grid(visible=False)
        mesh = axes.pcolormesh(
            1e3 * places, factor * commands, 1e3 * values, cmap=colours, vmin=-limit, vmax=limit, shading="gouraud"
        )
        axes.contour(1e3 * places, factor * commands, values, levels=[0.0], colors="0.5", linewidths=0.7)
        for one, (line, colour) in zip(traces, _STYLES, strict=False):
            command = dof.wrapped(one.of("magnet")[:, 0])
            command = broken(command, np.pi) if dof.turn else command  # two pieces where the angle wraps around
            axes.plot(1e3 * one.of("tip_arclength"), factor * command, line, color=colour, lw=1.6, label=one.name)
        if traces[0].error is None:
            axes.axvline(1e3 * traces[0].moments[0].goal, color=_TARGET, lw=2, label="target")
        axes.set(
            xlabel="tip arc length [mm]",
            ylabel=map_name(dof),
            title=f"{task}: the path over the force map",
            xlim=(0, 1e3 * places[-1]),
            ylim=(factor * commands[0], factor * commands[-1]),
        )
        if dof.turn:
            axes.set_yticks(np.linspace(factor * commands[0], factor * commands[-1], 5))
        figure.legend(loc="outside lower center", ncols=len(traces) + 1)
        figure.colorbar(mesh, label=f"{drive_name(scenario)} force [mN]")
        figure.savefig(path)
    return path


FLUOROSCOPY = (Fluoroscopy(), Fluoroscopy(lao=60), Fluoroscopy(lao=60, noise=0.04), Fluoroscopy(lao=60, lumen=False))
"""The guide's images: from the front, from the left, with noise, without contrast medium."""


def fluoroscopy(path: Path, enlarged: int = 3) -> None:
    """Write `FLUOROSCOPY` side by side: a wire in the left carotid artery of the arch, its target the right one."""
    image, options = need("PIL.Image", "a picture"), {"target": "RCCA", "start": ("LCCA", 0.08)}
    seen = [
        gym.make("MagWire/Navigate-v0", observe=how).reset(seed=0, options=options)[0]["image"][0]
        for how in FLUOROSCOPY
    ]
    gap = np.full((len(seen[0]), 2), 255, dtype=np.uint8)
    row = np.hstack([part for one in seen for part in (one, gap)][:-1])
    path.parent.mkdir(parents=True, exist_ok=True)
    image.fromarray(row.repeat(enlarged, axis=0).repeat(enlarged, axis=1)).save(path, optimize=True)


def main(folder: Path) -> None:
    """README's pictures, a learned policy in a tree and the paper's own one on its tract, and the guide's images."""
    learned = resolve("trained/NavigateAny-v0", split="test", env_kwargs=("pool_size=8",))
    film(learned.policy, folder / "navigating.gif", learned.task, _IN_A_TREE, 0.5, **learned.settings)
    print(folder / "navigating.gif")
    film(CONTROLLERS[REFERENCE].from_env, folder / "steering.gif", "MagWire/Steer-v0", seed=0, speed=2.0)
    print(folder / "steering.gif")
    fluoroscopy(folder / "fluoroscopy.png")
    print(folder / "fluoroscopy.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
