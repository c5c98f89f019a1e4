"""Training with Stable-Baselines3: the adapter, a run, the search for hyperparameters."""

from .sb3 import load, make_vec_env

__all__ = ["load", "make_vec_env"]
