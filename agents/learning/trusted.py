"""Files that can carry a program: the runs of earlier versions, saved by Stable-Baselines3 and pickle.

Opening one runs whatever stands in it. Nothing here is called without ``trust=True`` or ``--trust``.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import gymnasium as gym
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from .export import about_model, plain
from .plain_policy import PlainPolicy
from .sb3 import algorithm_class, make_vec_env
from .scenario_copy import text_for

__all__ = ["ZIP", "opened", "parts"]

ZIP = "model.zip"


def opened(folder: Path) -> PlainPolicy:
    """The plain form of the model that an earlier version saved in `folder`, a model's or a run's.

    Raises `FileNotFoundError` for a missing file, `ValueError` for a damaged one, both naming it.
    """
    if (folder / "best" / ZIP).exists():
        folder = folder / "best"
    model, meta = parts(folder)
    env = {key: value for key, value in meta.get("env", {}).items() if key != "scenario"}
    asked = meta.get("env", {}).get("scenario")
    known = {
        "seed": 0,
        **meta,
        "env": env,
        "scenario": text_for(meta["task"], asked),
        "scenario_given": asked is not None,
    }
    return plain(model, about_model(model, known), int(meta.get("frame_stack", 1)))


def parts(folder: Path, venv: VecEnv | None = None) -> tuple[BaseAlgorithm, dict[str, Any]]:
    """The model, under its normalisation, and what ``model.json`` says of it; with `venv` ready to train on."""
    for name in (ZIP, "model.json", "normalization.pkl"):
        if not (folder / name).exists():
            raise FileNotFoundError(f"{folder} holds no {name}: no model of an earlier version")
    try:
        meta = json.loads((folder / "model.json").read_text(encoding="utf-8"))
        algorithm, task = algorithm_class(meta["algorithm"]), meta["task"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{folder / 'model.json'} is damaged or of another program: {error}") from error
    env = meta.get("env", {})
    smallest = {"pool_size": 1} if "pool_size" in env else {}  # only its spaces are asked for
    try:
        batch = venv or make_vec_env(task, 1, frame_stack=meta.get("frame_stack", 1), **(env | smallest))
    except (ValueError, TypeError, gym.error.Error) as error:
        raise ValueError(f"{folder / 'model.json'} asks for an env that cannot be made: {error}") from error
    try:
        normalization = VecNormalize.load(str(folder / "normalization.pkl"), batch)
    except Exception as error:
        raise ValueError(f"{folder / 'normalization.pkl'} is damaged or of another program: {error}") from error
    normalization.training = venv is not None
    if not zipfile.is_zipfile(folder / ZIP):
        raise ValueError(f"{folder / ZIP} is truncated or not a model file")
    try:
        model = algorithm.load(folder / ZIP, env=normalization, device="cpu")
    except Exception as error:
        raise ValueError(f"{folder / ZIP} is damaged or does not fit its task: {error}") from error
    return model, meta
