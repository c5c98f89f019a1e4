"""Policies from outside the package, as docs/guide/policies.md explains them.

Everything that plays asks a policy as Stable-Baselines3 does: `predict(observation, state, episode_start,
deterministic)` → `(action, state)`. Here whatever a user has becomes such a policy: a function, a network, an object, a
class.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .controllers import Controller
from .env_kwargs import OWN
from .observations import numbers, rows, shapes

__all__ = ["Function", "own_policy"]


class Function:
    """A policy made of a function of the observations alone.

    act : (n, size) float32 → (n, k), in [−1, 1]; a `torch.nn.Module` is given a tensor, and no gradients are kept.
        Where the env shows an image, it is given a dict: "image", and "state" if there are numbers too

    >>> from agents.evaluation import evaluate
    >>> half = Function(lambda observation: 0.5 * observation[:, 4:5])
    >>> evaluate(half, "MagWire/Steer-v0", episodes=2).steps.shape
    (2,)
    """

    def __init__(self, act: Callable[[Any], Any], name: str | None = None) -> None:
        if not callable(act):
            raise ValueError(f"act must be a function of observations, got {act!r}")
        self._act, self._network = act, _is_network(act)
        self.name = name or getattr(act, "__name__", type(act).__name__)
        self.env_kwargs = dict(getattr(act, "env_kwargs", {}))

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """SB3's form: observation (size,) or (n, size) → action (k,) or (n, k), and the state as it was given."""
        batch, many = rows(observation)
        if not isinstance(batch, dict):
            batch = np.asarray(batch, dtype=np.float32)
        try:
            action = self._of_network(batch) if self._network else self._act(batch)
        except Exception as error:
            error.add_note(f"{self.name} was given observations of shape {shapes(batch)}, one row a lane")
            raise
        action = np.asarray(action, dtype=np.float32)
        return (action if many else action[0]), state

    def _of_network(self, batch: Any) -> np.ndarray:
        import torch

        if isinstance(batch, dict):
            seen: Any = {name: torch.from_numpy(part) for name, part in batch.items()}
        else:
            seen = torch.from_numpy(batch)
        with torch.no_grad():
            return self._act(seen).numpy()


def _is_network(thing: Any) -> bool:
    """It is a `torch.nn.Module`; torch is not imported to find out."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(thing, torch.nn.Module)


def own_policy(name: str) -> Any:
    """What ``module:thing`` or ``file.py:thing`` names, as something with ``from_env(env)`` that gives a policy.

    thing : a class with ``from_env(env)``; a class or object with ``predict``; or a class or object that is called with
        the observations, such as a function or a network. A class is made without arguments.

    A thing may have ``env_kwargs``, a dict of `agents.env_kwargs.OWN`: what its env must show and take.

    Raises `ValueError` for a module that cannot be imported, or a thing that is none of these.
    """
    place, _, attribute = name.rpartition(":")
    try:
        thing = getattr(_module(place), attribute)
    except (ImportError, AttributeError, OSError) as error:
        raise ValueError(f"policy must be an importable module:thing, got {name!r}: {error}") from error
    if unknown := sorted(set(getattr(thing, "env_kwargs", {})) - set(OWN)):
        raise ValueError(f"env_kwargs of the policy {name!r} must be of {', '.join(OWN)}, got {unknown[0]!r}")
    if isinstance(thing, type) and issubclass(thing, Controller):
        return thing
    if callable(getattr(thing, "from_env", None)):
        return _Own(attribute, thing.from_env, thing)
    if isinstance(thing, type):
        thing = _made(thing, name)
    if _is_network(thing):
        thing.eval()
    if not callable(getattr(thing, "predict", None)):
        if not callable(thing):
            raise ValueError(
                "policy must name a class with from_env(env), something with predict(observation, …), or a function of "
                f"observations, got {name!r}, which is {type(thing).__name__}"
            )
        thing = Function(thing, attribute)
    return _Own(attribute, lambda _: thing, thing)


def _made(kind: type, name: str) -> Any:
    if not (hasattr(kind, "predict") or "__call__" in dir(kind)):
        raise ValueError(
            f"policy must name a class with from_env(env), predict(observation, …) or __call__, got {name!r}"
        )
    try:
        needed = [
            p.name
            for p in inspect.signature(kind).parameters.values()
            if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)
        ]
    except ValueError:  # a class in C without a signature
        needed = []
    if needed:
        raise ValueError(
            f"policy must name a class that is made without arguments, or one with from_env(env); {name!r} needs "
            f"{', '.join(needed)}"
        )
    return kind()


class _Own:
    """A policy from outside, behind the same door as the controllers."""

    def __init__(self, name: str, make: Callable[[Any], Any], thing: Any) -> None:
        self.__name__, self._make = name, make
        self.env_kwargs = dict(getattr(thing, "env_kwargs", {}))
        self.plans_online, self.sees_nothing = (
            bool(getattr(thing, mark, False)) for mark in ("plans_online", "sees_nothing")
        )

    def from_env(self, env: Any) -> Any:
        return _Batched(self._make(env), self.__name__)


class _Batched:
    """A policy that is always asked about rows of observations, of a single env too."""

    def __init__(self, policy: Any, name: str) -> None:
        if not callable(getattr(policy, "predict", None)):
            raise ValueError(f"from_env of {name} must give something with predict(observation, …), got {policy!r:.80}")
        self._policy, self.name = policy, name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._policy, name)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """As `Function.predict`."""
        batch, many = rows(observation)
        starts = np.zeros(len(numbers(batch)), dtype=np.bool_)
        starts = starts if episode_start is None else np.atleast_1d(episode_start)
        action, state = self._policy.predict(batch, state=state, episode_start=starts, deterministic=deterministic)
        return (action if many else np.asarray(action)[0]), state


def _module(place: str) -> Any:
    """The module of an importable name, or of a Python file."""
    if not place.endswith(".py"):
        return importlib.import_module(place)
    path = Path(place).resolve()
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {place!r}")
    known = sys.modules.get(path.stem)
    if known is not None and getattr(known, "__file__", None) == str(path):
        return known
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None  # of every path that ends in .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    if known is None:
        sys.modules[path.stem] = module  # so that its classes can be pickled
    try:
        spec.loader.exec_module(module)
    except BaseException:
        if known is None:
            del sys.modules[path.stem]
        raise
    return module
