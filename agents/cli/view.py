"""The subcommands that show something: play, view, video, plot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import tyro

import magwire_env
from agents.evaluation.episodes import EVALUATION_SEED
from magwire_env.render.extra import need

__all__ = ["RUN", "Play", "Plot", "Video", "View"]


@dataclass
class Play:
    """Steer by hand in a window, by mouse or keyboard, with a score and the paper's policy to beat."""

    task: str = "MagWire/Steer-v0"
    """Environment id."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = 0
    """Seed of the first episode; the next episodes have the next numbers."""
    against: str = "MaxForce"
    """Whose time is to be beaten: a run's or policy's folder, a controller's name, or module:Class."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


@dataclass
class View:
    """Serve a 3-D page for the browser: turn the magnet by hand, or watch a policy do it."""

    policies: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Folders of runs or policies to choose from beside the controllers; no other can be chosen."""
    task: str = "MagWire/Steer-v0"
    """Environment id to begin with."""
    scenario: str | None = None
    """A TOML file or a shipped name to begin with."""
    host: str = "127.0.0.1"
    """Address to serve on; by default only this machine has access. 0.0.0.0 gives everybody in the network access."""
    port: int = 8080
    """Port to serve on, or the next free one."""
    seed: int = 0
    """Seed of the first episode; the next episodes have the next numbers."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


@dataclass
class Video:
    """Write a video of one evaluation episode."""

    policy: tyro.conf.Positional[str]
    """A run's or policy's folder, a controller's name, or module:Class."""
    task: str | None = None
    """Environment id; by default the policy's own task, or MagWire/Steer-v0."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    speed: float = 1.0
    """Speed of the video, times real time."""
    out: Path | None = None
    """.mp4 or .gif; by default episode.mp4 in the run's folder, or here."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


@dataclass
class Plot:
    """Plot a run: its learning curve, its way over the force map, arc length over time beside MaxForce."""

    policy: tyro.conf.Positional[str]
    """A run's or policy's folder, a controller's name, or module:Class."""
    task: str | None = None
    """Environment id; by default the policy's own task, or MagWire/Steer-v0."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    out: Path | None = None
    """Folder to write to; by default the run's, or here."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


def _play(options: Play) -> None:
    need("pygame", "playing")
    from agents.catalogue import resolve
    from agents.cli.pictures import trace
    from magwire_env.render.play import Game, play

    settings: dict[str, Any] = {} if options.scenario is None else {"scenario": options.scenario}
    rival = resolve(options.against, options.task, options.scenario, trust=options.trust)

    def time_to_beat(seed: int) -> float | None:
        """The rival's time to the goal in the episode of this seed, s; None if it does not get there."""
        one = trace(rival.policy, rival.name, options.task, seed, **rival.settings)
        return one.seconds if one.success else None

    play(Game(gym.make(options.task, **settings), options.seed, time_to_beat, rival.name))


def _view(options: View) -> None:
    need("viser", "the page in the browser")
    from magwire_env.render.browser import Page

    tasks = (options.task, *(t for t in magwire_env.TASK_IDS if t != options.task))
    policies = _policies(options.policies, options.trust)
    page = Page(tasks, _scenarios(options.scenario), policies, options.host, options.port, options.seed)
    print(f"look at {page.url}; Ctrl-C ends it", flush=True)
    try:
        page.run()
    except KeyboardInterrupt:
        page.server.stop()


def _scenarios(first: str | None) -> dict[str, Any]:
    """The given scenario, the task's own, and the shipped ones."""
    from magwire_env import Scenario

    found: dict[str, Any] = {} if first is None else {first: Scenario.load(first)}
    found["the task's own"] = None
    folder = Path(magwire_env.__file__).parent / "scenarios"
    return found | {path.stem: Scenario.load(path) for path in sorted(folder.glob("*.toml")) if path.stem != first}


def _policies(folders: tuple[Path, ...], trust: bool) -> dict[str, Callable[[gym.Env], Any]]:
    """Controllers, and the trained policies of `folders`, which are read before the page is there."""
    from agents.catalogue import CONTROLLERS, resolve

    found: dict[str, Callable[[gym.Env], Any]] = {name: kind.from_env for name, kind in CONTROLLERS.items()}
    for folder in folders:
        if not folder.is_dir():
            raise FileNotFoundError(f"policies must be folders of runs or policies, got {str(folder)!r}")
        found[str(folder)] = _fitting(resolve(str(folder), trust=trust).policy)
    return found


def _fitting(policy: Any) -> Callable[[gym.Env], Any]:
    """What gives a trained policy to an env, or says that it was trained on other observations."""

    def give(env: gym.Env) -> Any:
        channels = tuple(env.unwrapped.core.observer.names)  # type: ignore[attr-defined]
        trained = policy.about.channels
        if (policy.size,) != env.observation_space.shape or trained != channels:
            raise ValueError(f"it was trained to see {', '.join(trained)}; this task shows {', '.join(channels)}")
        return policy

    return give


def _video(options: Video) -> None:
    from agents.catalogue import resolve
    from agents.cli.pictures import film

    own = resolve(options.policy, options.task, options.scenario, trust=options.trust)
    path = options.out or _folder(options.policy) / "episode.mp4"
    film(own.policy, path, own.task, options.seed, options.speed, **own.settings)
    print(path)


def _plot(options: Plot) -> None:
    need("matplotlib", "plotting", "train")
    from agents.catalogue import resolve
    from agents.cli.pictures import plots

    own = resolve(options.policy, options.task, options.scenario, trust=options.trust)
    folder = options.out or _folder(options.policy)
    written = plots(own.policy, own.name, folder, own.task, options.seed, **own.settings)
    if (Path(options.policy) / "config.json").exists():
        from agents.learning.training import Run, learning_curve

        learning_curve(Run.at(Path(options.policy), options.trust), folder)
        written.append(folder / "learning_curve.png")
    print("\n".join(map(str, written)))


def _folder(policy: str) -> Path:
    return Path(policy) if Path(policy).is_dir() else Path()


RUN: dict[type, Callable[[Any], None]] = {Play: _play, View: _view, Video: _video, Plot: _plot}
