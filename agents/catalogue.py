"""All policies by name: the classical controllers, the par, those that users register, and trained models.

A controller of your own needs no edit of this package. Give its class to `register_controller`:

>>> import numpy as np
>>> from agents.catalogue import CONTROLLERS, register_controller
>>> from agents.controllers import Controller
>>> from agents.evaluation import evaluate
>>> @register_controller
... class AtHome(Controller):
...     \"\"\"Holds every magnet at home.\"\"\"
...
...     def act(self, observation, state, starts, deterministic):
...         return self.core.actuation.action(self.core.sim.library.home[self.core.sim.lane_scenario]), state
>>> evaluate(CONTROLLERS["AtHome"].from_env, "MagWire/Steer-v0", episodes=2).success.tolist()
[True, True]
>>> del CONTROLLERS["AtHome"]

Commands take such a class as ``module:Class`` or ``file.py:Class``, and other policies too: see `agents.policies`.

    magwire evaluate my_controllers.py:AtHome --task MagWire/Chase-v0
    magwire benchmark --controllers my_controllers.py:AtHome --only AtHome
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from magwire_env.envs.task import TASKS, known_task
from magwire_env.render.extra import need
from magwire_env.simulation.model import supports

from .controllers import (
    MPPI,
    PD,
    ConstantRotation,
    ExtremumSeeking,
    FollowRoute,
    Forward,
    Hold,
    InverseShape,
    MaxForce,
    NetForce,
    Random,
    RecoverRoute,
    SlopeAscent,
)
from .env_kwargs import parsed, world
from .par.held import BestConstant, BestConstantEach, HoldHome
from .par.optimal import Optimal
from .policies import own_policy
from .shipped import PREFIX

__all__ = [
    "CONTROLLERS",
    "FLOORS",
    "IN_TREES",
    "NOT_OF_TRACTS",
    "OF_SHAPES",
    "OF_TREES",
    "PAR",
    "REFERENCE",
    "Entrant",
    "compared_with",
    "controller",
    "has_par",
    "register_controller",
    "resolve",
]


class Untrained:
    """ppo before its first step of training, see `agents.learning.untrained`. Needs the extra ``train``."""

    floor = True

    @classmethod
    def from_env(cls, env: Any) -> Any:
        """The policy for `env`."""
        need("stable_baselines3", "an untrained policy", "train")
        from .learning.untrained import untrained

        return untrained(env)


CONTROLLERS: dict[str, Any] = {
    c.__name__: c
    for c in (
        MaxForce, NetForce, SlopeAscent, ExtremumSeeking, PD, MPPI, Optimal, FollowRoute, RecoverRoute, Forward, Hold,
        InverseShape, HoldHome, BestConstant, BestConstantEach, ConstantRotation, Random,
    )
} | {"untrained": Untrained}  # fmt: skip
"""Name → class. `register_controller` adds to it."""

PAR = Optimal.__name__
"""The controller that scores are measured by."""

REFERENCE = MaxForce.__name__
"""The controller that others are compared with: the paper's own policy."""

OF_SHAPES = ("InverseShape",)
"""Controllers of shaping tasks alone."""

OF_TREES = ("FollowRoute", "RecoverRoute", "Forward", "Hold")
"""Controllers of navigating tasks alone."""

NOT_OF_TRACTS = (*OF_TREES, *OF_SHAPES)
"""Controllers that no task along a tract has."""

FLOORS = tuple(
    name
    for name, kind in CONTROLLERS.items()
    if (getattr(kind, "sees_nothing", False) or getattr(kind, "floor", False)) and name not in NOT_OF_TRACTS
)
"""Controllers of tasks along a tract that see nothing, and the untrained policy."""

IN_TREES = (*OF_TREES, "Random")
"""Controllers that policies of navigating tasks are compared with: the reference first, the floors last."""

_DEFAULT_TASK = "MagWire/Steer-v1"

C = TypeVar("C", bound=type)


