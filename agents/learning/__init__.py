"""Training with Stable-Baselines3: the configuration, the adapter, a run, the search for hyperparameters."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .sb3 import load, make_vec_env

__all__ = ["load", "make_vec_env"]


def __getattr__(name: str) -> Any:
    """Import torch only when a model is asked for: commands that train nothing need no torch."""
    if name in __all__:
        return getattr(import_module(f"{__name__}.sb3"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
