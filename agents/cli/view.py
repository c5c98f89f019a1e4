"""The subcommands that show something: play, view, video, plot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import tyro

import magwire_env
from agents.env_kwargs import parsed
from agents.evaluation.episodes import EVALUATION_SEED, built
from magwire_env.envs.task import known_task
from magwire_env.render.extra import need

if TYPE_CHECKING:
    from agents.catalogue import Entrant

__all__ = ["RUN", "Play", "Plot", "Video", "View"]


@dataclass
class Play:
    """Steer by hand in a window, by mouse or keyboard, with a score and the paper's policy to beat."""

    task: str = "MagWire/Steer-v1"
    """Environment id."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = 0
    """Seed of the first episode; the next episodes have the next numbers."""
    against: str = "MaxForce"
    """Whose time is to be beaten: a run's or policy's folder, trained/…, an SB3 .zip, a controller, or module:thing."""
    env_kwargs: tuple[str, ...] = ()
    """key=value for the env: observe, action_mode, reward, safety, coupling, time_limit, split, pool_size, scenario."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


@dataclass
class View:
    """Serve a 3-D page for the browser: turn the magnet by hand, or watch a policy do it."""

    policies: tyro.conf.Positional[tuple[str, ...]] = ()
    """Runs, trained/…, SB3 .zip files or module:thing to choose from beside the controllers; no other can be chosen."""
    task: str = "MagWire/Steer-v1"
    """Environment id to begin with."""
    scenario: str | None = None
    """A TOML file or a shipped name to begin with."""
    host: str = "127.0.0.1"
    """Address to serve on; by default only this machine has access. 0.0.0.0 gives everybody in the network access."""
    port: int = 8080
    """Port to serve on, or the next free one."""
    seed: int = 0
    """Seed of the first episode; the next episodes have the next numbers."""
    env_kwargs: tuple[str, ...] = ()
    """key=value for the env: observe, action_mode, reward, safety, coupling, time_limit, split, pool_size, scenario."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


@dataclass
class Video:
    """Write a video of one evaluation episode."""

    policy: tyro.conf.Positional[str]
    """A run's or policy's folder, trained/…, an SB3 .zip, a controller's name, or module:thing of your own."""
    task: str | None = None
    """Environment id; by default the policy's own task, or MagWire/Steer-v1."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    env_kwargs: tuple[str, ...] = ()
    """key=value for the env: observe, action_mode, reward, safety, coupling, time_limit, split, pool_size, scenario."""
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
    """A run's or policy's folder, trained/…, an SB3 .zip, a controller's name, or module:thing of your own."""
    task: str | None = None
    """Environment id; by default the policy's own task, or MagWire/Steer-v1."""
    scenario: str | None = None
    """A TOML file or a shipped name, in place of the task's scenario."""
    seed: int = EVALUATION_SEED
    """Seed of the episode."""
    env_kwargs: tuple[str, ...] = ()
    """key=value for the env: observe, action_mode, reward, safety, coupling, time_limit, split, pool_size, scenario."""
    out: Path | None = None
    """Folder to write to; by default the run's, or here."""
    trust: bool = False
    """Also open a model.zip or pickle, which runs any program that stands in it."""


def _play(options: Play) -> None:
    need("pygame", "playing")
    from agents.catalogue import resolve
    from agents.cli.pictures import trace
    from magwire_env.render.play import Game, play

    rival = resolve(options.against, options.task, options.scenario, trust=options.trust, env_kwargs=options.env_kwargs)

    def time_to_beat(seed: int) -> float | None:
        """The rival's time to the goal in the episode of this seed, s; None if it does not get there."""
        one = trace(rival.policy, rival.name, rival.task, seed, **rival.settings)
        return one.seconds if one.success else None

    play(Game(gym.make(rival.task, **rival.same_episodes), options.seed, time_to_beat, rival.name))


def _view(options: View) -> None:
    need("viser", "the page in the browser")
    from magwire_env.render.browser import Page

    first, settings = known_task(options.task), parsed(options.env_kwargs)
    scenario = settings.pop("scenario", options.scenario)
    tasks = (first, *(t for t in magwire_env.TASK_IDS if t != first))
    policies = _policies(options.policies, options.trust)
    page = Page(tasks, _scenarios(scenario), policies, options.host, options.port, options.seed, settings)
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


def _policies(names: tuple[str, ...], trust: bool) -> dict[str, Callable[[gym.Env], Any]]:
    """Controllers, and the policies of `names`, which are read before the page is there."""
    from agents.catalogue import CONTROLLERS, resolve

    found: dict[str, Callable[[gym.Env], Any]] = {name: kind.from_env for name, kind in CONTROLLERS.items()}
    return found | {name: partial(built, resolve(name, trust=trust).policy) for name in names}


def _entrant(options: Video | Plot) -> Entrant:
    from agents.catalogue import resolve

    return resolve(options.policy, options.task, options.scenario, None, options.trust, options.env_kwargs)


def _video(options: Video) -> None:
    from agents.cli.pictures import film

    own = _entrant(options)
    path = options.out or _folder(options.policy) / "episode.mp4"
    film(own.policy, path, own.task, options.seed, options.speed, **own.settings)
    print(path)


def _plot(options: Plot) -> None:
    need("matplotlib", "plotting", "train")
    from agents.cli.pictures import plots

    own = _entrant(options)
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
