"""Observations of one env and of a batch, as arrays or, with an image, as dicts of arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["numbers", "rows", "shapes"]

_OF_ONE = {"image": 3, "state": 1}
"""By a part's name, how many dimensions it has in one env's observation."""


def rows(observation: Any) -> tuple[Any, bool]:
    """The observation with one row a lane, and whether it came so: (size,) → (1, size); each part of a dict alike."""
    if not isinstance(observation, Mapping):
        return np.atleast_2d(observation), np.ndim(observation) == 2
    many = all(np.ndim(part) > _OF_ONE.get(name, 1) for name, part in observation.items())
    return (dict(observation) if many else {k: np.asarray(v)[None] for k, v in observation.items()}), many


def numbers(batch: Any) -> np.ndarray:
    """The numbers in a batch of observations, (n, size); none beside an image that stands alone."""
    if not isinstance(batch, Mapping):
        return batch
    return batch["state"] if "state" in batch else np.zeros((len(batch["image"]), 0), dtype=np.float32)


def shapes(observation: Any) -> Any:
    """For people: the shape of an observation, or of each part of it."""
    if isinstance(observation, Mapping):
        return ", ".join(f"{name} {np.shape(part)}" for name, part in observation.items())
    return np.shape(observation)
