"""What a run is made of: its folder, its settings, the scenario it was begun in."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from magwire_env.envs.pools import scenario_pool
from magwire_env.envs.task import TASKS, known_task
from magwire_env.scenario import Scenario

from ..env_kwargs import parsed, world
from ..notes import note
from .config import ALGORITHMS, Config
from .hyperparameters import LESSON, hyperparameters
from .run_folder import made_whole, write_whole
from .scenario_copy import digest, settings_with, text_for
from .stored import Stored, read_json

__all__ = ["VALIDATION_EPISODES", "Run"]

VALIDATION_EPISODES, VALIDATION_POOL = 100, 1
"""Episodes that choose the best model, and the seed of the pool that a generated task's tracts then come from."""

FORMAT = 1
"""Of a run's folder."""

_PACKAGES = ("magwire-env", "gymnasium", "stable-baselines3", "torch", "numba", "numpy", "scipy")


@dataclass(frozen=True)
class Run:
    """A run folder and what stands in its config.json.

    scenario : TOML text of the scenario it was begun in, from its folder; None where the task draws one an episode
    trust : open files of earlier versions too, which can carry programs
    """

    folder: Path
    config: dict[str, Any]
    settings: dict[str, Any]
    scenario: str | None
    resume: bool = False
    trust: bool = False

    @classmethod
    def open(cls, config: Config, changes: dict[str, Any] | None = None) -> Run:
        """Make the folder of a new run, or find that of one to resume.

        changes : to the YAML's hyperparameters; a dotted name reaches into a block

        Raises `FileExistsError` for a run folder that exists without `resume`, `FileNotFoundError` for one to resume
        that does not; an existing folder is never written into otherwise.
        """
        if config.resume:
            if config.run is None or not (Path(config.run) / "config.json").exists():
                raise FileNotFoundError(f"--resume needs --run with a run's folder, got {config.run}")
            return cls.at(Path(config.run), config.trust)
        own = parsed(config.env_kwargs)
        scenario_asked = own.pop("scenario", config.scenario)
        if config.scenario is not None and scenario_asked != config.scenario:
            raise ValueError(
                f"scenario must be given once, got {config.scenario!r} and env-kwargs scenario={scenario_asked!r}"
            )
        config = replace(config, task=known_task(config.task), scenario=scenario_asked)
        asked = {k: (str(v) if isinstance(v, Path) else v) for k, v in asdict(config).items()}
        settings = _changed(hyperparameters(config.algorithm, config.task), changes or {})
        settings["env"] = settings.get("env", {}) | own
        settings["n_timesteps"] = config.timesteps or settings["n_timesteps"]
        settings["n_envs"] = config.n_envs or settings["n_envs"]
        for name in ("timesteps", "n_envs", "episodes"):
            if getattr(config, name) is not None and getattr(config, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(config, name)}")
        folder = Path(config.run) if config.run is not None else _free_folder(config)
        if folder.exists():
            raise FileExistsError(f"run folder {folder} exists: choose another --run, or --resume to go on with it")
        from .sb3 import make_vec_env

        scenario = text_for(config.task, config.scenario)
        smallest = {"pool_size": 1} if "pool_size" in settings["env"] else {}
        env = settings["env"] | smallest | _given(scenario, config.scenario is not None)
        make_vec_env(config.task, 1, **env)  # what does not exist fails here
        run = cls(folder, asked, settings, scenario)
        made_whole(folder, run._begin)
        return run

    def _begin(self, folder: Path) -> None:
        """The first files of a run."""
        stored = {"format": FORMAT, "config": self.config, "hyperparameters": self.settings}
        stored["scenario_sha256"] = None if self.scenario is None else digest(self.scenario)
        (folder / "config.json").write_text(json.dumps(stored, indent=2), encoding="utf-8")
        (folder / "versions.json").write_text(json.dumps(_versions(), indent=2), encoding="utf-8")
        if self.scenario is not None:
            (folder / "scenario.toml").write_text(self.scenario, encoding="utf-8")

    @classmethod
    def at(cls, folder: Path, trust: bool = False) -> Run:
        """The run that stands in `folder`.

        Raises `ValueError`, naming the file, for one that is damaged or asks for what no run may.
        """
        stored = read_json(folder / "config.json")
        config, settings = stored.part("config"), stored.part("hyperparameters")
        config.task(), config.one_of("algorithm", ALGORITHMS), config.get("seed", int)
        for name in ("threads", "evaluations", "episodes"):
            config.whole(name, 1)
        asked = config.get("scenario", str, type(None))
        settings.whole("n_envs", 1), settings.whole("n_timesteps", 0 if "imitate" in settings.tree else 1)
        for block in ("env", "training_env"):
            if block in settings.tree:
                settings.env(block)
        if "imitate" in settings.tree:
            _check_lesson(settings.part("imitate"))
        if "format" in stored.tree:
            scenario = _kept_scenario(folder, stored.get("scenario_sha256", str, type(None)))
        elif asked is not None and not trust:
            raise ValueError(
                f"{stored.where} is of an earlier version and names the file {asked!r} for its scenario, which may be "
                "any file of this machine and was not opened; --trust opens it"
            )
        else:
            scenario = text_for(config.tree["task"], asked)
        return cls(folder, config.tree, settings.tree, scenario, resume=True, trust=trust)

    @property
    def task(self) -> str:
        return self.config["task"]

    @property
    def algorithm(self) -> str:
        return self.config["algorithm"]

    @property
    def _drawn(self) -> bool:
        """The task draws a tract for every episode."""
        return self.config["scenario"] is None and TASKS[self.task].pool is not None

    @property
    def env_settings(self) -> dict[str, Any]:
        """Keyword arguments of the env: the hyperparameters' own, and the scenario the run was begun in."""
        given = self.config["scenario"] is not None
        return settings_with(self.settings.get("env", {}), self.task, self.scenario, given)

    @property
    def held_out(self) -> dict[str, Any]:
        """Keyword arguments of the final evaluation's env: a generated task's tracts are then of the test split."""
        return self.env_settings | ({"split": "test"} if self._drawn else {})

    @property
    def same_episodes(self) -> dict[str, Any]:
        """Keyword arguments of an env with the final evaluation's episodes and the task's own observation and action:
        what a controller needs."""
        return world(self.held_out)

    @property
    def validation(self) -> dict[str, Any]:
        """Keyword arguments of the env that chooses the best model: a generated task's tracts are then a pool of their
        own, neither training's nor the test split's, since a policy may learn its own tracts by heart."""
        pool = TASKS[self.task].pool
        if pool is None or not self._drawn:
            return self.env_settings
        settings = {k: v for k, v in self.env_settings.items() if k not in ("split", "pool_size")}
        return settings | {"scenario": list(scenario_pool(pool, "train", VALIDATION_EPISODES, VALIDATION_POOL))}

    @property
    def frames(self) -> int:
        """Observations that the policy sees together."""
        return self.settings.get("frame_stack", 1)

    @property
    def meta(self) -> dict[str, Any]:
        """What a saved policy says of the run it is of."""
        return {
            "task": self.task,
            "algorithm": self.algorithm,
            "seed": self.config["seed"],
            "env": self.settings.get("env", {}),
            "scenario": self.scenario,
            "scenario_given": self.config["scenario"] is not None,
        }

    def say_what_changed(self) -> None:
        """Say which packages are not those that the run was begun with: then it goes on, but not bit for bit."""
        path = self.folder / "versions.json"
        before = read_json(path).tree if path.exists() else {}
        changed = [f"{k} {before.get(k)} → {v}" for k, v in _versions().items() if before.get(k) != v]
        if changed:
            note(f"{self.folder} was begun with other versions ({', '.join(changed)}): its numbers may differ")

    def write(self, name: str, content: Any) -> None:
        """A JSON file of the folder."""
        write_whole(self.folder / name, json.dumps(content, indent=2))


