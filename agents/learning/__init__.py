"""Training with Stable-Baselines3: the adapter, a run, policies as plain arrays, the search for hyperparameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .policy_file import load

if TYPE_CHECKING:
    from .sb3 import make_vec_env

__all__ = ["load", "make_vec_env"]


def __getattr__(name: str) -> Any:
    if name == "make_vec_env":  # imports torch, which a loaded policy does without
        from .sb3 import make_vec_env

        return make_vec_env
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