def register_controller(kind: C, name: str | None = None) -> C:
    """Give a controller a name, by default that of its class; returns the class, so it also serves as a decorator.

    kind : a subclass of `Controller`, or any class whose ``from_env(env)`` returns something with SB3's ``predict``

    Raises `ValueError` for a name that is taken or has a ":" or "/" in it, or a class without ``from_env``.
    """
    name = kind.__name__ if name is None else name
    if not callable(getattr(kind, "from_env", None)):
        raise ValueError(f"kind must be a class with from_env(env), such as a Controller, got {kind!r}")
    if name in CONTROLLERS:
        raise ValueError(f"name must not be taken, got {name!r}, which is {CONTROLLERS[name]!r}")
    if not name or set(name) & set(":/\\"):
        raise ValueError(f"name must be a word without ':' and '/', got {name!r}")
    CONTROLLERS[name] = kind
    return kind


def controller(name: str) -> Any:
    """What has ``from_env(env)`` under a controller's name or as ``module:thing``; None for anything else.

    Raises `ValueError` for a module that cannot be imported, or one without such a thing: see `agents.policies`.
    """
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    return own_policy(name) if ":" in name and not Path(name).exists() else None


def compared_with(task: str, par: bool = True, floors: bool = False) -> tuple[str, ...]:
    """Names of the controllers that a policy of this task is compared with: the reference, the floors, the par.

    Of navigating tasks the floors always come. Only tasks of locked wires have a par, see `has_par`.
    """
    if TASKS[task].kind.navigates:
        return IN_TREES
    par = par and has_par(task)
    first = OF_SHAPES[0] if TASKS[task].kind.shapes else REFERENCE
    return (first, *(FLOORS if floors else ()), *((PAR,) if par else ()))


def has_par(task: str) -> bool:
    """Whether there is a par for a task: it is planned with the theory of the locked wire."""
    made = TASKS[task].scenario
    return not TASKS[task].kind.navigates and (made is None or supports(made(), "quasistatic"))


@dataclass(frozen=True, eq=False)
class Entrant:
    """A policy that is ready to be evaluated.

    policy : with SB3's ``predict``, or a callable that makes such a policy from an env
    name : for tables
    task : environment id
    settings : keyword arguments of its env
    """

    policy: Any
    name: str
    task: str
    settings: dict[str, Any]

    @property
    def same_episodes(self) -> dict[str, Any]:
        """Keyword arguments of an env with the same episodes and the task's own observation and action."""
        return world(self.settings)


def resolve(
    policy: str,
    task: str | None = None,
    scenario: str | None = None,
    split: str | None = None,
    trust: bool = False,
    env_kwargs: Sequence[str] = (),
) -> Entrant:
    """The policy of a name: a controller's, ``module:thing``, a run's or policy's folder, ``trained/…``, or an SB3
    zip file.

    task : by default the policy's own task, or MagWire/Steer-v1; ``module:id`` imports the module first
    scenario : a TOML file or a shipped name, in place of the task's
    split : of a generated task's tracts, unless there is a scenario
    trust : also open files that can carry a program, see `agents.learning.load`
    env_kwargs : ``key=value`` for the env, see `agents.env_kwargs`

    Raises `ValueError` for a name that is none of these.
    """
    task = None if task is None else known_task(task)
    asked = parsed(env_kwargs)
    if scenario is not None and asked.setdefault("scenario", scenario) != scenario:
        raise ValueError(f"scenario must be given once, got {scenario!r} and env-kwargs scenario={asked['scenario']!r}")
    settings: dict[str, Any] = {}
    made: Any
    if (kind := controller(policy)) is not None:
        made, name = kind.from_env, policy.rpartition(":")[2]
        settings = dict(getattr(kind, "env_kwargs", {}))
    elif Path(policy).is_dir() or policy.startswith(PREFIX):
        need("safetensors", "a trained policy", "policy")
        from .learning import load

        made, name = load(policy, trust), Path(policy).resolve().name
        task, settings = task or made.task, made.env_settings
    elif Path(policy).suffix == ".zip" and Path(policy).is_file():
        need("stable_baselines3", "a model of Stable-Baselines3", "train")
        from .learning.sb3_zip import load_zip

        made, name = load_zip(Path(policy), trust), Path(policy).stem
    else:
        raise ValueError(
            "policy must be a run's or policy's folder, trained/…, an SB3 .zip, module:thing or one of "
            f"{', '.join(CONTROLLERS)}; got {policy!r}"
        )
    task, settings = task or _DEFAULT_TASK, settings | asked
    if split is not None and TASKS[task].pool is not None and "scenario" not in settings and "split" not in asked:
        settings["split"] = split
    return Entrant(made, name, task, settings)
