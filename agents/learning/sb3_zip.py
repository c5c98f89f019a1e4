"""Models that Stable-Baselines3 saved by itself, ``model.save("mine.zip")``, as policies.

Such a file can carry a program, which opening it would run: nothing here opens one without trust.
"""

from __future__ import annotations

import importlib
import json
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..notes import note

__all__ = ["SavedModel", "load_zip"]

_ALGORITHMS = {
    "stable_baselines3.common.policies": ("stable_baselines3", ("PPO", "A2C")),
    "stable_baselines3.sac.policies": ("stable_baselines3", ("SAC",)),
    "stable_baselines3.td3.policies": ("stable_baselines3", ("TD3",)),
    "sb3_contrib.tqc.policies": ("sb3_contrib", ("TQC",)),
    "sb3_contrib.crossq.policies": ("sb3_contrib", ("CrossQ",)),
    "sb3_contrib.common.recurrent.policies": ("sb3_contrib", ("RecurrentPPO",)),
}
"""Module of a saved policy's class → the package and the algorithms that have such policies."""

_NORMALISATIONS = ("vecnormalize.pkl", "vec_normalize.pkl", "normalization.pkl")
"""Names under which `VecNormalize.save` is called for a model beside it."""


class SavedModel:
    """A model as SB3 saved it, under the normalisation that stands beside it, with SB3's `predict`."""

    def __init__(self, model: Any, normalisation: Any = None) -> None:
        self.model, self.normalisation = model, normalisation
        self.observation_space, self.action_space = model.observation_space, model.action_space

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """As SB3's, on the env's raw observations."""
        seen = observation if self.normalisation is None else self.normalisation.normalize_obs(observation)
        return self.model.predict(seen, state=state, episode_start=episode_start, deterministic=deterministic)


def load_zip(path: Path, trust: bool = False) -> SavedModel:
    """The model of an SB3 zip file, with ``vecnormalize.pkl`` from beside it if there is one.

    Raises `ValueError` without `trust`, and for a file that is no such model.
    """
    if not trust:
        raise ValueError(
            f"{path} is a file of Stable-Baselines3's own. It can carry a program, which opening it would run, and was "
            "not opened; --trust opens it, if it is yours"
        )
    try:
        with zipfile.ZipFile(path) as file:
            data = json.loads(file.read("data"))
        module = data["policy_class"]["__module__"]
    except (zipfile.BadZipFile, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} must be a model that Stable-Baselines3 saved: {error}") from error
    if module not in _ALGORITHMS:
        raise ValueError(f"{path} has a policy of {module}, which is none of {', '.join(_ALGORITHMS)}")
    package, names = _ALGORITHMS[module]
    name = names[0] if len(names) == 1 or "n_epochs" in data else names[1]
    try:
        model = getattr(importlib.import_module(package), name).load(path, device="cpu")
    except Exception as error:
        raise ValueError(f"{path} is damaged, or of another version of {package}: {error}") from error
    beside = next((path.with_name(n) for n in _NORMALISATIONS if path.with_name(n).is_file()), None)
    if beside is None:
        note(f"no {_NORMALISATIONS[0]} beside {path}: the model is given the env's observations as they are")
        return SavedModel(model)
    try:
        with beside.open("rb") as stored:
            return SavedModel(model, _still(pickle.load(stored)))
    except Exception as error:
        raise ValueError(f"{beside} must be what VecNormalize.save wrote: {error}") from error


def _still(normalisation: Any) -> Any:
    """A `VecNormalize` that learns nothing more."""
    normalisation.training = False
    normalisation.normalize_obs  # noqa: B018  (fails here for anything else)
    return normalisation