def _check_lesson(lesson: Stored) -> None:
    """Raise `ValueError` for settings that `imitation.imitate` does not take."""
    if unknown := sorted(set(lesson.tree) - set(LESSON)):
        raise ValueError(f"{lesson.where} must set only {', '.join(LESSON)}; got {unknown[0]!r}")
    lesson.get("teacher", str), lesson.whole("steps", 1)
    for name in {"rounds", "epochs"} & set(lesson.tree):
        lesson.whole(name, 1)


def _kept_scenario(folder: Path, sha256: str | None) -> str | None:
    if sha256 is None:
        return None
    path = folder / "scenario.toml"
    text = path.read_bytes().decode("utf-8", errors="replace")
    if digest(text) != sha256:
        raise ValueError(f"{path} is not the scenario that the run was begun in; config.json has its SHA-256")
    return text


def _given(scenario: str | None, given: bool) -> dict[str, Any]:
    return {"scenario": Scenario.loads(scenario)} if scenario is not None and given else {}


def _changed(settings: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    settings = dict(settings)
    for name, value in changes.items():
        block, _, inner = name.partition(".")
        settings[block] = {**settings.get(block, {}), inner: value} if inner else value
    return settings


def _free_folder(config: Config) -> Path:
    base = Path("runs") / f"{config.task.split('/')[-1]}-{config.algorithm}-seed{config.seed}"
    folder, number = base, 2
    while folder.exists():
        folder, number = base.with_name(f"{base.name}-{number}"), number + 1
    return folder


def _versions() -> dict[str, str]:
    return {"python": platform.python_version(), "machine": platform.machine()} | {p: version(p) for p in _PACKAGES}
