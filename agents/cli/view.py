"""The subcommands to look with: play, view, video, plot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import tyro

import magwire_env
from agents.evaluation.evaluator import EVALUATION_SEED
from magwire_env.render.extra import need

__all__ = ["COMMANDS", "LOOKS", "Play", "Plot", "Video", "View", "look"]


@dataclass
class Play:
    """Steer by hand in a window: mouse or keyboard, with a score and the paper's policy to beat."""

    task: str = "MagWire/Steer-v0"
    """Environment id."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = 0
    """Of the first episode; the next ones count on."""


@dataclass
class View:
    """Serve a 3-D page for the browser: turn the magnet by hand, or watch a policy do it."""

    policies: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Run or model folders to choose from beside the controllers; those under runs/ are found by themselves."""
    task: str = "MagWire/Steer-v0"
    """Environment id to begin with."""
    scenario: str | None = None
    """A TOML file or a shipped name to begin with."""
    host: str = "127.0.0.1"
    """Address to serve on; by default only this machine can look. 0.0.0.0 lets everybody in the network."""
    port: int = 8080
    """Port to serve on, or the next free one."""
    seed: int = 0
    """Of the first episode; the next ones count on."""


@dataclass
class Video:
    """Write a video of one evaluation episode."""

    policy: tyro.conf.Positional[str]
    """A run or model folder, or a controller's name."""
    task: str | None = None
    """Environment id; by default the model's own task, or MagWire/Steer-v0."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = EVALUATION_SEED
    """Of the episode."""
    speed: float = 1.0
    """Of the video, times real time."""
    out: Path | None = None
    """.mp4 or .gif; by default episode.mp4 in the run's folder, or here."""


@dataclass
class Plot:
    """Plot a run: its learning curve, its way over the force map, arc length over time beside MaxForce."""

    policy: tyro.conf.Positional[str]
    """A run or model folder, or a controller's name."""
    task: str | None = None
    """Environment id; by default the model's own task, or MagWire/Steer-v0."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = EVALUATION_SEED
    """Of the episode."""
    out: Path | None = None
    """Folder to write to; by default the run's, or here."""


LOOKS = (Play, View, Video, Plot)
COMMANDS = tuple(Annotated[kind, tyro.conf.subcommand(kind.__name__.lower())] for kind in LOOKS)


def look(options: Any) -> None:
    """Run one of `COMMANDS`."""
    _RUN[type(options)](options)


def _play(options: Play) -> None:
    need("pygame", "playing")
    from magwire_env.render.play import Game, play

    settings: dict[str, Any] = {} if options.scenario is None else {"scenario": options.scenario}
    env = gym.make(options.task, **settings)
    play(Game(env, options.seed, lambda seed: _time_of_max_force(options.task, seed, settings), "MaxForce"))


def _time_of_max_force(task: str, seed: int, settings: dict[str, Any]) -> float | None:
    """s from the start of the episode seeded so to its goal, None if it does not get there."""
    from agents.cli.pictures import trace
    from agents.controllers import CONTROLLERS

    one = trace(CONTROLLERS["MaxForce"].from_env, "MaxForce", task, seed, **settings)
    return one.seconds if one.success else None


def _view(options: View) -> None:
    need("viser", "the page in the browser")
    from magwire_env.render.browser import Page

    tasks = (options.task, *(t for t in magwire_env.TASK_IDS if t != options.task))
    page = Page(
        tasks, _scenarios(options.scenario), _policies(options.policies), options.host, options.port, options.seed
    )
    print(f"look at {page.url}; Ctrl-C ends it", flush=True)
    try:
        page.run()
    except KeyboardInterrupt:
        page.server.stop()


def _scenarios(first: str | None) -> dict[str, Any]:
    """The scenario asked for, the task's own, and the shipped ones."""
    from magwire_env import Scenario

    found: dict[str, Any] = {} if first is None else {first: Scenario.load(first)}
    found["the task's own"] = None
    folder = Path(magwire_env.__file__).parent / "scenarios"
    return found | {path.stem: Scenario.load(path) for path in sorted(folder.glob("*.toml")) if path.stem != first}


def _policies(folders: tuple[Path, ...]) -> dict[str, Callable[[gym.Env], Any]]:
    """Controllers, and trained models: those of `folders`, and the runs under runs/."""
    from agents.controllers import CONTROLLERS

    found: dict[str, Callable[[gym.Env], Any]] = {name: kind.from_env for name, kind in CONTROLLERS.items()}
    runs = [p.parent.parent for p in sorted(Path("runs").glob("*/best/model.zip"))]
    for folder in dict.fromkeys((*folders, *runs)):
        found[str(folder)] = _lazily(folder)
    return found


def _lazily(folder: Path) -> Callable[[gym.Env], Any]:
    """What loads a model when it is chosen, and says if it was trained on other observations."""

    def load(env: gym.Env) -> Any:
        need("stable_baselines3", "a trained model", "train")
        from agents.learning.sb3 import load

        policy = load(folder)
        wanted, seen = policy.model.observation_space.shape, env.observation_space.shape
        if wanted != seen:
            raise ValueError(f"it was trained on observations of shape {wanted}, this task's have {seen}")
        return policy

    return load


def _video(options: Video) -> None:
    from agents.cli.pictures import chosen, film

    policy, _, task, settings = chosen(options.policy, options.task, options.scenario)
    path = options.out or _folder(options.policy) / "episode.mp4"
    film(policy, path, task, options.seed, options.speed, **settings)
    print(path)


def _plot(options: Plot) -> None:
    need("matplotlib", "plotting", "train")
    from agents.cli.pictures import chosen, plots

    policy, name, task, settings = chosen(options.policy, options.task, options.scenario)
    folder = options.out or _folder(options.policy)
    written = plots(policy, name, folder, task, options.seed, **settings)
    if (Path(options.policy) / "learning_curve.csv").exists():
        from agents.learning.training import Run, learning_curve

        learning_curve(Run.at(Path(options.policy)), folder)
        written.append(folder / "learning_curve.png")
    print("\n".join(map(str, written)))


def _folder(policy: str) -> Path:
    return Path(policy) if Path(policy).is_dir() else Path()


_RUN: dict[type, Callable[[Any], None]] = {Play: _play, View: _view, Video: _video, Plot: _plot}
