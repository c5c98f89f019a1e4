"""Whether a policy fits an env: a sentence that names both where it does not."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..observations import shapes

__all__ = ["check_action", "check_fit", "shown"]


def check_fit(policy: Any, env: Any) -> None:
    """Raise `ValueError` for a policy that was made for other observations or actions than the env's.

    A policy says what it takes by `misfit(env)`, a sentence or "", or by SB3's `observation_space` and `action_space`;
    of one that says nothing, `check_action` looks at the first action.
    """
    if hasattr(policy, "misfit"):
        why = policy.misfit(env)
    else:
        why = _other_spaces(policy, env)
    if why:
        raise ValueError(why)


def _other_spaces(policy: Any, env: Any) -> str:
    observed, acted = _single(env)
    for what, theirs, ours in (
        ("sees observations", getattr(policy, "observation_space", None), observed),
        ("gives actions", getattr(policy, "action_space", None), acted),
    ):
        if theirs is not None and ours is not None and _shape(theirs) != _shape(ours):
            return (
                f"the policy {_name(policy)} {what} of shape {_shape(theirs)}, but those of "
                f"{shown(env)} have shape {_shape(ours)}"
            )
    return ""


def _shape(space: Any) -> Any:
    """Of a space, or of each part of a dict of spaces."""
    parts = getattr(space, "spaces", None)
    return (
        {name: part.shape for name, part in parts.items()}
        if isinstance(parts, dict)
        else getattr(space, "shape", space)
    )


def check_action(policy: Any, env: Any, observation: Any, action: Any) -> None:
    """Raise `ValueError` for an action of another shape than the env's."""
    space = getattr(env, "action_space", None)
    if space is not None and np.shape(action) != space.shape:
        raise ValueError(
            f"the policy {_name(policy)} must answer observations of shape {shapes(observation)} of "
            f"{shown(env)} with actions of shape {space.shape}, got {np.shape(action)}"
        )


def _name(policy: Any) -> str:
    return getattr(policy, "name", type(policy).__name__)


def _single(env: Any) -> tuple[Any, Any]:
    """The spaces of one env, or of one lane of a batch."""
    return tuple(getattr(env, f"single_{name}", getattr(env, name, None)) for name in _SPACES)  # type: ignore[return-value]


_SPACES = ("observation_space", "action_space")


def shown(env: Any) -> str:
    """An env for people: its task, and the channels that it shows."""
    core = getattr(getattr(env, "unwrapped", env), "core", None)
    if core is None:
        return str(env)
    return f"{core.task.id}, which shows {core.shown.text},"
