"""Plans kept on disk, one file an episode, named by a digest of everything that a plan depends on."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import warnings
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from magwire_env.kept import DAMAGE, kept_folder
from magwire_env.scenario import Scenario

from ..notes import note
from .starts import Starts

__all__ = ["VERSION", "Cache", "default_folder"]

VERSION = 2
"""Goes up when a change of the planner makes it find other plans."""


def default_folder() -> Path:
    """``$MAGWIRE_CACHE/par``, or ``~/.cache/magwire/par``."""
    return kept_folder("par")


class Cache:
    """Plans in a folder, which is made when the first plan is stored.

    folder : by default `default_folder`
    """

    def __init__(self, folder: str | Path | None = None) -> None:
        self.folder = default_folder() if folder is None else Path(folder)

    def keys(self, starts: Starts, settings: Any) -> list[str]:
        """A digest for every episode: of its scenario, task, start, goal or reference, planner settings and version."""
        task = starts.task
        common = [VERSION, task.kind.name, task.tolerance, task.hold, starts.step_limit, asdict(settings)]
        if not task.kind.holds:
            common[2:4] = [None, None]
        head = json.dumps(common, sort_keys=True).encode()
        return [self._key(head, starts, i) for i in range(len(starts))]

    def _key(self, head: bytes, starts: Starts, i: int) -> str:
        digest = hashlib.sha256(head)
        digest.update(_digest_of(starts.library.scenarios[starts.entries[i]]).encode())
        numbers = [starts.tip[i : i + 1], starts.magnet[i], starts.goal[i : i + 1], starts.reference[i]]
        if starts.task.kind.returns:
            numbers.append(starts.final[i : i + 1])
        digest.update(np.concatenate(numbers).astype(np.float64).tobytes())
        return digest.hexdigest()[:40]

    def path(self, key: str) -> Path:
        """The file of a plan."""
        return self.folder / key[:2] / f"{key}.npz"

    def load(self, key: str) -> tuple[np.ndarray, float] | None:
        """A plan (H, dof) of actions and its value; None if there is none, or, with a warning, for a damaged file."""
        path = self.path(key)
        try:
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                plan, value = np.array(file["plan"], dtype=np.float32), float(file["value"])
        except FileNotFoundError:
            return None
        except DAMAGE as failure:
            warnings.warn(f"{path} is damaged, so its plan is made again: {failure}", stacklevel=2)
            return None
        if plan.ndim != 2 or not plan.size or not np.isfinite(plan).all() or not np.isfinite(value):
            warnings.warn(f"{path} holds no plan, so it is made again: shape {plan.shape}", stacklevel=2)
            return None
        return plan, value

    def store(self, key: str, plan: np.ndarray, value: float) -> None:
        """Put a plan on disk, whole or not at all. A full disk, or one that may not be written, is said, and no more:
        the plan serves all the same."""
        try:
            self._store(self.path(key), plan, value)
        except OSError as error:
            note(f"plans cannot be kept in {self.folder} ({error}); set MAGWIRE_CACHE to a folder that can be written")

    def _store(self, path: Path, plan: np.ndarray, value: float) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez_compressed(file, plan=plan, value=np.float64(value))
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


@lru_cache(maxsize=4096)
def _digest_of(scenario: Scenario) -> str:
    """Digest of the scenario's values, without its name and its sensing; what is None, a default, does not count."""
    plain = scenario.replace(name="", sensing=type(scenario.sensing)())
    values = asdict(plain, dict_factory=lambda pairs: {key: value for key, value in pairs if value is not None})
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
